"""Named causes: how probable each is among what else it could be."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gatjax.diagnosis.aliases import again, alias
from gatjax.diagnosis.claims import PLACE, Claim, occam
from gatjax.diagnosis.judge import Judge

LIKELY = 0.5  # probability that a cause needs to be told at all; the first may tie
TEMPER = 0.5  # of the log evidence, so that probabilities are calibrated
CLOSE = 3.0  # nats: two causes that the data cannot tell apart
MARGIN = 10.0  # nats: an alias is told apart, or a rival not looked at any more


class Cause(NamedTuple):
    """A named cause with what else it could be."""

    claim: Claim
    probability: float
    rivals: list[tuple[Claim, float]]  # best first, with their probabilities
    equivalent: list[str]
    borne_out: bool | None = None  # by logs of another motion; None: nobody asked


def further(judge: Judge, causes: list[Cause]) -> list[Claim]:
    """Claims beside causes that a judge has accepted."""
    told, count = [cause.claim for cause in causes], len(judge.joints)
    return [c for c in judge.claims() if not again(c, told, count)]


def weighed(judge: Judge, best: Claim, claims: list[Claim]) -> Cause:
    """Probability of a claim against its rivals; aliases count as one."""
    count = len(judge.joints)
    mine = alias(best.hypothesis, count)
    rivals = _rivals(judge, best, claims)
    shares = _shares([best, *rivals])
    same = np.array([True, *(alike(c, best, mine) for c in rivals)])
    probability = float(shares[:-1][same].sum())
    shares = shares[1:-1] / shares[:-1].sum()
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


def worth_telling(
    judge: Judge, best: Claim, claims: list[Claim], causes: list[Cause]
) -> bool:
    """Whether a claim is likely enough to be told, wherever it is.

    The first one about its joints may tie with others: it is told with them. Another
    place of the same cause does not make it less likely.

    Args:
        judge: what is known.
        best: the claim.
        claims: all, best first.
        causes: that are told already.
    """
    mine = alias(best.hypothesis, len(judge.joints))
    rivals = _rivals(judge, best, claims)
    same = np.array([True, *(c.hypothesis.cause in mine for c in rivals)])
    if _shares([best, *rivals])[:-1][same].sum() >= LIKELY:
        return True
    alone = not any(best.rivals(cause.claim) for cause in causes)
    return alone and not _beaten(judge, best, rivals)


def _rivals(judge: Judge, best: Claim, claims: list[Claim]) -> list[Claim]:
    """Other claims about the same logs, best first, by what they explain of them.

    What one explains at joints that the best claim is not about is no reason against
    it: there both may be true.
    """
    found = [c for c in claims if c.rivals(best) and c is not best]
    if len(best.where) == len(judge.joints):
        return found

    def there(claim: Claim) -> Claim:
        shared = set(claim.fits) & set(best.fits)
        other = claim.body is not None or claim.lost or claim.stance is not None
        if other or len(shared) == len(claim.fits):
            return claim
        gain = sum(judge.score(k, claim.fits[k]) for k in shared)
        gain -= occam(claim.hypothesis, claim.own, claim.covariance)
        gain -= PLACE * len(shared)
        return claim._replace(gain=min(gain, claim.gain))

    return sorted(map(there, found), key=lambda claim: -claim.gain)


def _shares(claims: list[Claim]) -> np.ndarray:
    """Probabilities of claims, of which one is right, and last that none is."""
    gains = np.array([*(claim.gain for claim in claims), 0.0])
    weights = np.exp(TEMPER * (gains - gains.max()))
    return weights / weights.sum()


def told_again(judge: Judge, told: Claim, claims: list[Claim]) -> Cause | None:
    """A claim weighed among those beside another cause, if they say the same again."""
    mine, name = alias(told.hypothesis, len(judge.joints)), told.hypothesis.cause
    same = [c for c in claims if alike(c, told, mine)]
    if not same:
        return None
    best = min(same, key=lambda c: c.hypothesis.cause != name)
    found = weighed(judge, best, claims)
    equivalent = sorted({*found.equivalent, best.hypothesis.cause} - {name})
    return found._replace(claim=told, equivalent=equivalent)


def _beaten(judge: Judge, best: Claim, rivals: list[Claim]) -> bool:
    """Whether a catalogued rival that is no finding explains more; then neither is."""
    mine = alias(best.hypothesis, len(judge.joints))
    return any(
        c.hypothesis.cause and c.gain > best.gain and not alike(c, best, mine)
        for c in rivals
    )


def elsewhere(claim: Claim, told: Claim) -> bool:
    """Whether it is another value of a cause, at other joints: no further cause."""
    same = claim.hypothesis.law == told.hypothesis.law
    return same and bool(claim.where) and set(claim.where).isdisjoint(told.where)


def alike(claim: Claim, best: Claim, aliases: frozenset[str]) -> bool:
    """Whether a rival says the same: cause or alias, and place."""
    return claim.hypothesis.cause in aliases and claim.place() == best.place()
