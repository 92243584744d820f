"""From claims to a verdict: none, named, ambiguous or unknown."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gatjax.diagnosis import case as cases
from gatjax.diagnosis.claims import LATER, Claim
from gatjax.diagnosis.findings import adequate, whole, worth_naming
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis
from gatjax.diagnosis.judge import Judge

TEMPER = 0.5  # of the log evidence, so that probabilities are calibrated
CERTAIN = 0.8  # probability from which a cause is named
GUESS = 0.2  # probability that the first cause needs: what beats it is no finding
LIKELY = 0.5  # probability that a further cause needs to be told at all
CLOSE = 3.0  # nats: two causes that the data cannot tell apart
MARGIN = 10.0  # nats: an alias is told apart; two causes beat an unnamed law
STRAINED = 30.0  # squared deviations of a joint whose tolerances imitate something
ALIASES = (
    frozenset({"command_delay", "measurement_delay"}),
    frozenset({"damping_error", "viscous_friction"}),
)
"""Causes that logs of powered joints cannot tell apart (docs/diagnosis.md)."""
ONE_JOINT = frozenset({"com_shift", "gravity_tilt"})
COVERED = {"payload": frozenset({"com_shift"})}  # it shifts the centre, too


class Cause(NamedTuple):
    """A named cause with what else it could be."""

    claim: Claim
    probability: float
    rivals: list[tuple[Claim, float]]  # best first, with their probabilities
    equivalent: list[str]
    borne_out: bool = True  # by logs of another motion, where there are some


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
    if verdict.causes or spent < STRAINED:
        return verdict
    other = decide(judge)
    better = other.judge.evidence() - verdict.judge.evidence() > LATER
    drawn = len(other.judge.case.pulled) > len(verdict.judge.case.pulled)
    return other if other.causes and better and not drawn else verdict


def decide(judge: Judge) -> Verdict:
    """Name causes one after the other until nothing worth naming is left."""
    causes: list[Cause] = []
    law: Claim | None = None
    claims = judge.claims()
    fresh: Judge | None = judge.fork()
    while len(causes) < judge.most:
        best = next((c for c in claims if worth_naming(judge, c)), None)
        if best is None:
            break
        if not (judge.confirmed(best) or whole(judge, best)):
            named = _pair(judge, claims, best)
            if named is None:
                law = best if not best.hypothesis.cause else None
                break
            best = named
        cause = _weighed(judge, best, claims)
        if cause.probability < (LIKELY if causes else GUESS):
            break
        causes.append(cause._replace(claim=judge.accept(best)))
        if len(causes) == 2 and fresh is not None:
            judge, causes = _exchanged(judge, causes, fresh)
            fresh = None
        if len(causes) == judge.most:
            break
        count = len(judge.joints)
        told = [cause.claim for cause in causes]
        claims = [c for c in judge.claims() if not _again(c, told, count)]
    left = [k for k in range(len(judge.joints)) if not adequate(judge, k)]
    if law is not None:
        left = sorted({*left, *law.where})
    causes = [_doubted(cause, left) for cause in causes]
    return Verdict(word(causes, left), causes, left, law, claims, judge)


def _exchanged(
    judge: Judge, causes: list[Cause], fresh: Judge
) -> tuple[Judge, list[Cause]]:
    """Two causes at one joint, the first one looked for again beside the second.

    What explains most alone need not be there once the other one is known.

    Args:
        judge: has accepted both.
        causes: the two.
        fresh: a judge that has accepted none.
    """
    first, second = causes[0].claim, causes[1].claim
    told = len(second.own) or second.lost
    if set(first.fits) != set(second.fits) or not told:
        return judge, causes
    alone = fresh.accept(fresh.refitted(second))
    kept = causes[1]._replace(claim=alone)
    claims = [c for c in fresh.claims() if not _again(c, [alone], len(fresh.joints))]
    best = next((c for c in claims if worth_naming(fresh, c)), None)
    name = frozenset({first.hypothesis.cause})
    if best is not None and (_same(best, first, name) or not whole(fresh, best)):
        return judge, causes
    least, found = -LATER, [kept]
    if best is not None:
        other = _weighed(fresh, best, claims)
        least, found = CLOSE, [kept, other._replace(claim=fresh.accept(best))]
    freed = len(judge.case.pulled) - len(fresh.case.pulled)  # drawn ones look better
    better = fresh.evidence() - judge.evidence() > least
    return (fresh, found) if freed > 0 or (freed == 0 and better) else (judge, causes)


def _again(claim: Claim, told: list[Claim], joints: int) -> bool:
    """Whether a claim repeats a cause, or its alias, where it is known already."""

    def covered(known: Claim) -> frozenset[str]:
        more = COVERED.get(known.hypothesis.cause, frozenset())
        return alias(known.hypothesis, joints) | more

    return any(
        claim.hypothesis.cause in covered(known) and set(claim.where) & set(known.where)
        for known in told
    )


def _doubted(cause: Cause, left: list[int]) -> Cause:
    """A cause that leaves its own joint unexplained is no more than a guess."""
    if set(cause.claim.where) & set(left) and len(cause.claim.where) < 4:
        return cause._replace(probability=min(cause.probability, 0.5))
    return cause


def word(causes: list[Cause], left: list[int]) -> str:
    """none, named, ambiguous or unknown, for causes and joints left unexplained."""
    if left:
        return "unknown"
    if not causes:
        return "none"
    sure = all(cause.probability >= CERTAIN for cause in causes)
    return "named" if sure else "ambiguous"


def _pair(judge: Judge, claims: list[Claim], law: Claim) -> Claim | None:
    """The first of two named causes that explain a joint better than an unnamed law."""
    named = [
        claim for claim in claims
        if claim.hypothesis.cause and claim.gain > LATER
        and set(claim.where) & set(law.where)
    ][:2]  # fmt: skip
    for first in named:
        trial = judge.fork()
        known, count = trial.accept(first), len(trial.joints)
        left = [c for c in trial.claims() if not _again(c, [known], count)]
        second = next((c for c in left if worth_naming(trial, c)), None)
        if second is None or not whole(trial, second):
            continue
        if law.hypothesis.cause or first.gain + second.gain > law.gain + MARGIN:
            return first
    return None


def alias(hypothesis: Hypothesis, joints: int) -> frozenset[str]:
    """The causes that count as one with a hypothesis, itself included."""
    classes = (*ALIASES, ONE_JOINT) if joints == 1 else ALIASES
    for group in classes:
        if hypothesis.cause in group:
            return group
    return frozenset({hypothesis.cause})


def _weighed(judge: Judge, best: Claim, claims: list[Claim]) -> Cause:
    """Probability of a claim against its rivals; aliases count as one."""
    count = len(judge.joints)
    mine = alias(best.hypothesis, count)
    rivals = [c for c in claims if c.rivals(best) and c is not best]
    gains = np.array([best.gain, *(c.gain for c in rivals)])
    weights = np.exp(TEMPER * (gains - gains.max()))
    same = np.array([True, *(_same(c, best, mine) for c in rivals)])
    probability = float(
        weights[same].sum() / (weights.sum() + np.exp(-TEMPER * gains[0]))
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


def _same(claim: Claim, best: Claim, aliases: frozenset[str]) -> bool:
    """Whether a rival says the same: cause or alias, and place."""
    return claim.hypothesis.cause in aliases and claim.place() == best.place()
