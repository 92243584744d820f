"""From claims to a verdict: none, named, ambiguous or unknown."""

from __future__ import annotations

from typing import NamedTuple

from gatjax.diagnosis import agreed, everywhere, lost, pairs
from gatjax.diagnosis import case as cases
from gatjax.diagnosis.aliases import alias
from gatjax.diagnosis.claims import LATER, Claim
from gatjax.diagnosis.exchange import Before, coupled, exchanged, instead
from gatjax.diagnosis.findings import ROUGH, adequate, whole, worth_naming
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.weighing import (
    CLOSE,
    LIKELY,
    Cause,
    elsewhere,
    further,
    weighed,
    worth_telling,
)

CERTAIN = 0.8  # probability from which a cause is named
MANY = 4  # joints of a cause that is sure though one of them is unexplained
STRAINED = 30.0  # squared deviations of a joint whose tolerances imitate something
BESIDE = 30.0  # nats of a cause where another joint has something without a name


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
    spent = max(fit.spent for fit in verdict.judge.known)
    if verdict.causes or verdict.law is not None or spent < STRAINED:
        return verdict
    other = decide(judge)
    better = other.judge.evidence() - verdict.judge.evidence() > LATER
    better &= other.judge.case.aside == verdict.judge.case.aside  # else of other rows
    drawn = len(other.judge.case.pulled) > len(verdict.judge.case.pulled)
    return other if other.causes and better and not drawn else verdict


def decide(judge: Judge) -> Verdict:
    """Name causes one after the other until nothing worth naming is left.

    A joint whose best law has no name, or whose causes are too doubtful to be told, is
    looked at no more, and others have to show theirs plainly: what disturbs one joint
    may be felt at others, and look like a cause there.
    """
    causes = _everywhere(judge)
    law: Claim | None = None
    claims = further(judge, causes)
    before = [Before(judge.fork(), claims)] * len(causes)  # each of the causes
    turn, shut = 0, frozenset[int]()
    while max(len(causes), turn) < judge.most:  # a cause may come and go
        worth = (c for c in claims if worth_naming(judge, c))
        best = next((c for c in worth if not shut or _beside(judge, c, shut)), None)
        if best is None:
            break
        best = _catalogued(judge, claims, best)
        now = Before(judge.fork(), claims)
        if judge.apart(best.fits) and not whole(judge, best):
            room = len(causes) + 1 < judge.most and not shut
            trial, both = _both(judge, claims, best) if room else (judge, [])
            if not both:
                law = law or (None if best.hypothesis.cause else best)
                shut |= set(best.fits)
                continue
            judge, causes, before = trial, [*causes, *both], [*before, now, now]
        else:
            cause = weighed(judge, best, claims)
            if not worth_telling(judge, best, claims, causes):
                shut |= set(best.fits or range(len(judge.joints)))  # all feel the floor
                continue
            judge.most += any(elsewhere(best, c.claim) for c in causes)
            causes.append(cause._replace(claim=judge.accept(best)))
            before.append(now)
            if turn == 1 and len(causes) == 2:
                was = judge
                judge, causes = exchanged(judge, causes, before[0].judge.fork())
                before = before if judge is was else before[:1] * len(causes)
        turn += 1
        if len(causes) < judge.most:
            claims = further(judge, causes)
    if causes:
        was = judge
        judge, causes = instead(judge, causes, before)
        if judge is not was:
            claims = further(judge, causes)
            if law is not None and any(law.rivals(cause.claim) for cause in causes):
                law = None
    left = [k for k in range(len(judge.joints)) if not adequate(judge, k)]
    if law is not None:
        left = sorted({*left, *law.where})
    if not causes:  # what was left aside is no agreement
        left = sorted({*left, *judge.case.aside})
    causes = [cause._replace(claim=judge.current(cause.claim)) for cause in causes]
    causes = _together(judge, causes)
    return Verdict(word(causes, left), causes, left, law, claims, judge)


def _together(judge: Judge, causes: list[Cause]) -> list[Cause]:
    """Causes, lost commands of one joint after the other as one if they are alike."""
    some = [cause for cause in causes if cause.claim.lost]
    whole = lost.together(judge, [cause.claim for cause in some])
    if whole is None:
        return causes
    sure = max(cause.probability for cause in some)
    told = some[0]._replace(claim=whole, probability=sure)
    kept = (c for c in causes if c is some[0] or not c.claim.lost)
    return [told if cause is some[0] else cause for cause in kept]


def _beside(judge: Judge, claim: Claim, shut: frozenset[int]) -> bool:
    """Whether a claim is about other joints than those, and shows plainly there."""
    own = judge.apart(claim.fits) and shut.isdisjoint(claim.fits)
    return own and claim.gain >= BESIDE


def _both(judge: Judge, claims: list[Claim], best: Claim) -> tuple[Judge, list[Cause]]:
    """Two sure causes that explain a joint better than its best claim; none if none."""
    couple = pairs.better(judge, claims, best)
    trial, both = (judge, []) if couple is None else coupled(judge, couple)
    sure = both and min(cause.probability for cause in both) >= LIKELY
    if not sure or _eased(judge, best, trial) or not adequate(trial, best.where[0]):
        return judge, []
    return trial, both


def _catalogued(judge: Judge, claims: list[Claim], best: Claim) -> Claim:
    """The best claim; instead of a law without a name a cause that is as good.

    Such a law has to explain what the catalogue does not. It does where what is named
    at a joint leaves so much that a second law is needed.
    """
    if best.hypothesis.cause or any(best.rivals(known) for known in judge.accepted):
        return best
    near = (
        c for c in claims
        if c.hypothesis.cause and c.place() == best.place()
        and best.gain - c.gain < CLOSE and worth_naming(judge, c) and whole(judge, c)
    )  # fmt: skip
    index = best.where[0]
    clear = (c for c in near if c.fits[index].rms() < ROUGH * judge.joints[index].noise)
    return next(clear, best)


def _eased(judge: Judge, law: Claim, trial: Judge) -> bool:
    """Whether a couple needs a joint drawn that a law without a name follows freely."""
    k = law.where[0]
    follows = law.fits[k].rms() < ROUGH * judge.joints[k].noise
    follows &= not law.hypothesis.cause
    return follows and k in trial.case.pulled and k not in judge.case.pulled


def _everywhere(judge: Judge) -> list[Cause]:
    """The causes of a whole robot that is wrong in several ways, taken for known.

    None where joints agree on no value, not even nearly, or where what one of them
    carries explains more.
    """
    looked = judge.fork()  # on loads along the motion that causes make
    found, known = agreed.valued(looked, everywhere.causes(looked))
    if not any(agreed.common(looked, each.claims) for each in found):
        return []
    if agreed.carried(judge, looked, [c for each in found for c in each.claims], known):
        return []
    if looked.bounced(known):  # where teeth meet is chance
        found, known = agreed.revalued(looked, found)
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
        cause = weighed(judge, rows[0], rows)
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
