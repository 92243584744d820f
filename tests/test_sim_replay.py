"""Replays of logs: batches, both backends, measured angles, and joints at rest."""

import json

import jax
import mujoco
import numpy as np
import pytest

from gatjax.effects.catalogue import CATALOGUE
from gatjax.effects.effect import Effect
from gatjax.robot.model import slots
from gatjax.sim import replay
from gatjax.sim.backend import prepare
from gatjax.sim.replay import replay_many
from gatjax.sim.stored import read_world, write_world
from gatjax.sim.world import (
    add_cause,
    add_command,
    fields_applied,
    nominal,
    stacked,
    stiffened,
)
from gatjax.task import Task

MODEL = """
<mujoco><option timestep="0.002" integrator="implicitfast" iterations="40"
  ls_iterations="40"/>
<worldbody><body name="arm"><joint name="a" axis="0 1 0" armature="0.01" damping="0.4"
  frictionloss="0.05"/>
  <inertial pos="0 0 -0.15" mass="0.5" diaginertia="2e-3 2e-3 2e-3"/>
  <body name="hand" pos="0 0 -0.2"><joint name="b" axis="0 1 0" armature="0.005"
    damping="0.2" frictionloss="0.03"/>
    <inertial pos="0.02 0 -0.05" mass="0.2" diaginertia="4e-4 5e-4 6e-4"/></body></body>
</worldbody><actuator>
  <position joint="a" kp="20" kv="0.2" forcerange="-20 20" ctrlrange="-1 1"/>
  <position joint="b" kp="12" kv="0.1" forcerange="-15 15" ctrlrange="-1 1"/></actuator>
</mujoco>"""
TASK = Task(control_period=0.01)
TIME = 0.01 * np.arange(80)[:, None]
COMMAND = np.hstack([0.6 * np.sin(9.0 * TIME), 0.4 * (TIME > 0.2) - 0.7 * (TIME > 0.5)])
VALUES = {  # of every cause that acts on an arm without sensors and ground
    "command_delay": {"delay": 0.013}, "measurement_delay": {"delay": 0.017},
    "dropped_commands": {"probability": 0.2},
    "first_order_lag": {"time_constant": 0.02},
    "gain_error": {"scale": 0.7}, "damping_error": {"scale": 2.0},
    "torque_limit": {"limit": 1.2}, "torque_saturation": {"torque": 2.0},
    "speed_limit": {"limit": 3.0},
    "viscous_friction": {"coefficient": 0.2}, "coulomb_friction": {"torque": 0.15},
    "stiction": {"excess": 0.5, "velocity": 0.5}, "load_friction": {"coefficient": 0.3},
    "current_limit": {"limit": 0.5},
    "backlash": {"width": 0.05}, "dead_band": {"half_width": 0.02},
    "command_quantization": {"step": 0.07}, "joint_elasticity": {"stiffness": 30.0},
    "torque_ripple": {"amplitude": 0.3}, "asymmetric_friction": {"torque": -0.3},
    "encoder_offset": {"offset": 0.03}, "encoder_scale": {"scale": 0.9},
    "payload": {"mass": 0.3, "x": 0.02, "y": 0.03, "z": -0.1},
    "com_shift": {"x": 0.02, "z": -0.01}, "armature": {"inertia": 0.02},
    "gravity_tilt": {"roll": 0.1, "pitch": -0.2},
    "thermal_derating": {"lost_fraction": 0.5, "cooling": 5.0, "heat": 1.0},
    "supply_sag": {"max_drop": 0.5, "total": 4.0}, "clock_drift": {"drift": -0.02},
    "command_noise": {"deviation": 0.02},
}  # fmt: skip
VARIANTS = [
    ("speed_limit", {"limit": 3.0, "on_motor": 1}),
    ("encoder_offset", {"offset": 0.03, "in_loop": 1}),
    ("encoder_scale", {"scale": 0.9, "in_loop": 1}),
    ("backlash", {"width": 0.05, "encoder_on_motor": 1}),
    ("joint_elasticity", {"stiffness": 30.0, "encoder_on_motor": 1}),
]
CASES = [*VALUES.items(), *VARIANTS]
NOISE = np.random.default_rng(3).normal(size=(1, *COMMAND.shape))


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "arm.xml"
    path.write_text(MODEL)
    return nominal(TASK, path)


def neutral(name, values):
    """The same structure with a main value that changes nothing."""
    entry = CATALOGUE[name]
    rest = {key: each for key, each in values.items() if key not in entry.direction}
    return rest | {entry.main.name: entry.neutral}


