"""The one sentence on top of the page: what came out, also when nothing did."""

from __future__ import annotations

from typing import Literal, NamedTuple

from gatjax.report.intervals import LEVEL, Interval
from gatjax.report.tables import (
    UNGROUNDED,
    Method,
    Summary,
    faster,
    fewer_falls,
    gain_over,
    label_of,
    speed,
)
from gatjax.report.wording import number, percent, span

Kind = Literal["better", "safer", "unclear", "not better", "no comparison", "no data"]


class Verdict(NamedTuple):
    """Did grounding beat no grounding, and the sentence that says so."""

    kind: Kind
    sentence: str


class Pair(NamedTuple):
    """What the primary comparison rests on."""

    grounded: Method
    ungrounded: Method
    name: str  # of the grounded one, in words
    falls: int  # 1 fewer than without grounding, 0 unclear, -1 more
    fall_words: str


def judge(summary: Summary) -> Verdict:
    """Say which walk is fastest without falls and whether grounding paid."""
    if not any(method.evaluated for method in summary.methods):
        walked = "only theta0 has walked" if summary.theta0 else "nothing has walked"
        return Verdict(
            "no data", f"No verdict yet: {walked} on the robot, no learned walk has."
        )
    kind, grounding = grounding_clause(summary)
    opening = "In this run, one search a method"
    return Verdict(kind, f"{opening}, {fastest_clause(summary)}; {grounding}.")


def fastest_clause(summary: Summary) -> str:
    """Name the fastest method that never fell and its gain over theta0."""
    ranked = summary.ranked
    if not ranked:
        which = max(method.which for method in summary.methods)
        walks = f"no learned walk{which} got through its walks on the robot"
        return f"{walks} without a fall"
    first = ranked[0]
    what = "the fastest walk on the robot without a fall"
    if not first.stands:
        what = "every winner fell at least once; the fastest, its falls aside,"
    gain = gain_over(summary.theta0, first.best, 1.0 - (1.0 - LEVEL) / len(ranked))
    if summary.theta0 is None:
        against = "theta0 was not evaluated, so its gain is unknown"
    elif gain is None:
        against = "theta0 did not walk, so there is no gain to give"
    else:
        against = gain_words(gain, len(ranked))
    rate = f"{number(speed(first))} cm/s"
    return (
        f"{what} is from {first.label}{tie_with(ranked)}: {rate}, {against}, "
        f"{evidence(first)}"
    )


def evidence(method: Method) -> str:
    """Say on which walks the numbers of a method rest."""
    best = method.best
    if best is None:
        return f"no walk without a fall{method.which}"
    if method.confirmed:
        return f"{best.falls} of {best.rollouts} confirmation walks fell"
    return f"not confirmed: picked by the same {best.rollouts} walks"


def gain_words(gain: Interval, among: int) -> str:
    """Say the gain over theta0 in words that fit its interval."""
    size, ends = number(abs(gain.mean), 0), span(gain, 0, sign=True)
    pick = f", widened for the pick among {among}" if among > 1 else ""
    if gain.low > 0.0:
        return f"{size} % faster than theta0 (95 % interval {ends} %{pick})"
    if gain.high < 0.0:
        return f"{size} % slower than theta0 (95 % interval {ends} %{pick})"
    if not gain.known:
        return f"{number(gain.mean, 0, sign=True)} % against theta0 ({ends})"
    return f"not clearly different from theta0 (95 % interval {ends} %{pick})"


def tie_with(ranked: list[Method]) -> str:
    """Name the methods whose best walk cannot be told from the first one."""
    first = ranked[0]
    ties = [
        method.label
        for method in ranked[1:]
        if first.best
        and method.best
        and method.stands == first.stands
        and method.confirmed == first.confirmed
        and faster(first.best, method.best).low <= 0.0
    ]
    *most, last = ties or [""]
    listed = f"{', '.join(most)} and {last}" if most else last
    return f" (level with {listed})" if ties else ""


