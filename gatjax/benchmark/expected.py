"""Figures that an experiment should give again, each with how far it may be off."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from gatjax.benchmark.tables import table
from gatjax.runs import read_json

SCHEMA = "gatjax.expected/1"


class Compared(NamedTuple):
    """Expected figures beside those of a run."""

    table: str  # markdown
    off: list[str]  # names of figures that are too far off


def compare(results: dict[str, Any], file: str | Path) -> Compared:
    """Compare results with expected.json.

    Figures are named by their place in the results, as in `bam.held_out_kp200_deg`, and
    have a `value`; numbers have `within`, how far they may be from it in the same unit.
    What others reached (`anchors`, by name) and what was asked for (`reach`) may stand
    beside it. Figures of parts that are not in the results are listed as not run.

    Args:
        results: of the experiment, parts by name.
        file: expected.json, `{"schema": "gatjax.expected/1", "figures": {...}}`.

    Raises:
        ValueError: the file is of another kind, or names no figures.
    """
    expected = read_json(Path(file))
    if expected.get("schema") != SCHEMA:
        raise ValueError(f"{file}: its schema is not {SCHEMA}")
    if not expected.get("figures"):
        raise ValueError(f"{file}: it names no figures")
    rows, off = [], []
    for name, row in expected["figures"].items():
        part, *place = name.split(".")
        run = part in results
        got = _found(results[part], place) if run else "not run"
        right = not run or _right(got, row)
        beside = ", ".join(f"{who} {n}" for who, n in row.get("anchors", {}).items())
        rows.append((name, _shown(row["value"], row.get("within")), _shown(got),
                     "" if right else "off", beside, row.get("reach", "")))  # fmt: skip
        off += [] if right else [name]
    head = ("figure", "expected", "this run", "", "others", "asked for")
    used = len(head) if any(any(row[4:]) for row in rows) else 4
    return Compared(table(head[:used], [row[:used] for row in rows]), off)


def _found(value: Any, place: list[str]) -> Any:
    """What lies at a place in results; None where there is nothing."""
    for key in place:
        value = value.get(key) if isinstance(value, dict) else None
    return value


def _right(got: Any, row: dict[str, Any]) -> bool:
    """Whether a figure is as expected."""
    if "within" not in row or not isinstance(got, int | float):
        return got == row["value"]
    return abs(got - row["value"]) <= row["within"]


def _shown(value: Any, within: float | None = None) -> str:
    """A figure as text."""
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "nothing"
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return text if within is None else f"{text} ± {within:g}"
