"""Logs that say which share of its gain a servo had, row by row."""

import numpy as np
import pytest

from gatjax.data import checks
from gatjax.data.recording import Recording, check_recording
from gatjax.data.trajectories import JointRun, to_arrays
from gatjax.diagnosis import ahead, measure
from gatjax.diagnosis.case import held, unfitted
from gatjax.diagnosis.suitable import check_commands
from gatjax.sim.world import add_cause, nominal
from gatjax.task import Task

MODEL = """
<mujoco><option timestep="0.0005"/><worldbody><body><joint name="a" axis="0 1 0"
  armature="0.01" damping="0.04"/><geom size="0.05" pos="0 0 -0.15" mass="0.5"/></body>
</worldbody><actuator><position joint="a" kp="{kp}" kv="0.6"/></actuator></mujoco>"""
PERIOD = 0.01
TIME = PERIOD * np.arange(300)
COMMAND = np.where(TIME > 0.2, 0.6, 0.0)[:, None]
SHARE = np.select([TIME < 1.0, TIME < 2.0], [1.0, 0.25], 0.0)[:, None]


def world(folder, kp=20.0):
    path = folder / f"arm_{kp:g}.xml"
    path.write_text(MODEL.format(kp=kp))
    return nominal(Task(control_period=PERIOD), path)


def played(one, share=None):
    run = JointRun(0, TIME, COMMAND, 0.0 * COMMAND, share)
    return run._replace(angle=measure.whole_log(one, [run])[0])


def weight(angle):
    return 0.5 * 9.81 * 0.15 * np.sin(angle)


def test_a_quarter_of_the_gain_carries_as_a_servo_with_a_quarter_does(tmp_path):
    angle = played(world(tmp_path), SHARE).angle[:, 0]
    for row, kp in ((99, 20.0), (199, 5.0)):
        assert kp * (0.6 - angle[row]) == pytest.approx(weight(angle[row]), rel=0.02)
    weak = played(world(tmp_path, 5.0)).angle
    assert played(world(tmp_path), 0.0 * SHARE + 0.25).angle == pytest.approx(
        weak, abs=2e-3
    )


def test_without_power_a_joint_swings_without_back_emf(tmp_path):
    angle = played(world(tmp_path), SHARE).angle[200:, 0]
    inertia, resist, h = 0.01 + 0.5 * (0.15**2 + 0.4 * 0.05**2), 0.04, 1e-5
    q = float(angle[0])
    v = float(np.gradient(angle[:3], PERIOD)[0])
    out = []
    for k in range(round(99 * PERIOD / h)):
        if k % round(PERIOD / h) == 0:
            out.append(q)
        v += h * (-resist * v - weight(q)) / inertia
        q += h * v
    assert np.max(np.abs(angle[: len(out)] - out)) < 0.02
    assert np.ptp(angle) > 0.5


def test_effects_act_on_what_is_left_of_the_gain(tmp_path):
    soft = add_cause(world(tmp_path), "gain_error", ["a"], {"scale": 0.5})
    soft = add_cause(soft, "stiction", ["a"], {"excess": 1e-6})
    angle = played(soft, 0.0 * SHARE + 0.5).angle
    assert angle == pytest.approx(played(world(tmp_path, 5.0)).angle, abs=3e-3)


def test_a_gear_stays_a_gear_without_power(tmp_path):
    """Its teeth are as hard as with power: the reading is that of motor and link."""
    path = tmp_path / "limited.xml"
    text = MODEL.format(kp=20).replace('kv="0.6"', 'kv="0.6" forcerange="-5 5"')
    path.write_text(text)
    one = nominal(Task(control_period=PERIOD), path)
    tight = add_cause(one, "backlash", ["a"], {"width": 0.004})
    apart = played(tight, SHARE).angle - played(one, SHARE).angle
    assert np.abs(apart).max() < 0.05


