"""Predictions that start from a measured state."""

import numpy as np
import pytest

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import ahead, chance, measure
from gatjax.diagnosis.case import held, prepare, settled, unfitted
from gatjax.diagnosis.noise import noise_of
from gatjax.sim.limbs import settling
from gatjax.sim.world import add_cause, nominal
from gatjax.task import Task


@pytest.mark.parametrize("blocks", [1, 2, 3, 8, 30])
def test_a_gain_that_is_none_is_seldom_proven(blocks):
    """An interval of 95 % lies above nothing in 2.5 % of logs, however short."""
    draw, proven, tried = np.random.default_rng(0), 0, 400
    names = np.repeat(np.arange(blocks), 12)
    for _ in range(tried):
        size = np.repeat(np.exp(0.7 * draw.normal(size=(2, blocks))), 12, axis=1)
        rows = size * draw.chisquare(1.0, size.shape)
        before, after = (measure.Errors(row[:, None], names) for row in rows)
        proven += measure.interval(before, after, None)[0] > 0.0
    assert proven < 0.05 * tried


def test_a_gain_that_is_there_is_proven():
    draw, names = np.random.default_rng(0), np.repeat(np.arange(10), 12)
    before = measure.Errors(draw.chisquare(1.0, (120, 2)), names)
    after = measure.Errors(0.25 * draw.chisquare(1.0, (120, 2)), names)
    low, high = measure.interval(before, after, None)
    assert 0.3 < low < 0.5 < high < 0.65
    assert measure.interval(before, before, 1) == (0.0, 0.0)


MODEL = """
<mujoco><option timestep="0.002"/><worldbody><body><joint name="a" axis="0 1 0"
  armature="0.01" damping="0.4"/><geom size="0.05" pos="0 0 -0.15" mass="0.5"/></body>
</worldbody><actuator><position joint="a" kp="20" kv="0.2"/></actuator></mujoco>"""
PERIOD = 0.01
TIME = PERIOD * np.arange(300)
COMMAND = 0.6 * np.sin(5.0 * TIME)[:, None]
silent = lambda stage, share: None  # noqa: E731


def assert_foretold(world, commands):
    """A world foretells what it does itself, from any measured state on."""
    run = JointRun(0, TIME, commands, 0.0 * commands)
    run = run._replace(angle=measure.whole_log(world, [run])[0])
    cut = ahead.windows([run], PERIOD)
    assert cut is not None
    played = ahead.windowed(world, cut, PERIOD)
    for horizon in ahead.HORIZONS:
        error = ahead.window_errors(cut, played, horizon, PERIOD).rmse()
        assert error.max() < 2e-3


@pytest.mark.parametrize("loop", [0.0, 1.0])
def test_a_joint_starts_where_its_encoder_says_what_was_measured(tmp_path, loop):
    path = tmp_path / "arm.xml"
    path.write_text(MODEL)
    plain = nominal(Task(control_period=PERIOD), path)
    askew = add_cause(plain, "encoder_offset", ["a"], {"offset": 0.1, "in_loop": loop})
    askew = add_cause(askew, "encoder_scale", ["a"], {"scale": 0.8, "in_loop": loop})
    assert_foretold(askew, COMMAND)


TWO = """
<mujoco><option timestep="0.002"/><worldbody><body><joint name="a" axis="0 1 0"
  armature="0.01" damping="0.4"/><geom size="0.05" pos="0 0 -0.15" mass="0.5"/>
  <body pos="0 0 -0.2"><joint name="b" axis="0 1 0" armature="0.01" damping="0.4"/>
  <geom size="0.05" pos="0 0 -0.15" mass="0.4"/></body></body></worldbody><actuator>
  <position joint="a" kp="20" kv="0.2"/><position joint="b" kp="20" kv="0.2"/>
</actuator></mujoco>"""


