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
POOR = 1.7  # times the noise that two causes leave where two others may leave less
TRIED = 4  # others at most that are tried in the place of a cause


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
        goes = _loses_nothing(judge, fresh)
        return (fresh, [kept]) if goes else (judge, causes)
    mine, (best, *_) = alias(first.hypothesis, len(judge.joints)), worth
    if not whole(fresh, best):
        return judge, causes
    if alike(best, first, mine):
        found = told_again(fresh, first, worth)
        assert found is not None
        return judge, [found if cause is other else cause for cause in causes]
    near = [c for c in worth if best.gain - c.gain < MARGIN and whole(fresh, c)]
    near = [c for c in near if len(c.own) and not alike(c, first, mine)]
    tried = [(judge, other)]
    for claim in near[:TRIED] if len(best.own) else [best]:  # losses are priced by gain
        trial, cause = fresh.fork(), weighed(fresh, claim, claims)
        tried.append((trial, cause._replace(claim=trial.accept(claim))))
    chosen, found = _settled(tried)
    if chosen is judge:
        return judge, [found if cause is other else cause for cause in causes]
    return chosen, [kept, found]


def _settled(tried: list[tuple[Judge, Cause]]) -> tuple[Judge, Cause]:
    """The cause that explains most on loads along its own motion, and its judge.

    What is as good there is named with it. Joints that are drawn to their measured
    motion look better than they are: only judges that draw fewest are compared, and
    none that leaves other runs aside than the first one.
    """
    first, count = tried[0][0].case, len(tried[0][0].joints)
    tried = [each for each in tried if each[0].case.aside == first.aside]
    fewest = min(len(judge.case.pulled) for judge, _ in tried)
    tried = [each for each in tried if len(each[0].case.pulled) == fewest]
    gains = np.array(
        [judge.evidence() - price(cause.claim, count) for judge, cause in tried]
    )
    judge, cause = tried[int(np.argmax(gains))]
    here = [
        (gain, each.claim) for gain, (_, each) in zip(gains, tried, strict=True)
        if each.claim.place() == cause.claim.place()
    ]  # fmt: skip
    mine = alias(cause.claim.hypothesis, count)
    own = [gain for gain, claim in here if claim.hypothesis.cause in mine]
    near = {c.hypothesis.cause for gain, c in here if gain > gains.max() - CLOSE}
    likely = np.exp(TEMPER * (np.array(own) - gains.max())).sum()
    likely /= np.exp(TEMPER * (gains - gains.max())).sum()
    also = (mine & set(cause.equivalent) | near) - {cause.claim.hypothesis.cause}
    return judge, cause._replace(probability=float(likely), equivalent=sorted(also))


def _loses_nothing(judge: Judge, other: Judge) -> bool:
    """Whether another judge explains as much as one does, or draws fewer joints."""
    if other.case.aside != judge.case.aside:
        return False
    freed = len(judge.case.pulled) - len(other.case.pulled)
    lost = judge.evidence() - other.evidence()
    return freed > 0 or (freed == 0 and lost < LATER)


def instead(
    judge: Judge, causes: list[Cause], before: list[Before]
) -> tuple[Judge, list[Cause]]:
    """Two causes instead of the last ones, if these are many or explain too little.

    Two that leave a little give way to two that explain more by 10 nats (`MARGIN`).

    Args:
        judge: has accepted the causes.
        causes: so far.
        before: what was known before each of them.
    """
    last = set(causes[-1].claim.fits)
    if not last or not judge.apart(last):
        return judge, causes  # about floor, soles or inertial unit, or felt by them
    start = next(n for n, c in enumerate(causes) if last & set(c.claim.fits))
    bad = [k for k in last if not adequate(judge, k)]
    many, two = len(causes) - start > 2, len(causes) - start == 2
    (prior, claims), tried = before[start], causes[start].claim
    poor = [k for k in last
            if two and judge.known[k].rms() > POOR * judge.joints[k].noise]  # fmt: skip
    room = len(prior.accepted) == start and start + 2 <= judge.most
    alone = all(set(c.claim.fits) <= last for c in causes[start:])
    if not (room and alone and len(last) <= LOCAL and (bad or many or poor)):
        return judge, causes
    name = frozenset({tried.hypothesis.cause})
    others = [claim for claim in claims if not alike(claim, tried, name)]
    couple = pairs.couple(prior, others, min(bad or poor or last))
    trial, both = coupled(prior, couple) if couple else (judge, [])
    drawn = len(trial.case.pulled) > len(judge.case.pulled)
    fits = both and not drawn and all(adequate(trial, k) for k in last)
    same = trial.case.aside == judge.case.aside
    least = -LATER if many else MARGIN
    good = bad or (same and trial.evidence() > judge.evidence() + least)
    if fits and good and min(cause.probability for cause in both) > LIKELY:
        return trial, [*causes[:start], *both]
    return judge, causes
