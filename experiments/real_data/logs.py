"""The parts of a log that the robot moves freely in."""

from __future__ import annotations

import numpy as np

from gatjax.data.recording import Recording

AWAY = 0.5  # rad from upright: a hand that pushed the pendulum down has let go
AFTER = 0.4  # s that it stands upright until somebody may push it again


def parts(log: Recording, times: list[tuple[float, float]]) -> Recording:
    """Parts of a log, (from, to) in s, as trajectories of their own."""
    rows = [np.flatnonzero((log.time >= a) & (log.time < b)) for a, b in times]
    every = np.concatenate(rows)
    columns = {name: values[every] for name, values in log.columns.items()}
    run = np.repeat(np.arange(len(rows)), [len(some) for some in rows])
    return log._replace(time=log.time[every], trajectory=run, columns=columns)


def swings(log: Recording, joint: str) -> list[tuple[float, float]]:
    """When a pendulum swings up from hanging (0 rad), or falls, (from, to) in s."""
    angle = np.abs(log.columns[f"position.{joint}"] % (2.0 * np.pi) - np.pi)
    low = np.concatenate([[False], angle > AWAY, [False]])
    edges = np.flatnonzero(low[1:] != low[:-1]).reshape(-1, 2)
    found: list[tuple[float, float]] = []
    for begin, end in log.time[np.minimum(edges, len(log.time) - 1)]:
        if found and begin < found[-1][1]:  # it was thrown over the top
            begin, _ = found.pop()
        found.append((begin, end + AFTER))
    return found