def test_joints_that_are_seen_late_start_as_long_ago(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(TWO)
    plain = nominal(Task(control_period=PERIOD), path)
    late = add_cause(plain, "measurement_delay", ["a"], {"delay": 0.035})
    late = add_cause(late, "measurement_delay", ["b"], {"delay": 0.012})
    assert_foretold(late, np.hstack([COMMAND, -0.5 * COMMAND]))


@pytest.fixture
def lossy(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(MODEL)
    plain = nominal(Task(control_period=PERIOD), path)
    lost = {"probability": 0.7, "burst": 5.0}
    return plain, add_cause(plain, "dropped_commands", ["a"], lost)


def test_lost_commands_are_late_in_the_mean_and_never_freeze_a_joint(lossy):
    run = JointRun(0, TIME, COMMAND, 0.0 * COMMAND)
    plain, mean = (measure.whole_log(world, [run])[0][:, 0] for world in lossy)
    size = 2.0 * np.exp(-5j * TIME[100:]) / len(TIME[100:])
    ratio = (mean[100:] @ size) / (plain[100:] @ size)
    # a command comes late by the ticks since the last one that arrived: of a two-state
    # chain 0.7 x (burst - 1) + 0.7 + ... = share x burst ticks in the mean
    assert -np.angle(ratio) / 5.0 == pytest.approx(0.7 * 5.0 * PERIOD, rel=0.35)
    assert 0.8 < abs(ratio) < 1.02


def test_each_joint_has_draws_of_its_own(lossy):
    """Which joints lose a message together is for the world to say."""
    plain, lost = lossy
    assert not chance.draws(plain, (2, 50, 3)).any()
    drawn = chance.draws(lost, (2, 50, 3)).reshape(-1, 3)
    assert np.abs(np.corrcoef(drawn.T) - np.eye(3)).max() < 0.15


def test_windows_lose_commands_too(lossy):
    plain, _ = lossy
    run = JointRun(0, TIME, COMMAND, measure.whole_log(plain, [JointRun(
        0, TIME, COMMAND, 0.0 * COMMAND)])[0])  # fmt: skip
    cut = ahead.windows([run], PERIOD)
    assert cut is not None
    errors = [
        ahead.window_errors(cut, ahead.windowed(each, cut, PERIOD), 0.5, PERIOD)
        for each in lossy
    ]
    assert errors[0].rmse() < 2e-3 < 0.02 < errors[1].rmse()


def test_the_first_second_of_a_log_that_starts_in_motion_does_not_count():
    still = JointRun(0, TIME, COMMAND, COMMAND * (1.0 - np.exp(-20.0 * TIME))[:, None])
    errors = measure.log_errors([still], {"one": [still.angle]})["one"]
    assert len(errors.block) == len(TIME)
    moving = still._replace(angle=COMMAND)
    errors = measure.log_errors([still, moving], {"one": [still.angle, COMMAND]})["one"]
    assert len(errors.block) == 2 * len(TIME) - 101


def test_a_joint_that_had_not_settled_starts_where_it_was(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(MODEL)
    world = nominal(Task(control_period=PERIOD), path)
    told = np.concatenate([np.full((50, 1), -0.2), COMMAND])
    time = PERIOD * np.arange(350)
    (angle,) = measure.whole_log(world, [JointRun(0, time, told, 0.0 * told)])
    late = JointRun(0, TIME, COMMAND, angle[50:])
    (predicted,) = measure.whole_log(world, [late])
    assert np.abs(predicted - late.angle).max() < 0.05  # of 0.2, for its load
    errors = measure.log_errors([late], {"one": [predicted]})["one"]
    assert len(errors.block) == len(TIME) - 101
    (joint,) = unfitted(held(world.model, [late], 0), [late]).joints
    before = np.asarray(joint.grid.clock)[:, 0] < -0.01
    assert np.asarray(joint.grid.target)[before, 0] == pytest.approx(late.angle[0, 0])
    assert joint.valid.sum() == len(TIME) - 101


def sampled(path, stamps, told):
    """A log of commands [N, 1] at stamps, as a world of fine ticks follows them."""
    fine = nominal(Task(control_period=1e-3), path)
    every = 1e-3 * np.arange(int(1e3 * stamps[-1]))
    held = told[np.searchsorted(stamps, every + 1e-9, side="right") - 1]
    (angle,) = measure.whole_log(fine, [JointRun(0, every, held, 0.0 * held)])
    seen = np.interp(stamps, every, angle[:, 0])[:, None]
    return JointRun(0, stamps, told, seen)


@pytest.mark.parametrize("rate", [1.0, 0.99])
def test_commands_of_another_rate_are_as_late_as_they_were(tmp_path, rate):
    """A perfect world follows a log at 99 Hz though it ticks at 100."""
    path = tmp_path / "arm.xml"
    path.write_text(MODEL)
    stamps = PERIOD / rate * np.arange(300)
    run = sampled(path, stamps, 0.6 * np.sin(5.0 * stamps)[:, None])
    (found,) = measure.whole_log(nominal(Task(control_period=PERIOD), path), [run])
    assert np.abs(found - run.angle)[:-2].max() < 4e-3


@pytest.mark.parametrize("jitter", [0.0, 5e-4, 2e-3])
def test_commands_whose_stamps_wander_are_as_late_as_they_were(tmp_path, jitter):
    """Sleeps that add up: stamps come anywhere between ticks of their mean period."""
    path = tmp_path / "arm.xml"
    path.write_text(MODEL)
    steps = np.random.default_rng(3).normal(10.0, 1e3 * jitter, 1000)
    stamps = 1e-3 * np.cumsum(np.maximum(np.round(steps), 2.0))
    stamps -= stamps[0]
    run = sampled(path, stamps, 0.5 * np.sin(5.6 * stamps)[:, None])
    world = nominal(Task(control_period=measure.mean_period([stamps])), path)
    (found,) = measure.whole_log(world, [run])
    assert np.sqrt(np.square(found - run.angle)[:-2].mean()) < 1.5e-3


def test_rows_a_second_apart_are_predicted_by_one():
    time = 1.0 * np.arange(12)
    run = JointRun(0, time, np.zeros((12, 1)), np.zeros((12, 1)))
    cut = ahead.windows([run], 1.0)
    assert cut is not None
    errors = ahead.window_errors(cut, 0.0 * cut.angle[:, -1:], 0.5, 1.0)
    assert errors.squared.shape == (len(cut.angle), 1) and not errors.squared.any()


def test_a_speed_is_taken_over_a_time_and_not_over_rows():
    draw = np.random.default_rng(0)
    assert [measure.back(1.0 / rate) for rate in (50, 100, 1000)] == [6, 6, 60]
    time = 1e-3 * np.arange(400)
    still = JointRun(0, time, np.zeros((400, 1)), 5e-4 * draw.normal(size=(400, 1)))
    found = [measure.speed(still, slice(k, k + measure.back(1e-3)), k)
             for k in range(0, 300, 60)]  # fmt: skip
    assert np.abs(found).max() < 0.05


@pytest.mark.parametrize("rate", [20.0, 30.0, 50.0, 200.0])
def test_noise_is_told_from_motion_at_any_rate(rate):
    """A sweep to 1.5 Hz: third differences of 20 rows a second tell mostly that."""
    draw = np.random.default_rng(0)
    time = np.arange(0.0, 16.0, 1.0 / rate)
    angle = 0.5 * np.sin(2.0 * np.pi * (0.2 + 0.04 * time) * time)
    seen = angle + 3e-4 * draw.normal(size=len(time))
    run = JointRun(0, time, angle[:, None], seen[:, None])
    assert 2e-4 < noise_of([run])[0] < 4.5e-4


HEAVY = """
<mujoco><option timestep="0.002"/><worldbody><body><joint name="a" axis="0 1 0"
  armature="0.02" damping="5"/><geom size="0.05" pos="0.4 0 0" mass="5.5"/></body>
</worldbody><actuator><position joint="a" kp="130" kv="35"/></actuator></mujoco>"""


def test_a_slow_servo_under_load_is_at_rest_before_a_run(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(HEAVY)
    world = nominal(Task(control_period=PERIOD), path)
    run = JointRun(0, TIME, 0.0 * COMMAND, 0.0 * COMMAND)
    angle = measure.whole_log(world, [run])[0][:, 0]
    sunk = 5.5 * 9.81 * 0.4 / 130.0  # rad, about
    assert angle[-1] == pytest.approx(sunk, rel=0.05)
    assert np.ptp(angle) < 1e-3
    runs = [run._replace(angle=angle[:, None])]
    case = settled(prepare(held(world.model, runs, 0), runs, silent), silent)
    fit = case.healthy[0]
    assert fit.rms() < 3e-4 and np.abs(fit.x).max() < 0.3
    assert settling(world.model) == pytest.approx(7.0 * 40.0 / 130.0, rel=0.2)


def test_a_servo_without_damping_is_waited_for_five_seconds_at_most(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(HEAVY.replace('damping="5"', "").replace('kv="35"', ""))
    assert settling(nominal(Task(control_period=PERIOD), path).model) == 5.0


def test_windows_are_cut_to_the_last_row_and_counted_from_the_first_of_a_run():
    rows = ahead.warming(PERIOD) + round(ahead.HORIZONS[0] / PERIOD)
    time = PERIOD * np.arange(rows)
    angle = np.sin(time)[:, None]
    for start in (0.0, 0.7, 10_000.0):  # what a log's clock says first
        run = JointRun(0, start + time, angle, angle)
        cut = ahead.windows([run, run], PERIOD)
        assert cut is not None
        assert cut.block.tolist() == [0, measure.APART]
