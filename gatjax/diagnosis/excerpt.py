"""Pieces of long logs: causes are looked for in as much as there is time for.

A diagnosis simulates its fit logs tens of thousands of times. Of long ones it takes
pieces of every speed that they have: some causes show at rest, others at speed
only. What does not show within a piece (a motor that warms up over minutes) does not
count then. Held-out logs stay whole.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gatjax.data.recording import Recording
from gatjax.data.trajectories import JointRun

ENOUGH, JOINTS = 60.0, 600.0  # s that are looked into: of all joints, and of each
LONG = 2.5  # times that: longer logs are cut
PIECE = 6.0  # s
OUTSTANDING = 3.0  # times the speed of the middle of a part


def _lasting(logs: Sequence[Recording]) -> float:
    """How long logs are, s."""
    return float(sum(log.time[rows][-1] - log.time[rows][0]
                     for log in logs for rows in _runs(log)))  # fmt: skip


def _enough(logs: Sequence[Recording], joints: int) -> tuple[float, float]:
    """How long logs are, s, and how much of them is looked into."""
    whole, enough = _lasting(logs), max(ENOUGH, JOINTS / joints)
    return whole, enough if whole > LONG * enough else whole


def shortened(logs: Sequence[Recording], joints: int) -> str | None:
    """One line for the user whose logs are cut; None if they are not."""
    whole, enough = _enough(logs, joints)
    if enough == whole:
        return None
    some = _lasting(excerpt(logs, joints))
    return (
        f"the logs to be explained last {whole:.0f} s: causes are looked for in "
        f"{some:.0f} s of them, pieces of up to {PIECE:.0f} s from calm to lively; "
        f"for what builds up over minutes give a shorter log"
    )


def excerpt(logs: Sequence[Recording], joints: int) -> list[Recording]:
    """Logs, or pieces of long ones, as trajectories of their own.

    Every run has a piece at least; of more runs than there is time for every so many-th
    is taken, and a log of which nothing is taken is left out.

    Args:
        logs: to be explained.
        joints: of the robot.
    """
    whole, enough = _enough(logs, joints)
    if enough == whole:
        return list(logs)
    runs = [(log, rows) for log in logs for rows in _runs(log)]
    lasts = np.array([log.time[rows][-1] - log.time[rows][0] for log, rows in runs])
    shares = lasts / lasts.sum() * enough / np.clip(lasts, 1e-3, PIECE)
    many = len(runs) > enough / PIECE
    thinned = np.diff(np.floor(np.cumsum(shares) + 0.5), prepend=0.0)
    counts = (thinned if many else _parts(shares, enough / PIECE)).astype(int).tolist()
    out = []
    for log in logs:
        mine = [(rows, n) for (one, rows), n in zip(runs, counts, strict=True)
                if one is log and n > 0]  # fmt: skip
        if mine:
            out.append(_cut(log, mine))
    return out


def _parts(shares: np.ndarray, total: float) -> np.ndarray:
    """Whole numbers [N] near shares, one at least; largest remainders round up."""
    counts = np.maximum(np.floor(shares), 1.0)
    left = max(int(np.ceil(total - 1e-9) - counts.sum()), 0)
    counts[np.argsort(counts - shares, kind="stable")[:left]] += 1.0
    return counts


def source(piece: JointRun, whole: Sequence[JointRun]) -> int:
    """Number of the trajectory that a piece is of; its own where there is none."""
    rows = len(piece.time)
    for run in whole:
        first = int(np.searchsorted(run.time, piece.time[0]))
        part = run.part(np.arange(len(run.time))[first : first + rows])
        same = np.array_equal(part.time, piece.time)
        if same and np.array_equal(part.angle, piece.angle):
            return run.trajectory
    return piece.trajectory


def _runs(log: Recording) -> list[np.ndarray]:
    """Rows of each trajectory of a log, in order."""
    return [np.flatnonzero(log.trajectory == run) for run in np.unique(log.trajectory)]


def _tiled(time: np.ndarray, rows: np.ndarray) -> list[np.ndarray]:
    """Rows of a run in pieces that cover it; a short one is whole."""
    tiles = max(int(np.ceil((time[-1] - time[0]) / PIECE - 1e-9)), 1)
    length = min(PIECE, time[-1] - time[0])
    begins = time[0] + np.linspace(0.0, time[-1] - time[0] - length, tiles)
    return [
        rows[(time >= begin - 1e-9) & (time <= begin + length + 1e-9)]
        for begin in begins
    ]


def _spread(
    pieces: list[np.ndarray], moved: np.ndarray, count: int
) -> list[np.ndarray]:
    """So many pieces of a run, in time's order; each stands for equally many.

    Ordered by speed and divided into parts, of each part the middle one is taken. So
    the fastest end of a chirp, where any drive gives up, counts for what it is; but a
    part in which something moves `OUTSTANDING` times as much is there with that.
    """
    if count >= len(pieces):
        return pieces
    speed = np.sqrt([np.nanmean(moved[rows[:-1]], 0).sum() for rows in pieces])
    chosen = []
    for part in np.array_split(np.argsort(speed, kind="stable"), count):
        middle, fastest = part[len(part) // 2], part[-1]
        out = speed[fastest] > OUTSTANDING * speed[middle]
        chosen.append(fastest if out else middle)
    return [pieces[k] for k in sorted(chosen)]


def _moved(log: Recording) -> np.ndarray:
    """Square of each joint's step to its next row [N, J], over its mean in the log.

    That is the next row of its trajectory; none follows the last one, which has NaN.
    """
    names = [name for name in log.columns if name.startswith("position.")]
    angles = np.stack([log.columns[name] for name in names], 1)
    squares = np.full_like(angles, np.nan)
    for rows in _runs(log):
        squares[rows[:-1]] = np.square(np.diff(angles[rows], axis=0))
    return squares / (np.nanmean(squares, 0) + 1e-12)


def _cut(log: Recording, runs: list[tuple[np.ndarray, int]]) -> Recording:
    """A log of so many pieces of each of its runs; short runs stay whole."""
    kept, number, moved = [], [], _moved(log)
    for rows, count in runs:
        for some in _spread(_tiled(log.time[rows], rows), moved, count):
            kept.append(some)
            number.append(np.full(len(some), len(number)))
    rows = np.concatenate(kept)
    return log._replace(
        time=log.time[rows], trajectory=np.concatenate(number),
        columns={name: values[rows] for name, values in log.columns.items()},
    )  # fmt: skip
