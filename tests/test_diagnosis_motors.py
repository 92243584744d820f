"""Joints that are told torques or voltages instead of angles."""

import numpy as np
import pytest

from gatjax.cli import main
from gatjax.cli.diagnosis import read_given
from gatjax.cli.parsing import parse
from gatjax.data.mapping import column_map, resolve, to_si
from gatjax.data.readers.assemble import joined
from gatjax.data.recording import Recording, read_recording, write_recording
from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import ahead, measure
from gatjax.diagnosis.case import held, unfitted
from gatjax.diagnosis.given import Logs, given
from gatjax.diagnosis.start import Start
from gatjax.sim.limbs import limbs_of
from gatjax.sim.world import add_cause, nominal
from gatjax.task import Task

ARM = """
<mujoco><option timestep="0.002"/><worldbody><body><joint name="a" axis="0 1 0"
  armature="0.01" damping="0.1"/><geom size="0.05" pos="0 0 -0.15" mass="0.5"/>
  <body pos="0 0 -0.3"><joint name="b" axis="0 1 0" armature="0.01"/>
  <geom size="0.02" pos="0 0 -0.1" mass="0.1"/></body></body></worldbody>
<actuator>{first}{second}</actuator></mujoco>"""
MOTOR = '<general joint="{}" gainprm="0.5" biasprm="0 0 -0.2" biastype="affine"/>'
SERVO = '<position joint="{}" kp="20" kv="0.2"/>'
PERIOD = 0.01
TIME = PERIOD * np.arange(250)


@pytest.fixture
def world(tmp_path):
    """Two links with motors."""
    return nominal(Task(control_period=PERIOD), arm(tmp_path))


def arm(folder, first=MOTOR, second=MOTOR):
    path = folder / "arm.xml"
    path.write_text(ARM.format(first=first.format("a"), second=second.format("b")))
    return path


def swung():
    """A run whose first row is neither at rest nor at an angle of its command."""
    angle = 0.4 * np.cos(6.0 * TIME)[:, None] + np.array([0.0, 0.3])
    return JointRun(0, TIME, 0.2 * np.sin(9.0 * TIME)[:, None] + 0.0 * angle, angle)


def test_a_world_plays_torques_the_same_with_effects_of_the_joint(world):
    smooth = add_cause(world, "torque_ripple", ["all"], {"amplitude": 1e-9})
    plain, beside = (measure.whole_log(w, [swung()])[0] for w in (world, smooth))
    assert np.ptp(plain, axis=0).min() > 0.1
    assert np.max(np.abs(plain - beside)) < 1e-3


def test_a_whole_log_starts_where_the_joint_was_measured_and_as_fast(world):
    run = swung()
    run = run._replace(angle=measure.whole_log(world, [run])[0])
    later = run._replace(time=TIME[37:], command=run.command[37:], angle=run.angle[37:])
    again = measure.whole_log(world, [later])[0]
    assert again[0] == pytest.approx(later.angle[0])
    assert np.abs(np.diff(later.angle[:2], axis=0)).min() > 1e-3  # on the way
    assert np.max(np.abs(again - later.angle)) < 0.02


def test_half_a_second_ahead_of_a_measured_state(world):
    run = swung()
    run = run._replace(angle=measure.whole_log(world, [run])[0])
    cut = ahead.windows([run], PERIOD)
    assert cut is not None
    played = ahead.windowed(world, cut, PERIOD)
    error = ahead.window_errors(cut, played, 0.5, PERIOD).rmse()
    assert error.max() < 0.01


@pytest.mark.parametrize(
    ("cause", "values"),
    [
        ("dead_band", {"half_width": 0.01}),
        ("encoder_offset", {"offset": 0.1, "in_loop": 1.0}),
        ("encoder_scale", {"scale": 0.9, "in_loop": 1.0}),
        ("speed_limit", {"limit": 2.0}),
    ],
)
def test_what_only_a_servo_has_is_refused(world, cause, values):
    with pytest.raises(ValueError, match="only position servos"):
        add_cause(world, cause, ["a"], values)


def test_a_step_of_the_command_is_no_ramp(tmp_path):
    """The simulation of one joint knows no limit of a torque's or voltage's rate."""
    text = ARM.format(first=MOTOR.format("a"), second="")
    path = tmp_path / "one.xml"
    path.write_text(text.replace('<joint name="b" axis="0 1 0" armature="0.01"/>', ""))
    one = nominal(Task(control_period=PERIOD), path, 5e-4)
    volts = 6.0 * np.sign(np.sin(2.5 * TIME + 0.1))[:, None]
    run = JointRun(0, TIME, volts, 0.0 * volts)
    run = run._replace(angle=measure.whole_log(one, [run])[0])
    joint = unfitted(held(one.model, [run], 0), [run]).joints[0]
    left = joint.residual([{"delay": 0.0}], False)
    assert np.ptp(run.angle) > 1.0
    assert np.sqrt(np.mean(left**2)) < 2e-3


def test_what_begins_in_motion_counts_after_half_a_second(tmp_path):
    """A motor's joint forgets no start by itself: it begins as it was measured."""
    text = ARM.format(first='<motor joint="a"/>', second="")
    for some in (' damping="0.1"', '<joint name="b" axis="0 1 0" armature="0.01"/>'):
        text = text.replace(some, "")
    path = tmp_path / "one.xml"
    path.write_text(text)
    one = nominal(Task(control_period=PERIOD), path, 5e-4)
    torque = 0.2 * np.sin(5.5 * TIME + 1.0)[:, None]
    run = JointRun(0, TIME, torque, 0.0 * torque)
    run = run._replace(angle=measure.whole_log(one, [run])[0])
    middle = run.part(np.arange(72, 230))
    assert abs(np.diff(middle.angle[:2, 0])[0]) > 2.0 * PERIOD
    joint = unfitted(held(one.model, [middle], 0), [middle]).joints[0]
    counted = joint.time[0][joint.valid[0]]
    assert counted.min() == pytest.approx(0.5, abs=0.011)
    left = joint.residual([{"delay": 0.0}], False)
    assert abs(left[0]) < 3e-4
    assert np.sqrt(np.mean(left**2)) < 3e-4


