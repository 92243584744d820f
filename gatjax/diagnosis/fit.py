"""Fit hypotheses to a joint: bounded Gauss-Newton with tolerances as priors.

cost = |residual|^2 / spread^2 + |x_tolerances|^2, minus twice the log posterior but for
a constant; x_tolerances lie within +-BOUND. All hypotheses of a joint advance together,
so that one compiled simulation serves the finite differences of all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gatjax.diagnosis import hypotheses
from gatjax.diagnosis.hypotheses import (
    BOUND,
    COUNT,
    Hypothesis,
    combined,
    information,
    numbers,
)
from gatjax.diagnosis.joint import Joint
from gatjax.diagnosis.tolerances import CORRELATED
from gatjax.diagnosis.valleys import exchanged

INFLATION = 3.0  # of the reading noise: readings within CORRELATED count as one
LEFT = 1.5  # times the reading noise, that the best model leaves
FLOOR = 0.9  # of the reading noise: no fit is better
STEP = 0.15  # of a tolerance, for the finite differences
FAINT = 1e-6  # prior information on a cause's coordinates, against singular fits
RIDGE = 1e-12  # of information: simulations that fall apart tell of nothing else
TRUST = 2.0  # largest change of a tolerance in one iteration
BORROWED = 3  # iterations with slopes of tolerances that are only updated


class Fit(NamedTuple):
    """A hypothesis at its best coordinates so far."""

    hypothesis: Hypothesis | None  # None: tolerances only
    x: np.ndarray  # [COUNT + own]
    cost: float
    residual: np.ndarray  # [n] rad
    slopes: np.ndarray  # [n, COUNT + own] rad per coordinate
    information: np.ndarray  # [P, P] inverse covariance, priors included
    damping: float
    settled: bool
    age: int = BORROWED  # iterations since the slopes of tolerances were simulated

    @property
    def law(self) -> tuple[str, str]:
        """Its newest cause and variant; there has to be one."""
        assert self.hypothesis is not None
        return self.hypothesis.law

    @property
    def newest(self) -> Hypothesis:
        """Its last cause; there has to be one."""
        assert self.hypothesis is not None
        return self.hypothesis.newest

    @property
    def geared(self) -> bool:
        """Whether motor and link are simulated apart."""
        return self.hypothesis is not None and self.hypothesis.geared

    @property
    def spent(self) -> float:
        """Squared deviations of its tolerances, of all together."""
        return float(self.x[:COUNT] @ self.x[:COUNT])

    def rms(self) -> float:
        """Of the residual, rad."""
        return float(np.sqrt(np.mean(np.square(self.residual))))


def spread(joint: Joint) -> float:
    """Standard deviation by which a fit weighs residuals, rad.

    Rows within CORRELATED count as one: of fast logs these are more than INFLATION^2.
    """
    least = INFLATION**2 * lasts(joint) / CORRELATED
    alike = joint.valid.sum() / independent(joint)
    return joint.noise * float(np.sqrt(max(least, alike)))


def lasts(joint: Joint) -> float:
    """Time after which residuals of a joint are taken as independent, s."""
    return joint.allowed.lasts(joint.name)


Point = tuple[Hypothesis | None, np.ndarray]


def parts_of(fit: Fit) -> list[tuple[Hypothesis, np.ndarray]]:
    """The causes of a fit with their coordinates."""
    out, first = [], COUNT
    for part in hypotheses.parts_of(fit.hypothesis):
        out.append((part, fit.x[first : first + len(part.low)]))
        first += len(part.low)
    return out


def with_last(fit: Fit, cause: str) -> Fit:
    """The same fit with one of its causes as the last one."""
    parts = parts_of(fit)
    place = next(n for n, (part, _) in enumerate(parts) if part.cause == cause)
    first = COUNT + sum(len(own) for _, own in parts[:place])
    last = first + len(parts[place][1])
    order = np.r_[:first, last : len(fit.x), first:last]
    owner, x = put_together(
        fit.x[:COUNT], [*parts[:place], *parts[place + 1 :], parts[place]]
    )
    return fit._replace(
        hypothesis=owner, x=x, slopes=fit.slopes[:, order],
        information=fit.information[np.ix_(order, order)],
    )  # fmt: skip


def unspent(x: np.ndarray) -> np.ndarray:
    """Coordinates with nominal tolerances, which imitate nothing, and their causes'."""
    return np.append(np.zeros(COUNT), x[COUNT:])


