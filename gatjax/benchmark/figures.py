"""confusion.png and detection.png."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from gatjax.benchmark import scores
from gatjax.benchmark.marks import Mark

LAST = 12.0  # d at which the open bin is drawn to end
DOTS = 120


def draw_confusion(marks: Sequence[Mark], path: Path) -> None:
    """Draw what was said of each truth; rows add up to their number of cases."""
    rows, columns, counts = scores.confusion(marks)
    if not rows:
        return
    size = (2.5 + 0.3 * len(columns), 2.0 + 0.26 * len(rows))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.add_subplot()
    share = counts / np.maximum(counts.sum(1, keepdims=True), 1)
    axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for (r, c), count in np.ndenumerate(counts):
        if count:
            color = "white" if share[r, c] > 0.5 else "black"
            axes.text(c, r, str(count), ha="center", va="center", color=color, size=7)
    plain = [name.replace("_", " ") for name in columns]
    axes.set_xticks(range(len(columns)), plain, rotation=90, size=7)
    labels = [name.replace("_", " ") for name in rows]
    axes.set_yticks(range(len(rows)), labels, size=7)
    axes.set_xlabel("said")
    axes.set_ylabel("true")
    figure.savefig(path, dpi=DOTS)


def draw_detection(marks: Mapping[str, Sequence[Mark]], path: Path) -> None:
    """Draw found and rightly named single causes against the size of the effect.

    Args:
        marks: of each solver by its name; the first one also shows what was found.
        path: png to write.
    """
    figure = Figure(figsize=(6.0, 3.8), layout="constrained")
    axes = figure.add_subplot()
    for index, (name, own) in enumerate(marks.items()):
        shift = 1.0 + 0.025 * index
        _curve(axes, own, "right", f"{name}: cause right", "-o", shift)
        if index == 0:
            _curve(axes, own, "detected", f"{name}: something found", "--s", 0.975)
    axes.axvline(scores.BINS[1], color="0.7", linewidth=0.8)
    axes.set_xscale("log")
    axes.set_xticks([0.8, 1.5, 3.0, 6.0, 12.0], ["0.8", "1.5", "3", "6", "12"])
    axes.minorticks_off()
    axes.set_ylim(-0.02, 1.04)
    axes.set_xlabel("visibility d of the effect")
    axes.set_ylabel("share of single causes")
    axes.legend(fontsize=8, frameon=False, loc="lower right")
    figure.savefig(path, dpi=DOTS)


def _curve(
    axes, marks: Sequence[Mark], key: str, label: str, style: str, shift: float
) -> None:  # fmt: skip
    """One curve with its intervals, a point for each bin that has cases."""
    bins = [row for row in scores.by_visibility(marks) if row[key].count]
    if not bins:
        return
    ends = [(max(row["low"], 0.4), min(row["high"], LAST)) for row in bins]
    middle = [shift * math.sqrt(low * high) for low, high in ends]
    value = np.array([row[key].value for row in bins])
    low = value - [row[key].low for row in bins]
    high = np.array([row[key].high for row in bins]) - value
    axes.errorbar(
        middle, value, [low, high], fmt=style, label=label, capsize=2, markersize=4,
        linewidth=1.2,
    )  # fmt: skip
