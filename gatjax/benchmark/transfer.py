"""Trials of the loop as the paper's Table 1 counts them, with intervals and tests.

Hanna & Stone 2017, Table 1: per method the best improvement over theta0 that any policy
found after the first update shows on the robot, the trials without any, and the
generation that the best one is of. A policy counts only if it never fell there.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from gatjax.loop.candidates import counts
from gatjax.loop.explain import EXPLAINED, SKIPPED
from gatjax.report.intervals import Interval, share_interval
from gatjax.report.read import CHOSEN
from gatjax.runs import read_json, read_table

DRAWS = 10_000  # of the bootstrap


class Found(NamedTuple):
    """What one method found in one trial."""

    gain: float | None  # % over theta0, its fastest policy that never fell; None: none
    generation: int | None  # of that policy
    confirmed: float | None  # % over theta0 of that policy on fresh walks
    confirmed_falls: int | None  # in those walks
    falls: int  # of all candidates of generations that count
    walks: int

    @property
    def failed(self) -> bool:
        """Whether there is no stable improvement."""
        return self.gain is None or self.gain <= 0.0

    @property
    def fallen(self) -> float:
        """Share of the candidates' walks that fell, %; NaN if there were none."""
        return 100.0 * self.falls / self.walks if self.walks else float("nan")

    @property
    def useful(self) -> float:
        """Gain in %, nothing for a trial that failed: theta0 stays then."""
        return 0.0 if self.gain is None or self.failed else self.gain

    @property
    def kept(self) -> float:
        """Gain in % on fresh walks, nothing for a trial that failed."""
        return 0.0 if self.confirmed is None or self.failed else self.confirmed


def trial_of(
    run: Path, iteration: int = 0, methods: Sequence[str] | None = None
) -> dict[str, Found]:
    """What the methods of a run found in one iteration.

    A diagnosis that the run refused is a failure of `explained`.

    Args:
        run: folder.
        iteration: of the loop.
        methods: that count; all that the run has begun if left out.

    Raises:
        ValueError: the run has not got that far.
    """
    rows = read_table(run / "metrics.csv")
    theta0 = [row for row in rows if row["method"] == "theta0"]
    if not theta0:
        raise ValueError(f"{run}: theta0 has not walked yet; let the run go on")
    base = theta0[0]["robot_velocity_m_s"]
    found: dict[str, Found] = {}
    for method in dict.fromkeys(row["method"] for row in rows):
        mine = [r for r in rows if (r["method"], r["iteration"]) == (method, iteration)]
        tried = [r for r in mine if r["candidate"] != CHOSEN]
        last = max((row["generation"] for row in tried), default=0)
        tried = [row for row in tried if counts(row["generation"], last)]
        left_out = methods is not None and method not in methods
        if method == "theta0" or left_out or not tried:
            continue
        if any(row["robot_falls"] is None for row in tried):
            raise ValueError(f"{run}: {method} has not walked on the robot yet")
        found[method] = _found(tried, [r for r in mine if r["candidate"] == CHOSEN],
                               base)  # fmt: skip
    asked = methods is None or EXPLAINED in methods
    if asked and (run / SKIPPED).exists():
        found[EXPLAINED] = Found(None, None, None, None, 0, 0)
    return found


def _found(tried: Sequence[dict], chosen: Sequence[dict], base: float) -> Found:
    """One method from its candidates and its winner's fresh walks."""

    def gain(row: dict[str, Any]) -> float:
        return 100.0 * (row["robot_velocity_m_s"] / base - 1.0)

    stable = [row for row in tried if row["robot_falls"] == 0]
    best = max(stable, key=gain, default=None)
    again = chosen[0] if chosen else None
    return Found(
        gain=None if best is None else gain(best),
        generation=None if best is None else best["generation"],
        confirmed=None if again is None else gain(again),
        confirmed_falls=None if again is None else again["robot_falls"],
        falls=sum(row["robot_falls"] for row in tried),
        walks=sum(row["robot_rollouts"] for row in tried),
    )


class Line(NamedTuple):
    """One method over all trials."""

    method: str
    trials: int
    gain: Interval  # %, mean over the trials that did not fail (the paper's column)
    useful: Interval  # %, mean over all trials, 0 for one that failed
    failures: int
    generation: float  # mean, of the trials that did not fail
    stood: int  # of these, winners that stood all fresh walks and were faster there
    confirmed: Interval  # %, gain of these winners on fresh walks
    falls: Interval  # share of all candidates' walks after the first generation


