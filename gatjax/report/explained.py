"""The part of the page about the diagnosis: what it explained, and what it was for."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

from gatjax.report.read import Prediction, Run
from gatjax.report.sections import section
from gatjax.report.tables import Method, Summary, faster, label_of
from gatjax.report.verdict import compare_falls, evidence, failure_words
from gatjax.report.wording import DASH, escape, number, span

ALONE, AFTER = "gat", "explained"  # with which GAT after diagnosis is compared
NOTE = (
    "<p class=note>Angles of all walking joints together (rms), on held-out walks "
    "of the robot with theta0, which neither diagnosis nor GAT has seen. Explained: "
    "the part of the way from the nominal simulator to GAT after diagnosis that the "
    "named causes, the calibration and the bounds of torques go; learned: the rest, "
    "which the network goes. "
    "Below 0 %: away from the robot.</p>"
)


class Chain(NamedTuple):
    """Prediction errors at one horizon, degrees."""

    horizon_s: float
    nominal: float
    extended: float
    alone: float  # GAT without a diagnosis; nan if it was not run
    after: float  # GAT after diagnosis

    @property
    def explained(self) -> float:
        """Share of the improvement that the causes make; nan without improvement."""
        gained = self.nominal - self.after
        return (self.nominal - self.extended) / gained if gained > 0.0 else math.nan


def explained_section(run: Run, summary: Summary) -> str:
    """What the diagnosis said, explained and learned shares, and the transfer."""
    if not run.config.get("explain"):
        return ""
    title = "What the diagnosis explained"
    parts = []
    if run.diagnosis:
        sentence = escape(run.diagnosis.get("sentence") or "It holds no sentence.")
        link = '<a href="diagnosis/report.html">The whole diagnosis</a>'
        parts.append(f"<p>{sentence} {link}.</p>")
    if run.skipped:
        parts.append(f"<p>There is no GAT after diagnosis: {escape(run.skipped)}.</p>")
        return section(title, "".join(parts))
    lines = chains(run.predictions)
    if not lines:
        parts.append("<p>GAT after diagnosis has not been learned yet.</p>")
        return section(title, "".join(parts))
    parts += [_table(lines), NOTE, _bounds(run.extended)]
    parts.append(f"<p>{escape(transfer(summary))}</p>")
    return section(title, "".join(parts))


def _bounds(extended: dict[str, Any]) -> str:
    """Say which torques the search kept to; nothing of a run without bounds."""
    rows = [row for row in extended.get("effects", []) if row.get("role") == "bound"]
    each = [
        f"{number(row['values']['limit'], 2)} N m ({', '.join(row['where'])})"
        for row in rows
    ]
    if not each:
        return ""
    said = (
        "The search kept to the torques that the robot's walks with theta0 bear out, "
        "since no log tells what it does under more: "
    )
    return f"<p class=note>{said}{escape('; '.join(each))}.</p>"


def chains(predictions: list[Prediction]) -> list[Chain]:
    """Errors before and after, a row a horizon, of the walks that all methods share."""
    shared = [row for row in predictions if row.iteration == 0]
    found = []
    for horizon in sorted({row.horizon_s for row in shared if row.method == AFTER}):
        rows = [row for row in shared if row.horizon_s == horizon]
        own = [row for row in rows if row.method == AFTER]
        plain = [row for row in rows if row.method != AFTER]
        first = [row for row in plain if row.method == plain[0].method]
        found.append(
            Chain(
                horizon_s=horizon,
                nominal=_rms(row.before_rad for row in first),
                extended=_rms(row.before_rad for row in own),
                alone=_rms(row.after_rad for row in plain if row.method == ALONE),
                after=_rms(row.after_rad for row in own),
            )
        )
    return found


def transfer(summary: Summary) -> str:
    """Say whether the walk of GAT after diagnosis transfers better than that of GAT."""
    found = {each.name: each for each in summary.methods if each.evaluated}
    one, other = found.get(AFTER), found.get(ALONE)
    asked = "Whether the walk transfers better than with GAT alone cannot be said"
    if one is None or other is None:
        lacking = label_of(AFTER if one is None else ALONE)
        return f"{asked}: the method “{lacking}” did not walk on the robot."
    falls, fall_words = compare_falls(one, other)
    fall_words = f"GAT after diagnosis {fall_words}"
    if not (one.best and other.best and one.best.upright and other.best.upright):
        fallen = one if not (one.best and one.best.upright) else other
        return f"{asked} by its speed: {failure_words(fallen)}; {fall_words}."
    if one.confirmed != other.confirmed:
        open_one = one if other.confirmed else other
        return f"{asked}: the walk of {open_one.label} was not confirmed."
    change = faster(one.best, other.best)
    signs = ((change.low > 0.0) - (change.high < 0.0), falls)
    stood = one.stands - other.stands  # of few walks: it can only object
    if max(signs) > 0 and min(*signs, stood) >= 0:
        opening = "The walk transfers better than with GAT alone"
    elif min(signs) < 0 and max(*signs, stood) <= 0:
        opening = "The walk transfers worse than with GAT alone"
    else:
        opening = asked
    speeds = f"{number(change.mean, sign=True)} cm/s ({span(change, sign=True)})"
    return (
        f"{opening}, in this run of one search each: {speeds}, {_standing(one)}, "
        f"{_standing(other)}; {fall_words}."
    )


def _standing(method: Method) -> str:
    return f"{method.label}: {evidence(method)}"


def _rms(values: Iterable[float]) -> float:
    """Root mean square in degrees; nan of nothing."""
    squares = [value**2 for value in values]
    if not squares:
        return math.nan
    return math.degrees(math.sqrt(sum(squares) / len(squares)))


def _table(lines: list[Chain]) -> str:
    """Errors and shares, a row a horizon."""
    names = ["nominal", "extended", f"{label_of(ALONE)} alone", label_of(AFTER)]
    heads = [*names, "explained", "learned"]
    cells = "".join(f"<th class=n>{escape(head)}</th>" for head in heads)
    rows = ""
    for place, line in enumerate(lines):
        when = f"{line.horizon_s:g} s ahead" + (" (one step)" if place == 0 else "")
        errors = (line.nominal, line.extended, line.alone, line.after)
        values = [_degrees(value) for value in errors]
        values += [_share(line.explained), _share(1.0 - line.explained)]
        row = "".join(f"<td class=n>{value}</td>" for value in values)
        rows += f"<tr><td>{escape(when)}</td>{row}</tr>"
    return (
        f"<div class=scroll><table><thead><tr><th>error</th>{cells}</tr></thead>"
        f"<tbody>{rows}</tbody></table></div>"
    )


def _degrees(value: float) -> str:
    return f"{number(value, 3)}°" if math.isfinite(value) else DASH


def _share(value: float) -> str:
    return f"{number(100.0 * value, 0)} %" if math.isfinite(value) else DASH
