"""A log whose clock runs away: the row at t holds the angle at t (1 - drift).

Time is counted from the first row of the log, whatever is played before it.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from test_diagnosis_measure import MODEL

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import ahead, experiment, measure
from gatjax.diagnosis.verdict import Verdict
from gatjax.loop import Simulator
from gatjax.sim.world import add_cause, nominal
from gatjax.task import Task

PERIOD = 0.01
TIME = PERIOD * np.arange(1400)
COMMAND = 0.4 * np.cos(2.0 * np.pi * 0.7 * TIME)[:, None]
CLOSE = 5e-4  # rad; straight lines between rows are worth 0.1 mrad
HELD = JointRun(0, TIME, COMMAND, 0.0 * COMMAND)


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "arm.xml"
    path.write_text(MODEL)
    return nominal(Task(control_period=PERIOD), path)


@pytest.fixture(scope="module")
def angle(plain):
    """What a good clock logs, [T] rad."""
    return measure.whole_log(plain, [HELD])[0][:, 0]


def drifting(world, drift):
    return add_cause(world, "clock_drift", ["all"], {"drift": drift})


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize("drift", [0.005, 0.02, -0.01])
def test_a_whole_log_drifts_from_its_first_row_on(drift, plain, angle):
    seen = measure.whole_log(drifting(plain, drift), [HELD])[0][:, 0]
    told = TIME * (1.0 - drift)
    known = told <= TIME[-1]
    assert rms(seen - angle) > 0.03
    assert rms((seen - np.interp(told, TIME, angle))[known]) < CLOSE


def test_a_motion_of_the_simulator_drifts_from_its_first_row_on(plain):
    robots = [Simulator(world) for world in (plain, drifting(plain, 0.02))]
    good, bad = (
        robot.play(COMMAND[None], 100.0, [0]).reading.angle[0, :, 0] for robot in robots
    )
    assert rms(bad - np.interp(0.98 * TIME, TIME, good)) < CLOSE


def test_motions_to_log_next_are_compared_from_their_first_row_on(plain, angle):
    judge = SimpleNamespace(joints=[SimpleNamespace(noise=1.0)])
    verdict = Verdict("none", [], [], None, [], judge)
    pair = [plain, drifting(plain, 0.02)]
    (apart,) = experiment._separations(pair, [COMMAND], verdict)
    assert apart == pytest.approx(
        rms(np.interp(0.98 * TIME, TIME, angle) - angle), abs=CLOSE
    )


@pytest.mark.parametrize("drift", [0.005, 0.02, -0.01])
def test_what_a_clock_has_drifted_so_far_counts_ahead_of_a_measured_state(
    drift, plain, angle
):
    told = TIME * (1.0 - drift)
    known = told <= TIME[-1]
    seen = np.interp(told, TIME, angle)[known, None]
    run = JointRun(3, 40.0 + TIME[known], COMMAND[known], seen)
    cut = ahead.windows([HELD._replace(angle=angle[:, None]), run], PERIOD)
    assert cut is not None
    mine = np.flatnonzero(cut.block >= measure.APART)
    mine = mine[TIME[known][-1] > np.arange(len(mine)) * 0.1 * (1.0 - drift) + 0.75]
    errors = [
        [
            ahead.window_errors(cut, played, horizon, PERIOD).squared[mine]
            for horizon in ahead.HORIZONS
        ]
        for played in (
            ahead.windowed(world, cut, PERIOD)
            for world in (plain, drifting(plain, drift))
        )
    ]
    nominal, true = (np.sqrt(np.mean(each, axis=(1, 2))) for each in errors)
    assert nominal[0] > 0.03
    assert (true < 2e-3).all()
