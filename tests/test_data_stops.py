"""A joint that runs against the end of its range."""

import numpy as np
import pytest

from gatjax.data import stops
from gatjax.data.recording import Recording
from gatjax.data.trajectories import JointRun

TIME = 0.01 * np.arange(300)


def run_of(angle):
    return JointRun(0, TIME, angle[:, None], angle[:, None])


def test_readings_count_again_half_a_second_after_the_stop():
    angle = np.zeros(300)
    angle[100:105] = 0.4  # beyond 0.3
    out = stops.hindered(run_of(angle), 0, -1.0, 0.3)
    assert np.flatnonzero(out).tolist() == list(range(100, 154))


def test_the_lower_end_is_a_stop_too():
    angle = np.zeros(300)
    angle[290] = -0.999
    out = stops.hindered(run_of(angle), 0, -1.0, 0.3)
    assert np.flatnonzero(out).tolist() == list(range(290, 300))


@pytest.mark.parametrize("angle", [np.full(300, 0.3), np.zeros(300)])
def test_a_joint_that_rests_at_its_stop_or_never_reaches_it_counts(angle):
    assert not stops.hindered(run_of(angle), 0, -1.0, 0.3).any()


def test_a_joint_without_a_range_has_no_stop():
    angle = 10.0 * np.sin(TIME)
    assert not stops.hindered(run_of(angle), 0, -np.inf, np.inf).any()


def test_a_stop_is_told_with_its_row_and_what_it_costs():
    angle = np.zeros(300)
    angle[100:105] = 0.4
    columns = {"command.knee": np.zeros(300), "position.knee": angle}
    log = Recording("fit.parquet", TIME, np.zeros(300, int), columns, {})
    runs = [run_of(angle)]
    (told,) = stops.check_stops(log, runs, ["knee"], {"knee": (-1.0, 0.3)})
    assert told.level == "info" and "row 101, column 'position.knee'" in told.text
    assert "0.54 s in all" in told.text
    assert stops.check_stops(log, runs, ["knee"], {"knee": (-1.0, 1.0)}) == []
