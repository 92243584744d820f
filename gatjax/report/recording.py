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


def draw_recording(recording: Recording, path: Path) -> None:
    """Draw command and position of each joint over time, runs one after the other.

    Args:
        recording: SI.
        path: png to write.
    """
    seen = [c[9:] for c in recording.columns if c.startswith("position.")]
    shown = sorted(seen)[:MOST]
    unit = recording.command_unit
    step = max(1, len(recording.time) // POINTS)
    ids = recording.trajectory[::step]
    time = _strung(recording.time[::step], ids)
    ends = time[:-1][np.diff(ids) != 0]
    figure = Figure(figsize=(11.0, 1.0 + 1.5 * len(shown)), layout="constrained")
    grid = figure.subplots(len(shown), 1, sharex=True, squeeze=False)
    for axes, joint in zip(grid[:, 0], shown, strict=True):
        command = recording.columns.get(f"command.{joint}")
        if command is not None:
            _draw_command(axes, time, command[::step], unit)
            release(command)
        position = np.rad2deg(recording.columns[f"position.{joint}"][::step])
        axes.plot(time, position, lw=0.8, label="position")
        axes.set_ylabel(f"{joint}\ndegrees", fontsize=8)
        release(recording.columns[f"position.{joint}"])
        for end in ends:
            axes.axvline(end, color="0.8", lw=0.6)
    grid[0, 0].legend(loc="upper right", fontsize=8, ncols=2)
    left = len(seen) - len(shown)
    more = f", {left} more joints not drawn" if left else ""
    grid[-1, 0].set_xlabel(f"time, runs one after the other, s{more}")
    figure.savefig(path, dpi=DOTS)


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
