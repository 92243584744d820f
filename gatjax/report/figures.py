"""The pictures of a run as inline svg."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from gatjax.report.ink import COLOURS, FAINT, MARKERS, PAPER, colour_of, draw
from gatjax.report.intervals import Interval, share_interval
from gatjax.report.read import CHOSEN, THETA0, Metric, Prediction, Rollout
from gatjax.report.tables import CM, Candidate, Summary, ordered
from gatjax.report.wording import number
from gatjax.task import Task, cost_of

Costs = list[tuple[Metric | Candidate, float]]  # row, cm/s
Points = list[tuple[float, Interval, bool]]  # place, value, whether any walk fell


class Stroke(NamedTuple):
    """Candidates that one line joins."""

    method: str
    shift: float  # to the side, so that methods do not hide each other
    rows: list[Candidate]


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
        axes.set_xticks(
            [place for _, place in shown], [str(key[1]) for key, _ in shown]
        )
        axes.set_xlim(-0.5, max(len(self.places) - 0.5, 0.5))
        iterations = sorted({iteration for iteration, _ in self.places})
        for iteration in iterations[1:]:
            start = min(p for (i, _), p in self.places.items() if i == iteration)
            axes.axvline(start - 0.5, color=FAINT, linewidth=1, linestyle=":")
        axes.set_xlabel(
            "generation" if len(iterations) < 2 else "generation (dots: grounded anew)"
        )


def velocity_picture(summary: Summary, kind: str) -> str:
    """Velocity on the robot of a kind of candidates by generation, cm/s."""
    strokes, axis = _candidates(summary, kind)

    def paint(axes: Axes) -> None:
        axes.set_ylim(*_velocity_limits(summary))
        _theta0_band(axes, summary)
        for stroke in strokes:
            points: Points = []
            for row in stroke.rows:
                place = axis.of(row) + stroke.shift
                if row.velocity is not None:
                    points.append((place, row.velocity, row.falls > 0))
                else:
                    _cross_at_bottom(axes, place, stroke.method)
            _line(axes, stroke.method, points)
        axis.label(axes)
        axes.set_ylabel("velocity, cm/s")

    return draw(paint)


def falls_picture(summary: Summary, kind: str) -> str:
    """Share of walks on the robot that fell per generation, per cent."""
    strokes, axis = _candidates(summary, kind)

    def paint(axes: Axes) -> None:
        axes.set_ylim(-4, 104)
        for stroke in strokes:
            points: Points = []
            for row in stroke.rows:
                share = share_interval(row.falls, row.rollouts)
                share = Interval(*(100.0 * end for end in share))
                points.append((axis.of(row) + stroke.shift, share, row.falls > 0))
            _line(axes, stroke.method, points)
        axis.label(axes)
        axes.set_ylabel("walks that fell, %")

    return draw(paint, height=2.6)


def simulator_costs(metrics: Sequence[Metric]) -> Costs:
    """Cost of every candidate in its method's own simulator, cm/s."""
    return [
        (row, CM * row.simulator_cost)
        for row in metrics
        if row.method != THETA0
        and row.candidate != CHOSEN
        and math.isfinite(row.simulator_cost)
    ]


def robot_costs(summary: Summary, rollouts: Sequence[Rollout]) -> Costs:
    """Mean cost of every candidate on the robot, cm/s, falls included."""
    walks: dict[tuple, list[float]] = {}
    for row in rollouts:
        key = (row.method, row.iteration, row.generation, row.candidate)
        cost = float(cost_of(Task(), row.velocity_m_s, row.fell))
        walks.setdefault(key, []).append(CM * cost)
    return [
        (row, sum(walks[row[:4]]) / row.rollouts)
        for method in summary.methods
        for row in method.candidates
    ]


