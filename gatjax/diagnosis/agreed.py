"""The values of a whole robot's causes: one for all, one a motor, or each its own.

The division is taken that has the largest evidence: a value that joints share costs its
price once, and every joint pays with its misfit where the value does not suit it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.case import mapped
from gatjax.diagnosis.claims import (
    PLACE,
    WHOLE,
    Claim,
    occam,
    shared_value,
    uncertainty,
)
from gatjax.diagnosis.everywhere import Option, parts_of, put_together
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis, pinned
from gatjax.diagnosis.judge import Judge

FREE, HELD = 12, 3  # iterations of a joint with values of its own, and with given ones

Group = tuple[int, ...]


def valued(
    judge: Judge, options: Sequence[Option]
) -> tuple[list[list[Claim]], list[Fit]]:
    """Claims of causes that a whole robot has, with the values that joints agree on.

    Args:
        judge: what is known without them.
        options: the causes.

    Returns:
        For each cause its claims, one a value; and the fits of all joints.
    """
    hypotheses = [option.hypothesis for option in options]
    guesses = [
        shared_value(list(option.fits.values()), option.hypothesis)
        for option in options
    ]
    every = range(len(judge.joints))

    def free(index: int) -> Fit:
        joint, parts = judge.joints[index], list(zip(hypotheses, guesses, strict=True))
        starts = (judge.known[index].x[:COUNT], np.zeros(COUNT))
        tried = fits.start(joint, [put_together(x, parts) for x in starts])
        return fits.improve(joint, [min(tried, key=lambda fit: fit.cost)], FREE)[0]

    known, claims = mapped(free, every), []
    for number, hypothesis in enumerate(hypotheses):
        groups = _divisions(judge, hypothesis)
        tried = [_divided(judge, known, number, each) for each in groups]
        _, mine, known = max(tried, key=lambda one: one[0])
        claims.append(mine)
    return [_weighed(judge, known, n, mine) for n, mine in enumerate(claims)], known


def _divisions(judge: Judge, hypothesis: Hypothesis) -> list[list[Group]]:
    """Ways to divide the joints into those with one value."""
    every = tuple(range(len(judge.joints)))
    if hypothesis.cause in WHOLE:
        return [[every]]
    motors: dict[tuple, Group] = {}
    for k in every:
        motor = judge.joints[k].motor
        motors[motor] = (*motors.get(motor, ()), k)
    return [[every], list(motors.values()), [(k,) for k in every]]


def _divided(
    judge: Judge, known: list[Fit], number: int, groups: list[Group]
) -> tuple[float, list[Claim], list[Fit]]:
    """Nats, claims and fits where groups of joints have one value of a cause each.

    The causes before it have given values already: its coordinates come first.
    """
    claims, price = [], 0.0
    held: dict[int, Hypothesis] = {}
    for group in groups:
        part, _ = parts_of(known[group[0]])[number]
        heard = [known[k] for k in group]
        own = shared_value(heard, part, COUNT)
        sure = uncertainty(heard, len(part.low), COUNT)
        price += occam(part, own, sure)
        price += PLACE * (1 if len(group) == len(known) else len(group))
        claims.append(Claim(part, own, group, {}, 0.0, covariance=sure))
        held |= dict.fromkeys(group, pinned(part, own))

    def one(index: int) -> Fit:
        parts = parts_of(known[index])
        parts[number] = held[index], np.zeros(0)
        return _refitted(judge, index, known[index], parts)

    fitted = mapped(one, range(len(known)))
    pairs = zip(judge.joints, fitted, strict=True)
    return sum(fits.evidence(*pair) for pair in pairs) - price, claims, fitted


def _refitted(
    judge: Judge, index: int, fit: Fit, parts: list[tuple[Hypothesis, np.ndarray]]
) -> Fit:
    """A joint's fit with other causes, from the tolerances that it had."""
    joint = judge.joints[index]
    first = fits.start(joint, [put_together(fit.x[:COUNT], parts)])
    return fits.improve(joint, first, HELD)[0]


def _weighed(
    judge: Judge, known: list[Fit], number: int, claims: list[Claim]
) -> list[Claim]:
    """Claims of a cause with their fits, and the nats that are lost without it."""

    def lost(index: int) -> float:
        fit, joint = known[index], judge.joints[index]
        parts = parts_of(fit)
        del parts[number]
        without = _refitted(judge, index, fit, parts)
        return fits.evidence(joint, fit) - fits.evidence(joint, without)

    gains = mapped(lost, range(len(known)))
    return [
        claim._replace(
            fits={k: known[k] for k in claim.where},
            gain=float(sum(gains[k] for k in claim.where)),
        )
        for claim in claims
    ]