def line(method: str, found: Sequence[Found], seed: int = 0) -> Line:
    """Sum up one method's trials."""
    good = [each for each in found if not each.failed]
    again = [each.confirmed for each in good if each.confirmed is not None]
    fell, walks = sum(e.falls for e in found), sum(e.walks for e in found)
    return Line(
        method=method,
        trials=len(found),
        gain=mean([each.useful for each in good], seed),
        useful=mean([each.useful for each in found], seed),
        failures=len(found) - len(good),
        generation=mean([float(e.generation or 0) for e in good], seed).mean,
        stood=sum(e.confirmed_falls == 0 and (e.confirmed or 0.0) > 0 for e in good),
        confirmed=mean(again, seed),
        falls=share_interval(fell, walks) if walks else mean([]),
    )


def mean(samples: Sequence[float], seed: int = 0) -> Interval:
    """Mean over trials with a 95 % percentile bootstrap; NaN of no trials.

    Of ten normal samples it covers the mean in 90 % instead of 95, of three in 75.
    """
    if not samples:
        return Interval(float("nan"), -np.inf, np.inf)
    values = np.asarray(samples, float)
    if len(values) < 2:
        return Interval(float(values[0]), -np.inf, np.inf)
    drawn = np.random.default_rng(seed).choice(values, (DRAWS, len(values)))
    low, high = np.quantile(drawn.mean(-1), [0.025, 0.975])
    return Interval(float(values.mean()), float(low), float(high))


class Paired(NamedTuple):
    """One method against another in the same trials."""

    trials: int
    difference: Interval  # points of theta0's speed: mean of this minus the other
    p: float  # two-sided; sign flips of the differences, all of them up to 16 trials
    kept: Interval  # the same of gains on fresh walks
    p_kept: float
    fewer: int  # trials in which only the other failed
    more: int  # trials in which only this one failed
    p_failures: float  # two-sided exact McNemar
    fallen: Interval  # points: falls of candidates' walks, this minus the other
    p_fallen: float  # as of gains


def paired(these: Sequence[Found], others: Sequence[Found], seed: int = 0) -> Paired:
    """Compare two methods, trial by trial; a failed trial gains nothing.

    Raises:
        ValueError: not the same trials.
    """
    if len(these) != len(others) or not these:
        raise ValueError("paired tests need the same trials of both methods")
    both = list(zip(these, others, strict=True))

    def apart(field: str) -> tuple[Interval, float]:
        each = np.array([getattr(a, field) - getattr(b, field) for a, b in both])
        each = each[np.isfinite(each)]  # falls: where both methods' candidates walked
        p = _flipped(each, seed) if len(each) else float("nan")
        return mean(each.tolist(), seed), p

    fewer = sum(b.failed and not a.failed for a, b in both)
    more = sum(a.failed and not b.failed for a, b in both)
    told = fewer + more
    p_failures = stats.binomtest(fewer, told).pvalue if told else 1.0
    return Paired(
        len(both), *apart("useful"), *apart("kept"), fewer, more, float(p_failures),
        *apart("fallen"),
    )  # fmt: skip


def _flipped(apart: np.ndarray, seed: int) -> float:
    """Two-sided p of a mean difference, were every sign as likely as the other."""
    if len(apart) < 2 or not apart.any():
        return 1.0
    result = stats.permutation_test(
        (apart,), np.mean, permutation_type="samples", n_resamples=2**16,
        rng=np.random.default_rng(seed),
    )  # fmt: skip
    return float(result.pvalue)


def corrected(values: Sequence[float]) -> list[float]:
    """P values [n] of one family of tests, corrected for their number (Holm 1979).

    NaN is a test without data: it stays so, and counts as none.
    """
    found = np.asarray(values, float)
    order = np.argsort(found)[: np.isfinite(found).sum()]
    steps = np.maximum.accumulate(found[order] * np.arange(len(order), 0, -1))
    out = np.full(len(found), np.nan)
    out[order] = np.minimum(steps, 1.0)
    return out.tolist()


def read_trials(folder: Path) -> dict[str, dict[int, dict[str, Found]]]:
    """Results of trials by robot and number: {robot: {trial: {method: Found}}}."""
    trials: dict[str, dict[int, dict[str, Found]]] = {}
    for path in sorted(folder.glob("*.json")):
        text = read_json(path)
        found = {name: Found(**row) for name, row in text["methods"].items()}
        trials.setdefault(text["robot"], {})[text["trial"]] = found
    return trials
