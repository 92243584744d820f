"""The two backends run the same robot: mjx inside one compiled call, native in C.

Both do the same arithmetic in another order, so they differ by rounding, and contacts
multiply that from step to step. Runs are short for this reason: 1.2 s after the request
they differ by 3e-8 m/s at most, and in a joint by 3e-6 rad (a hand at its stop).

The solver stops where C and MJX agree to 1e-11: friction that holds takes up to 23
iterations, and where it is cut off they are not at the same point (7e-3 in cost).

Teeth that strike multiply rounding: in the mix `motor`, policies times 1 + 1e-11 end
1e-7 apart in cost and 4e-3 rad in a joint, in all other mixes 1e-12 and 6e-11 rad.
There the backends are compared over the first 0.6 s, and to 2e-4 in cost.

Compiling for mjx takes 40 s. This file compiles two programs, and tests whatever it can
by other values in the first of them; test_loop_mjx compiles a world without causes.
"""

import threading

import jax
import mujoco
import numpy as np
import pytest
from mujoco import batch

from gatjax.effects.catalogue import CATALOGUE
from gatjax.effects.effect import Effect, memoryless
from gatjax.robot.model import slots
from gatjax.sim.backend import costs, pairs, prepare
from gatjax.sim.episode import joints_of
from gatjax.sim.lighter import lighter
from gatjax.sim.native import Native
from gatjax.sim.shares import joined
from gatjax.sim.world import add_cause, add_causes, add_command, nominal
from gatjax.task import Task
from gatjax.walk.parameters import THETA0

TASK = Task(settle=0.3, longest_delay=0.1, duration=1.2)
COUNT = 3
CAUSES = {
    "command_noise": 0.01, "command_delay": 0.018, "first_order_lag": 0.02,
    "speed_limit": 5.0, "backlash": 0.02, "torque_limit": 5.0, "gain_error": 0.8,
    "coulomb_friction": 0.1, "viscous_friction": 0.3, "dropped_commands": 0.2,
    "imu_misalignment": 0.03, "ground_friction": 0.7, "ground_compliance": 0.02,
    "sole_geometry": 0.001,
}  # fmt: skip
WHERE = {"imu": ["imu"], "ground": ["ground"], "foot": ["LFoot"]}
MIXES = {
    "none": [],
    "command": ["command_noise"],
    "motor": ["command_delay", "first_order_lag", "speed_limit", "backlash"],
    "body": ["torque_limit", "gain_error", "coulomb_friction", "viscous_friction"],
    "floor": ["imu_misalignment", "ground_compliance", "sole_geometry"],
    "slip": ["ground_friction"],
    "loss": ["dropped_commands"],
    "all": list(CAUSES),
}
TRACES = []


def counted():
    """An effect without effect that notes every time Python runs it."""

    def change(params, signal):
        TRACES.append(type(signal.target).__name__)
        return signal._replace(target=signal.target + params)

    return memoryless(change)


def build(strong, scale=1.0):
    """A world with every cause, of which those in `strong` do something."""
    world = add_command(nominal(TASK), "counted", counted(), 0.0)
    world.model.opt.tolerance = 1e-14  # friction that holds is a stiff constraint
    floor = int(np.flatnonzero(world.model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)[0])
    as_it_is = {
        "ground_friction": world.model.geom_friction[floor, 0],
        "ground_compliance": world.model.geom_solref[floor, 0],
    }
    for name, value in CAUSES.items():
        neutral = as_it_is.get(name, CATALOGUE[name].neutral)
        where = WHERE.get(CATALOGUE[name].place, ["all"])
        value = scale * value if name in strong else float(neutral)
        world = add_cause(world, name, where, value)
    return world


@pytest.fixture(scope="module")
def world():
    """The structure that is compiled; its own values are all neutral."""
    return build([])


@pytest.fixture(scope="module")
def native(world):
    return prepare(world)


@pytest.fixture(scope="module")
def mjx(world):
    return prepare(world, "mjx")


@pytest.fixture(scope="module")
def policies():
    """theta0, a slower and a shorter walk."""
    scale = np.ones((COUNT, 15))
    scale[1, 6], scale[2, 5] = 0.7, 0.97
    return THETA0 * scale


@pytest.fixture(scope="module")
def keys():
    return jax.random.split(jax.random.key(3), COUNT)


@pytest.mark.parametrize("mix", MIXES)
def test_both_backends_agree_on_cost_and_falls(mix, native, mjx, policies, keys):
    values = build(MIXES[mix]).values
    ours, first = native.rollout(values, policies, keys)
    theirs, second = mjx.rollout(values, policies, keys)
    assert first.ok.all() and np.asarray(second.ok).all()
    np.testing.assert_array_equal(np.isinf(second.fell_at), np.isinf(first.fell_at))
    strikes = mix == "motor"
    far = 2e-4 if strikes else 1e-5
    np.testing.assert_allclose(second.cost, first.cost, rtol=0, atol=far)
    assert (first.velocity > 0.05).all()  # they walk
    np.testing.assert_array_equal(np.asarray(theirs.alive), ours.alive)
    alive = ours.alive & (ours.time < (0.6 if strikes else np.inf))
    left, right = ours.reading.angle[alive], np.asarray(theirs.reading.angle)[alive]
    np.testing.assert_allclose(right, left, rtol=0, atol=3e-5)


