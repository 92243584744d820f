"""The parts of the page about the run itself: its 15 parameters and its settings."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from gatjax.report.read import CHOSEN, THETA0, Run
from gatjax.report.sections import mark, section, swatch
from gatjax.report.tables import (
    Method,
    Summary,
    fastest_standing,
    label_of,
    ordered,
)
from gatjax.report.wording import DASH, duration, escape, number, significant
from gatjax.walk.parameters import PARAMETERS

SEARCHED = {parameter.name: parameter for parameter in PARAMETERS}


class Chosen(NamedTuple):
    """The policy that stands for a method in the parameter table."""

    method: str
    stem: str
    words: str


def parameter_table(run: Run, summary: Summary) -> str:
    """The parameters before and after, with their change in search steps."""
    title = "The 15 parameters before and after"
    start = run.policies.get(THETA0)
    if start is None:
        return section(title, "<p>policies/theta0.json is missing.</p>")
    found = (choose_policy(run, method) for method in summary.methods)
    chosen = [each for each in found if each is not None]
    if not chosen:
        return section(title, "<p>No learned policy has been written yet.</p>")
    changes = {
        (each.method, name): steps_between(name, value.value, run, each.stem)
        for each in chosen
        for name, value in start.items()
    }
    widest = max([abs(c) for c in changes.values() if math.isfinite(c)], default=0.0)
    head = "<tr><th>parameter</th><th>unit</th><th class=n>theta0</th>"
    head += "".join(
        f"<th>{swatch(each.method)}<small><br>{escape(each.words)}</small></th>"
        for each in chosen
    )
    rows = []
    for name, value in start.items():
        meaning = SEARCHED[name].meaning if name in SEARCHED else ""
        cells = f"<td>{escape(name)}<small>{escape(meaning)}</small></td>"
        cells += f"<td>{escape(value.unit or unit_of(name))}</td>"
        cells += f"<td class=n>{significant(value.value)}</td>"
        for each in chosen:
            change = changes[each.method, name]
            cells += _value_cell(run, each, name, change, max(widest, 1e-9))
        rows.append(f"<tr>{cells}</tr>")
    note = (
        "<p class=note>Bars: change from theta0 in steps, one step being the spread of "
        "the search distribution at sigma 1; all bars share one scale. "
        "In a straight walk left_change, turn_change, max_left, max_turn, "
        "left_extra_foot_height and pendulum_height have no or hardly any effect, so "
        "their change is a random walk.</p>"
    )
    body = f"<div class=scroll><table><thead>{head}</tr></thead>"
    body += f"<tbody>{''.join(rows)}</tbody></table></div>{note}"
    return section(title, body)


def choose_policy(run: Run, method: Method) -> Chosen | None:
    """Pick the policy of the best walk, else the last one written."""
    best = method.best
    if method.confirmed and best is not None and best.stem not in run.policies:
        found_in = (best.iteration, best.generation)  # the chosen one is a copy
        best = fastest_standing(
            each
            for each in method.candidates
            if (each.iteration, each.generation) == found_in
        )
    if best is not None and best.stem in run.policies:
        words = f"generation {best.generation}, {best.candidate}"
        return Chosen(method.name, best.stem, words)
    written = []
    for stem in run.policies:
        parts = stem.removeprefix(f"{method.name}_").split("_")
        numbered = len(parts) == 3 and parts[0].isdigit() and parts[1].isdigit()
        if stem.startswith(f"{method.name}_") and numbered:
            written.append((int(parts[0]), int(parts[1]), parts[2], stem))
    if not written:
        return None
    _, generation, candidate, stem = max(written)
    return Chosen(method.name, stem, f"generation {generation}, {candidate}, the last")


def unit_of(name: str) -> str:
    """Unit of a parameter of the walk engine."""
    return SEARCHED[name].unit if name in SEARCHED else ""


def steps_between(name: str, start: float, run: Run, stem: str) -> float:
    """Change of a parameter from theta0 in search steps; nan if unknown."""
    after = run.policies[stem].get(name)
    if after is None or name not in SEARCHED:
        return math.nan
    return (after.value - start) / SEARCHED[name].step


def _value_cell(run: Run, each: Chosen, name: str, change: float, widest: float) -> str:
    after = run.policies[each.stem].get(name)
    if after is None:
        return f"<td>{DASH}</td>"
    text = significant(after.value)
    if not math.isfinite(change):
        return f"<td>{text}</td>"
    width = 50.0 * abs(change) / widest
    left = 50.0 if change >= 0 else 50.0 - width
    place = f"left: {left:.1f}%; width: {width:.1f}%"
    limits = (SEARCHED[name].low, SEARCHED[name].high)
    near = 1e-3 * SEARCHED[name].step
    bound = ", at its bound" if any(abs(after.value - e) < near for e in limits) else ""
    words = f"{number(change, sign=True)} steps{bound}"
    return (
        f"<td>{text}<em>{words}</em>"
        f'<div class="bar" {mark(each.method)}><i style="{place}"></i></div></td>'
    )


def run_facts(run: Run) -> str:
    """Settings, versions and seconds of the run."""
    tables = ""
    times = seconds_of(run)
    if times:
        rows = [(label_of(name), duration(times[name])) for name in ordered(times)]
        rows.append(("all methods", duration(sum(times.values()))))
        tables += f"<h3>Time to search</h3>{_facts(rows)}"
    for name, content in (
        ("Settings (config.json)", run.config),
        ("Machine and versions (environment.json)", run.environment),
        ("Robot (robot.json)", run.robot),
    ):
        if content:
            rows = with_units(flatten(content))
            opened = " open" if len(rows) <= 14 else ""
            tables += f"<details{opened}><summary>{escape(name)}</summary>"
            tables += f"{_facts(rows)}</details>"
    return section(
        "The run", tables or "<p>The folder holds no facts about the run.</p>"
    )


def seconds_of(run: Run) -> dict[str, float]:
    """Seconds of search of each method; all kinds of candidates share a generation."""
    spent: dict[tuple[str, int, int], float] = {}
    for row in run.metrics:
        if math.isfinite(row.seconds) and row.candidate != CHOSEN:
            key = (row.method, row.iteration, row.generation)
            spent[key] = max(spent.get(key, 0.0), row.seconds)
    total: dict[str, float] = {}
    for (method, _, _), seconds in spent.items():
        total[method] = total.get(method, 0.0) + seconds
    return total


def flatten(content: Any, prefix: str = "") -> list[tuple[str, str]]:
    """Nested json as rows of a dotted name and a text."""
    if isinstance(content, dict):
        return [
            row
            for key, value in content.items()
            for row in flatten(value, f"{prefix}.{key}" if prefix else str(key))
        ]
    if isinstance(content, float):
        text = str(float(f"{content:.4g}")) if math.isfinite(content) else DASH
    elif isinstance(content, list):
        text = ", ".join(value for _, value in (r for e in content for r in flatten(e)))
    else:
        text = DASH if content is None else str(content)
    return [(prefix, text)]


def with_units(rows: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """Rows of `flatten`, those below `units` behind the values that they are of."""
    units = {
        name.removeprefix("units."): text
        for name, text in rows
        if name.startswith("units.")
    }
    return [
        (name, f"{text} {units.get(name.rpartition('.')[2], '')}".rstrip())
        for name, text in rows
        if not name.startswith("units.")
    ]


def _facts(rows: list[tuple[str, str]]) -> str:
    lines = "".join(
        f"<tr><td>{escape(name)}</td><td>{escape(text)}</td></tr>"
        for name, text in rows
    )
    return (
        f'<div class=scroll><table class="facts"><tbody>{lines}</tbody></table></div>'
    )