def test_half_a_second_ahead_with_the_gain_of_each_row(tmp_path):
    one = world(tmp_path)
    run = played(one, SHARE)
    cut = ahead.windows([run], PERIOD)
    assert cut is not None
    seen = ahead.windowed(one, cut, PERIOD)
    error = ahead.window_errors(cut, seen, 0.5, PERIOD).rmse()
    plain = ahead.windowed(one, cut._replace(stiffness=cut.stiffness**0), PERIOD)
    assert error < 0.02 < 0.1 < ahead.window_errors(cut, plain, 0.5, PERIOD).rmse()


def test_the_simulation_of_one_joint_knows_the_gain_too(tmp_path):
    one = world(tmp_path)
    run = played(one, SHARE)
    joint = unfitted(held(one.model, [run], 0), [run]).joints[0]
    left = joint.residual([{"delay": 0.0}], False)[:, 0]
    assert np.sqrt(np.mean(left**2)) < 0.01
    blind = unfitted(held(one.model, [run], 0), [run._replace(stiffness=None)])
    far = blind.joints[0].residual([{"delay": 0.0}], False)[:, 0]
    assert np.sqrt(np.mean(far**2)) > 0.1


def log(**columns):
    table = {"command.a": COMMAND[:, 0], "position.a": COMMAND[:, 0]} | columns
    return Recording("x.csv", TIME, np.zeros(len(TIME), int), table, {})


def test_a_run_carries_the_share_and_its_parts_do():
    run = to_arrays(log(**{"stiffness.a": SHARE[:, 0]}), ["a"])[0]
    assert run.part(np.arange(150, 250)).stiff[:, 0] == pytest.approx(SHARE[150:250, 0])
    plain = to_arrays(log(), ["a"])[0]
    assert plain.stiffness is None and (plain.stiff == 1.0).all()


def test_a_share_below_zero_is_refused():
    with pytest.raises(ValueError, match=r"row 201, column 'stiffness.a': -1 is no"):
        check_recording(
            log(**{"stiffness.a": np.where(SHARE[:, 0] > 0, 1.0, -1.0)}), ["a"]
        )
    with pytest.raises(ValueError, match=r"row 1, .*: 100 is no share of a gain"):
        check_recording(log(**{"stiffness.a": 100.0 * SHARE[:, 0]}), ["a"])


def test_a_joint_without_power_need_not_follow():
    moved = 0.5 * np.sin(4.0 * TIME)
    off = {"stiffness.a": np.where(TIME < 0.1, 1.0, 0.0)}
    told = np.where(TIME < 0.1, moved, -moved)  # the opposite, without power
    ranges = {"a": (-2.0, 2.0)}
    columns = {"command.a": told, "position.a": moved}
    with_power = checks.findings(log(**columns), ranges, "fit")
    without = checks.findings(log(**columns, **off), ranges, "fit")
    assert any(f.level == "refuse" for f in with_power)
    assert not any(f.level == "refuse" for f in without)


def test_a_standing_robot_keeps_its_gains(tmp_path):
    path = tmp_path / "stand.xml"
    path.write_text(
        MODEL.format(kp=5).replace("<body>", '<geom type="plane" size="1 1 1"/><body>'
        '<freejoint/><geom size="0.1"/><body>', 1).replace(
            "</body>", "</body></body>", 1)
    )  # fmt: skip
    model = nominal(Task(), path).model
    with pytest.raises(ValueError, match=r"'stiffness.a' is not 1 all the time"):
        check_commands(model, log(**{"stiffness.a": SHARE[:, 0]}))


def test_the_same_commands_with_another_gain_are_no_repeat():
    wave = np.sin(3.0 * TIME)
    told = {"command.a": np.tile(wave, 2), "position.a": np.tile(0.9 * wave, 2)}
    again = Recording("x.csv", np.tile(TIME, 2), np.repeat([0, 1], len(TIME)), told, {})
    share = {"stiffness.a": np.repeat([1.0, 0.5], len(TIME))}
    other = again._replace(columns=told | share)
    repeats = [
        [f for f in checks.findings(log, {}, "fit") if f.check == "repeats"]
        for log in (again, other)
    ]
    assert len(repeats[0]) == 1 and not repeats[1]
