"""The values of a whole robot's causes: one for all, one a motor, or each its own.

The division is taken that has the largest evidence: a value that joints share costs its
price once, and every joint pays with its misfit where the value does not suit it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.borrowing import Parts, borrowed
from gatjax.diagnosis.case import mapped
from gatjax.diagnosis.claims import (
    LATER,
    Claim,
    price,
    shared_value,
    uncertainty,
)
from gatjax.diagnosis.everywhere import odd_ones
from gatjax.diagnosis.findings import VISIBLE
from gatjax.diagnosis.fit import Fit, parts_of, refitted
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis, pinned
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.option import SHARE, Option
from gatjax.diagnosis.sharing import Group, divisions
from gatjax.effects.catalogue import cause

ALIKE = 0.25  # of their median: values that are near it
MOSTLY = 0.75  # of the joints: that agree, or that a cause has to be worth it at
CHANCE = 6  # joints whose values are not alike by chance
FREE, HELD = 12, 3  # iterations of a joint with values of its own, and with given ones


class Valued(NamedTuple):
    """A cause of a whole robot with its values."""

    options: list[Option]  # in its place, itself first
    claims: list[Claim]  # one a value


def valued(judge: Judge, found: list[list[Option]]) -> tuple[list[Valued], list[Fit]]:
    """Causes that a whole robot has, with the values that joints agree on.

    Left out is what is worth nothing any more with such values, or too small to see,
    one after the other, what is worth least first: others may then be worth more.

    Args:
        judge: what is known without them.
        found: of `everywhere.causes`.

    Returns:
        The causes, and the fits of all joints; none where no cause is left.
    """
    while found:
        claims, known, odd = _agreed(judge, [options[0] for options in found])
        weak = [n for n, mine in enumerate(claims) if _weak(judge, mine, odd)]
        if not weak:
            pairs = zip(found, claims, strict=True)
            return [Valued(*pair) for pair in pairs], known
        worst = min(weak, key=lambda n: sum(claim.gain for claim in claims[n]))
        found = found[:worst] + found[worst + 1 :]
    return [], []


def revalued(judge: Judge, found: list[Valued]) -> tuple[list[Valued], list[Fit]]:
    """The same causes with values of joints as they are by now, and all fits."""
    claims, known, _ = _agreed(judge, [each.options[0] for each in found])
    pairs = zip(found, claims, strict=True)
    return [each._replace(claims=mine) for each, mine in pairs], known


def common(judge: Judge, claims: list[Claim]) -> bool:
    """Whether joints agree on a cause: some have one value, or many have values alike.

    A delay is the same at all joints, but where something else is left each joint's own
    suits it best by a hair. A limit may be the same share of what each motor has: all
    are alike if they were of one joint.
    """
    count = len(judge.joints)
    if len(claims) < count or count < CHANCE:
        return len(claims) < count
    sizes = [_size(judge, claim, claim.where[0]) for claim in claims]
    shares = [_size(judge, claim, 0) for claim in claims]
    return _alike(np.array(sizes)) or _alike(np.array(shares))


def _alike(sizes: np.ndarray) -> bool:
    """Whether most of some sizes [N] are near their median."""
    middle = np.median(sizes)
    near = np.abs(sizes - middle) < ALIKE * np.abs(middle)
    return bool(near.mean() >= MOSTLY)


def carried(judge: Judge, looked: Judge, claims: list[Claim], known: list[Fit]) -> bool:
    """Whether a changed body explains its bearers better than causes of a whole robot.

    Where most joints carry a link, a payload there makes all of them slow and soft.

    Args:
        judge: what is known without the causes.
        looked: has joints on the loads along the motion that the causes make.
        claims: all values of the causes.
        known: fits of all joints with them.
    """
    count = len(judge.joints)
    ends = [k for k in range(count) if len(judge.case.bearers(k)) >= SHARE * count]

    def gained(joint: int) -> float:
        before = fits.evidence(judge.joints[joint], judge.known[joint])
        return fits.evidence(looked.joints[joint], known[joint]) - before

    def worth(bearers: set[int]) -> float:
        mine = [claim for claim in claims if bearers & set(claim.where)]
        cost = sum(price(claim, count) for claim in mine)
        return sum(map(gained, bearers)) - cost

    return any(body.gain > worth(set(body.fits)) for body in judge.borne(ends))


def _size(judge: Judge, claim: Claim, index: int) -> float:
    """Size of a cause in the catalogue's unit, if it were at a joint."""
    hypothesis, entry = claim.hypothesis, cause(claim.hypothesis.cause)
    values = hypothesis.values(judge.joints[index], claim.own)
    return entry.size(values[entry.main.name])