def grounding_clause(summary: Summary) -> tuple[Kind, str]:
    """Compare the grounded method that was named in advance with no grounding."""
    evaluated = {each.name: each for each in summary.methods if each.evaluated}
    grounded = evaluated.get(summary.grounded)
    ungrounded = evaluated.get(UNGROUNDED)
    if grounded is None or ungrounded is None:
        lacking = UNGROUNDED if grounded else summary.grounded
        return "no comparison", (
            "whether grounding helps cannot be said, because "
            f"the method “{label_of(lacking)}” did not walk on the robot"
        )
    falls, fall_words = compare_falls(grounded, ungrounded)
    name = f"grounding ({grounded.label})"
    pair = Pair(grounded, ungrounded, name, falls, fall_words)
    if grounded.best and ungrounded.best and grounded.confirmed != ungrounded.confirmed:
        open_one = ungrounded if grounded.confirmed else grounded
        return "unclear", (
            "whether grounding helps cannot be said yet, because the walk of "
            f"{open_one.label} was not confirmed with fresh seeds"
        )
    lead = _lead(pair)
    if grounded.stands and ungrounded.stands and lead is not None:
        return _both_stand(pair, lead)
    if grounded.stands:
        return _only_grounded_stands(pair, lead)
    if ungrounded.stands:
        return "not better", (
            f"{name} did not beat no grounding, which stood: "
            f"{failure_words(grounded)}, and it {fall_words}"
        )
    if falls > 0:
        return "safer", f"{name} did not prevent falls but {fall_words}"
    return "not better", f"{name} did not beat no grounding: it {fall_words}"


def compare_falls(grounded: Method, ungrounded: Method) -> tuple[int, str]:
    """Return +1, 0, -1 for fewer, unclear, more falls, and the words for it."""
    if grounded.falls is None or ungrounded.falls is None:
        return 0, "was not compared by its falls after the first generation"
    one, other = grounded.falls, ungrounded.falls
    words = (
        f"fell in {percent(one.share.mean)} of its walks after the first generation "
        f"against {percent(other.share.mean)}"
    )
    change = fewer_falls(one, other)
    if change.high < 0.0:
        return 1, words
    if change.low > 0.0:
        return -1, words
    return 0, f"{words}, too few to tell apart"


def failure_words(method: Method) -> str:
    """Why a method does not stand."""
    best = method.best
    if best is None:
        return f"every candidate of {method.label}{method.which} fell at least once"
    return f"the winner of {method.label} fell in {best.falls} of {best.rollouts} walks"


def _slower_than_theta0(method: Method) -> bool:
    return method.gain is not None and method.gain.high < 0.0


def _only_grounded_stands(pair: Pair, lead: Interval | None) -> tuple[Kind, str]:
    """No grounding fell; that is a win only with fewer falls and no loss of speed."""
    failure = failure_words(pair.ungrounded)
    if pair.falls <= 0 or _slower_than_theta0(pair.grounded):
        slow = _slower_than_theta0(pair.grounded)
        also = ", and its best walk is slower than theta0" if slow else ""
        turn = "but" if pair.falls < 0 or slow else "and in the search"
        return "unclear", (
            f"whether {pair.name} beat no grounding is unclear: {failure}, {turn} "
            f"grounding {pair.fall_words}{also}"
        )
    if lead is not None and lead.low <= 0.0:
        return "safer", (
            f"{pair.name} was not measurably faster than no grounding but "
            f"{pair.fall_words}; {failure}"
        )
    return "better", (
        f"{pair.name} beat no grounding: {failure}, and grounding {pair.fall_words}"
    )


def _lead(pair: Pair) -> Interval | None:
    """Velocity with grounding minus without, cm/s; None if one never stood."""
    one, other = pair.grounded.best, pair.ungrounded.best
    if one is None or other is None or not (one.upright and other.upright):
        return None
    return faster(one, other)


def _both_stand(pair: Pair, change: Interval) -> tuple[Kind, str]:
    name, falls, fall_words = pair.name, pair.falls, pair.fall_words
    size, ends = number(abs(change.mean)), span(change, sign=True)
    if change.low > 0.0:
        if falls >= 0 and not _slower_than_theta0(pair.grounded):
            words = f"beat no grounding by {size} cm/s ({ends}) and {fall_words}"
            return "better", f"{name} {words}"
        lost = fall_words if falls < 0 else "is slower than theta0"
        return "unclear", (
            f"{name} was {size} cm/s faster than no grounding ({ends}) but {lost}"
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
