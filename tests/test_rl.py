"""The walk world as a Brax environment, PPO, and groundings that learn by it."""

import functools
import importlib.util

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.envs.base import Env, State

from gatjax.data.trajectories import JointRun
from gatjax.effects.effect import Effect, memoryless
from gatjax.grounding import garat, learn, reinforced, rgat
from gatjax.grounding.gat import (
    forward_inputs,
    joined,
    learn_forward,
    next_angle_of,
    pushed,
    remembered,
)
from gatjax.grounding.grounder import Experience
from gatjax.grounding.reinforced import correction_effect
from gatjax.grounding.transitions import transitions
from gatjax.loop.ground import practice
from gatjax.records import Signal
from gatjax.rl import ppo
from gatjax.rl.env import View, Walk
from gatjax.robot.nao import WALKING, WALKING_JOINTS
from gatjax.sim import called
from gatjax.sim.course import course
from gatjax.sim.lighter import lighter
from gatjax.sim.native import Native
from gatjax.sim.world import add_cause, add_command, nominal
from gatjax.task import Task
from gatjax.walk.parameters import THETA0

SHORT = Task(settle=0.1, longest_delay=0.04, duration=0.6)
JOINTS = len(WALKING_JOINTS)
VIEW = View(
    size=reinforced.inputs_of(JOINTS),
    begin=lambda signal: remembered(signal.angle, signal.target),
    look=lambda memory, signal, reading: forward_inputs(
        *joined(memory, signal.angle, signal.target)
    ),
    push=lambda memory, signal, sent: pushed(memory, signal.angle, signal.target, sent),
)


@pytest.fixture(scope="module")
def world():
    return lighter(nominal(SHORT))


def walked(world, engine, keys):
    """Positions [B, T, 3] of walks inside one compiled call."""
    track = course(world, engine)
    policy = jnp.asarray(THETA0, float)

    def run(key):
        def tick(place, _):
            place, signal, row = track.look(world.values, policy, place)
            return track.move(world.values, place, signal), row.base.position

        begin = track.begin(world.values, policy, key)
        return jax.lax.scan(tick, begin, None, length=world.task.ticks)[1]

    return np.asarray(jax.jit(jax.vmap(run))(keys))


def test_called_back_mujoco_walks_as_the_native_backend_does(world):
    keys = jax.random.split(jax.random.key(0), 6)
    found = walked(world, called.engine(world), keys)
    native, _ = Native(world).rollout(world.values, np.tile(THETA0, (6, 1)), keys)
    alive = np.asarray(native.alive).all(0)
    assert alive.sum() > 30
    off = np.abs(found - np.asarray(native.base.position))[:, alive]
    assert np.median(off) < 1e-5
    assert off.max() < 5e-3


def test_a_world_with_effects_in_its_motors_is_refused_there(world):
    softer = add_cause(world, "torque_limit", ["all"], 0.5)
    lagging = add_cause(softer, "backlash", ["LKneePitch"], 0.02)
    with pytest.raises(ValueError, match="learn in it with mjx"):
        called.engine(lagging)


def test_rewards_of_a_plain_walk_add_up_to_its_cost(world):
    env, keys = Walk(world, THETA0, VIEW, 0.05), jax.random.split(jax.random.key(1), 4)

    def episode(key):
        def step(state, _):
            state = env.step(state, jnp.zeros(JOINTS))
            return state, (state.reward, state.done)

        state = env.reset(key)
        return jax.lax.scan(step, state, None, length=world.task.ticks - 1)[1]

    words = jax.random.key_data(keys)
    reward, done = jax.jit(jax.vmap(episode))(words)
    found = Native(world).outcome(world.values, np.tile(THETA0, (4, 1)), keys)
    assert not np.asarray(done).any()
    assert np.abs(found.velocity).min() > 0.01
    np.testing.assert_allclose(-reward.sum(1), found.cost, atol=2e-3)


def test_an_action_is_added_to_its_joint_and_to_no_other(world):
    env = Walk(world, THETA0, VIEW, 0.05)
    state = env.reset(jax.random.key_data(jax.random.key(2)))
    knee = WALKING_JOINTS.index("LKneePitch")
    action = jnp.zeros(JOINTS).at[knee].set(1.0)
    step = jax.jit(env.step)
    bent, plain = step(state, action), step(state, jnp.zeros(JOINTS))
    moved = bent.obs[:JOINTS] - plain.obs[:JOINTS]  # the joint angles now
    assert moved[knee] > 0.01
    assert np.abs(moved).argmax() == knee
    sent = bent.pipeline_state.memory.sent[0] - plain.pipeline_state.memory.sent[0]
    np.testing.assert_allclose(sent, 0.05 * action, atol=1e-6)


