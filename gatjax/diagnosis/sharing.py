"""What fits of many joints say together, where joints may share the value of a cause.

A value that joints share costs its price once, and each joint pays with its misfit
where it suits it less than its own would (Laplace's approximation around its fit).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.claims import PLACE, WHOLE, occam, shared_value, uncertainty
from gatjax.diagnosis.fit import Fit, parts_of, with_last
from gatjax.diagnosis.joint import Joint

MANY = 5  # joints from which on one may be odd

Group = tuple[int, ...]
Fits = Mapping[int, Fit]  # of some joints, by index


def nats(joints: Sequence[Joint], known: Fits) -> float:
    """Evidence of fits, less what their causes cost, but for the worst of many joints.

    What explains them best is judged by the others: one that is wrong in a way of its
    own, which nothing of the whole robot explains, has no say (a trimmed likelihood).
    """
    said = {k: fits.evidence(joints[k], fit) for k, fit in known.items()}
    worst = {min(said, key=said.__getitem__)} if len(said) >= MANY else set()
    return _together(joints, {k: fit for k, fit in known.items() if k not in worst})


def alone(joint: Joint, fit: Fit) -> float:
    """Evidence of a joint's fit by itself, less what its causes cost."""
    return nats([joint], {0: fit})


def gained(joints: Sequence[Joint], before: Fits, after: Fits) -> float:
    """Nats by which fits say more than others, but for the joint that gains most.

    A joint that is wrong in a way of its own pays most for what imitates it.
    """
    gain = {
        k: fits.evidence(joints[k], fit) - fits.evidence(joints[k], before[k])
        for k, fit in after.items()
    }
    most = {max(gain, key=gain.__getitem__)} if len(gain) >= MANY else set()
    old, new = ({k: f[k] for k in after if k not in most} for f in (before, after))
    return _together(joints, new) - _together(joints, old)


def divisions(
    joints: Sequence[Joint], among: Iterable[int], cause: str
) -> list[list[Group]]:
    """Ways to divide joints into those with one value: all, a motor's, each its own."""
    every = tuple(among)
    motors: dict[tuple, Group] = {}
    for k in every:
        motors[joints[k].motor] = (*motors.get(joints[k].motor, ()), k)
    ways = [[every], list(motors.values()), [(k,) for k in every]]
    if cause in WHOLE:
        return ways[:1]
    return [way for n, way in enumerate(ways) if way not in ways[:n]]


class _Held(NamedTuple):
    """A fit while causes get values, one after the other."""

    fit: Fit  # where the rest is best; a coordinate with a value depends on none
    more: float = 0.0  # squared misfit that the values have added so far, rad^2

    def given(self, joint: Joint, own: np.ndarray) -> _Held:
        """With a value [count] of the last coordinates, and the rest moved along."""
        fit, rest = self.fit, slice(0, -len(own))
        last, square = slice(-len(own), None), fit.information.copy()
        far, x = own - fit.x[last], fit.x.copy()
        along = np.linalg.pinv(square[rest, rest]) @ square[rest, last]
        sure = square[last, last] - square[last, rest] @ along  # Schur complement
        x[rest] -= along @ far
        x[last] = own
        square[last], square[:, last] = 0.0, 0.0
        square[last, last] = np.eye(len(own))
        more = self.more + fits.spread(joint) ** 2 * float(far @ sure @ far)
        return _Held(fit._replace(x=x, information=square), more)

    def lost(self, joint: Joint) -> float:
        """Nats that the values have taken from its evidence."""
        best = max(self.fit.rms(), fits.FLOOR * joint.noise) ** 2
        share = self.more / (best * len(self.fit.residual))
        return 0.5 * fits.independent(joint) * float(np.log1p(share))


def _together(joints: Sequence[Joint], known: Fits) -> float:
    """Evidence of fits, less what their causes cost, each divided as is cheapest."""
    having: dict[str, list[int]] = {}
    for k, fit in known.items():
        for part, _ in parts_of(fit):
            having.setdefault(part.cause, []).append(k)
    held = {k: _Held(fit) for k, fit in known.items()}
    total = sum(fits.evidence(joints[k], fit) for k, fit in known.items())
    for cause, where in having.items():
        free = {k: with_last(known[k], cause) for k in where}
        mine = {k: held[k]._replace(fit=with_last(held[k].fit, cause)) for k in where}
        ways = [
            [_shared(joints, free, mine, group) for group in way]
            for way in divisions(joints, where, cause)
        ]
        best = min(ways, key=lambda way: sum(price for price, _ in way))
        for price, values in best:
            total -= price
            held |= values
    return total


def _shared(
    joints: Sequence[Joint], free: Fits, held: Mapping[int, _Held], group: Group
) -> tuple[float, dict[int, _Held]]:
    """What one value of the last cause costs a group, in nats, and the fits with it.

    How sure it is, fits tell in which all causes are `free`.
    """
    part, _ = parts_of(free[group[0]])[-1]
    own = shared_value([held[k].fit for k in group], part)
    price = occam(part, own, uncertainty([free[k] for k in group], len(own)))
    given = {k: held[k].given(joints[k], own) for k in group}
    lost = sum(given[k].lost(joints[k]) - held[k].lost(joints[k]) for k in group)
    return price + PLACE * len(group) + lost, given
