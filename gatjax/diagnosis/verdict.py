"""From claims to a verdict: none, named, ambiguous or unknown."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from gatjax.diagnosis import agreed, everywhere, pairs
from gatjax.diagnosis import case as cases
from gatjax.diagnosis.aliases import again, alias
from gatjax.diagnosis.claims import LATER, Claim
from gatjax.diagnosis.findings import adequate, whole, worth_naming
from gatjax.diagnosis.hypotheses import COUNT
from gatjax.diagnosis.judge import Judge

TEMPER = 0.5  # of the log evidence, so that probabilities are calibrated
CERTAIN = 0.8  # probability from which a cause is named
LIKELY = 0.5  # probability that a cause needs to be told at all; the first may tie
CLOSE = 3.0  # nats: two causes that the data cannot tell apart
MARGIN = 10.0  # nats: an alias is told apart
LOCAL = 2  # joints at most of a cause that may give way to two others
MANY = 4  # joints of a cause that is sure though one of them is unexplained
STRAINED = 30.0  # squared deviations of a joint whose tolerances imitate something


class Cause(NamedTuple):
    """A named cause with what else it could be."""

    claim: Claim
    probability: float
    rivals: list[tuple[Claim, float]]  # best first, with their probabilities
    equivalent: list[str]
    borne_out: bool | None = None  # by logs of another motion; None: nobody asked


class Before(NamedTuple):
    """What was known when a cause was chosen, and the claims, best first."""

    judge: Judge
    claims: list[Claim]


class Verdict(NamedTuple):
    """What a diagnosis says."""

    verdict: str
    causes: list[Cause]
    unexplained: list[int]  # joints whose misfit no cause explains
    law: Claim | None  # the unnamed law that explains best, if there is one
    last: list[Claim]  # what was weighed after the last cause, best first
    judge: Judge


def conclude(judge: Judge) -> Verdict:
    """The verdict on settled loads, or on loads along the measured motion.

    Tolerances may take on improbable values to imitate a cause, and move the loads
    until it is hidden. It then shows on loads along the measured motion, whose noise
    can look like a cause too: one that is named there has to explain more, on loads
    along the motion that it makes itself.
    """
    start = judge.case
    case = cases.settled(start, judge.tell)
    if case is start:
        return decide(judge)
    verdict = decide(type(judge)(case, judge.tell))
    spent = max(float(fit.x[:COUNT] @ fit.x[:COUNT]) for fit in verdict.judge.known)
    if verdict.causes or verdict.law is not None or spent < STRAINED:
        return verdict
    other = decide(judge)
    better = other.judge.evidence() - verdict.judge.evidence() > LATER
    better &= other.judge.case.aside == verdict.judge.case.aside  # else of other rows
    drawn = len(other.judge.case.pulled) > len(verdict.judge.case.pulled)
    return other if other.causes and better and not drawn else verdict


def decide(judge: Judge) -> Verdict:
    """Name causes one after the other until nothing worth naming is left."""
    causes = _everywhere(judge)
    law: Claim | None = None
    claims = _further(judge, causes)
    before = [Before(judge.fork(), claims)] * len(causes)  # each of the causes
    turn = 0
    while max(len(causes), turn) < judge.most:  # a cause may come and go
        best = next((c for c in claims if worth_naming(judge, c)), None)
        if best is None:
            break
        now = Before(judge.fork(), claims)
        if not (judge.confirmed(best) or whole(judge, best)):
            room = len(causes) + 1 < judge.most
            couple = pairs.better(judge, claims, best) if room else None
            trial, both = (judge, []) if couple is None else _both(judge, couple)
            sure = both and min(cause.probability for cause in both) >= LIKELY
            if not (sure and adequate(trial, best.where[0])):
                law = best if not best.hypothesis.cause else None
                break
            judge, causes, before = trial, [*causes, *both], [*before, now, now]
        else:
            cause = _weighed(judge, best, claims)
            if cause.probability < LIKELY and (causes or _beaten(judge, best, claims)):
                break
            judge.most += any(_elsewhere(best, c.claim) for c in causes)
            causes.append(cause._replace(claim=judge.accept(best)))
            before.append(now)
            if turn == 1 and len(causes) == 2:
                was = judge
                judge, causes = _exchanged(judge, causes, before[0].judge.fork())
                before = before if judge is was else before[:1] * len(causes)
        turn += 1
        if len(causes) < judge.most:
            claims = _further(judge, causes)
    if causes:
        was = judge
        judge, causes = _instead(judge, causes, before)
        if judge is not was:
            law, claims = None, _further(judge, causes)
    left = [k for k in range(len(judge.joints)) if not adequate(judge, k)]
    if law is not None:
        left = sorted({*left, *law.where})
    if not causes:  # what was left aside is no agreement
        left = sorted({*left, *judge.case.aside})
    causes = [cause._replace(claim=judge.current(cause.claim)) for cause in causes]
    return Verdict(word(causes, left), causes, left, law, claims, judge)


def _everywhere(judge: Judge) -> list[Cause]:
    """The causes of a whole robot that is wrong in several ways, taken for known.

    None where joints agree on no value, not even nearly: a body that is heavier than
    the model's, say, is something else at each joint.
    """
    looked = judge.fork()  # on loads along the motion that causes make
    found, known = agreed.valued(looked, everywhere.causes(looked))
    if not any(agreed.common(looked, each.claims) for each in found):
        return []
    judge.case, judge.joints = looked.case, looked.joints
    judge.take([claim for each in found for claim in each.claims], known)
    every, out = tuple(range(len(judge.joints))), []
    told = {each.options[0].hypothesis.cause for each in found}
    for options, claims in found:
        mine = options[0].hypothesis.cause
        rows = [
            Claim(option.hypothesis, option.own, every, option.fits, option.gain)
            for option in options
            if option.hypothesis.cause not in told - {mine}
        ]  # fmt: skip
        cause = _weighed(judge, rows[0], rows)
        others = alias(rows[0].hypothesis, len(every)) - {mine}
        alike = sorted(others | set(cause.equivalent))  # six joints' fits part nothing
        more = sum(claim.gain for claim in claims) - rows[0].gain  # than its probes say
        rivals = [
            (rival._replace(gain=rival.gain + more, fits={}), share)
            for rival, share in cause.rivals
        ]
        for claim in claims:
            settled = {k: judge.known[k] for k in claim.where}
            claim = claim._replace(fits=settled)
            out.append(cause._replace(claim=claim, rivals=rivals, equivalent=alike))
    judge.most += len(out)
    return out


def _further(judge: Judge, causes: list[Cause]) -> list[Claim]:
    """Claims beside causes that a judge has accepted."""
    told, count = [cause.claim for cause in causes], len(judge.joints)
    return [c for c in judge.claims() if not again(c, told, count)]


def _instead(
    judge: Judge, causes: list[Cause], before: list[Before]
) -> tuple[Judge, list[Cause]]:
    """Two causes instead of the last ones, if these are many or explain too little.

    Args:
        judge: has accepted the causes.
        causes: so far.
        before: what was known before each of them.
    """
    last = set(causes[-1].claim.fits)
    if not last:
        return judge, causes  # about floor, soles or inertial unit
    start = next(n for n, c in enumerate(causes) if last & set(c.claim.fits))
    bad = [k for k in last if not adequate(judge, k)]
    many = len(causes) - start > 2
    (prior, claims), tried = before[start], causes[start].claim
    room = len(prior.accepted) == start and start + 2 <= judge.most
    alone = all(set(c.claim.fits) <= last for c in causes[start:])
    if not (room and alone and len(last) <= LOCAL and (bad or many)):
        return judge, causes
    name = frozenset({tried.hypothesis.cause})
    others = [claim for claim in claims if not _same(claim, tried, name)]
    couple = pairs.couple(prior, others, min(bad or last))
    trial, both = _both(prior, couple) if couple else (judge, [])
    drawn = len(trial.case.pulled) > len(judge.case.pulled)
    fits = both and not drawn and all(adequate(trial, k) for k in last)
    same = trial.case.aside == judge.case.aside
    good = bad or (same and trial.evidence() > judge.evidence() - LATER)
    if fits and good and min(cause.probability for cause in both) > LIKELY:
        return trial, [*causes[:start], *both]
    return judge, causes


def _both(before: Judge, couple: pairs.Couple) -> tuple[Judge, list[Cause]]:
    """A judge that has accepted two causes, and each of them weighed beside the other.

    There are none if the first one is not found again beside the second.

    Args:
        before: a judge that has accepted neither.
        couple: the two; its judge accepts the second here.
    """
    judge, other, first = couple.judge, before.fork(), couple.first
    last = _weighed(judge, couple.second, couple.claims)
    last = last._replace(claim=judge.accept(couple.second))
    alone = other.accept(other.refitted(last.claim))
    claims = _further(other, [last._replace(claim=alone)])
    mine = alias(first.hypothesis, len(judge.joints))
    same = [c for c in claims if _same(c, first, mine)]
    if not same:
        return judge, []
    best = min(same, key=lambda c: c.hypothesis.cause != first.hypothesis.cause)
    found, name = _weighed(other, best, claims), first.hypothesis.cause
    equivalent = sorted({*found.equivalent, best.hypothesis.cause} - {name})
    kept = judge.accepted[len(before.accepted)]
    return judge, [found._replace(claim=kept, equivalent=equivalent), last]


def _exchanged(
    judge: Judge, causes: list[Cause], fresh: Judge
) -> tuple[Judge, list[Cause]]:
    """Two causes that share a joint, one of them looked for again beside the other.

    What explains most alone need not be there once the other one is known. What a link
    carries, more joints bear than it may have been named at.

    Args:
        judge: has accepted both.
        causes: the two.
        fresh: a judge that has accepted none.
    """
    for other, kept in (causes, causes[::-1]):
        first, alone = other.claim, fresh.carried(kept.claim)
        told = len(alone.own) or alone.lost
        shared = set(first.fits) & set(alone.fits)
        if told and shared and (kept is causes[1] or alone.body != kept.claim.body):
            break
    else:
        return judge, causes
    kept = kept._replace(claim=fresh.accept(fresh.refitted(alone)))
    claims = _further(fresh, [kept])
    best = next((c for c in claims if worth_naming(fresh, c)), None)
    name = frozenset({first.hypothesis.cause})
    if best is not None and (_same(best, first, name) or not whole(fresh, best)):
        return judge, causes
    least, found = -LATER, [kept]
    if best is not None:
        other = _weighed(fresh, best, claims)
        least, found = CLOSE, [kept, other._replace(claim=fresh.accept(best))]
    if fresh.case.aside != judge.case.aside:
        return judge, causes  # evidence of other rows
    freed = len(judge.case.pulled) - len(fresh.case.pulled)  # drawn ones look better
    better = fresh.evidence() - judge.evidence() > least
    return (fresh, found) if freed > 0 or (freed == 0 and better) else (judge, causes)


def doubted(verdict: Verdict) -> Verdict:
    """A verdict whose causes are guesses where they leave their own joint unexplained.

    Held-out logs may have said before that a joint is explained after all.
    """
    causes = []
    for cause in verdict.causes:
        most = 0.5 if _guess(cause, verdict.causes, verdict.unexplained) else 1.0
        causes.append(cause._replace(probability=min(cause.probability, most)))
    return verdict._replace(causes=causes)


def word(causes: list[Cause], left: list[int]) -> str:
    """none, named, ambiguous or unknown, for causes and joints left unexplained.

    What is wrong at other joints takes nothing from a cause that is sure.
    """
    sure = [
        c for c in causes if c.probability >= CERTAIN and not _guess(c, causes, left)
    ]  # fmt: skip
    if left and not sure:
        return "unknown"
    if not causes:
        return "none"
    return "named" if len(sure) == len(causes) else "ambiguous"


def _guess(cause: Cause, causes: list[Cause], left: list[int]) -> bool:
    """Whether a cause, with all of its values, leaves one of few joints unexplained."""
    values = [c.claim for c in causes if c.rivals is cause.rivals]
    bad = set(cause.claim.where) & set(left)
    return bool(bad) and sum(len(claim.where) for claim in values) < MANY


def _weighed(judge: Judge, best: Claim, claims: list[Claim]) -> Cause:
    """Probability of a claim against its rivals; aliases count as one."""
    count = len(judge.joints)
    mine = alias(best.hypothesis, count)
    rivals = [c for c in claims if c.rivals(best) and c is not best]
    gains = np.array([best.gain, *(c.gain for c in rivals)])
    weights = np.exp(TEMPER * (gains - gains.max()))
    same = np.array([True, *(_same(c, best, mine) for c in rivals)])
    probability = float(
        weights[same].sum() / (weights.sum() + np.exp(-TEMPER * gains.max()))
    )
    shares = weights[1:] / weights.sum()
    near = [c for c in rivals if c.place() == best.place()]
    close = {
        c.hypothesis.cause for c in near
        if c.hypothesis.cause and best.gain - c.gain < CLOSE
    }  # fmt: skip
    told = {c.hypothesis.cause for c in near} - {
        c.hypothesis.cause for c in near if best.gain - c.gain < MARGIN
    }
    equivalent = sorted((close | mine - told) - {best.hypothesis.cause})
    return Cause(best, probability, list(zip(rivals, shares, strict=True)), equivalent)


def _beaten(judge: Judge, best: Claim, claims: list[Claim]) -> bool:
    """Whether a catalogued rival that is no finding explains more; then neither is."""
    mine = alias(best.hypothesis, len(judge.joints))
    before = itertools.takewhile(lambda claim: claim is not best, claims)
    return any(
        c.hypothesis.cause and c.rivals(best) and not _same(c, best, mine)
        for c in before
    )


def _elsewhere(claim: Claim, told: Claim) -> bool:
    """Whether it is another value of a cause, at other joints: no further cause."""
    same = claim.hypothesis.law == told.hypothesis.law
    return same and bool(claim.where) and set(claim.where).isdisjoint(told.where)


def _same(claim: Claim, best: Claim, aliases: frozenset[str]) -> bool:
    """Whether a rival says the same: cause or alias, and place."""
    return claim.hypothesis.cause in aliases and claim.place() == best.place()
