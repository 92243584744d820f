"""Marks of many cases to rates with intervals: all scores of docs/files.md."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from gatjax.benchmark.marks import CONFIDENT, Mark
from gatjax.report.intervals import share_interval

BINS = (0.0, 0.8, 1.5, 3.0, 6.0, math.inf)  # edges of visibility
DECILES = np.linspace(0.0, 1.0, 11)
DRAWS = 1000  # of the bootstrap
PERCENT, PLAIN = "%", ""


class Score(NamedTuple):
    """One line of a table: a rate or a number with its 95 % interval."""

    name: str
    value: float  # nan where nothing counts for it
    low: float
    high: float
    count: int  # cases it is made of
    unit: str  # "%": a share of the cases; "": a number; "s"


def rate(name: str, hits: Iterable[bool]) -> Score:
    """A share of cases, Wilson interval."""
    given = list(hits)
    if not given:
        return Score(name, math.nan, math.nan, math.nan, 0, PERCENT)
    mean, low, high = share_interval(sum(given), len(given))
    return Score(name, mean, low, high, len(given), PERCENT)


def number(
    name: str,
    values: Iterable[float],
    statistic: Callable[..., Any] = np.median,
    unit: str = PLAIN,
) -> Score:
    """A statistic of numbers, nan left out; percentile bootstrap over cases.

    Args:
        name: of the line.
        values: one for each case.
        statistic: takes an array and `axis`.
        unit: of the values.
    """
    given = np.array([value for value in values if math.isfinite(value)])
    if not given.size:
        return Score(name, math.nan, math.nan, math.nan, 0, unit)
    drawn = np.random.default_rng(0).integers(0, given.size, (DRAWS, given.size))
    low, high = np.quantile(statistic(given[drawn], axis=1), (0.025, 0.975))
    value = float(statistic(given, axis=0))
    return Score(name, value, float(low), float(high), given.size, unit)


def _ninth(values: np.ndarray, axis: int) -> Any:
    return np.quantile(values, 0.9, axis=axis)


def summary(marks: Sequence[Mark]) -> list[Score]:
    """All scores of some cases; which cases count is the caller's choice."""
    single = [m for m in marks if m.kind == "single"]
    healthy = [m for m in marks if m.kind == "null"]
    pairs = [m for m in marks if m.kind == "pair"]
    outside = [m for m in marks if m.kind == "outside"]
    named = [m for m in marks if m.first]
    correct = [m.right for m in named]
    brier = [(m.probability - hit) ** 2 for m, hit in zip(named, correct, strict=True)]
    return [
        rate("cause right, exact name", (m.exact for m in single)),
        rate("cause right, by class", (m.right for m in single)),
        rate("cause and joint right", (m.joint for m in single)),
        rate("joint right where the cause is", (m.joint for m in single if m.right)),
        rate("joint right where one is named", (m.located for m in single if m.first)),
        rate("a further cause that is not there", (m.spurious > (not m.right)
             for m in single if m.first)),
        rate("right, but beside 'unknown'", (m.beside is not None and m.beside[1]
             for m in single)),
        rate("false alarms", (m.verdict != "none" for m in healthy
             if m.verdict != "failed")),
        rate("pairs: both", (m.matched == 2 for m in pairs)),
        rate("pairs: both, with joints", (m.placed == 2 for m in pairs)),
        rate("pairs: at least one", (m.matched >= 1 for m in pairs)),
        rate("pairs: a cause that is not there", (m.spurious > 0 for m in pairs)),
        rate("outside: unknown", (m.verdict == "unknown" for m in outside)),
        rate("outside: confidently misnamed", (m.surest >= CONFIDENT
             for m in outside)),
        rate("outside: misnamed beside 'unknown'", (m.beside is not None and
             m.beside[0] >= CONFIDENT for m in outside)),
        number("parameter error, median", (m.error for m in single)),
        number("parameter error, 90 of 100", (m.error for m in single), _ninth),
        rate("interval covers the truth", (m.covered > 0.5 for m in single
             if math.isfinite(m.covered))),
        number("Brier score of the first cause", brier, np.mean),
        number("held-out gain, share of the oracle's", (m.share for m in marks)),
        number("the same, outside left out", (m.share for m in [*single, *pairs])),
        number("utility per case", (m.utility for m in marks), np.mean),
        number("seconds per case, median", (m.seconds for m in marks), unit="s"),
        number("seconds per case, longest", (m.seconds for m in marks), np.max, "s"),
        rate("no answer", (m.verdict == "failed" for m in marks)),
    ]  # fmt: skip


