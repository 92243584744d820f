"""Pictures of a run as inline svg, drawn by matplotlib and coloured by the page's css.

Every colour is drawn as a stand-in and replaced by a css variable, so that one picture
serves the light and the dark page. The palette is Okabe and Ito's, which readers with
any colour vision can tell apart; line markers differ as well.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Sequence

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from gatjax.report.intervals import Interval, mean_interval, share_interval
from gatjax.report.read import THETA0, Metric, Prediction, Rollout
from gatjax.report.tables import CM, Candidate, Summary, ordered
from gatjax.report.wording import number

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
}
COLOURS = {variable[2:]: stand_in for stand_in, variable in STAND_INS.items()}
MARKERS = {"none": "o", "envelope": "^", "guided": "D", "gat": "s"}
FALL_COST = 15.0  # what a fall adds to the cost in m/s
STYLE = {
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

Points = list[tuple[float, Interval, bool]]  # place, value, whether any walk fell


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


class Axis:
    """Where generation g of iteration i lies on the common axis."""

    def __init__(self, rows: Sequence[Rollout | Metric | Candidate]) -> None:
        """Lay the generations of all iterations one after the other."""
        places = {(each.iteration, each.generation) for each in rows}
        self.places = {key: place for place, key in enumerate(sorted(places))}

    def of(self, row: Metric | Candidate) -> float:
        """Place of a row."""
        return float(self.places[row.iteration, row.generation])

    def label(self, axes: Axes) -> None:
        """Write the generations under the axis and mark where grounding was redone."""
        step = max(1, math.ceil(len(self.places) / 14))
        shown = list(self.places.items())[::step]
        axes.set_xticks([place for _, place in shown], [str(key[1]) for key, _ in shown])
        axes.set_xlim(-0.5, max(len(self.places) - 0.5, 0.5))
        iterations = sorted({iteration for iteration, _ in self.places})
        for iteration in iterations[1:]:
            start = min(p for (i, _), p in self.places.items() if i == iteration)
            axes.axvline(start - 0.5, color=FAINT, linewidth=1, linestyle=":")
        axes.set_xlabel(
            "generation" if len(iterations) < 2 else "generation, grounded anew at dots"
        )


def velocity_picture(summary: Summary, kind: str) -> str:
    """Velocity on the robot of the best or mean candidate per generation, cm/s."""
    rows, axis = _candidates(summary, kind)

    def paint(axes: Axes) -> None:
        _theta0_band(axes, summary)
        for index, (method, own) in enumerate(rows):
            points: Points = []
            for row in own:
                place = axis.of(row) + _dodge(index, len(rows))
                if row.velocity is not None:
                    points.append((place, row.velocity, row.falls > 0))
                else:
                    mark = {"marker": "x", "color": colour_of(method), "markersize": 6}
                    across = axes.get_xaxis_transform()
                    axes.plot(place, 0.03, transform=across, clip_on=False, **mark)
            _line(axes, method, points)
        axis.label(axes)
        axes.set_ylim(*_velocity_limits(summary))
        axes.set_ylabel("velocity, cm/s")

    return draw(paint)


def falls_picture(summary: Summary, kind: str) -> str:
    """Share of walks on the robot that fell per generation, per cent."""
    rows, axis = _candidates(summary, kind)

    def paint(axes: Axes) -> None:
        for index, (method, own) in enumerate(rows):
            points: Points = []
            for row in own:
                share = share_interval(row.falls, row.rollouts)
                share = Interval(*(100.0 * end for end in share))
                place = axis.of(row) + _dodge(index, len(rows))
                points.append((place, share, row.falls > 0))
            _line(axes, method, points)
        axis.label(axes)
        axes.set_ylim(-4, 104)
        axes.set_ylabel("walks that fell, %")

    return draw(paint, height=2.6)


def simulator_cost_picture(metrics: Sequence[Metric]) -> str:
    """Cost per generation in each method's own simulator, cm/s."""
    rows = [row for row in metrics if row.method != THETA0]
    axis = Axis(rows)

    def paint(axes: Axes) -> None:
        worst = 0.0
        for method in ordered(row.method for row in rows):
            for kind in ("best", "mean"):
                own = [r for r in rows if (r.method, r.candidate) == (method, kind)]
                own = [row for row in own if math.isfinite(row.simulator_cost)]
                own.sort(key=axis.of)
                costs = [CM * row.simulator_cost for row in own]
                worst = max([worst, *costs])
                _plain_line(axes, method, kind, [axis.of(row) for row in own], costs)
        _cost_axis(axes, worst)
        axis.label(axes)

    return draw(paint)