def test_both_backends_see_the_same_falls(native, mjx, policies, keys):
    """Legs of 0.6 N m can't carry the robot."""
    world = add_cause(build([]), "torque_limit", ["all"], 0.6)
    values = world.values
    ours, first = native.rollout(values, policies, keys)
    theirs, second = mjx.rollout(values, policies, keys)
    assert np.isfinite(first.fell_at).all()
    np.testing.assert_allclose(second.fell_at, first.fell_at, rtol=0, atol=1e-9)
    assert (np.asarray(second.cost) > 14.0).all() and (first.cost > 14.0).all()
    assert not np.asarray(theirs.alive)[:, -1].any() and not ours.alive[:, -1].any()


def test_every_mix_walks_otherwise(native, policies, keys):
    """The values do reach the simulation: each mix has a walk of its own."""
    walks = {
        mix: native.outcome(build(names).values, policies, keys).velocity[0]
        for mix, names in MIXES.items()
    }
    ordered = sorted(walks.values())
    assert np.diff(ordered).min() > 1e-4, walks


def test_mjx_traces_once_for_all_values(mjx, world, policies, keys):
    mjx.rollout(world.values, policies, keys)
    before = len(TRACES)
    assert before > 0
    for mix, scale in (("none", 1.0), ("all", 0.5), ("all", 1.1), ("motor", 0.9)):
        mjx.rollout(build(MIXES[mix], scale).values, policies, keys)
    mjx.rollout(world.values, policies * 1.01, keys)
    mjx.rollout(world.values, policies, jax.random.split(jax.random.key(8), COUNT))
    assert len(TRACES) == before


def test_native_traces_once_for_all_values(native, world, policies, keys):
    native.outcome(world.values, policies, keys)
    before = len(TRACES)
    native.outcome(build(CAUSES, 0.5).values, policies * 1.01, keys)
    assert len(TRACES) == before


# Replay


def window(native, values, policies, keys):
    """A recorded run as a replay wants it: one tick of warm-up, then all of it."""
    walk, _ = native.rollout(values, policies, keys)
    begin = native.rollout.__self__.begin(values, policies, keys)[0]
    first = walk.command[:, :1]
    commands = np.concatenate([first, walk.command[:, :-1]], axis=1)
    warm = walk.reading.angle[:, :1]
    return walk, (commands, warm, np.asarray(begin.qpos), np.asarray(begin.qvel))


@pytest.fixture(scope="module")
def recorded(native, policies, keys):
    """Runs without chance on the command: replay leaves it out.

    And without a gear, whose motor does not rest in the tick of warm-up.
    """
    left_out = ("command_noise", "dropped_commands", "backlash")
    names = [name for name in CAUSES if name not in left_out]
    values = build(names).values
    return values, *window(native, values, policies, keys)


def test_replaying_a_recording_gives_the_recording(native, recorded):
    """The same physics and effects, open loop: nothing but the commands is used."""
    values, walk, arguments = recorded
    played = native.replay(values, *arguments)
    expected = walk.reading.angle[:, 1:]
    assert walk.alive[:, : expected.shape[1]].any()
    ticks = walk.alive.sum(1).min() - 1
    np.testing.assert_allclose(
        played[:, :ticks], expected[:, :ticks], rtol=0, atol=1e-9
    )


def amid(walk, qpos, qvel):
    """A window that begins amid the walk: its warm-up moves, 4 of 44 ticks."""
    ticks, warm = slice(25, 69), slice(25, 29)
    return walk.command[:, ticks], walk.reading.angle[:, warm], qpos, qvel


@pytest.fixture(scope="module")
def middle(recorded):
    values, walk, (_, _, qpos, qvel) = recorded
    return values, amid(walk, qpos, qvel)


def test_both_backends_replay_the_same(policies, keys):
    """Without the joints that do not walk: it compiles in a third of the time."""
    names = ("command_delay", "first_order_lag", "speed_limit", "encoder_offset")
    world = nominal(TASK)
    for name in names:
        world = add_cause(world, name, ["all"], CAUSES.get(name, 0.02))
    world = lighter(world)
    native, kept = prepare(world), joints_of(world.model)
    walk, (_, _, qpos, qvel) = window(native, world.values, policies, keys)
    commands, warm, *start = amid(walk, qpos, qvel)
    arguments = commands[..., kept], warm[..., kept], *start
    ours = native.replay(world.values, *arguments)
    mjx = prepare(world, "mjx")
    theirs = np.asarray(mjx.replay(world.values, *arguments))
    assert ours.shape == theirs.shape == (COUNT, 40, 13)
    assert np.ptp(ours, axis=1).max() > 0.1  # it moves
    np.testing.assert_allclose(theirs, ours, rtol=0, atol=3e-5)