def groups(marks: Sequence[Mark], field: str) -> list[dict[str, Any]]:
    """The main rates of each value of a field (truth, robot, engine, kind).

    Of singles: right, placed, seen; of all: what the verdict should have been.
    """
    rows = []
    for value in sorted({str(getattr(m, field)) for m in marks}):
        some = [m for m in marks if str(getattr(m, field)) == value]
        single = [m for m in some if m.kind == "single"]
        rows.append(
            {
                field: value,
                "cases": len(some),
                "right": rate("right", (_fits(m) for m in some)),
                "joint": rate("joint", (m.joint for m in single)),
                "alarms": rate("alarms", (m.verdict != "none" for m in some
                               if m.kind == "null" and m.verdict != "failed")),
                "error": number("error", (m.error for m in single)),
                "covered": rate("covered", (m.covered > 0.5 for m in single
                                if math.isfinite(m.covered))),
                "utility": number("utility", (m.utility for m in some), np.mean),
            }
        )  # fmt: skip
    return rows


def _fits(mark: Mark) -> bool:
    """Whether an answer is what the kind of case asks for."""
    if mark.kind == "single":
        return mark.right
    if mark.kind == "pair":
        return mark.matched == 2
    return mark.verdict == {"null": "none", "outside": "unknown"}[mark.kind]


def by_visibility(marks: Sequence[Mark]) -> list[dict[str, Any]]:
    """Detection and right names of singles against the size of the effect."""
    rows = []
    for low, high in itertools.pairwise(BINS):
        some = [m for m in marks if m.kind == "single" and low <= m.visibility < high]
        rows.append(
            {
                "low": low,
                "high": high,
                "detected": rate("detected", (m.verdict not in ("none", "failed")
                                 for m in some)),
                "right": rate("right", (m.right for m in some)),
                "joint": rate("joint", (m.joint for m in some)),
            }
        )  # fmt: skip
    return rows


def reliability(marks: Sequence[Mark]) -> list[dict[str, Any]]:
    """How often causes are right whose probability lies in each tenth."""
    rows = []
    for low, high in itertools.pairwise(DECILES):
        some = [
            m
            for m in marks
            if m.first and (low <= m.probability < high or m.probability == high == 1.0)
        ]
        said = float(np.mean([m.probability for m in some])) if some else math.nan
        rows.append({"low": float(low), "high": float(high), "said": said,
                     "right": rate("right", (m.right for m in some))})  # fmt: skip
    return rows


def confusion(marks: Sequence[Mark]) -> tuple[list[str], list[str], np.ndarray]:
    """What was said of each truth, pairs left out: rows, columns, counts [R, C]."""
    some = [m for m in marks if m.kind != "pair"]
    ends = ("none", "outside")
    rows = sorted({m.truth for m in some if m.truth not in ends})
    rows += [end for end in ends if any(m.truth == end for m in some)]
    names = {m.first for m in some if m.first} | {r for r in rows if r not in ends}
    columns = [*sorted(names), "none", "unknown"]
    if any(m.verdict == "failed" for m in some):
        columns.append("failed")
    counts = np.zeros((len(rows), len(columns)), int)
    for m in some:
        counts[rows.index(m.truth), columns.index(m.first or m.verdict)] += 1
    return rows, columns, counts
