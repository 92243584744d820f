"""Scores as text: markdown tables that also read well on a terminal."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from gatjax.benchmark import scores
from gatjax.benchmark.marks import Mark
from gatjax.benchmark.scores import PERCENT, Score

LIVELY = 3.0  # visibility d from which the main figures are asked
FIELDS = {"kind": "kind of case", "truth": "cause", "robot": "robot", "engine": "plant"}
FAILURES = 20  # that are listed


def document(marks: Mapping[str, Sequence[Mark]]) -> str:
    """scores.md: every table.

    Args:
        marks: of each solver by its name, the first one is shown in detail.
    """
    name, own = next(iter(marks.items()))
    main = [m for m in own if m.main]
    parts = [
        f"# Scores on {len(own)} cases",
        "95 % intervals in brackets (Wilson for shares, bootstrap for numbers). Main "
        "score: effects with visibility d of 0.8 or more.",
        f"## {name}",
        _summary_table(own),
    ]
    if len(marks) > 1:
        parts += ["## Beside simpler methods", _comparison(marks)]
    parts += ["## Size of the effect (single causes)", _visibility_table(own)]
    for field, title in FIELDS.items():
        parts += [f"## By {title} (main score)", _group_table(main, field, title)]
    parts += ["## Said and true probability", _reliability_table(main)]
    parts += ["## What was said of what (pairs left out)", _confusions(main)]
    failed = [m for m in own if m.verdict == "failed"]
    if failed:
        lines = [f"- {m.case}: {m.note}" for m in failed[:FAILURES]]
        parts += ["## No answer", "\n".join(lines)]
    return "\n\n".join(parts) + "\n"


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A markdown table whose columns line up."""
    every = [list(heads), *map(list, rows)]
    widths = [max(len(row[k]) for row in every) for k in range(len(heads))]
    lines = [
        "| " + " | ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) + " |"
        for row in every
    ]
    ruler = "|" + "|".join("-" * (width + 2) for width in widths) + "|"
    return "\n".join([lines[0], ruler, *lines[1:]])


def shown(score: Score) -> str:
    """A score with its interval and count; a dash where nothing counts for it."""
    if score.count == 0:
        return "-"
    ends = (score.value, score.low, score.high)
    if score.unit == PERCENT:
        value, low, high = (f"{100.0 * end:.1f}" for end in ends)
        return f"{value} % [{low}, {high}] of {score.count}"
    value, low, high = (f"{end:.3g}" for end in ends)
    unit = f" {score.unit}" if score.unit else ""
    return f"{value}{unit} [{low}, {high}] of {score.count}"


def visible(marks: Sequence[Mark], least: float) -> list[Mark]:
    """Cases whose effects all show that much, and the healthy ones."""
    return [m for m in marks if math.isnan(m.visibility) or m.visibility >= least]


def _summary_table(marks: Sequence[Mark]) -> str:
    main = scores.summary([m for m in marks if m.main])
    lively = scores.summary(visible(marks, LIVELY))
    rows = [
        (one.name, shown(one), shown(other))
        for one, other in zip(main, lively, strict=True)
    ]
    return table(("score", "main (d >= 0.8)", f"d >= {LIVELY:g}"), rows)


def _comparison(marks: Mapping[str, Sequence[Mark]]) -> str:
    columns = [scores.summary([m for m in own if m.main]) for own in marks.values()]
    rows = [
        (line[0].name, *(shown(score) for score in line))
        for line in zip(*columns, strict=True)
    ]
    return table(("score (main)", *marks), rows)


def _visibility_table(marks: Sequence[Mark]) -> str:
    rows = [
        (
            f"{row['low']:g} to {row['high']:g}",
            *(shown(row[key]) for key in ("detected", "right", "joint")),
        )
        for row in scores.by_visibility(marks)
    ]
    return table(("d", "something found", "cause right", "and joint right"), rows)


def _group_table(marks: Sequence[Mark], field: str, title: str) -> str:
    keys = ("right", "joint", "alarms", "error", "covered", "utility")
    heads = (title, "cases", "answer right", "joint right", "false alarms",
             "parameter error", "covered", "utility")  # fmt: skip
    rows = [
        (row[field], str(row["cases"]), *(shown(row[key]) for key in keys))
        for row in scores.groups(marks, field)
    ]
    used = [k for k in range(len(heads)) if k < 2 or any(r[k] != "-" for r in rows)]
    cells = [[row[k] for k in used] for row in rows]
    return table([heads[k] for k in used], cells)


def _reliability_table(marks: Sequence[Mark]) -> str:
    rows = [
        (f"{row['low']:.1f} to {row['high']:.1f}", f"{row['said']:.2f}",
         shown(row["right"]))
        for row in scores.reliability(marks)
        if row["right"].count
    ]  # fmt: skip
    return table(("said", "mean", "right"), rows)


def _confusions(marks: Sequence[Mark]) -> str:
    """The wrong cells of the confusion matrix, most frequent first.

    What logs cannot tell from the truth is not wrong.
    """
    rows, columns, counts = scores.confusion(marks)
    single = [m for m in marks if m.right and m.kind != "pair"]
    accepted = Counter((m.truth, m.first) for m in single)
    right = {"outside": "unknown"}
    found: list[tuple[int, Any]] = []
    for r, row in enumerate(rows):
        for c, column in enumerate(columns):
            count = int(counts[r, c]) - accepted[row, column]
            if count and column != right.get(row, row):
                cell = (row, column, f"{count} of {counts[r].sum()}")
                found.append((count, cell))
    found.sort(key=lambda each: -each[0])
    if not found:
        return "Nothing was mistaken."
    return table(("true", "said", "cases"), [cell for _, cell in found])