def test_a_world_that_hears_no_command_hears_no_action(world):
    deaf = memoryless(lambda params, signal: signal._replace(target=0.0 * params))
    world = add_command(world, "deaf", deaf, jnp.zeros(JOINTS))
    env = Walk(world, THETA0, VIEW, 0.05)
    state = env.reset(jax.random.key_data(jax.random.key(2)))
    bent, plain = (
        env.step(state, share * jnp.ones(JOINTS)).obs[:JOINTS] for share in (1.0, 0.0)
    )
    np.testing.assert_array_equal(bent, plain)


def test_a_robot_that_falls_ends_its_episode_and_pays(world):
    env = Walk(world, THETA0, VIEW, 2.0)
    state, step = env.reset(jax.random.key_data(jax.random.key(3))), jax.jit(env.step)
    action = jnp.zeros(JOINTS).at[WALKING_JOINTS.index("LAnklePitch")].set(1.0)
    rewards = []
    for _ in range(world.task.ticks - 1):
        state = step(state, action)
        rewards.append(float(state.reward))
        if state.done:
            break
    assert state.done
    assert rewards[-1] < -14.0
    assert min(rewards[:-1]) > -1.0


class Target(Env):
    """The action should be a function of what is seen."""

    def reset(self, rng):
        seen = jax.random.normal(jax.random.wrap_key_data(rng), (3,))
        zero = jnp.zeros(())
        return State(seen, seen, zero, zero, {})

    def step(self, state, action):
        reward = 1.0 - jnp.sum((action - 0.5 * jnp.tanh(state.obs[:2])) ** 2)
        seen = jnp.sin(7.0 * state.obs + 1.0)
        return state.replace(pipeline_state=seen, obs=seen, reward=reward)

    observation_size, action_size, backend = 3, 2, "mjx"


def test_ppo_learns_from_rewards_that_it_is_given_or_that_the_world_gives():
    plan = ppo.Plan(rounds=25, robots=32, ticks=40, unroll=10, rate=2e-3, discount=0.1)
    scale = ppo.Scale(np.zeros(3), np.ones(3))
    first, *_, last = ppo.trained(Target(), scale, plan, 0)
    assert first.reward < 0.75
    assert last.reward > 0.93
    assert first.fell == last.fell == 0.0

    def opposite(walks):
        return 1.0 - ((walks.action + 0.3) ** 2).sum(-1)

    *_, last = ppo.trained(Target(), scale, plan, 0, opposite)
    seen = jax.random.normal(jax.random.key(4), (100, 3))
    actions = np.asarray(jax.vmap(ppo.act, (None, 0))(last.policy, seen))
    assert np.abs(actions + 0.3).mean() < 0.1


def test_a_correction_is_what_its_network_says():
    draw = np.random.default_rng(0)
    params = reinforced.template(JOINTS)._replace(alpha=np.float32(0.5))
    bias = draw.normal(size=JOINTS)
    params = params._replace(biases=(*params.biases[:-1], bias))
    effect = correction_effect(np.arange(JOINTS))
    signal = Signal(*jnp.asarray(draw.normal(size=(4, JOINTS)), float))
    state = effect.init(params, signal)
    _, changed = effect.apply(params, state, signal)
    expected = signal.target + 0.5 * reinforced.CORRECTION * bias
    np.testing.assert_allclose(changed.target, expected, rtol=1e-5)


def test_the_discriminator_pays_for_what_looks_like_the_robot():
    draw = np.random.default_rng(1)
    robot, other = draw.normal(size=(900, 5)), draw.normal(size=(900, 5))
    robot[:, 4] = robot[:, 0] + 0.1 * robot[:, 4]
    other[:, 4] = -other[:, 0] + 0.1 * other[:, 4]
    judge = garat.Discriminator(robot, 0)
    for _ in range(40):
        judge.rewards(other)
    assert judge.accuracy > 0.8  # of samples that it sees blurred
    seen = judge._logits(judge._layers, judge._standard(robot))
    assert garat.SURE + np.mean(seen) > 1.0 + judge.rewards(other).mean() > 1.0


