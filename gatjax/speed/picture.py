"""A picture of `gatjax bench`: speeds side by side, and where the time goes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

INK = {"physics": "#0072B2", "control": "#E69F00", "search": "#CC79A7",
       "rest": "#999999"}  # fmt: skip
WHOLE = "#56606B"  # of what is no part
WORDS = {
    "physics": "bare physics", "control": "walk engine, sensors, effects, task",
    "search": "search", "rest": "waiting and carrying",
}  # fmt: skip


def draw(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Draw rows of `gatjax bench` into a file."""
    names = [f"{row['backend']}, {row['world']}, {row['model']}" for row in rows]
    figure = Figure((11.0, 1.6 + 0.45 * len(rows)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    places = range(len(rows))
    for place, row in zip(places, rows, strict=True):
        speed, bare = row["closed_robot_s_per_s"], row["bare_robot_s_per_s"]
        left.barh(place, speed, color=WHOLE)
        if bare:
            left.plot([bare] * 2, [place - 0.4, place + 0.4], color="black")
        _stack(right, place, row)
    left.set_yticks(list(places), names)
    left.invert_yaxis()
    left.set_xlabel("robot-seconds simulated a second; stroke: bare loop")
    right.set_xlabel("seconds, each part by itself; stroke: a generation")
    for part, colour in INK.items():
        right.barh([0], [0], color=colour, label=WORDS[part])
    figure.legend(loc="outside upper right", ncols=len(INK), fontsize=8)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=110)


def _stack(axes: Axes, place: int, row: dict[str, Any]) -> None:
    """One row's stages after each other; the whole time of a row without any."""
    stages = row["stages_s"] or {"rest": row["generation_s"]}
    begun = 0.0
    for part, seconds in stages.items():
        axes.barh(place, max(seconds, 0.0), left=begun, color=INK[part])
        begun += max(seconds, 0.0)
    axes.plot([row["generation_s"]] * 2, [place - 0.4, place + 0.4], color="black")