def test_a_whole_log_starts_where_the_encoder_says_what_was_measured(world):
    askew = add_cause(world, "encoder_offset", ["a"], {"offset": 0.2})
    run = swung()
    run = run._replace(angle=measure.whole_log(askew, [run])[0])
    again = measure.whole_log(askew, [run])[0]
    assert np.max(np.abs(again - run.angle)) < 0.02


def test_a_motor_without_a_limit_that_nothing_tells_moves(tmp_path):
    run = JointRun(0, TIME, np.zeros((250, 2)), np.zeros((250, 2)))
    model = nominal(Task(control_period=PERIOD), arm(tmp_path)).model
    joints = unfitted(held(model, [run], 0), [run]).joints
    assert all(joint.nominal["limit"] > 0.0 for joint in joints)
    assert np.isfinite(joints[0].residual([{}], False)).all()


def write(path, **about):
    run = swung()
    columns = {
        f"{family}.{name}": table[:, k]
        for family, table in (("command", run.command), ("position", run.angle))
        for k, name in enumerate("ab")
    }
    metadata = {"robot": "arm", "base": "fixed"} | about
    zero = np.zeros(len(TIME), int)
    write_recording(path, Recording("x", TIME, zero, columns, metadata))
    return str(path)


@pytest.mark.parametrize(
    ("drives", "about", "text"),
    [
        ((MOTOR, MOTOR), {}, "commands are in rad, but the model has no position"),
        ((SERVO, SERVO), {"command_unit": "V"}, "commands are in V, but the model has"),
        ((MOTOR, SERVO), {}, "only some actuators are position servos"),
    ],
)
def test_a_log_and_a_model_have_to_agree(tmp_path, capsys, drives, about, text):
    log = write(tmp_path / "fit.parquet", **about)
    words = ["--model", str(arm(tmp_path, *drives)), "--data", log, "--out", "o"]
    assert main(["diagnose", *words]) == 1
    assert text in capsys.readouterr().err


def test_files_of_two_units_are_not_mixed(tmp_path, capsys):
    logs = [write(tmp_path / f"{u[0]}.parquet", command_unit=u) for u in ("V", "N m")]
    words = ["--model", str(arm(tmp_path)), "--data", *logs, "--out", "o"]
    assert main(["diagnose", *words]) == 1
    assert "diagnose files of one unit together" in capsys.readouterr().err
    parts = [read_recording(log) for log in logs]
    with pytest.raises(ValueError, match="import logs of one unit together"):
        joined(parts, "both")


def test_no_motion_is_made_for_motors(world):
    with pytest.raises(ValueError, match="motions need position servos"):
        limbs_of(world.model)


def test_commands_beyond_the_range_of_a_motor_are_taken_as_the_motor_takes_them(
    tmp_path,
):
    motor = MOTOR.replace("/>", ' ctrllimited="true" ctrlrange="-0.1 0.1"/>')
    log = read_recording(write(tmp_path / "x.parquet", command_unit="V"))
    case = given(Start(str(arm(tmp_path, motor, motor))), Logs([log], []), 0)
    assert np.abs(case.logs[0].command).max() == pytest.approx(0.1)


def test_a_map_says_that_commands_are_no_angles(tmp_path):
    tree = {"columns": {"command.a": {"from": "u", "unit": "mV"}}}
    mapping = column_map(tree, "x.yaml")
    assert mapping.metadata == {"command_unit": "V"}
    entry = resolve(mapping, ["u"], "log")["command.a"]
    assert to_si(entry, np.array([250.0])) == pytest.approx([0.25])
    for entry, kind in (({"unit": "N cm"}, "torque"), ("w", "angle")):
        tree["columns"]["command.b"] = entry
        with pytest.raises(ValueError, match=f"{kind} and voltage; those of one"):
            column_map(tree, "x.yaml")
    del tree["columns"]["command.b"]
    with pytest.raises(ValueError, match="command_unit is rad, but the commands' unit"):
        column_map(tree | {"metadata": {"command_unit": "rad"}}, "x.yaml")
    tree["columns"]["command.a"]["unit"] = "N·m"
    mapping = column_map(tree | {"metadata": {"command_unit": "N·m"}}, "x.yaml")
    assert mapping.metadata["command_unit"] == "N·m"


def test_another_unit_of_commands_is_refused(tmp_path):
    with pytest.raises(ValueError, match="command_unit is 'A'; it is one of rad, N m"):
        read_recording(write(tmp_path / "x.parquet", command_unit="V"), column_map(
            {"metadata": {"command_unit": "A"}}, "x.yaml"
        ))  # fmt: skip


def test_motors_may_turn_on_and_on(tmp_path):
    path = tmp_path / "x.parquet"
    log = read_recording(write(path, command_unit="N m"))
    log.columns["position.a"][:] += 30.0
    write_recording(path, log)
    words = ["--model", str(arm(tmp_path)), "--data", str(path), "--out", "o"]
    assert read_given(parse(["diagnose", *words]))[1].fit[0].metadata["command_unit"]