def robot_cost_picture(summary: Summary, rollouts: Sequence[Rollout]) -> str:
    """Cost per generation on the robot, cm/s, falls included."""
    rows = [each for method in summary.methods for each in method.candidates]
    axis = Axis(rows)
    costs: dict[tuple, list[float]] = {}
    for row in rollouts:
        key = (row.method, row.iteration, row.generation, row.candidate)
        cost = CM * (FALL_COST * row.fell - row.velocity_m_s)
        costs.setdefault(key, []).append(cost)

    def paint(axes: Axes) -> None:
        worst = 0.0
        for method in ordered(row.method for row in rows):
            for kind in ("best", "mean"):
                own = [r for r in rows if (r.method, r.candidate) == (method, kind)]
                own.sort(key=axis.of)
                means = [mean_interval(costs[row[:4]]).mean for row in own]
                worst = max([worst, *means])
                _plain_line(axes, method, kind, [axis.of(row) for row in own], means)
        _cost_axis(axes, worst)
        axis.label(axes)

    return draw(paint)


def prediction_picture(rows: Sequence[Prediction]) -> str:
    """Prediction error per joint at one horizon, before and after grounding, degrees."""
    joints = list(dict.fromkeys(row.joint for row in rows))
    methods = ordered(row.method for row in rows)

    def paint(axes: Axes) -> None:
        for row in rows:
            place = joints.index(row.joint)
            place += 2.2 * _dodge(methods.index(row.method), len(methods))
            before, after = math.degrees(row.before_rad), math.degrees(row.after_rad)
            colour = colour_of(row.method)
            axes.plot([before, after], [place] * 2, color=colour, linewidth=1.6)
            axes.plot(before, place, "|", color=FAINT, markersize=9, markeredgewidth=2)
            axes.plot(
                after, place, MARKERS.get(row.method, "o"), color=colour, markersize=5
            )
        axes.set_yticks(range(len(joints)), joints)
        axes.set_ylim(len(joints) - 0.4, -0.6)
        axes.set_xlim(left=0.0)
        axes.set_xlabel("prediction error (rms), degrees")
        axes.grid(axis="y", visible=False)

    return draw(paint, height=0.9 + 0.3 * len(joints))


def _candidates(
    summary: Summary, kind: str
) -> tuple[list[tuple[str, list[Candidate]]], Axis]:
    rows = []
    for method in summary.methods:
        own = [each for each in method.candidates if each.candidate == kind]
        if own:
            rows.append((method.name, own))
    every = [each for method in summary.methods for each in method.candidates]
    return rows, Axis(every)


def _velocity_limits(summary: Summary) -> tuple[float, float]:
    """Limits that hold every candidate, so that the pictures can be compared."""
    every = [each for method in summary.methods for each in method.candidates]
    velocities = [each.velocity for each in (*every, summary.theta0) if each]
    ends = [
        end
        for velocity in velocities
        if velocity is not None
        for end in velocity
        if math.isfinite(end)
    ]
    low, high = min(ends, default=0.0), max(ends, default=1.0)
    room = max(0.08 * (high - low), 0.5)
    return low - 1.5 * room, high + room


def _dodge(index: int, count: int) -> float:
    return 0.1 * (index - (count - 1) / 2)


def _theta0_band(axes: Axes, summary: Summary) -> None:
    velocity = summary.theta0.velocity if summary.theta0 else None
    if velocity is None:
        return
    if velocity.known:
        axes.axhspan(velocity.low, velocity.high, color=COLOURS[THETA0], alpha=0.25, lw=0)
    axes.axhline(velocity.mean, color=COLOURS[THETA0], linewidth=1.4, linestyle="--")


def _line(axes: Axes, method: str, points: Points) -> None:
    colour = colour_of(method)
    places = [place for place, _, _ in points]
    means = [value.mean for _, value, _ in points]
    axes.plot(places, means, color=colour, linewidth=1.6, alpha=0.85)
    for place, value, fell in points:
        if value.known:
            ends = [value.low, value.high]
            axes.plot([place] * 2, ends, color=colour, linewidth=1.6, alpha=0.6)
        axes.plot(
            place,
            value.mean,
            MARKERS.get(method, "o"),
            markersize=6,
            color=colour,
            markerfacecolor=PAPER if fell else colour,
            markeredgewidth=1.6,
        )


def _plain_line(
    axes: Axes, method: str, kind: str, places: list[float], values: list[float]
) -> None:
    axes.plot(
        places,
        values,
        color=colour_of(method),
        linestyle="-" if kind == "best" else (0, (3, 2)),
        marker=MARKERS.get(method, "o"),
        markersize=5 if kind == "best" else 3.5,
        linewidth=1.6,
    )


def _cost_axis(axes: Axes, worst: float) -> None:
    """Straight scale for speeds; logarithmic above 50, where only falls count."""
    axes.set_ylabel("cost, cm/s")
    if worst <= 50.0:
        return
    axes.set_yscale("symlog", linthresh=50.0, linscale=1.6)
    ticks = (-40, -20, 0, 20, 40, 150, 500, 1500)
    axes.yaxis.set_major_locator(FixedLocator(ticks))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda tick, _: number(tick, 0)))
    axes.set_ylim(top=2000.0)
