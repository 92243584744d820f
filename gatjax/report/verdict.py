"""The one sentence on top of the page: what came out, also when nothing did."""

from __future__ import annotations

from typing import Literal, NamedTuple

from gatjax.report.intervals import Interval, difference_interval
from gatjax.report.tables import (
    BASELINES,
    UNGROUNDED,
    Candidate,
    Method,
    Summary,
    faster,
)
from gatjax.report.wording import number, percent, span

Kind = Literal["better", "safer", "unclear", "not better", "no comparison", "no data"]


class Verdict(NamedTuple):
    """Did grounding beat no grounding, and the sentence that says so."""

    kind: Kind
    sentence: str


def judge(summary: Summary) -> Verdict:
    """Say which walk is fastest without falls and whether grounding paid."""
    if not any(method.candidates for method in summary.methods):
        walked = "only theta0 has walked" if summary.theta0 else "nothing has walked"
        return Verdict(
            "no data", f"No verdict yet: {walked} on the robot, no learned walk has."
        )
    kind, grounding = grounding_clause(summary.methods)
    return Verdict(kind, f"{fastest_clause(summary)}; {grounding}.")


def fastest_clause(summary: Summary) -> str:
    """Name the fastest method that never fell and its gain over theta0."""
    standing = [method for method in summary.methods if method.best is not None]
    if not standing:
        return "Every learned walk fell on the robot at least once"
    ranked = sorted(standing, key=_speed, reverse=True)
    first = ranked[0]
    speed = f"{number(_speed(first))} cm/s"
    if summary.theta0 is None:
        against = "theta0 was not evaluated, so its gain is unknown"
    elif first.gain is None:
        against = "theta0 did not walk, so there is no gain to give"
    else:
        against = gain_words(first.gain)
    rival = tie_with(ranked)
    return (
        f"The fastest walk on the robot without a fall is from {first.label}"
        f"{rival}: {speed}, {against}"
    )


def gain_words(gain: Interval) -> str:
    """Say the gain over theta0 in words that fit its interval."""
    size, ends = number(abs(gain.mean), 0), span(gain, 0, sign=True)
    if gain.low > 0.0:
        return f"{size} % faster than theta0 (95 % interval {ends} %)"
    if gain.high < 0.0:
        return f"{size} % slower than theta0 (95 % interval {ends} %)"
    if not gain.known:
        return f"{number(gain.mean, 0, sign=True)} % against theta0 ({ends})"
    return f"not clearly different from theta0 (95 % interval {ends} %)"


def tie_with(ranked: list[Method]) -> str:
    """Name the methods whose best walk cannot be told from the first one."""
    first = ranked[0].best
    ties = [
        method.label
        for method in ranked[1:]
        if first and method.best and faster(first, method.best).low <= 0.0
    ]
    return f" (level with {' and '.join(ties)})" if ties else ""


def grounding_clause(methods: list[Method]) -> tuple[Kind, str]:
    """Compare the best grounded method with no grounding."""
    evaluated = [method for method in methods if method.candidates]
    ungrounded = next((each for each in evaluated if each.name == UNGROUNDED), None)
    grounded = [method for method in evaluated if method.name not in BASELINES]
    if ungrounded is None or not grounded:
        lacking = "no ungrounded method" if grounded else "no grounded method"
        return "no comparison", (
            f"whether grounding helps cannot be said, because {lacking} was evaluated"
        )
    champion = max(grounded, key=_speed)
    name = f"grounding ({champion.label})"
    falls, fall_words = compare_falls(champion, ungrounded)
    if champion.best is None or ungrounded.best is None:
        return _one_cannot_stand(champion, ungrounded, name, falls, fall_words)
    return _both_stand(champion.best, ungrounded.best, name, falls, fall_words)


def compare_falls(grounded: Method, ungrounded: Method) -> tuple[int, str]:
    """Return +1, 0, -1 for fewer, unclear, more falls, and the words for it."""
    if grounded.falls is None or ungrounded.falls is None:
        return 0, "falls were not compared after the first generation"
    one, other = grounded.falls, ungrounded.falls
    words = (
        f"fell in {percent(one.share.mean)} of its walks after the first generation "
        f"against {percent(other.share.mean)}"
    )
    change = difference_interval(one.shares, other.shares)
    if change.high < 0.0:
        return 1, words
    if change.low > 0.0:
        return -1, words
    return 0, f"{words}, too few to tell apart"


def _one_cannot_stand(
    grounded: Method, ungrounded: Method, name: str, falls: int, fall_words: str
) -> tuple[Kind, str]:
    if grounded.best is not None:
        return "better", (
            f"{name} beat no grounding, of which every candidate fell at least once"
        )
    if ungrounded.best is not None:
        return "not better", (
            f"{name} did not beat no grounding: every grounded candidate fell at least "
            "once"
        )
    if falls > 0:
        return "safer", f"{name} did not prevent falls but {fall_words}"
    return "not better", f"{name} did not beat no grounding: it {fall_words}"


def _both_stand(
    grounded: Candidate, ungrounded: Candidate, name: str, falls: int, fall_words: str
) -> tuple[Kind, str]:
    change = faster(grounded, ungrounded)
    size, ends = number(abs(change.mean)), span(change, sign=True)
    also = "but" if falls < 0 else "and"
    if change.low > 0.0:
        return "better", (
            f"{name} beat no grounding by {size} cm/s ({ends}) {also} {fall_words}"
        )
    if change.high < 0.0:
        words = f"did not beat no grounding: {size} cm/s slower ({ends})"
    else:
        words = (
            f"did not make the walk measurably faster than no grounding "
            f"({number(change.mean, sign=True)} cm/s, {ends})"
        )
    if falls > 0:
        return "safer", f"{name} {words}, but {fall_words}"
    kind: Kind = "not better" if change.high < 0.0 else "unclear"
    return kind, f"{name} {words} and {fall_words}"


def _speed(method: Method) -> float:
    velocity = method.best.velocity if method.best else None
    return velocity.mean if velocity else float("-inf")
