"""Pieces of long logs: causes are looked for in as much as there is time for.

A diagnosis simulates its fit logs tens of thousands of times. Of long ones it takes
pieces, evenly spaced; what does not show within a piece (a motor that warms up over
minutes) does not count then. Held-out logs stay whole.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gatjax.data.recording import Recording

ENOUGH, JOINTS = 60.0, 400.0  # s that are looked into: of all joints, and of each
LONG = 2.5  # times that: longer logs are cut
PIECE = 6.0  # s


def _enough(logs: Sequence[Recording], joints: int) -> tuple[float, float]:
    """How long logs are, s, and how much of them is looked into."""
    lasts = [log.time[rows][-1] - log.time[rows][0]
             for log in logs for rows in _runs(log)]  # fmt: skip
    whole, enough = float(sum(lasts)), max(ENOUGH, JOINTS / joints)
    return whole, enough if whole > LONG * enough else whole


def shortened(logs: Sequence[Recording], joints: int) -> str | None:
    """One line for the user whose logs are cut; None if they are not."""
    whole, enough = _enough(logs, joints)
    if enough == whole:
        return None
    return (
        f"the logs to be explained last {whole:.0f} s: causes are looked for in "
        f"{enough:.0f} s of them, pieces of {PIECE:.0f} s evenly spaced; for what "
        f"builds up over minutes give a shorter log"
    )


def excerpt(logs: Sequence[Recording], joints: int) -> list[Recording]:
    """Logs, or pieces of long ones, as trajectories of their own.

    Args:
        logs: to be explained.
        joints: of the robot.
    """
    whole, enough = _enough(logs, joints)
    if enough == whole:
        return list(logs)
    runs = [(log, rows) for log in logs for rows in _runs(log)]
    lasts = np.array([log.time[rows][-1] - log.time[rows][0] for log, rows in runs])
    counts = np.ceil(lasts / lasts.sum() * enough / PIECE).astype(int).tolist()
    out = []
    for log in logs:
        mine = [(rows, n) for (one, rows), n in zip(runs, counts, strict=True)
                if one is log]  # fmt: skip
        out.append(_cut(log, mine))
    return out


def _runs(log: Recording) -> list[np.ndarray]:
    """Rows of each trajectory of a log, in order."""
    return [np.flatnonzero(log.trajectory == run) for run in np.unique(log.trajectory)]


def _cut(log: Recording, runs: list[tuple[np.ndarray, int]]) -> Recording:
    """A log of so many pieces of each of its runs; short runs stay whole."""
    kept, number = [], []
    for rows, count in runs:
        time = log.time[rows] - log.time[rows[0]]
        span = min(PIECE, time[-1] / count)
        for k in range(count):
            begin = (k + 0.5) * time[-1] / count - 0.5 * span
            some = rows[(time >= begin - 1e-9) & (time <= begin + span + 1e-9)]
            kept.append(some)
            number.append(np.full(len(some), len(number)))
    rows = np.concatenate(kept)
    return log._replace(
        time=log.time[rows], trajectory=np.concatenate(number),
        columns={name: values[rows] for name, values in log.columns.items()},
    )  # fmt: skip