@pytest.mark.parametrize("names, remembers", [
    ([], False), (["command_delay"], True), (["backlash"], True),
])  # fmt: skip
def test_the_warm_up_is_what_effects_remember(native, middle, names, remembers):
    """Other commands in the warm-up alone: only effects with a memory can tell."""
    values, (commands, *rest) = build(names).values, middle[1]
    other = commands.copy()
    other[:, :4] += 0.05
    gap = native.replay(values, other, *rest) - native.replay(values, commands, *rest)
    assert (np.abs(gap).max() > 1e-4) == remembers


def test_replay_obeys_the_effects(native, recorded):
    values, _, arguments = recorded
    plain = native.replay(build([]).values, *arguments)
    assert np.abs(plain - native.replay(values, *arguments)).max() > 0.01


def test_a_correction_sees_what_encoders_report(policies, keys):
    """In a replay as in the closed loop."""

    def apply(gain, first, signal):
        turned = signal.angle + first
        return first, signal._replace(target=signal.target + gain * turned)

    follow = Effect(lambda gain, signal: signal.angle, apply)
    world = add_command(nominal(TASK), "follow", follow, 0.1)
    world = add_cause(world, "encoder_offset", ["LKneePitch", "RHipPitch"], 0.1)
    native = prepare(world)
    walk, (commands, _, qpos, qvel) = window(native, world.values, policies, keys)
    angle = qpos[:, None, slots(world.model).position]
    played = native.replay(world.values, commands, angle, qpos, qvel)
    ticks = walk.alive.sum(1).min() - 1
    expected = walk.reading.angle[:, 1 : ticks + 1]
    np.testing.assert_allclose(played[:, :ticks], expected, rtol=0, atol=1e-9)


# The bare world, and batches of policies and keys


def test_without_effects_c_plays_whole_ticks_and_the_same(policies, keys):
    world = nominal(TASK)
    stepped = add_cause(world, "command_delay", ["all"], 0.0)
    first, second = (
        prepare(each).outcome(each.values, policies, keys) for each in (world, stepped)
    )
    np.testing.assert_allclose(second.cost, first.cost, rtol=0, atol=1e-5)
    np.testing.assert_array_equal(second.ok, first.ok)
    np.testing.assert_array_equal(np.isinf(second.fell_at), np.isinf(first.fell_at))


@pytest.mark.parametrize("causes", [[], [("load_friction", ["all"], 0.05)]])
def test_shares_of_robots_run_as_all_together(causes, policies, keys):
    world = add_causes(nominal(TASK), causes)
    found = [
        Native(world, shares=lambda _, k=parts: k).rollout(world.values, policies, keys)
        for parts in (1, 2)
    ]
    alive = found[0][0].alive
    for one, other in zip(*map(jax.tree.leaves, found), strict=True):
        walked = alive if one.ndim > 1 else slice(None)  # no row matters after a fall
        np.testing.assert_array_equal(other[walked], one[walked])


def test_a_share_that_fails_stops_the_others():
    told, begun = [], threading.Barrier(3, timeout=20.0)

    def run(rows, stopped):
        begun.wait()
        if 0 in rows:
            raise ValueError("the first share")
        told.append(stopped.wait(20.0))

    with pytest.raises(ValueError, match="the first share"):
        joined(run, 10, 3)
    assert told == [True, True]


def test_sensors_are_those_of_the_last_step(policies, keys):
    class Sensing:
        """A batch whose sensors are never left out."""

        def __init__(self, model, nsim):
            self._batch = batch.Batch(model, nsim=nsim)
            self._kept = np.zeros((nsim, 1), np.int32)

        def expand(self, name):
            if name == "opt.disableflags":
                return self._kept
            return self._batch.expand(name)

        def __getattr__(self, name):
            return getattr(self._batch, name)

    world = nominal(TASK)
    whole = Native(world, lambda model, nsim: Sensing(model, nsim))
    one, _ = whole.rollout(world.values, policies, keys)
    other, _ = Native(world).rollout(world.values, policies, keys)
    assert np.ptp(one.reading.force) > 1.0  # N
    for field in ("force", "gyro", "accelerometer"):
        np.testing.assert_array_equal(
            getattr(other.reading, field), getattr(one.reading, field)
        )


def test_costs_try_every_policy_with_every_key(native, world, policies, keys):
    table = costs(native)(world.values, policies[:2], keys)
    assert table.shape == (2, COUNT)
    for row in range(2):
        alone = np.tile(policies[row], (COUNT, 1))
        expected = native.outcome(world.values, alone, keys).cost
        np.testing.assert_array_equal(table[row], expected)
    result = pairs(native.outcome, world.values, policies[:2], keys)
    np.testing.assert_array_equal(result.cost, table)
