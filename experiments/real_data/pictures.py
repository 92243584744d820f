"""Before and after on held-out motions of real robots, as pictures for a paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

INK = {  # Okabe and Ito's colours
    "command": "#999999", "measured": "#000000", "nominal": "#D55E00",
    "mujoco.sysid": "#009E73", "gatjax": "#0072B2",
}  # fmt: skip
STYLE: dict[Any, Any] = {
    "font.size": 9, "axes.spines.top": False, "axes.spines.right": False,
}  # fmt: skip


class Panel(NamedTuple):
    """One joint in one held-out log."""

    title: str
    time: np.ndarray  # [N] s
    lines: Mapping[str, np.ndarray]  # [N] by name: measured, and what predicts it
    unit: str = "degrees"


def draw(panels: Sequence[Panel], columns: int, file: Path) -> None:
    """Write a picture: angles above, their errors below, for every panel."""
    rows = -(-len(panels) // columns)
    with matplotlib.rc_context(STYLE):
        figure = Figure((4.2 * columns, 3.3 * rows), layout="constrained")
        axes: Any = figure.subplots(
            2 * rows, columns, squeeze=False, height_ratios=[2, 1] * rows
        )
        for number, panel in enumerate(panels):
            row, column = divmod(number, columns)
            _paint(panel, axes[2 * row][column], axes[2 * row + 1][column])
        for number in range(len(panels), rows * columns):
            row, column = divmod(number, columns)
            axes[2 * row][column].axis("off")
            axes[2 * row + 1][column].axis("off")
        handles, names = axes[0][0].get_legend_handles_labels()
        figure.legend(handles, names, ncols=len(names), loc="outside upper center")
        file.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(file, dpi=110)


def _paint(panel: Panel, above: Axes, below: Axes) -> None:
    """One joint: what was measured and predicted, and how far off that is."""
    measured = panel.lines["measured"]
    for name, angle in panel.lines.items():
        behind = name == "command"
        above.plot(panel.time, angle, color=INK[name], label=name,
                   lw=0.8 if behind else 1.3, ls=":" if behind else "-")  # fmt: skip
        if name not in ("command", "measured"):
            off = angle - measured
            below.plot(panel.time, off, color=INK[name], lw=1.0)
    errors = {
        name: float(np.sqrt(np.nanmean(np.square(angle - measured))))
        for name, angle in panel.lines.items()
        if name not in ("command", "measured")
    }
    words = ", ".join(f"{name} {value:.2f}" for name, value in errors.items())
    above.set_title(f"{panel.title}\nrms error, {panel.unit}: {words}", fontsize=8)
    above.set_ylabel(panel.unit)
    above.tick_params(labelbottom=False)
    below.axhline(0.0, color=INK["measured"], lw=0.6)
    below.set_ylabel("error")
    below.set_xlabel("s")