def put_together(
    x: np.ndarray, parts: list[tuple[Hypothesis, np.ndarray]]
) -> tuple[Hypothesis | None, np.ndarray]:
    """Tolerances x [COUNT] and causes as a point to fit from."""
    owner = None
    for part, _ in parts:
        owner = combined(owner, part)
    return owner, np.concatenate([x, *(own for _, own in parts)])


def scatter(joint: Joint, plain: Fit) -> float:
    """RMS, rad, of what healthy robots differ by: tolerances (linear) and noise.

    `plain` is linearised at the nominal numbers.
    """
    return float(np.sqrt(np.square(plain.slopes).sum(1).mean() + joint.noise**2))


def residuals(joint: Joint, points: Sequence[Point]) -> np.ndarray:
    """Residuals [n, S] of many hypotheses at many coordinates; failures are large."""
    geared = [h is not None and h.geared for h, _ in points]
    out = np.empty((int(joint.valid.sum()), len(points)))
    for kind in (False, True):
        chosen = [k for k, is_geared in enumerate(geared) if is_geared == kind]
        if chosen:
            drives = [numbers(joint, *points[k]) for k in chosen]
            out[:, chosen] = joint.residual(drives, kind)
    return np.where(np.isfinite(out), out, 10.0)


def squares(joint: Joint, point: Point) -> float:
    """Sum of squared residuals of one hypothesis at its coordinates, rad^2."""
    return float(np.square(residuals(joint, [point])).sum())


def cost_of(joint: Joint, point: Point, residual: np.ndarray) -> float:
    """Misfit of a residual and prior of a point."""
    hypothesis, x = point
    prior = information(hypothesis) @ np.square(x)
    return float(residual @ residual / spread(joint) ** 2 + prior)


def start(joint: Joint, points: Sequence[Point]) -> list[Fit]:
    """Fits at their starting points."""
    found = residuals(joint, points)
    fits = []
    for (hypothesis, x), residual in zip(points, found.T, strict=True):
        cost = cost_of(joint, (hypothesis, x), residual)
        empty = np.zeros((len(residual), len(x)))
        square = np.eye(len(x))
        fits.append(Fit(hypothesis, x, cost, residual, empty, square, 1e-2, False))
    return fits


def independent(joint: Joint) -> float:
    """Number of independent residuals in the runs of a joint."""
    period = np.diff(joint.time, axis=1)[joint.valid[:, 1:]].mean()
    return float(joint.valid.sum() * period / lasts(joint))


def evidence(joint: Joint, fit: Fit) -> float:
    """Log evidence of a fit in nats, up to a constant of the joint.

    The misfit is noise of unknown size, independent after a time (CORRELATED; the size
    integrated out, Bretthorst 1988, eq. 3.17): a fit gains by the ratio of residuals,
    so a small modelling error beside a large effect does not look certain.
    """
    count = independent(joint)
    level = max(fit.rms() / joint.noise, FLOOR)
    return float(-count * np.log(level) - 0.5 * fit.spent)


def bounds(hypothesis: Hypothesis | None) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest coordinates."""
    low, high = np.full(COUNT, -BOUND), np.full(COUNT, BOUND)
    if hypothesis is None:
        return low, high
    return np.append(low, hypothesis.low), np.append(high, hypothesis.high)


def _differences(hypothesis: Hypothesis | None) -> np.ndarray:
    own = hypothesis.steps if hypothesis else ()
    return np.append(np.full(COUNT, STEP), own)


def linearised(joint: Joint, fits: list[Fit]) -> list[Fit]:
    """Finite-difference slopes of all fits, in one batch."""
    return _sloped(joint, [fit._replace(age=BORROWED) for fit in fits])


def _sloped(joint: Joint, fits: list[Fit]) -> list[Fit]:
    """Slopes of all fits; those of tolerances only where they are too old."""
    points: list[Point] = []
    steps, borrowed = [], [COUNT if fit.age < BORROWED else 0 for fit in fits]
    for fit, kept in zip(fits, borrowed, strict=True):
        _, high = bounds(fit.hypothesis)
        step = _differences(fit.hypothesis)
        step = np.where(fit.x + step > high, -step, step)
        steps.append(step)
        wanted = np.diag(step)[kept:]
        points += [(fit.hypothesis, fit.x + row) for row in wanted]
    found = residuals(joint, points)
    out, first = [], 0
    for fit, step, kept in zip(fits, steps, borrowed, strict=True):
        columns = found[:, first : first + len(step) - kept]
        first += len(step) - kept
        fresh = (columns - fit.residual[:, None]) / step[kept:]
        slopes = np.concatenate([fit.slopes[:, :kept], fresh], 1)
        square = slopes.T @ slopes / spread(joint) ** 2
        square += np.diag(np.maximum(information(fit.hypothesis), FAINT))
        age = fit.age if kept else 0
        out.append(fit._replace(slopes=slopes, information=square, age=age))
    return out


def _moved(fit: Fit, x: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Slopes after a step that agree with what it changed (Broyden 1965, eq. 4.5)."""
    step = x - fit.x
    missed = residual - fit.residual - fit.slopes @ step
    length = float(step @ step)
    return fit.slopes + np.outer(missed, step / length) if length else fit.slopes


