"""Two causes that share a joint, each looked for again beside the other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gatjax.diagnosis import pairs
from gatjax.diagnosis.aliases import alias
from gatjax.diagnosis.claims import LATER, Claim, price
from gatjax.diagnosis.findings import adequate, whole, worth_naming
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.weighing import (
    CLOSE,
    LIKELY,
    MARGIN,
    TEMPER,
    Cause,
    alike,
    further,
    told_again,
    weighed,
)

LOCAL = 2  # joints at most of a cause that may give way to two others
TRIED = 4  # causes that are tried in the place of another one


class Before(NamedTuple):
    """What was known when a cause was chosen, and the claims, best first."""

    judge: Judge
    claims: list[Claim]


def coupled(before: Judge, couple: pairs.Couple) -> tuple[Judge, list[Cause]]:
    """A judge that has accepted two causes, and each of them weighed beside the other.

    There are none if the first one is not found again beside the second.

    Args:
        before: a judge that has accepted neither.
        couple: the two; its judge accepts the second here.
    """
    judge, other, first = couple.judge, before.fork(), couple.first
    last = weighed(judge, couple.second, couple.claims)
    last = last._replace(claim=judge.accept(couple.second))
    alone = other.accept(other.refitted(last.claim))
    claims = further(other, [last._replace(claim=alone)])
    found = told_again(other, first, claims)
    if found is None:
        return judge, []
    kept = judge.accepted[len(before.accepted)]
    return judge, [found._replace(claim=kept), last]


def exchanged(
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
    claims = further(fresh, [kept])
    worth = [c for c in claims if c.rivals(first) and worth_naming(fresh, c)]
    if not worth:
        goes = _more(judge, fresh) > -LATER
        return (fresh, [kept]) if goes else (judge, causes)
    mine, (best, *_) = alias(first.hypothesis, len(judge.joints)), worth
    if not whole(fresh, best):
        return judge, causes
    if alike(best, first, mine):
        found = told_again(fresh, first, claims) or other
        return judge, [found if cause is other else cause for cause in causes]
    near = [c for c in worth if best.gain - c.gain < MARGIN and whole(fresh, c)]
    tried = [(judge, other)]
    for claim in [c for c in near if not alike(c, first, mine)][:TRIED]:
        trial, cause = fresh.fork(), weighed(fresh, claim, claims)
        tried.append((trial, cause._replace(claim=trial.accept(claim))))
    chosen, found = _settled(tried)
    if chosen is judge:
        return judge, [found if cause is other else cause for cause in causes]
    return chosen, [kept, found]


def _settled(tried: list[tuple[Judge, Cause]]) -> tuple[Judge, Cause]:
    """The cause that explains most on loads along its own motion, and its judge.

    What is as good is named with it.
    """
    (first, _), count = tried[0], len(tried[0][0].joints)
    gains = np.array(
        [_more(first, judge) - price(cause.claim, count) for judge, cause in tried]
    )
    best = int(np.argmax(gains))
    judge, cause = tried[best]
    if np.isinf(gains[best]):
        return judge, cause
    names = [each.claim.hypothesis.cause for _, each in tried]
    mine = alias(cause.claim.hypothesis, count)
    shares = np.exp(TEMPER * (gains - gains.max()))
    own = sum(share for share, name in zip(shares, names, strict=True) if name in mine)
    near = {
        name for gain, name in zip(gains, names, strict=True)
        if gain > gains[best] - CLOSE
    }  # fmt: skip
    also = (mine & set(cause.equivalent) | near) - {names[best]}
    likely = float(own / shares.sum())
    return judge, cause._replace(probability=likely, equivalent=sorted(also))


def _more(judge: Judge, other: Judge) -> float:
    """Nats by which another judge explains more.

    One that draws fewer joints to their measured motion is better, whatever it says;
    one that draws more, or leaves other runs aside, is worse.
    """
    if other.case.aside != judge.case.aside:
        return -np.inf
    freed = len(judge.case.pulled) - len(other.case.pulled)
    return freed * np.inf if freed else other.evidence() - judge.evidence()


def instead(
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
    others = [claim for claim in claims if not alike(claim, tried, name)]
    couple = pairs.couple(prior, others, min(bad or last))
    trial, both = coupled(prior, couple) if couple else (judge, [])
    drawn = len(trial.case.pulled) > len(judge.case.pulled)
    fits = both and not drawn and all(adequate(trial, k) for k in last)
    same = trial.case.aside == judge.case.aside
    good = bad or (same and trial.evidence() > judge.evidence() - LATER)
    if fits and good and min(cause.probability for cause in both) > LIKELY:
        return trial, [*causes[:start], *both]
    return judge, causes
