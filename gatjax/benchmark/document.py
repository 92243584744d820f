"""The table of the paper and paired tests, as markdown."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gatjax.benchmark.tables import table
from gatjax.benchmark.transfer import Found, Paired, corrected, line, paired
from gatjax.report.intervals import Interval
from gatjax.report.tables import PAPER

COLUMNS = (
    "method", "trials", "gain, %", "failures", "best generation",
    "paper: gain, failures, generation", "gain, failed ones 0, %",
    "stood 10 fresh walks", "gain on those, %", "falls, %",
)  # fmt: skip
TESTS = (
    "paired", "trials", "gain, points", "p (Holm)", "gain on fresh walks, points",
    "p (Holm)", "falls, points", "p (Holm)", "fails less to more often", "p",
)  # fmt: skip


def document(
    trials: dict[str, dict[int, dict[str, Found]]], against: str = "gat"
) -> str:
    """The table of every robot as markdown, and every method against one of them."""
    return "\n".join(_section(robot, each, against) for robot, each in trials.items())


def _section(robot: str, trials: dict[int, dict[str, Found]], against: str) -> str:
    """One robot: the paper's columns, more honest ones, and paired tests."""
    methods = list(dict.fromkeys(name for each in trials.values() for name in each))
    lines = []
    for method in methods:
        mine = [each[method] for each in trials.values() if method in each]
        one = line(method, mine)
        theirs = PAPER.get(method)
        beside = (
            f"{theirs.gain}, {theirs.failed}, {theirs.generation}" if theirs else ""
        )
        lines.append((
            method, f"{one.trials}", _shown(one.gain), f"{one.failures}",
            f"{one.generation:.1f}".replace("nan", "-"), beside,
            _shown(one.useful), f"{one.stood}",
            _shown(one.confirmed), _shown(one.falls, 100.0),
        ))  # fmt: skip
    parts = [f"## Simulator to {robot}", table(COLUMNS, lines)]
    tests = _tests(trials, [name for name in methods if name != against], against)
    parts += [table(TESTS, tests)] if tests else []
    return "\n\n".join(parts) + "\n"


def _tests(
    trials: dict[int, dict[str, Found]], methods: Sequence[str], against: str
) -> list[tuple[str, ...]]:
    """Rows of paired tests; all of gains and falls of one robot are a family."""
    tests: dict[str, Paired] = {}
    for method in methods:
        both = [each for each in trials.values() if method in each and against in each]
        if both:
            tests[method] = paired(
                [e[method] for e in both], [e[against] for e in both]
            )
    plain = [p for t in tests.values() for p in (t.p, t.p_kept, t.p_fallen)]
    pairs = zip(plain, corrected(plain), strict=True)
    told = iter(
        [f"{p:.3f} ({more:.3f})" if np.isfinite(p) else "-" for p, more in pairs]
    )
    return [
        (
            f"{method} - {against}", f"{test.trials}",
            _shown(test.difference), next(told), _shown(test.kept), next(told),
            _shown(test.fallen), next(told),
            f"{test.fewer} to {test.more}", f"{test.p_failures:.3f}",
        )
        for method, test in tests.items()
    ]  # fmt: skip


def _shown(interval: Interval, scale: float = 1.0) -> str:
    """A number with its interval; a dash where there is none."""
    if not np.isfinite(interval.mean):
        return "-"
    text = f"{scale * interval.mean:.1f}"
    if not interval.known:
        return text
    return f"{text} ({scale * interval.low:.1f} to {scale * interval.high:.1f})"
