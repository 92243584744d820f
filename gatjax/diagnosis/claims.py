"""Claims: a cause at one or several joints, and what it explains, in nats."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import Hypothesis

PRICE = 2.0  # nats at least for each coordinate of a cause
PLACE = 1.0  # nats for each joint that is named by itself
WORTH = 3.5  # nats: a claim below is no finding
SEVERAL = 3  # joints of a claim, of which one may have a cause of its own besides
LATER = 10.0  # the same beside a finding, and of a robot on the floor
SHARED = (
    "command_delay", "measurement_delay", "first_order_lag", "gain_error",
    "damping_error", "clock_drift", "gravity_tilt", "command_quantization",
    "encoder_scale", "viscous_friction", "coulomb_friction", "dead_band", "backlash",
    "speed_limit", "torque_limit", "torque_saturation", "supply_sag", "armature",
    "stiction", "load_friction", "joint_elasticity",
)  # fmt: skip
WHOLE = ("gravity_tilt", "supply_sag", "clock_drift")
BODY = ("payload", "com_shift")
REPEATED = 8.0


class Stance(NamedTuple):
    """What a claim says of floor, feet or inertial unit."""

    where: str
    values: dict[str, float]  # the catalogue's parameters, the scored one first
    low: float  # 90 % interval of the first parameter
    high: float
    visibility: float


class Claim(NamedTuple):
    """A cause with its coordinates at some joints, beside what was known before."""

    hypothesis: Hypothesis
    own: np.ndarray  # coordinates of the cause
    where: tuple[int, ...]
    fits: dict[int, Fit]  # of the joints that bear it out
    gain: float  # nats over the explanation before
    body: int | None = None  # joint whose body it changes
    lost: dict[int, list[np.ndarray]] | None = None  # lost commands, per run
    covariance: np.ndarray | None = None  # of the coordinates
    stance: Stance | None = None  # instead of joints
    coded: float = 0.0  # nats of naming what commands were lost; the gain has paid them

    def place(self) -> tuple:
        """Where it is."""
        return self.where if self.stance is None else (self.stance.where,)

    def moved(self, other: Claim) -> bool:
        """Whether its coordinates left those of another by half a deviation."""
        if self.covariance is None or not len(self.own):
            return False
        far = np.square(self.own - other.own) > 0.25 * np.diag(self.covariance)
        return bool(far.any())

    def rivals(self, other: Claim) -> bool:
        """Whether both explain the same logs; a stance explains all of them."""
        everything = self.stance is not None or other.stance is not None
        return everything or bool(set(self.fits) & set(other.fits))


def uncertainty(
    free: list[Fit], count: int, first: int | None = None
) -> np.ndarray | None:
    """Covariance [count, count] of coordinates that fits of several joints share.

    They are the last ones, or those from the index `first` on.

    The fits take residuals as independent; they are so after a tenth of a second or
    more only, which REPEATED samples stand for.
    """
    total = np.zeros((count, count))
    part = slice(-count, None) if first is None else slice(first, first + count)
    for fit in free:
        covariance = np.linalg.pinv(fit.information)[part, part]
        scale = REPEATED * max(fit.cost / len(fit.residual), 0.3)
        total += np.linalg.pinv(covariance * scale)
    return np.linalg.pinv(total) if count and free else None


def occam(
    hypothesis: Hypothesis, own: np.ndarray, covariance: np.ndarray | None
) -> float:
    """What a cause's coordinates cost, in nats: the share of their prior that fits.

    The prior is uniform within the bounds, or normal where the hypothesis has one;
    Laplace's approximation of the integral over the posterior (MacKay 2003, eq. 28.6).
    """
    count = len(own)
    if covariance is None or not count:
        return PRICE * count
    known = hypothesis.weights()
    width = np.array(hypothesis.high) - np.array(hypothesis.low)
    square = 1.0 / np.maximum(known, 1e-12)
    flat, variance = known == 0.0, np.where(known == 0.0, width**2 / 12.0, square)
    normal = 0.5 * (own**2 / variance + np.log(2.0 * np.pi * variance))
    posterior = np.linalg.pinv(covariance) + np.diag(1.0 / variance)
    size = 0.5 * (count * np.log(2.0 * np.pi) - np.linalg.slogdet(posterior)[1])
    price = float(np.where(flat, np.log(width), normal).sum() - size)
    return max(price, PRICE * count)


def price(claim: Claim, joints: int) -> float:
    """What a claim's value and its places cost, in nats, of a robot with some joints.

    All joints together are one place; a group costs at least what chooses it from all
    groups of its size.
    """
    count = len(claim.where)
    places = PLACE * (1 if count == joints else count)
    if 1 < count < joints:
        places = max(places, math.log(math.comb(joints, count)))
    return occam(claim.hypothesis, claim.own, claim.covariance) + places


def shared_value(
    free: list[Fit], hypothesis: Hypothesis, first: int | None = None
) -> np.ndarray:
    """The coordinates of a cause that fits agree on, weighted by information.

    They are the last ones, or those from the index `first` on.

    Coordinates may depend on each other: the mean of values within bounds can lie out
    of them, and is brought back.
    """
    count = len(hypothesis.low)
    part = slice(-count, None) if first is None else slice(first, first + count)
    total, right = 1e-9 * np.eye(count), np.zeros(count)
    for fit in free:
        covariance = np.linalg.pinv(fit.information)[part, part]
        weight = np.linalg.pinv(covariance) / max(fit.cost / len(fit.residual), 0.5)
        total += weight
        right += weight @ fit.x[part]
    return np.clip(np.linalg.solve(total, right), hypothesis.low, hypothesis.high)


def outdone(shared: Claim, single: list[Claim]) -> bool:
    """Whether causes of each joint's own explain more than one value at several joints.

    Each of them beyond the first has to earn what a further cause needs. Where several
    joints' own best cause is the one that is shared, it is theirs; what else some of
    the joints have is found beside it.
    """
    best: dict[int, Claim] = {}
    for claim in sorted(single, key=lambda claim: claim.gain):
        (joint, *others) = claim.where
        if claim.hypothesis.cause and not others and joint in shared.fits:
            best[joint] = claim
    worth = [claim for claim in best.values() if claim.gain > LATER]
    votes = sum(claim.hypothesis.law == shared.hypothesis.law for claim in worth)
    if votes >= SEVERAL or not worth:
        return False
    total = sum(claim.gain for claim in worth)
    return total - LATER * (len(worth) - 1) > shared.gain
