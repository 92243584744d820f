"""Runs of hardware as the records of the loop: padded, stacked, judged."""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np

from gatjax.hardware.session import Row
from gatjax.records import Base, Outcome, Reading, Trajectory
from gatjax.task import Task, cost_of

Array = Any


def judged(task: Task, metres: float, fell_at: Array) -> Outcome:
    """Return the verdict on a walk that somebody measured; NaN m: not yet."""
    velocity = np.asarray(metres / task.duration)
    cost = cost_of(task, velocity, np.isfinite(fell_at))
    return Outcome(cost, velocity, np.asarray(fell_at), np.asarray(True))


def padded(
    rows: list[Row], ticks: int, period: float, whole: bool = False
) -> Trajectory:
    """Turn the rows of a run into a Trajectory [ticks, ...].

    The last row is repeated, not alive, where there are no more. Of a run that is
    `whole` but for frames that were lost, the last one is alive, at the end.
    """
    rows = rows[:ticks]
    index = np.minimum(np.arange(ticks), len(rows) - 1)
    alive = np.arange(ticks) < len(rows)
    time = np.array([row.time for row in rows]) - rows[0].time
    after = np.maximum(np.arange(ticks) - len(rows) + 1, 0) * period
    if whole:
        alive[len(rows) - 1], alive[-1], after[-1] = False, True, 0.0
    readings = zip(*(row.reading for row in rows))
    return Trajectory(
        time=time[index] + after,
        command=np.stack([row.command for row in rows])[index],
        reading=Reading(*(np.stack(part)[index] for part in readings)),
        base=_bases([row.base for row in rows], index),
        alive=alive,
    )


def _bases(bases: list[Base | None], index: Array) -> Base:
    """Stack where the robot was; NaN where nobody knows."""
    unknown = Base(np.full(3, np.nan), np.full(4, np.nan))
    known = [unknown if base is None else base for base in bases]
    return Base(*(np.stack(part)[index] for part in zip(*known)))


def stacked(records: Sequence[Any]) -> Any:
    """Stack equal records along a new first axis."""
    first = records[0]
    if isinstance(first, tuple):
        parts = (stacked(part) for part in zip(*records))
        return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)
    return np.stack([np.asarray(record) for record in records])
