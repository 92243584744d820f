"""Long logs are cut into pieces, short ones stay as they are."""

import numpy as np
import pytest

from gatjax.data.recording import Recording
from gatjax.diagnosis.excerpt import PIECE, excerpt, shortened


def log(*seconds, rate=50.0):
    """A recording of runs that last so long, whose position is the time."""
    times = [np.arange(0.0, each + 1e-9, 1.0 / rate) for each in seconds]
    run = [np.full(len(time), 7 + k) for k, time in enumerate(times)]
    time = np.concatenate(times)
    return Recording("log", time, np.concatenate(run), {"position.a": time.copy()}, {})


def lasts(cut):
    return [
        np.ptp(cut.time[cut.trajectory == run]) for run in np.unique(cut.trajectory)
    ]


def test_short_logs_stay_as_they_are():
    logs = [log(60.0), log(60.0, 20.0)]
    assert all(a is b for a, b in zip(excerpt(logs, 6), logs, strict=True))
    assert shortened(logs, 6) is None


def test_long_logs_become_evenly_spaced_pieces():
    logs = [log(120.0), log(240.0)]
    first, second = excerpt(logs, 20)
    assert len(lasts(first)) == 4 and len(lasts(second)) == 7
    for cut in (first, second):
        assert lasts(cut) == pytest.approx([PIECE] * len(lasts(cut)), abs=0.03)
        assert cut.time == pytest.approx(cut.columns["position.a"])
    middles = [first.time[first.trajectory == k].mean() for k in range(4)]
    assert middles == pytest.approx([15.0, 45.0, 75.0, 105.0], abs=0.05)


def test_runs_that_are_shorter_than_a_piece_stay_whole():
    (cut,) = excerpt([log(*[5.0] * 80)], 20)
    assert lasts(cut) == pytest.approx([5.0] * 80, abs=0.03)


def test_the_user_is_told():
    told = shortened([log(400.0)], 8)
    assert "400 s" in told and "60 s of them" in told and "\n" not in told