def play(world, *values, commands=COMMAND, noise=NOISE):
    each = stacked(values or [world.values])
    noise = np.repeat(noise, len(values) or 1, axis=0)
    state = np.zeros(world.model.nq), np.zeros(world.model.nv)
    return replay_many(world, each, commands, *state, noise)


def where(name):
    place = CATALOGUE[name].place
    return ["a"] if place == "joint" else [place]


@pytest.mark.parametrize(("name", "values"), CASES)
def test_a_neutral_cause_changes_nothing_and_a_batch_equals_one_by_one(
    name, values, arm
):
    strong = add_cause(arm, name, where(name), values)
    none = add_cause(arm, name, where(name), neutral(name, values))
    plain = play(arm)
    both = play(strong, none.values, strong.values, none.values)
    one, other = play(strong), play(none)
    for field in ("velocity", "torque"):
        np.testing.assert_allclose(
            getattr(both, field)[:2],
            [getattr(none_or_strong, field)[0] for none_or_strong in (other, one)],
            rtol=0, atol=1e-9,
        )  # fmt: skip
    angle = both.reading.angle
    np.testing.assert_allclose(angle[0], plain.reading.angle[0], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(angle[2], angle[0])
    np.testing.assert_allclose(angle[1], one.reading.angle[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(angle[0], other.reading.angle[0], rtol=0, atol=1e-12)
    assert np.abs(angle[1] - angle[0]).max() > 3e-3


@pytest.mark.parametrize(("name", "values"), [
    ("command_delay", {"delay": 0.1}), ("first_order_lag", {"time_constant": 0.1}),
    ("speed_limit", {"limit": 0.5}), ("backlash", {"width": 0.05}),
])  # fmt: skip
def test_a_run_that_begins_beyond_the_range_of_its_commands(name, values, arm):
    """MuJoCo clamps commands at once, and so does an effect that remembers them."""
    world = add_cause(arm, name, ["a"], values)
    far = np.where(TIME < 0.3, 3.0, 0.2) * np.ones(2)
    for one, other in ((far, np.minimum(far, 1.0)), (-far, np.maximum(-far, -1.0))):
        beyond, within = (play(world, commands=each).reading.angle
                          for each in (one, other))  # fmt: skip
        np.testing.assert_allclose(beyond, within, rtol=0, atol=1e-12)


@pytest.mark.parametrize("more", ["backlash", "load_friction"])
def test_a_long_replay_is_compiled_and_the_same(more, arm, monkeypatch):
    world = add_cause(arm, "command_delay", ["a"], {"delay": 0.013})
    world = stiffened(
        add_cause(world, "thermal_derating", ["b"], {"lost_fraction": 0.5})
    )
    pair = [add_cause(world, more, ["a"], {CATALOGUE[more].main.name: value})
            for value in (0.05, 0.1)]  # fmt: skip
    each, start = stacked([one.values for one in pair]), np.zeros(2)
    stiffness = np.stack([np.where(TIME > 0.4, 0.5, 1.0) + 0.0 * COMMAND] * 2)
    played = []
    for longest in (10_000, 0):
        monkeypatch.setattr(replay, "LONG", longest)
        with jax.enable_x64(False):  # as users have it
            played.append(
                replay_many(pair[0], each, COMMAND, start, start, None, stiffness)
            )
    for name in ("velocity", "torque"):
        one, other = (getattr(each, name) for each in played)
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-9)
        assert np.abs(one[0] - one[1]).max() > 0.01
    one, other = (each.reading.angle for each in played)
    np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-12)


def test_row_0_is_the_start_and_rows_are_measured_before_their_command(arm):
    played = play(arm)
    assert played.reading.angle.shape == (1, len(COMMAND), 2)
    np.testing.assert_array_equal(played.reading.angle[0, 0], 0.0)
    late = COMMAND.copy()
    late[40:] += 0.2
    other = play(arm, commands=late).reading.angle[0]
    np.testing.assert_array_equal(other[:41], played.reading.angle[0, :41])
    assert np.abs(other[41] - played.reading.angle[0, 41]).max() > 1e-4


def test_effects_that_foresee_play_as_step_by_step(arm):
    """A neutral dead band looks at the joints, so MuJoCo is called every step."""
    world = add_cause(arm, "command_delay", ["a"], 0.013)
    world = add_cause(world, "dropped_commands", ["b"], 0.3)
    assert world.foresees
    slow = add_cause(world, "dead_band", ["all"], 0.0)
    assert not slow.foresees
    fast, slow = play(world), play(slow)
    np.testing.assert_allclose(
        fast.reading.angle, slow.reading.angle, rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(fast.torque, slow.torque, rtol=0, atol=1e-12)


# Standing still

HOLDS = {
    "coulomb_friction": {"torque": 1.0}, "stiction": {"excess": 1.0, "velocity": 0.1},
    "load_friction": {"coefficient": 0.9}, "asymmetric_friction": {"torque": 2.0},
}  # fmt: skip


@pytest.mark.parametrize("timestep", [0.002, 0.005])
@pytest.mark.parametrize("name", HOLDS)
def test_dry_friction_holds_a_joint_without_creep_or_chatter(name, timestep, arm):
    world = nominal(TASK, arm.source, timestep)
    still = add_cause(world, name, ["all"], HOLDS[name])
    commands = np.full((300, 2), 0.5) * (0.01 * np.arange(300)[:, None] < 0.15)
    played = play(still, commands=commands, noise=np.zeros((1, 300, 2)))
    rest = played.reading.angle[0, 150:]
    assert np.abs(rest).max() > 0.01  # not where the servo wants it
    # 1.5 s; an encoder resolves 1.5e-3 rad. MuJoCo's own friction creeps by 1e-2.
    assert np.ptp(rest, axis=0).max() < 2e-4
    assert np.abs(played.velocity[0, 150:]).max() < 1e-3


# Both backends

MIX = [
    "command_delay", "measurement_delay", "gain_error", "damping_error", "torque_limit",
    "coulomb_friction", "stiction", "load_friction", "backlash", "dead_band",
    "command_quantization", "joint_elasticity", "torque_ripple", "asymmetric_friction",
    "payload", "com_shift", "armature", "gravity_tilt", "thermal_derating",
    "supply_sag", "clock_drift", "torque_saturation", "current_limit",
]  # fmt: skip


def follow():
    """A correction of commands by what the encoders report."""

    def apply(gain, first, signal):
        turned = signal.angle + first
        return first, signal._replace(target=signal.target + gain * turned)

    return Effect(lambda gain, signal: signal.angle, apply)


def mixed(arm, strong):
    world = add_command(arm, "follow", follow(), 0.3 * ("follow" in strong))
    for name in MIX:
        full = VALUES[name]
        values = full if name in strong else neutral(name, full)
        world = add_cause(world, name, where(name), values)
    for name, values in VARIANTS[:3]:
        full = values if name in strong else neutral(name, values)
        world = add_cause(world, name, where(name), full)
    return world


@pytest.fixture(scope="module")
def backends(arm):
    world = mixed(arm, [])
    return prepare(world), prepare(world, "mjx")


@pytest.mark.parametrize("strong", [
    [], ["backlash"], ["joint_elasticity"], ["stiction"], ["load_friction"],
    ["payload", "com_shift", "armature", "gravity_tilt"],
    ["thermal_derating", "supply_sag", "speed_limit", "torque_limit"],
    ["torque_saturation"], ["current_limit"],
    ["encoder_offset", "encoder_scale", "measurement_delay", "clock_drift"],
    ["follow", "encoder_offset", "encoder_scale", "measurement_delay"],
    MIX,
], ids=lambda names: "-".join(names[:2]))  # fmt: skip
def test_both_backends_measure_the_same(strong, backends, arm):
    """As long as no servo is at the limit of its actuator, so that steps are the same.

    C leaves the damping of a servo at its limit out of the implicit step, MJX does not.
    """
    values = mixed(arm, strong).values
    native, mjx = backends
    commands = np.concatenate([COMMAND[:1], COMMAND])[None]
    state = np.zeros((1, 1, 2)), np.zeros((1, 2)), np.zeros((1, 2))
    ours = native.replay(values, commands, *state)
    theirs = np.asarray(mjx.replay(values, commands, *state))
    assert ours.shape == theirs.shape == (1, len(COMMAND), 2)
    np.testing.assert_allclose(theirs, ours, rtol=0, atol=2e-5)
    plain = native.replay(mixed(arm, []).values, commands, *state)
    assert not strong or np.abs(ours - plain).max() > 3e-3


def test_replay_of_windows_is_replay_of_rows(backends, arm):
    world = mixed(arm, ["load_friction", "encoder_scale", "supply_sag"])
    commands = np.concatenate([COMMAND[:1], COMMAND])[None]
    state = np.zeros((1, 1, 2)), np.zeros((1, 2)), np.zeros((1, 2))
    windows = backends[0].replay(world.values, commands, *state)
    rows = play(world, noise=0.0 * NOISE).reading.angle
    np.testing.assert_allclose(windows[:, :-1], rows[:, 1:], rtol=0, atol=1e-9)


@pytest.mark.parametrize("drift", [0.03, -0.03])
def test_a_window_drifts_from_the_state_it_starts_in(drift, arm):
    """However long its effects are warmed up: what was measured has drifted already."""
    good, bad = (
        add_cause(arm, "clock_drift", ["all"], {"drift": each}) for each in (0.0, drift)
    )
    warm = 20
    calm = 0.5 * np.hstack([1.0 - np.cos(5.0 * TIME), np.cos(4.0 * TIME) - 1.0])
    commands = np.concatenate([np.zeros((warm, 2)), calm])[None]
    state = np.zeros((1, warm, 2)), np.zeros((1, 2)), np.zeros((1, 2))
    plain = prepare(good).replay(good.values, commands, *state)[0]
    rows = np.arange(len(plain) + 1)
    told = [np.interp(rows * (1.0 - drift), rows, np.append(0.0, joint))[1:]
            for joint in plain.T]  # fmt: skip
    for name in ("native", "mjx"):
        played = prepare(bad, name).replay(bad.values, commands, *state)
        seen = np.asarray(played)[0]
        known = rows[1:] * (1.0 - drift) <= rows[-1]
        assert np.abs(seen - plain).max() > 0.01
        np.testing.assert_allclose(seen[known], np.stack(told, 1)[known], atol=1e-3)


def test_a_correction_sees_what_encoders_report(arm):
    """So a wrong zero shifts what servos are told, by what it saw first, too."""
    plain = add_command(arm, "follow", follow(), 0.2)
    askew = add_cause(plain, "encoder_offset", ["a"], 0.1)
    expected = play(plain, commands=COMMAND + np.array([0.04, 0.0]))
    expected = expected.reading.angle + np.array([0.1, 0.0])
    rows = play(askew).reading.angle
    np.testing.assert_allclose(rows, expected, rtol=0, atol=1e-6)
    commands = np.concatenate([COMMAND[:1], COMMAND])[None]
    state = np.zeros((1, 1, 2)), np.zeros((1, 2)), np.zeros((1, 2))
    windows = prepare(askew).replay(askew.values, commands, *state)
    np.testing.assert_allclose(windows[:, :-1], expected[:, 1:], rtol=0, atol=1e-6)


# Servos without a torque limit


@pytest.fixture(scope="module")
def free(tmp_path_factory):
    """The arm with a limit at `a` only."""
    path = tmp_path_factory.mktemp("model") / "free.xml"
    path.write_text(MODEL.replace(' forcerange="-15 15"', ""))
    return nominal(TASK, path)


def test_a_servo_without_a_limit_can_be_limited(free, arm):
    """At either joint, in one compilation; the other one pulls as before."""
    both = play(free), play(arm)  # 15 N m are never reached
    np.testing.assert_array_equal(*(played.torque for played in both))
    native, mjx = (prepare(add_cause(free, "torque_limit", ["a"], np.inf), name)
                   for name in ("native", "mjx"))  # fmt: skip
    commands = np.concatenate([COMMAND[:1], COMMAND])[None]
    state = np.zeros((1, 1, 2)), np.zeros((1, 2)), np.zeros((1, 2))
    plain = native.replay(free.values, commands, *state)
    for number, joint in enumerate("ab"):
        world = add_cause(free, "torque_limit", [joint], 1.2)
        most = np.abs(play(world).torque[0]).max(0)
        assert most[number] == pytest.approx(1.2) and most[1 - number] > 1.3
        ours = native.replay(world.values, commands, *state)
        theirs = np.asarray(mjx.replay(world.values, commands, *state))
        effect = np.abs(ours - plain)[..., number].max()
        assert effect > 0.03
        assert np.abs(theirs - ours).max() < 0.05 * effect


def test_a_motor_without_a_limit_has_a_top_speed(free):
    """An endlessly strong one: its line falls as steeply as the step allows."""
    world = add_cause(free, "speed_limit", ["b"], {"limit": 2.0, "on_motor": 1})
    plain, slow = (np.abs(play(each).velocity[0]) for each in (free, world))
    assert plain[:, 1].max() > 3.0
    assert slow[:, 1].max() == pytest.approx(2.0, rel=0.1)
    np.testing.assert_allclose(slow[:20, 0], plain[:20, 0], rtol=0, atol=1e-6)


# The world file and calibrations


def test_variants_and_calibrations_survive_the_world_file(arm, tmp_path):
    world = arm
    for name, values in VARIANTS:
        world = add_cause(world, name, ["b"], values)
    world = add_cause(world, "viscous_friction", ["all"], -0.05, role="calibration")
    world = add_cause(world, "armature", ["a"], {"inertia": -0.001}, "calibration")
    write_world(tmp_path / "world.json", world, {}, None)
    text = json.loads((tmp_path / "world.json").read_text())
    assert [row.get("role") for row in text["effects"]] == [None] * 5 + [
        "calibration"
    ] * 2
    again, _ = read_world(tmp_path / "world.json", TASK)
    assert again.causes == world.causes
    one, other = play(world), play(again)
    np.testing.assert_array_equal(one.reading.angle, other.reading.angle)
    np.testing.assert_array_equal(one.torque, other.torque)
    calibrated = add_cause(arm, "viscous_friction", ["all"], -0.05, "calibration")
    np.testing.assert_allclose(fields_applied(calibrated).dof_damping, [0.35, 0.15])


@pytest.mark.parametrize(("name", "value", "message"), [
    ("viscous_friction", -0.3, "dof_damping of the model would be negative"),
    ("armature", -0.02, "dof_armature of the model would be negative"),
    ("coulomb_friction", -0.06, "dof_frictionloss of the model would be negative"),
    ("payload", -0.3, "body_mass of the model would be negative"),
    ("gain_error", -1.0, "a position gain would not be positive"),
    ("command_delay", -0.01, "out of range; use 0.0 to 0.21"),
])  # fmt: skip
def test_a_calibration_that_is_not_physical_is_refused(name, value, message, arm):
    with pytest.raises(ValueError, match=message):
        add_cause(arm, name, ["all"], value, role="calibration")


def test_a_direction_may_be_given_by_size_or_by_components(arm):
    whole = add_cause(arm, "com_shift", ["a"], {"distance": 0.05, "x": 3.0, "z": 4.0})
    parts = add_cause(arm, "com_shift", ["a"], {"x": 0.03, "z": 0.04})
    for world in (whole, parts):
        moved = world.values.body["body_ipos"] - arm.model.body_ipos
        np.testing.assert_allclose(moved[1], [0.03, 0.0, 0.04], atol=1e-15)
        np.testing.assert_allclose(moved[2], 0.0)


# A robot on the floor


@pytest.fixture(scope="module")
def floor():
    return nominal(Task())


def stand(world):
    """0.6 s of standing still with bent knees."""
    model = world.model
    pose = np.array(model.key_qpos[0] if model.nkey else model.qpos0)
    target = pose[slots(model).position]
    return replay_many(
        world,
        stacked([world.values]),
        np.tile(target, (30, 1)),
        pose,
        np.zeros(model.nv),
    )


def test_a_floating_robot_gives_imu_forces_and_pose(floor):
    played = stand(floor)
    assert played.reading.gyro.shape == (1, 30, 3)
    assert played.reading.force.shape == (1, 30, 8)
    weight = floor.model.body_mass.sum() * 9.81
    assert played.reading.force[0, -5:].sum(-1).mean() == pytest.approx(weight, rel=0.1)
    assert played.base.position[0, -1, 2] > 0.2
    assert played.reading.accelerometer[0, -1, 2] == pytest.approx(9.81, abs=0.8)


def test_an_imu_that_is_askew_turns_what_it_measures(floor):
    world = add_cause(floor, "imu_misalignment", ["imu"], {"roll": 0.1, "yaw": 0.3})
    plain, askew = stand(floor).reading, stand(world).reading
    roll = np.array([[1, 0, 0], [0, np.cos(0.1), -np.sin(0.1)],
                     [0, np.sin(0.1), np.cos(0.1)]])  # fmt: skip
    yaw = np.array([[np.cos(0.3), -np.sin(0.3), 0], [np.sin(0.3), np.cos(0.3), 0],
                    [0, 0, 1]])  # fmt: skip
    axes = yaw @ roll  # columns: the sensor's axes in the torso's
    np.testing.assert_allclose(
        askew.accelerometer, plain.accelerometer @ axes, rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(askew.gyro, plain.gyro @ axes, rtol=0, atol=1e-9)


def test_up_is_where_the_resting_accelerometer_points(floor):
    """On a tilted ground, with an IMU that is askew."""
    world = add_cause(floor, "gravity_tilt", ["all"], {"roll": 0.05, "pitch": 0.08})
    world = add_cause(world, "imu_misalignment", ["imu"], {"pitch": 0.2, "yaw": -0.1})
    played = stand(world)
    felt = played.reading.accelerometer[0, -5:].mean(0)
    up = played.up[0, -1]
    np.testing.assert_allclose(np.linalg.norm(up), 1.0, rtol=1e-9)
    np.testing.assert_allclose(felt / np.linalg.norm(felt), up, atol=0.045)  # it sways
    assert np.abs(up - stand(floor).up[0, -1]).max() > 0.1


def test_ground_and_soles_change_where_they_should(floor):
    model = floor.model
    slippery = add_cause(floor, "ground_friction", ["ground"], 0.3)
    touching = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    friction = slippery.values.body["geom_friction"]
    np.testing.assert_array_equal(friction[touching, 0], 0.3)
    np.testing.assert_array_equal(friction[~touching], model.geom_friction[~touching])
    soft = add_cause(floor, "ground_compliance", ["ground"], 0.05)
    np.testing.assert_array_equal(soft.values.body["geom_solref"][touching, 0], 0.05)
    worn = add_cause(floor, "sole_geometry", ["LFoot"], {"wear": 0.002, "x": -1.0})
    lifted = worn.values.body["geom_pos"] - model.geom_pos
    names = [model.geom(int(i)).name for i in np.flatnonzero(lifted[:, 2])]
    assert sorted(names) == ["LFootRearLeft", "LFootRearRight"]
    np.testing.assert_allclose(lifted[lifted[:, 2] != 0.0, 2], 0.002)


@pytest.mark.parametrize("turn", [0.0, 90.0, 30.0])
def test_a_box_wears_off_by_what_it_loses_however_it_is_turned(tmp_path, turn):
    size, angle = np.array([0.05, 0.1, 0.01]), np.deg2rad(turn)
    (tmp_path / "box.xml").write_text(f"""<mujoco><worldbody><geom type="plane"
      size="1 1 1"/><body name="foot" pos="0 0 0.01"><freejoint/><geom type="box"
      size="{" ".join(map(str, size))}" euler="0 0 {turn}"/><body pos="0 0 0.1">
      <joint name="a" axis="0 1 0"/><geom size="0.01" contype="0" conaffinity="0"/>
      </body></body></worldbody><actuator><position joint="a" kp="1"/></actuator>
      </mujoco>""")
    world = nominal(TASK, tmp_path / "box.xml")
    worn = add_cause(world, "sole_geometry", ["foot"], {"wear": 0.002, "x": 1.0})
    box = int(np.flatnonzero(world.model.geom_type == mujoco.mjtGeom.mjGEOM_BOX)[0])
    axes, place = np.empty(9), worn.values.body["geom_pos"][box]
    mujoco.mju_quat2Mat(axes, worn.values.body["geom_quat"][box])
    corners = np.array([[x, y, -1.0] for x in (-1, 1) for y in (-1, 1)]) * size
    lifted = (place + corners @ axes.reshape(3, 3).T)[:, 2] + size[2]
    reach = size[:2] @ np.abs([np.cos(angle), np.sin(angle)])
    out = corners[:, :2] @ np.array([np.cos(angle), -np.sin(angle)])
    np.testing.assert_allclose(lifted, 0.001 * (1.0 + out / reach), atol=5e-5)


def test_a_robot_without_an_imu_has_none_askew(arm):
    with pytest.raises(ValueError, match="the model has no IMU"):
        add_cause(arm, "imu_misalignment", ["imu"], {"angle": 0.1})


def test_a_worn_sole_lets_the_robot_lean(floor):
    worn = add_cause(floor, "sole_geometry", ["LFoot"], {"wear": 0.004, "x": -1.0})
    shift = stand(worn).base.quaternion - stand(floor).base.quaternion
    assert np.abs(shift[0, -1]).max() > 1e-3


def test_soft_ground_lets_the_robot_sink(floor):
    soft = add_cause(floor, "ground_compliance", ["ground"], 0.1)
    sunk = stand(floor).base.position - stand(soft).base.position
    assert sunk[0, -1, 2] > 5e-4