def _step(joint: Joint, fit: Fit, damping: float) -> np.ndarray:
    """Next coordinates: damped Gauss-Newton, coordinates at a bound held there."""
    gradient = fit.slopes.T @ fit.residual / spread(joint) ** 2
    gradient += information(fit.hypothesis) * fit.x
    low, high = bounds(fit.hypothesis)
    trust = np.append(np.full(COUNT, TRUST), 0.25 * (high - low)[COUNT:])
    free = np.ones(len(gradient), bool)
    x = fit.x
    for _ in range(3):
        matrix = fit.information[np.ix_(free, free)]
        own = np.diag(matrix)
        diagonal = np.diag(own * (damping + RIDGE) + 1e-9)
        move = np.zeros(len(gradient))
        move[free] = -np.linalg.solve(matrix + diagonal, gradient[free])
        x = fit.x + np.clip(move, -trust, trust)
        outside = free & ((x < low) | (x > high))
        if not outside.any():
            break
        free &= ~(outside & ((fit.x <= low + 1e-9) | (fit.x >= high - 1e-9)))
    return np.clip(x, low, high)


def _trials(joint: Joint, fit: Fit) -> list[np.ndarray]:
    """Where a fit may go next: steps by its slopes, the last a short one; a valley."""
    steps = [_step(joint, fit, fit.damping * factor) for factor in (0.0, 1.0, 30.0)]
    other = exchanged(joint, fit.hypothesis, fit.x)
    return steps if other is None else [*steps, other]


def improve(joint: Joint, fits: list[Fit], iterations: int) -> list[Fit]:
    """Advance all fits by some Gauss-Newton iterations; settled ones rest."""
    for _ in range(iterations):
        active = [k for k, fit in enumerate(fits) if not fit.settled]
        if not active:
            break
        moving = _sloped(joint, [fits[k] for k in active])
        trials = [_trials(joint, fit) for fit in moving]
        owners = [f.hypothesis for f, own in zip(moving, trials, strict=True)
                  for _ in own]  # fmt: skip
        every = [x for own in trials for x in own]
        found, first = residuals(joint, list(zip(owners, every, strict=True))), 0
        for k, fit, own in zip(active, moving, trials, strict=True):
            left = found[:, first : first + len(own)]
            first += len(own)
            options = [
                (cost_of(joint, (fit.hypothesis, x), residual), i)
                for i, (x, residual) in enumerate(zip(own, left.T, strict=True))
            ]
            cost, best = min(options)
            gain = fit.cost - cost
            fresh = fit.age == 0
            if gain > 0.0:
                factor = 0.3 if best < 2 else 3.0
                fits[k] = fit._replace(
                    x=own[best], cost=cost, residual=left[:, best],
                    slopes=_moved(fit, own[best], left[:, best]),
                    age=fit.age + 1 if gain > 0.3 and best < 3 else BORROWED,
                    damping=max(1e-4, fit.damping * factor),
                    settled=fresh and gain < 0.3,
                )  # fmt: skip
            elif fresh:
                fits[k] = fit._replace(
                    damping=fit.damping * 30.0, settled=fit.damping > 1e3
                )
            else:
                fits[k] = fit._replace(age=BORROWED)
    return fits


def refitted(
    joint: Joint, fit: Fit, parts: list[tuple[Hypothesis, np.ndarray]], rounds: int
) -> Fit:
    """A joint's fit with other causes, from the tolerances that it had."""
    first = start(joint, [put_together(fit.x[:COUNT], parts)])
    return improve(joint, first, rounds)[0]
