"""Where a joint runs against the end of its range, and what that does to a log.

The stop takes over from the servo, and single-joint simulations have none: until the
joint has settled again, its readings tell nothing of the drive.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gatjax.data.finding import Finding, Ranges, cell
from gatjax.data.recording import Recording
from gatjax.data.trajectories import JointRun, soon_after

REACHED = 0.002  # rad from the end of the range
RECOVERY = 0.5  # s after a stop that readings tell nothing of the drive
MOST = 0.5  # share of a log: a joint that rests there by intention is kept


def at_stop(angle: np.ndarray, low: float, high: float) -> np.ndarray:
    """Whether readings [N] rad are at or beyond the end of a range, [N] bool."""
    return (angle > high - REACHED) | (angle < low + REACHED)


def hindered(run: JointRun, joint: int, low: float, high: float) -> np.ndarray:
    """Rows [N] bool from a stop until the joint has settled; none if that is most.

    Args:
        run: of all joints.
        joint: index of the one in question.
        low: end of its range, rad; -inf if there is none.
        high: the other end, rad.
    """
    reached = at_stop(run.angle[:, joint], low, high)
    out = soon_after(run.time, reached, RECOVERY)
    return out & bool(out.mean() < MOST)


def check_stops(
    recording: Recording, runs: Sequence[JointRun], joints: Sequence[str],
    ranges: Ranges,
) -> list[Finding]:  # fmt: skip
    """Joints that run against the end of their range now and then."""
    found = []
    for k, joint in enumerate(joints):
        low, high = ranges.get(joint, (-np.inf, np.inf))
        seconds, first = 0.0, -1
        for run in runs:
            out = hindered(run, k, low, high)
            if out.any():
                rows = np.flatnonzero(recording.trajectory == run.trajectory)
                first = first if first >= 0 else int(rows[np.flatnonzero(out)[0]])
                seconds += float(out.mean() * (run.time[-1] - run.time[0]))
        if first >= 0:
            column = f"position.{joint}"
            text = (
                f"{cell(recording, first, column)}: runs against the end of its range, "
                f"{low:.3g} to {high:.3g} rad; readings up to {RECOVERY:g} s later are "
                f"not explained ({seconds:.2g} s in all), command less far"
            )
            found.append(Finding("info", "stop", text, {joint: seconds}))
    return found