@pytest.mark.parametrize("rate, ticks", [(50.0, 200), (83.3, 330), (100.0, 400)])
def test_episodes_take_as_long_at_any_control_rate(rate, ticks):
    run = JointRun(0, np.arange(20) / rate, None, None)
    experience = Experience([], [run], None, None, None, None, 0, print)
    assert reinforced.plan_of(experience, 3).ticks == ticks


def test_methods_that_need_brax_say_so(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"rgat .* needs brax; .*pip install .*rl"):
        learn.check_needs("rgat")
    learn.check_needs("gat")


def test_on_mjx_the_environment_is_the_same(world):
    native, other = (
        jax.jit(Walk(world, THETA0, VIEW, 0.05, engine).reset)(
            jax.random.key_data(jax.random.key(5))
        )
        for engine in ("native", "mjx")
    )
    np.testing.assert_allclose(native.obs, other.obs, atol=1e-5)


@pytest.fixture(scope="module")
def experience():
    """Logs of a robot that does nine tenths of what it is told, and of a simulator."""
    plain = nominal(SHORT)
    lazy = Effect(
        init=lambda params, signal: (),
        apply=lambda params, state, signal: (
            state, signal._replace(target=0.9 * signal.target + 0.1 * signal.angle),
        ),
    )  # fmt: skip
    keys, policies = jax.random.split(jax.random.key(7), 6), np.tile(THETA0, (6, 1))
    logs = []
    for one in (add_command(plain, "lazy", lazy, ()), plain):
        walk, _ = Native(one).rollout(one.values, policies, keys)
        rows = zip(walk.time, walk.command, walk.reading.angle, strict=True)
        logs.append([
            JointRun(number, time, command[:, WALKING], angle[:, WALKING])
            for number, (time, command, angle) in enumerate(rows)
        ])  # fmt: skip
    return Experience(
        robot=logs[0], simulator=logs[1], gyros=None, step_error=None, play=None,
        practice=functools.partial(practice, plain, THETA0), seed=0, tell=print,
    )  # fmt: skip


def test_a_grounding_by_reinforcement_is_learned_kept_and_used(
    experience, monkeypatch, tmp_path
):
    small = functools.partial(ppo.Plan, robots=8, minibatches=4)
    monkeypatch.setattr(ppo, "Plan", small)
    monkeypatch.setattr(reinforced, "EPISODE", 0.6)
    monkeypatch.setattr(garat, "ROUNDS", 3)
    grounding = learn.learn("garat", experience)
    assert all(0.0 <= share <= 1.0 for share in grounding.facts["unmasked"])
    learn.write_grounding(tmp_path, grounding)
    again = learn.read_grounding(tmp_path)
    world = nominal(SHORT)
    keys, policies = jax.random.split(jax.random.key(8), 2), np.tile(THETA0, (2, 1))
    speeds = []
    for one in (grounding, again, learn.with_alpha(grounding, 0.0)):
        better = learn.grounded(world, one)
        outcome = Native(better).outcome(better.values, policies, keys)
        speeds.append(outcome.velocity)
    plain = Native(world).outcome(world.values, policies, keys).velocity
    np.testing.assert_allclose(speeds[0], speeds[1], atol=1e-4)
    np.testing.assert_allclose(speeds[2], plain, atol=1e-4)
    assert np.abs(speeds[0] - plain).max() > 1e-4


def test_rgat_pays_for_the_angle_that_f_expects(experience, monkeypatch):
    forward, fit = learn_forward(experience.robot, 0)
    monkeypatch.setattr(rgat, "learn_forward", lambda runs, seed: (forward, fit))
    tried = [reinforced.template(JOINTS)._replace(alpha=np.float32(n)) for n in (1, 2)]

    def practised(experience, rewards, rounds):
        data = transitions(experience.simulator)
        inputs = forward_inputs(data.angle, data.action)
        expected = next_angle_of(forward, data)
        paid = [
            float(np.mean(rewards(inputs, later)))
            for later in (expected, data.following)
        ]
        assert paid[0] > 0.999 > paid[1] > 0.1
        return list(zip(tried, paid, strict=True))

    monkeypatch.setattr(rgat, "reinforced", practised)
    params, facts = rgat.learn(experience)
    assert params is tried[0]  # the round that was paid most
    assert facts["reward"][1] > 0.999
