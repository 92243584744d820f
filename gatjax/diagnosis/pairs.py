"""Two causes at a joint: the one that explains most alone may be neither of them."""

from __future__ import annotations

from typing import NamedTuple

from gatjax.diagnosis import lost, search
from gatjax.diagnosis.aliases import again, alias, covered
from gatjax.diagnosis.bank import CAUSES, of_drive
from gatjax.diagnosis.case import mapped
from gatjax.diagnosis.claims import LATER, WHOLE, Claim
from gatjax.diagnosis.findings import LEAST_SHARE, explained, whole, worth_naming
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.known import changed

TRIED = 8  # causes that are taken for the first of two
JUDGED = 2  # of them that are looked into
MARGIN = 10.0  # nats by which two causes beat an unnamed law


class Couple(NamedTuple):
    """Two named causes, and what they were chosen from."""

    first: Claim  # alone
    second: Claim  # beside the first
    claims: list[Claim]  # beside the first, best first
    judge: Judge  # has accepted the first


def better(judge: Judge, claims: list[Claim], law: Claim) -> Couple | None:
    """Two named causes that explain a joint better than another claim does.

    Args:
        judge: what is known.
        claims: all, best first.
        law: the best one, which has no name or leaves too much.
    """
    found = couple(judge, claims, law.where[0])
    if found is None or law.hypothesis.cause:
        return found
    more = found.first.gain + found.second.gain - law.gain
    return found if more > MARGIN else None


def couple(judge: Judge, claims: list[Claim], joint: int) -> Couple | None:
    """The two named causes that explain a joint best, if there are any.

    The best ones of that joint alone are taken for the first, and the whole bank is
    tried beside each; where two explain most of its misfit, they are judged as ever.

    Args:
        judge: what is known.
        claims: all, best first.
        joint: in question.
    """
    count = len(judge.joints)
    firsts = _firsts(claims, joint, count)
    if not firsts:
        return None
    beside = mapped(lambda claim: _beside(judge, claim, joint), firsts)
    order = sorted(range(len(firsts)), key=lambda n: -beside[n].gain)
    enough = [n for n in order if explained(judge, beside[n]) >= LEAST_SHARE]
    for first in (firsts[n] for n in enough[:JUDGED]):
        trial = judge.fork()
        trial.accept(first)
        left = [c for c in trial.claims() if not again(c, trial.accepted, count)]
        worth = (c for c in left if joint in c.fits and worth_naming(trial, c))
        second = next(worth, None)
        if second is not None and whole(trial, second):
            return Couple(first, second, left, trial)
    return None


def _firsts(claims: list[Claim], joint: int, count: int) -> list[Claim]:
    """The best claims about a joint with a name, one of each cause and place."""
    out: dict[tuple, Claim] = {}
    for claim in claims:
        key = alias(claim.hypothesis, count), claim.place()
        if claim.hypothesis.cause and claim.gain > LATER and joint in claim.fits:
            out.setdefault(key, claim)
    return list(out.values())[:TRIED]


def _beside(judge: Judge, first: Claim, index: int) -> Claim:
    """A cause with the best fit, and nats, of another one beside it at a joint."""
    joint = changed(judge.case, first, index, judge.joints[index])
    count = len(judge.joints)
    never = covered(first.hypothesis, count) | set(WHOLE if count > 1 else ())
    for claim in judge.accepted:
        never |= covered(claim.hypothesis, count) if index in claim.where else set()
    bank = tuple(h for h in of_drive(joint, CAUSES) if h.cause not in never)
    found = search.proposals(joint, first.fits[index], bank)
    best = max(found, key=lambda fit: judge.score(index, fit, joint))
    told = judge.score(index, best, joint), best
    if best.rms() > lost.NOISY * joint.noise:
        losses = lost.second(judge, index, joint, first.fits[index])
        told = max(told, losses or told, key=lambda each: each[0])
    nats, best = told
    return first._replace(gain=nats, fits={index: best})
