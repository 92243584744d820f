"""A recording as a picture: what every joint was told and did."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gatjax.data.metadata import ANGLE
from gatjax.data.recording import Recording
from gatjax.data.spill import release

MOST = 12  # joints that are drawn
POINTS = 3000  # of each line
DOTS = 110
APART = 0.5  # s between two runs
CLOSE = 6.0  # s that the right column shows
Stretch = tuple[np.ndarray, slice | np.ndarray]  # time s, and rows of a recording


def draw_recording(recording: Recording, path: Path) -> None:
    """Draw command and position of each joint: all of it, and a part close by.

    Runs are drawn one after the other; the part is where the joints move most.

    Args:
        recording: SI.
        path: png to write.
    """
    seen = [c[9:] for c in recording.columns if c.startswith("position.")]
    shown = sorted(seen)[:MOST]
    step = max(1, len(recording.time) // POINTS)
    time = _strung(recording.time, recording.trajectory)
    near = _busiest(time[::step], recording, shown, step)
    close = np.flatnonzero((time >= near) & (time <= near + CLOSE))
    close = close[:: max(1, len(close) // POINTS)]
    parts: list[Stretch] = [(time[::step], slice(None, None, step))]
    parts += [(time[close], close)] if time[-1] > 2.0 * CLOSE else []
    wide = (2.0, 1.0)[: len(parts)]
    figure = Figure(figsize=(14.0, 1.0 + 1.5 * len(shown)), layout="constrained")
    grid = figure.subplots(
        len(shown), len(parts), sharex="col", squeeze=False, width_ratios=wide
    )
    ends = time[:-1][np.diff(recording.trajectory) != 0]
    for row, joint in zip(grid, shown, strict=True):
        for axes, part in zip(row, parts, strict=True):
            _draw_joint(axes, recording, joint, part)
            for end in ends[(ends > part[0][0]) & (ends < part[0][-1])]:
                axes.axvline(end, color="0.8", lw=0.6)
        row[0].set_ylabel(f"{joint}\ndegrees", fontsize=8)
        release(recording.columns[f"position.{joint}"])
    grid[0, 0].legend(loc="upper right", fontsize=8, ncols=2)
    left = len(seen) - len(shown)
    more = f", {left} more joints not drawn" if left else ""
    grid[-1, 0].set_xlabel(f"time, runs one after the other, s{more}")
    for axes in grid[-1, 1:]:
        axes.set_xlabel(f"{CLOSE:.0f} s with the most motion, s")
    figure.savefig(path, dpi=DOTS)


def _draw_joint(axes: Axes, recording: Recording, joint: str, part: Stretch) -> None:
    """Draw what a joint was told and did in a stretch of time."""
    time, rows = part
    command = recording.columns.get(f"command.{joint}")
    if command is not None:
        _draw_command(axes, time, command[rows], recording.command_unit)
        release(command)
    position = np.rad2deg(recording.columns[f"position.{joint}"][rows])
    axes.plot(time, position, lw=0.8, label="position")


def _busiest(
    time: np.ndarray, recording: Recording, joints: list[str], step: int
) -> float:
    """Begin, s, of the stretch in which the joints go the longest way.

    Args:
        time: [N] s of every `step`-th row.
    """
    way = np.zeros(len(time))
    for joint in joints:
        position = recording.columns[f"position.{joint}"][::step]
        went = np.abs(np.diff(position, prepend=position[:1]))
        way += np.cumsum(went) / max(float(went.sum()), 1e-9)
    last = time <= max(time[-1] - CLOSE, time[0])
    after = np.interp(time[last] + CLOSE, time, way)
    return float(time[last][np.argmax(after - way[last])])


def _draw_command(axes: Axes, time: np.ndarray, command: np.ndarray, unit: str) -> None:
    """Draw a command beside the position, on an axis of its own if it is no angle."""
    if unit == ANGLE:
        axes.plot(time, np.rad2deg(command), lw=0.8, label="command")
        return
    axes.plot([], [], lw=0.8, label="command")  # for the legend, and its colour
    beside = axes.twinx()
    beside.plot(time, command, lw=0.8)
    beside.set_ylabel(f"command, {unit}", fontsize=8)


def _strung(time: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Time [N] s with the runs one after the other."""
    out, start = np.empty(len(time)), 0.0
    for run in dict.fromkeys(ids.tolist()):
        rows = ids == run
        own = time[rows] - time[rows][0]
        out[rows] = own + start
        start += float(own[-1]) + APART
    return out
