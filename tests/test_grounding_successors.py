"""Successors of GAT: what each learns beyond it, on data whose answer is known."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gatjax.data.trajectories import JointRun, to_recording
from gatjax.effects.effect import Effect
from gatjax.grounding import dagger, sensing
from gatjax.grounding.envelope import ENVELOPE, Envelope
from gatjax.grounding.gat import (
    GAT,
    Gat,
    forward_inputs,
    inverse_inputs,
    learn_inverse,
    next_angle,
)
from gatjax.grounding.grounder import Experience
from gatjax.grounding.guided import GUIDED
from gatjax.grounding.learn import Grounding, grounded
from gatjax.grounding.network import predict, raw_many
from gatjax.grounding.sgat import SGAT, learn_spread, sgat_effect
from gatjax.grounding.transitions import HISTORY, transitions
from gatjax.loop import Simulator, learn_grounding
from gatjax.loop.ground import played
from gatjax.records import JOINTS, Reading, Sensed, Signal
from gatjax.robot.nao import WALKING, WALKING_JOINTS
from gatjax.sim.backend import prepare
from gatjax.sim.lighter import lighter
from gatjax.sim.world import add_sensor, nominal
from gatjax.task import Task, pose
from gatjax.walk.parameters import THETA0

PULL = 0.4  # share of the way to its target that a joint makes in a tick
NOISE = np.array([0.002, 0.012])  # rad
ROWS = 300


def driven(seed, pull=PULL, noise=0.0, shift=0.0, number=0):
    """A run of two joints that answer with a share of the way, and noise."""
    rng = np.random.default_rng(seed)
    command = 0.3 * np.cumsum(rng.normal(size=(ROWS, 2)), axis=0) / 3.0
    command = shift + 0.5 * np.sin(command)
    angle = np.zeros_like(command)
    for t in range(1, ROWS):
        way = command[t - 1] - angle[t - 1]
        angle[t] = angle[t - 1] + pull * way + noise * rng.normal(size=2)
    return JointRun(number, 0.02 * np.arange(ROWS), command, angle)


def many(count, first=0, **how):
    return [driven(first + n, number=n, **how) for n in range(count)]


def experience(robot, simulator, gyros=None, play=None):
    return Experience(
        robot, simulator, gyros, step_error=lambda: np.zeros(2), play=play,
        practice=None, seed=0, tell=print,
    )  # fmt: skip


@pytest.fixture(scope="module")
def noisy():
    params, facts = SGAT.learn(experience(many(10, noise=NOISE), many(10, 50)))
    return params, facts


def test_stochastic_gat_knows_how_unsure_each_joint_is(noisy):
    params, facts = noisy
    data = transitions(many(4, 90, noise=NOISE))
    inputs = forward_inputs(data.angle, data.action)
    told = np.exp(raw_many(params.spread, inputs))
    np.testing.assert_allclose(np.median(told, axis=0), NOISE, rtol=0.2)
    rms = np.sqrt(np.mean(NOISE**2))
    assert facts["spread"]["deviation_rad"] == pytest.approx(rms, rel=0.25)


def test_a_deterministic_robot_has_no_spread():
    runs = many(8)
    params, _ = GUIDED.learn(experience(runs, []))
    _, facts = learn_spread(params.forward, experience(runs, []))
    assert facts["deviation_rad"] < 0.2 * NOISE.min()


def test_stochastic_gat_samples_and_without_a_draw_is_gat(noisy):
    params, _ = noisy
    rest = jnp.full(2, 0.1, jnp.float32)
    sent = {}
    for drawn in (0.0, -1.0, 1.0):
        signal = Signal(rest + 0.1, rest, 0.0 * rest, jnp.full(2, drawn))
        for name, effect, own in (
            ("gat", GAT.effect(np.arange(2)),
             Gat(params.alpha, params.forward, params.inverse)),
            ("sgat", sgat_effect(np.arange(2)), params),
        ):  # fmt: skip
            state = effect.init(own, signal)
            sent[name, drawn] = np.asarray(effect.apply(own, state, signal)[1].target)
    assert np.abs(sent["sgat", 0.0] - sent["gat", 0.0]).max() < 1e-6
    np.testing.assert_array_equal(sent["gat", 1.0], sent["gat", -1.0])
    spread = 0.5 * (sent["sgat", 1.0] - sent["sgat", -1.0]) * PULL
    assert (spread > NOISE.min()).all()


def test_what_decides_whether_a_command_is_lost_draws_no_noise_there():
    rest, drawn = jnp.zeros(2), jnp.array([-9.0, 0.5])
    signal = Signal(rest, rest, rest, drawn)
    effect, params = ENVELOPE.effect(np.arange(2)), Envelope(1.0, jnp.ones(len(JOINTS)))
    state = effect.init(params, signal)
    sent = effect.apply(params, state, signal)[1].target
    np.testing.assert_array_equal(sent, [0.5, -9.0])


def test_dagger_learns_where_the_grounded_simulator_goes():
    """The plain simulator stays near 0, the grounded one goes to 1.5 rad."""
    asked = []

    def play(method, params, number):
        asked.append((method, number))
        return many(3, 200 + 10 * number, pull=0.3, shift=1.5)

    near = many(4, 50)
    params, facts = dagger.learn(experience(many(4), near, play=play))
    assert asked == [("gat", 0), ("gat", 1), ("gat", 2)]
    assert len(facts["rounds"]) == dagger.ROUNDS + 1
    data = transitions(many(2, 300, pull=0.3, shift=1.5))
    inputs = inverse_inputs(data.angle, data.action[:, 1:], data.following)
    change = data.action[:, 0] - data.angle[:, 0]
    errors = []
    for inverse in (learn_inverse(near, 1)[0], params.inverse):
        found = jax.vmap(predict, in_axes=(None, 0))(inverse, inputs)
        errors.append(np.sqrt(np.mean((np.asarray(found) - change) ** 2)))
    assert errors[1] < 0.5 * errors[0]


def rocking(runs, gain):
    """What a gyro reads that turns with the joints."""
    return [gain * np.diff(r.angle, axis=0, prepend=0.0) @ np.ones((2, 3)) / 0.02
            for r in runs]  # fmt: skip


def test_sensing_adds_what_the_robots_gyro_reads_more():
    robot, simulator = many(10), many(10, 50)
    gyros = rocking(robot, 0.2), rocking(simulator, 0.1)
    params, facts = sensing.learn(experience(robot, simulator, lambda: gyros))
    assert facts["gyro_robot"]["validation_rmse"] < 0.1
    effect = sensing.gyro_effect(np.arange(2))
    run = driven(7)
    truth = rocking([run], 0.1)[0]
    for alpha, times in ((0.0, 1.0), (1.0, 2.0)):
        own = params._replace(alpha=np.float32(alpha))
        state, told = None, []
        for angle, gyro in zip(run.angle[:60], truth, strict=False):
            reading = Reading(angle, gyro, np.zeros(3), np.zeros(8))
            signal = jax.tree.map(jnp.asarray, Sensed(reading, reading))
            state = effect.init(own, signal) if state is None else state
            state, signal = effect.apply(own, state, signal)
            told.append(np.asarray(signal.reading.gyro))
        error = np.asarray(told)[HISTORY:] - times * truth[HISTORY:60]
        assert np.sqrt(np.mean(error**2)) < 0.1 * np.std(truth)


SHORT = Task(duration=1.0)


@pytest.fixture(scope="module")
def walked():
    world, keys = nominal(SHORT), jax.random.split(jax.random.key(3), 4)
    policies = np.tile(THETA0, (4, 1))
    walk, _ = prepare(world, "native").rollout(world.values, policies, keys)
    return world, walk, keys


def test_a_log_without_a_gyro_is_refused_by_the_method_that_needs_it(walked):
    world, walk, _ = walked
    log = to_recording(walk, "robot", 50.0, {})
    columns = {k: v for k, v in log.columns.items() if not k.startswith("gyro.")}
    with pytest.raises(ValueError, match=r"no column gyro\.x, gyro\.y, gyro\.z; log"):
        learn_grounding(world, "sensing", log._replace(columns=columns), log, 0)


def leaning(lean):
    """Guided params that expect the joints to go on as they go, and lean rad more."""
    params = jax.tree.map(np.float32, GUIDED.template(len(WALKING)))
    mean = np.concatenate([np.full(13, np.sin(lean)), np.full(13, np.cos(lean))])
    forward = params.forward._replace(
        output_mean=mean.astype(np.float32), input_scale=params.forward.input_scale + 1
    )
    return params._replace(alpha=np.float32(0.5), forward=forward)


def test_runs_of_a_grounded_simulator_say_what_it_was_told(walked):
    """Sent is half of what is asked and half of what the model expects."""
    world, _, keys = walked
    params = leaning(0.001)
    runs = played(world, Grounding("guided", params, {}), THETA0, keys)
    better = grounded(world, Grounding("guided", params, {}))
    policies = np.tile(THETA0, (4, 1))
    walk, _ = prepare(better, "native").rollout(better.values, policies, keys)
    assert len(runs) == 4
    for number, run in enumerate(runs):
        asked = walk.command[number][walk.alive[number]][:, WALKING]
        angles = np.stack([run.angle[k : len(run.angle) - 2 + k] for k in range(3)])
        expects = 2.0 * angles[1] - angles[0] + 0.001
        told = 0.5 * (asked[1:-1] + expects)
        np.testing.assert_allclose(run.command[1:-1], told, atol=1e-5)
    still = next_angle(params.forward, jnp.zeros((5, 13)), jnp.zeros((5, 13)))
    np.testing.assert_allclose(still, 0.001, atol=1e-6)


def test_a_learned_sensor_sees_the_joints_that_are_held():
    seen = []

    def apply(params, state, signal):
        seen.append(signal.reading.angle.shape)
        return state, signal._replace(
            reading=signal.reading._replace(gyro=signal.reading.gyro + params)
        )

    effect = Effect(lambda params, signal: (), apply)
    light = lighter(add_sensor(nominal(SHORT), "grounding", effect, np.float32(0.3)))
    assert light.learned_sensors == ("grounding",)
    _, _, sensor = light.chains()
    angle = np.zeros(len(WALKING_JOINTS), np.float32)
    reading = Reading(angle, np.zeros(3, np.float32), np.zeros(3), np.zeros(8))
    silent = jax.tree.map(np.zeros_like, reading)
    signal = Sensed(reading, silent)
    values = light.values.sensor
    _, changed = sensor.apply(values, sensor.init(values, signal), signal)
    assert set(seen) == {(len(JOINTS),)}
    np.testing.assert_allclose(changed.reading.gyro, 0.3, atol=1e-6)
    assert changed.reading.angle.shape == angle.shape


def test_a_world_with_a_learned_sensor_plays_motions():
    """A correction by 0.3 rad/s shows in the gyro and not in which way is up."""
    params = sensing.template(len(WALKING))
    shift = params.robot._replace(
        input_scale=params.robot.input_scale + 1.0,
        output_mean=np.full(3, 0.3, np.float32),
    )
    other = params.simulator._replace(input_scale=params.simulator.input_scale + 1.0)
    params = jax.tree.map(
        np.float32,
        params._replace(alpha=np.float32(1.0), robot=shift, simulator=other),
    )
    network = params.action.forward
    network = network._replace(
        input_scale=network.input_scale + 1.0, output_mean=network.output_mean + 0.7
    )
    action = params.action._replace(forward=network, inverse=network)
    plain = Simulator(nominal(SHORT))
    none = Grounding("sensing", params._replace(action=action), {})
    better = grounded(plain.world, none)
    effect = Effect(lambda p, s: (), lambda p, state, signal: (state, signal))
    better = dataclasses.replace(  # the gyro alone is changed
        better, command={"grounding": effect}
    )
    stand = np.tile(np.asarray(pose(THETA0)), (3, 30, 1))
    one, other = (robot.play(stand, 50.0, [0, 1, 2])
                  for robot in (plain, Simulator(better)))  # fmt: skip
    np.testing.assert_allclose(other.reading.gyro - one.reading.gyro, 0.3, atol=1e-5)
    np.testing.assert_allclose(other.reading.angle, one.reading.angle, atol=1e-7)