def cost_picture(costs: Costs) -> str:
    """Cost per generation: best candidates solid, means dashed, others dotted."""
    axis = Axis([row for row, _ in costs])
    lines: dict[tuple[str, int, str], list[tuple[float, float]]] = {}
    for row, cost in costs:
        key = (row.method, row.iteration, row.candidate)
        lines.setdefault(key, []).append((axis.of(row), cost))

    def paint(axes: Axes) -> None:
        for (method, _, kind), points in lines.items():
            axes.plot(
                *zip(*sorted(points), strict=True),
                color=colour_of(method),
                linestyle={"best": "-", "mean": (0, (3, 2))}.get(kind, ":"),
                marker=MARKERS.get(method, "o"),
                markersize=5 if kind == "best" else 3.5,
                linewidth=1.6,
            )
        _cost_axis(axes, max(cost for _, cost in costs))
        axis.label(axes)

    return draw(paint)


def prediction_picture(rows: Sequence[Prediction]) -> str:
    """Prediction error per joint at one horizon in degrees, before and after."""
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


def _candidates(summary: Summary, kind: str) -> tuple[list[Stroke], Axis]:
    """Candidates of one kind: a stroke for each method and iteration."""
    every = [each for method in summary.methods for each in method.candidates]
    methods = [method.name for method in summary.methods if method.candidates]
    strokes: dict[tuple[str, int], Stroke] = {}
    for row in every:
        if row.candidate == kind:
            shift = _dodge(methods.index(row.method), len(methods))
            new = Stroke(row.method, shift, [])
            strokes.setdefault((row.method, row.iteration), new).rows.append(row)
    return list(strokes.values()), Axis(every)


def _cross_at_bottom(axes: Axes, place: float, method: str) -> None:
    axes.plot(
        place,
        0.03,
        "x",
        color=colour_of(method),
        markersize=6,
        transform=axes.get_xaxis_transform(),
        clip_on=False,
    )


def _velocity_limits(summary: Summary) -> tuple[float, float]:
    """Limits that hold every candidate, so that the pictures can be compared.

    An interval of two walks may be longer than all else: it is cut at half the spread
    of the candidates beyond them.
    """
    every = [each for method in summary.methods for each in method.candidates]
    found = [each.velocity for each in (*every, summary.theta0) if each]
    velocities = [velocity for velocity in found if velocity is not None]
    means = [velocity.mean for velocity in velocities] or [0.0, 1.0]
    spread = max(max(means) - min(means), 1.0)
    lows = [velocity.low for velocity in velocities if velocity.known]
    highs = [velocity.high for velocity in velocities if velocity.known]
    low = max(min(lows + means), min(means) - 0.5 * spread)
    high = min(max(highs + means), max(means) + 0.5 * spread)
    room = max(0.08 * (high - low), 0.5)
    return low - 1.5 * room, high + room


def _dodge(index: int, count: int) -> float:
    return 0.1 * (index - (count - 1) / 2)


def _theta0_band(axes: Axes, summary: Summary) -> None:
    velocity = summary.theta0.velocity if summary.theta0 else None
    if velocity is None:
        return
    if velocity.known:
        axes.axhspan(
            velocity.low, velocity.high, color=COLOURS[THETA0], alpha=0.25, lw=0
        )
    axes.axhline(velocity.mean, color=COLOURS[THETA0], linewidth=1.4, linestyle="--")


def _line(axes: Axes, method: str, points: Points) -> None:
    """Join the points; an interval that leaves the picture says little: it is pale."""
    colour = colour_of(method)
    least, most = axes.get_ylim()
    places = [place for place, _, _ in points]
    means = [value.mean for _, value, _ in points]
    axes.plot(places, means, color=colour, linewidth=1.6, alpha=0.85)
    for place, value, fell in points:
        if value.known:
            inside = least <= value.low and value.high <= most
            width, alpha = (1.6, 0.6) if inside else (0.8, 0.35)
            ends = [value.low, value.high]
            axes.plot([place] * 2, ends, color=colour, linewidth=width, alpha=alpha)
        axes.plot(
            place,
            value.mean,
            MARKERS.get(method, "o"),
            markersize=6,
            color=colour,
            markerfacecolor=PAPER if fell else colour,
            markeredgewidth=1.6,
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
    axes.yaxis.set_major_formatter(
        FuncFormatter(lambda tick, _: number(float(tick), 0))
    )
    axes.set_ylim(top=2000.0)
