"""The values of a whole robot's causes: one for all, one a motor, or each its own.

The division is taken that has the largest evidence: a value that joints share costs its
price once, and every joint pays with its misfit where the value does not suit it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.case import mapped
from gatjax.diagnosis.claims import (
    LATER,
    WHOLE,
    Claim,
    price,
    shared_value,
    uncertainty,
)
from gatjax.diagnosis.everywhere import Option
from gatjax.diagnosis.findings import VISIBLE
from gatjax.diagnosis.fit import Fit, parts_of, put_together, refitted
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis, pinned
from gatjax.diagnosis.judge import Judge
from gatjax.effects.catalogue import cause
from gatjax.effects.cause import complete

ALIKE, MOSTLY = 0.25, 0.75  # of their median, of the joints: values that are near it
CHANCE = 6  # joints whose values are not alike by chance
FREE, HELD = 12, 3  # iterations of a joint with values of its own, and with given ones

Group = tuple[int, ...]


class Valued(NamedTuple):
    """A cause of a whole robot with its values."""

    options: list[Option]  # in its place, itself first
    claims: list[Claim]  # one a value


def valued(judge: Judge, found: list[list[Option]]) -> tuple[list[Valued], list[Fit]]:
    """Causes that a whole robot has, with the values that joints agree on.

    Left out is what is worth nothing any more with such values, or too small to see.

    Args:
        judge: what is known without them.
        found: of `everywhere.causes`.

    Returns:
        The causes, and the fits of all joints; none where no cause is left.
    """
    while found:
        claims, known = _agreed(judge, [options[0] for options in found])
        weak = next((n for n, mine in enumerate(claims) if _weak(judge, mine)), None)
        if weak is None:
            pairs = zip(found, claims, strict=True)
            return [Valued(*pair) for pair in pairs], known
        found = found[:weak] + found[weak + 1 :]
    return [], []


def common(judge: Judge, claims: list[Claim]) -> bool:
    """Whether joints agree on a cause: some have one value, or many have values alike.

    A delay is the same at all joints, but where something else is left each joint's own
    suits it best by a hair.
    """
    count = len(judge.joints)
    if len(claims) < count or count < CHANCE:
        return len(claims) < count
    sizes = np.array([_size(judge, claim) for claim in claims])
    middle = np.median(sizes)
    near = np.abs(sizes - middle) < ALIKE * np.abs(middle)
    return bool(near.mean() > MOSTLY)


def _size(judge: Judge, claim: Claim) -> float:
    """Main parameter of a cause at the first of its joints, in the catalogue's unit."""
    hypothesis, joint = claim.hypothesis, judge.joints[claim.where[0]]
    name, values = hypothesis.cause, hypothesis.values(joint, claim.own)
    return complete(name, cause(name), values)[cause(name).main.name]


def _weak(judge: Judge, claims: list[Claim]) -> bool:
    """Whether a cause is no finding."""
    if sum(claim.gain for claim in claims) < LATER:
        return True
    return all(judge.visibility(claim) <= VISIBLE for claim in claims)


def _agreed(
    judge: Judge, options: Sequence[Option]
) -> tuple[list[list[Claim]], list[Fit]]:
    """The claims of each cause, and the fits of all joints."""
    hypotheses = [option.hypothesis for option in options]
    guesses = [option.own for option in options]

    def one(index: int) -> Fit:
        joint, parts = judge.joints[index], list(zip(hypotheses, guesses, strict=True))
        starts = (judge.known[index].x[:COUNT], np.zeros(COUNT))
        tried = fits.start(joint, [put_together(x, parts) for x in starts])
        return fits.improve(joint, [min(tried, key=lambda fit: fit.cost)], FREE)[0]

    free = mapped(one, range(len(judge.joints)))
    known, claims = free, []
    for number, hypothesis in enumerate(hypotheses):
        tried = [
            _divided(judge, known, free, number, groups)
            for groups in _divisions(judge, hypothesis)
        ]
        _, mine, known = max(tried, key=lambda each: each[0])
        claims.append(mine)
    return [_weighed(judge, known, n, mine) for n, mine in enumerate(claims)], known


def _divisions(judge: Judge, hypothesis: Hypothesis) -> list[list[Group]]:
    """Ways to divide the joints into those with one value."""
    every = tuple(range(len(judge.joints)))
    motors: dict[tuple, Group] = {}
    for k in every:
        motor = judge.joints[k].motor
        motors[motor] = (*motors.get(motor, ()), k)
    ways = [[every], list(motors.values()), [(k,) for k in every]]
    if hypothesis.cause in WHOLE:
        return ways[:1]
    return [way for n, way in enumerate(ways) if way not in ways[:n]]


def _divided(
    judge: Judge, known: list[Fit], free: list[Fit], number: int, groups: list[Group]
) -> tuple[float, list[Claim], list[Fit]]:
    """Nats, claims and fits where groups of joints have one value of a cause each.

    The causes before it have given values already: its coordinates come first.
    How sure a value is, fits tell in which all causes are `free`.
    """
    claims = []
    first = COUNT + sum(len(own) for _, own in parts_of(free[0])[:number])
    held: dict[int, Hypothesis] = {}
    for group in groups:
        part, _ = parts_of(known[group[0]])[number]
        own = shared_value([known[k] for k in group], part, COUNT)
        sure = uncertainty([free[k] for k in group], len(own), first)
        claims.append(Claim(part, own, group, {}, 0.0, covariance=sure))
        held |= dict.fromkeys(group, pinned(part, own))

    def one(index: int) -> Fit:
        parts = parts_of(known[index])
        parts[number] = held[index], np.zeros(0)
        return refitted(judge.joints[index], known[index], parts, HELD)

    fitted = mapped(one, range(len(known)))
    pairs = zip(judge.joints, fitted, strict=True)
    nats = sum(fits.evidence(*pair) for pair in pairs)
    nats -= sum(price(claim, len(fitted)) for claim in claims)
    return nats, claims, fitted


def _weighed(
    judge: Judge, known: list[Fit], number: int, claims: list[Claim]
) -> list[Claim]:
    """Claims of a cause with their fits and their gain beside the other causes."""

    def lost(index: int) -> float:
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
