"""Colours and style of every picture, and the way from matplotlib to inline svg.

Every colour is drawn as a stand-in and replaced by a css variable, so that one picture
serves the light and the dark page. The palette is Okabe and Ito's, which readers with
any colour vision can tell apart; line markers differ as well.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

INK, FAINT, GRID, PAPER = "#010203", "#010204", "#010205", "#010206"
STAND_INS = {
    INK: "--ink",
    FAINT: "--faint",
    GRID: "--grid",
    PAPER: "--card",
    "#010207": "--none",
    "#010208": "--envelope",
    "#010209": "--guided",
    "#01020a": "--gat",
    "#01020b": "--other",
    "#01020c": "--theta0",
    "#01020d": "--explained",
    "#01020e": "--dagger",
    "#01020f": "--sgat",
    "#010210": "--sensing",
    "#010211": "--oracle",
    "#010212": "--rgat",
    "#010213": "--garat",
}
COLOURS = {variable[2:]: stand_in for stand_in, variable in STAND_INS.items()}
MARKERS = {
    "none": "o", "envelope": "^", "guided": "D", "gat": "s", "explained": "P",
    "dagger": "v", "sgat": "<", "sensing": ">", "oracle": "*",
    "rgat": "X", "garat": "d",
}  # fmt: skip
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "gatjax",
    "font.size": 11,
    "axes.edgecolor": GRID,
    "axes.labelcolor": INK,
    "axes.linewidth": 1.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "text.color": INK,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "axes.axisbelow": True,
}


def colour_of(method: str) -> str:
    """Stand-in colour of a method."""
    return COLOURS.get(method, COLOURS["other"])


def draw(paint: Callable[[Axes], None], height: float = 3.3) -> str:
    """Run `paint` on fresh axes and return the picture as an svg element."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(5.6, height), layout="constrained")
        paint(figure.add_subplot())
        file = io.StringIO()
        empty = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        figure.savefig(file, format="svg", transparent=True, metadata=empty)
    svg = file.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r'\s(xmlns(:xlink)?|width|height)="[^"]*"', "", svg, count=4)
    svg = re.sub(r'<g id="[^"]*"', "<g", svg)
    svg = svg.replace("xlink:href", "href").replace("<metadata/>", "")
    for stand_in, variable in STAND_INS.items():
        svg = svg.replace(stand_in, f"var({variable})")
    return svg
