"""Plain least squares of hypotheses, without tolerances or priors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis
from gatjax.diagnosis.joint import Joint

STARTS = 2  # of each hypothesis that are refined
TRUST = 0.25  # of a coordinate's range, largest change in one round
DAMPINGS = (1e-6, 1e-2, 1.0, 30.0)  # that a round tries
LITTLE = 1e-4  # relative improvement that is none


class Solved(NamedTuple):
    """A hypothesis at its best coordinates, the same at all of its joints."""

    hypothesis: Hypothesis
    own: np.ndarray  # [P] coordinates of the hypothesis
    squares: np.ndarray  # [J] sums of squared residuals of its joints, rad^2
    deviation: np.ndarray  # [P] standard deviations of the coordinates


def nominal(joint: Joint) -> float:
    """Sum of squared residuals of the nominal joint, rad^2."""
    return fits.squares(joint, (None, np.zeros(COUNT)))


def solved(
    joints: Sequence[Joint],
    bank: Sequence[Hypothesis],
    starts: Sequence[Sequence[np.ndarray]],
    rounds: int,
) -> list[Solved]:
    """Fit every hypothesis to all of some joints at once.

    Args:
        joints: that share one value of each hypothesis.
        bank: hypotheses.
        starts: for each hypothesis, coordinates to start from.
        rounds: of Gauss-Newton.

    Returns:
        The best fit of each hypothesis.
    """
    owners = [h for h, own in zip(bank, starts, strict=True) for _ in own]
    points = [np.asarray(own, float) for some in starts for own in some]
    costs = np.square(_residuals(joints, owners, points)).sum(0)
    chosen: list[int] = []
    for hypothesis in bank:
        mine = [k for k, owner in enumerate(owners) if owner is hypothesis]
        chosen += sorted(mine, key=lambda k: costs[k])[:STARTS]
    owners, points = [owners[k] for k in chosen], [points[k] for k in chosen]
    active = list(range(len(points)))
    current = costs[chosen].copy()
    for _ in range(rounds):
        moved = _round(joints, owners, points, active)
        active = [k for k, (_, cost) in moved.items() if cost < 0.999 * current[k]]
        for k, (own, cost) in moved.items():
            if cost < current[k] * (1.0 - LITTLE):
                points[k], current[k] = own, cost
        if not active:
            break
    best = [min((k for k, owner in enumerate(owners) if owner is hypothesis),
                key=lambda k: current[k]) for hypothesis in bank]  # fmt: skip
    return _finished(joints, list(bank), [points[k] for k in best])


def _residuals(
    joints: Sequence[Joint], owners: Sequence[Hypothesis], points: Sequence[np.ndarray]
) -> np.ndarray:
    """Residuals of all joints under each other [n, S], rad."""
    full = [
        (owner, np.append(np.zeros(COUNT), own))
        for owner, own in zip(owners, points, strict=True)
    ]
    return np.concatenate([fits.residuals(joint, list(full)) for joint in joints])


def _slopes(
    joints: Sequence[Joint], owners: Sequence[Hypothesis], points: Sequence[np.ndarray]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Residual [n] and its slopes [n, P] of each hypothesis, in one batch."""
    every, places = [], []
    for owner, own in zip(owners, points, strict=True):
        step = np.asarray(owner.steps)
        step = np.where(own + step > np.asarray(owner.high), -step, step)
        every += [(owner, own), *((owner, own + row) for row in np.diag(step))]
        places.append(step)
    found = _residuals(joints, [o for o, _ in every], [x for _, x in every])
    out, first = [], 0
    for step in places:
        base = found[:, first]
        columns = found[:, first + 1 : first + 1 + len(step)]
        out.append((base, (columns - base[:, None]) / step))
        first += 1 + len(step)
    return out


def _round(
    joints: Sequence[Joint],
    owners: Sequence[Hypothesis],
    points: Sequence[np.ndarray],
    active: Sequence[int],
) -> dict[int, tuple[np.ndarray, float]]:
    """One damped Gauss-Newton step of the active fits: best trial and its cost."""
    mine = [owners[k] for k in active]
    slopes = _slopes(joints, mine, [points[k] for k in active])
    trials = []
    for k, (residual, columns) in zip(active, slopes, strict=True):
        low, high = (np.asarray(end) for end in (owners[k].low, owners[k].high))
        matrix, gradient = columns.T @ columns, columns.T @ residual
        scale = np.diag(np.diag(matrix)) + 1e-12 * np.eye(len(low))
        for damping in DAMPINGS:
            move = -np.linalg.solve(matrix + damping * scale, gradient)
            bound = TRUST * (high - low)
            trials.append(np.clip(points[k] + np.clip(move, -bound, bound), low, high))
    many = len(DAMPINGS)
    found = _residuals(joints, [o for o in mine for _ in DAMPINGS], trials)
    costs = np.square(found).sum(0).reshape(len(active), many)
    best = costs.argmin(1)
    return {
        k: (trials[many * place + best[place]], float(costs[place, best[place]]))
        for place, k in enumerate(active)
    }


def _finished(
    joints: Sequence[Joint], bank: list[Hypothesis], points: list[np.ndarray]
) -> list[Solved]:
    """Sums of squares by joint and deviations of the coordinates."""
    ends = np.cumsum([int(joint.valid.sum()) for joint in joints])[:-1]
    out = []
    slopes = _slopes(joints, bank, points)
    for owner, own, (residual, columns) in zip(bank, points, slopes, strict=True):
        squares = np.array([float(r @ r) for r in np.split(residual, ends)])
        matrix = columns.T @ columns
        variance = squares.sum() / max(1, len(residual) - len(own))
        covariance = variance * np.linalg.pinv(matrix)
        deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        out.append(Solved(owner, own, squares, deviation))
    return out