def _weak(judge: Judge, claims: list[Claim], odd: set[int]) -> bool:
    """Whether a cause is no finding: worth too little with its values, or invisible.

    A value that many joints share is worth it once for all of them; values of their own
    have to be so at `MOSTLY` of the joints that are not `odd`. Nearly all bear a true
    cause out; what makes up for a wrong one is worth it at some.
    """
    worth = {k for claim in claims if claim.gain > LATER for k in claim.where}
    if len(worth - odd) < MOSTLY * (len(judge.joints) - len(odd)):
        return True
    return all(judge.visibility(claim) <= VISIBLE for claim in claims)


def _agreed(
    judge: Judge, options: Sequence[Option]
) -> tuple[list[list[Claim]], list[Fit], set[int]]:
    """The claims of each cause, the fits of all joints, and the odd ones of these."""
    hypotheses = [option.hypothesis for option in options]
    guesses = [option.own for option in options]

    sets = [list(zip(hypotheses, guesses, strict=True)), *_had(options)]
    probed = options[0].fits

    def one(index: int) -> Fit:
        joint, none = judge.joints[index], np.zeros(COUNT)
        begun = probed.get(index, judge.known[index]).x[:COUNT]
        return fits.improve(joint, borrowed(joint, [begun, none], [sets]), FREE)[0]

    every = range(len(judge.joints))
    free = mapped(one, every)
    known, claims, odd = free, [], odd_ones(judge, free)
    for number, hypothesis in enumerate(hypotheses):
        tried = [
            _divided(judge, known, free, number, groups, odd)
            for groups in divisions(judge.joints, every, hypothesis.cause)
        ]
        _, mine, known = max(tried, key=lambda each: each[0])
        claims.append(mine)
    weighed = [_weighed(judge, known, n, mine, odd) for n, mine in enumerate(claims)]
    return weighed, known, odd


def _had(options: Sequence[Option]) -> list[Parts]:
    """All causes as single joints have them that have them all, in the same order."""
    found = []
    for fit in options[0].fits.values():
        own = {part.cause: x for part, x in parts_of(fit)}
        laws = [option.hypothesis for option in options]
        if all(law.cause in own for law in laws):
            found.append([(h, np.clip(own[h.cause], h.low, h.high)) for h in laws])
    return found


def _divided(
    judge: Judge,
    known: list[Fit],
    free: list[Fit],
    number: int,
    groups: list[Group],
    odd: set[int],
) -> tuple[float, list[Claim], list[Fit]]:
    """Nats, claims and fits where groups of joints have one value of a cause each.

    The causes before it have given values already: its coordinates come first.
    How sure a value is, fits tell in which all causes are `free`. Joints that are
    `odd` have a value, but no say in it.
    """
    claims = []
    first = COUNT + sum(len(own) for _, own in parts_of(free[0])[:number])
    held: dict[int, Hypothesis] = {}
    for group in groups:
        part, _ = parts_of(known[group[0]])[number]
        heard = _heard(judge, group, odd)
        own = shared_value([known[k] for k in heard], part, COUNT)
        sure = uncertainty([free[k] for k in heard], len(own), first)
        claims.append(Claim(part, own, group, {}, 0.0, covariance=sure))
        held |= dict.fromkeys(group, pinned(part, own))

    def one(index: int) -> Fit:
        parts = parts_of(known[index])
        parts[number] = held[index], np.zeros(0)
        return refitted(judge.joints[index], known[index], parts, HELD)

    fitted = mapped(one, range(len(known)))
    rest = [k for k in range(len(known)) if k not in odd]
    nats = sum(fits.evidence(judge.joints[k], fitted[k]) for k in rest)
    nats -= sum(price(claim, len(fitted)) for claim in claims)
    return nats, claims, fitted


def _heard(judge: Judge, group: Group, odd: set[int]) -> list[int]:
    """Joints that a group's value is of: its own, or those of its motors, or all."""
    rest = [k for k in range(len(judge.joints)) if k not in odd]
    motor = judge.joints[group[0]].motor
    alike = [k for k in rest if judge.joints[k].motor == motor]
    return [k for k in group if k not in odd] or alike or rest


def _weighed(
    judge: Judge, known: list[Fit], number: int, claims: list[Claim], odd: set[int]
) -> list[Claim]:
    """Claims of a cause with their fits and their gain beside the other causes."""

    def lost(index: int) -> float:
        if index in odd:
            return 0.0
        fit, joint = known[index], judge.joints[index]
        parts = parts_of(fit)
        del parts[number]
        without = refitted(joint, fit, parts, HELD)
        return fits.evidence(joint, fit) - fits.evidence(joint, without)

    gains = mapped(lost, range(len(known)))
    return [
        claim._replace(
            fits={k: known[k] for k in claim.where},
            gain=sum(gains[k] for k in claim.where) - price(claim, len(judge.joints)),
        )
        for claim in claims
    ]
