"""What fits of many joints say together, where joints may share the value of a cause.

A value that joints share costs its price once, and each joint pays with its misfit
where it suits it less than its own would (Laplace's approximation around its fit).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.claims import PLACE, WHOLE, occam, shared_value, uncertainty
from gatjax.diagnosis.fit import Fit, parts_of, with_last
from gatjax.diagnosis.joint import Joint

MANY = 5  # joints from which on one may be odd

Group = tuple[int, ...]


def nats(joints: Sequence[Joint], known: Mapping[int, Fit]) -> float:
    """Evidence of fits, less what their causes cost, but for the worst of many joints.

    Else a joint that is wrong in a way of its own decided (a trimmed likelihood).

    Args:
        joints: of the robot.
        known: fits of some of them, by index.
    """
    said = {k: fits.evidence(joints[k], fit) for k, fit in known.items()}
    if len(said) >= MANY:
        said.pop(min(said, key=said.__getitem__))
    having: dict[str, list[int]] = {}
    for k in said:
        for part, _ in parts_of(known[k]):
            having.setdefault(part.cause, []).append(k)
    return sum(said.values()) - sum(
        _price(joints, {k: with_last(known[k], cause) for k in having[cause]}, cause)
        for cause in having
    )


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


def _price(joints: Sequence[Joint], known: Mapping[int, Fit], cause: str) -> float:
    """What the values of a cause, the last one of some fits, cost at least, in nats."""
    return min(
        sum(_shared(joints, {k: known[k] for k in group}) for group in way)
        for way in divisions(joints, known, cause)
    )


def _shared(joints: Sequence[Joint], known: Mapping[int, Fit]) -> float:
    """What one value of the last cause costs at all joints of these, in nats."""
    free = list(known.values())
    part, _ = parts_of(free[0])[-1]
    own = shared_value(free, part)
    lost = sum(_lost(joints[k], fit, own) for k, fit in known.items() if len(own))
    return lost + occam(part, own, uncertainty(free, len(own))) + PLACE * len(free)


def _lost(joint: Joint, fit: Fit, own: np.ndarray) -> float:
    """Nats that a fit loses where its last coordinates are given as `own`."""
    last = slice(-len(own), None)
    sure = np.linalg.pinv(np.linalg.pinv(fit.information)[last, last])
    far = own - fit.x[last]
    more = fits.spread(joint) ** 2 * float(far @ sure @ far)
    before = max(fit.rms(), fits.FLOOR * joint.noise) ** 2 * len(fit.residual)
    return 0.5 * fits.independent(joint) * float(np.log1p(more / before))
