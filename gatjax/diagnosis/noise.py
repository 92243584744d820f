"""Reading noise of joints, from how third differences of their readings scatter."""

from __future__ import annotations

import numpy as np

from gatjax.data.trajectories import JointRun

SPREAD = np.sqrt(20.0)  # of third differences of white noise, in its deviations
SIXTH = np.sqrt(924.0)  # of sixth ones
SLOW = 1.0 / 55.0  # s from row to row: of more rows motion leaks into neither
LEAKS = 0.9  # share that sixth ones find where motion leaks into third ones
WHITE = 0.25  # correlation of third differences that reading noise does not reach
CHANCE = 5.0  # deviations: nor this, of few rows
APART = 4  # rows: third differences of white noise are uncorrelated from here on
PERIOD = 0.25  # s, of the slowest oscillation that is looked for
BLOCK = 20  # rows that are calm or not
CALM = 0.7  # share of them that is taken for calm
LEAST = 1e-5  # rad
EXACT = 3e-6  # rad, five decimals; encoders are not as fine


def of_joints(runs: list[JointRun]) -> np.ndarray:
    """Standard deviation of the readings of each joint [J], rad.

    Of a joint that hunts (teeth bounce to and fro across a gap while the servo holds)
    third differences tell its motion: it has the middle noise of those that do not.
    """
    own = noise_of(runs)
    hunts = np.mean([_correlation(run) for run in runs], axis=0) > 1.0
    if hunts.all():
        return own
    least = np.maximum(_rounding(runs), np.median(own[~hunts]))
    return np.where(hunts, np.minimum(own, least), own)


def exact(runs: list[JointRun]) -> np.ndarray:
    """Whether a joint [J] is read without noise or steps, as simulators log it."""
    levels = [_level(run, 3, SPREAD, 0.0) for run in runs]
    return np.maximum(np.max(levels, axis=0), _rounding(runs)) < EXACT


def noise_of(runs: list[JointRun]) -> np.ndarray:
    """Standard deviation of the readings of each joint [J], rad; the mean over runs.

    Third differences of the calmest third of a run; a coarse encoder counts with its
    rounding error, LSB / sqrt(12), also in a run in which the joint stands still. Of
    few rows a second third differences tell the motion, too: sixth ones less of it. A
    joint whose reading never changes has the least noise of those that do.
    """
    levels = []
    for run in runs:
        level = _level(run, 3, SPREAD)
        if np.median(np.diff(run.time)) > SLOW and len(run.time) > 6:
            sixth = _level(run, 6, SIXTH)
            level = np.where(sixth < LEAKS * level, sixth, level)
        levels.append(level)
    rounding = _rounding(runs)
    found = np.mean(np.maximum(levels, np.maximum(rounding, LEAST)), axis=0)
    least = found[rounding > 0.0].min(initial=np.inf)
    return np.where((rounding > 0.0) | np.isinf(least), found, least)


def _level(
    run: JointRun, order: int, spread: float, calmest: float = 0.3
) -> np.ndarray:
    """Noise [J], rad, that differences of an order tell where a run is calm."""
    apart = np.diff(run.angle, order, axis=0) / spread
    count = max(len(apart) // BLOCK, 1)
    calm = apart[: count * BLOCK].reshape(count, -1, run.angle.shape[1])
    return np.sqrt(np.quantile(np.square(calm).mean(1), calmest, axis=0))


def _rounding(runs: list[JointRun]) -> np.ndarray:
    """Rounding error of each encoder [J], rad; 0 if nothing tells its step."""
    steps = []
    for run in runs:
        seen = [np.diff(np.unique(np.round(angle, 9))) for angle in run.angle.T]
        steps.append([apart.min() if len(apart) else np.inf for apart in seen])
    lsb = np.min(steps, axis=0)
    return np.where(np.isfinite(lsb), lsb, 0.0) / np.sqrt(12.0)


def _correlation(run: JointRun) -> np.ndarray:
    """Largest autocorrelation [J] of third differences where a run is calm.

    In shares of what white noise does not reach.
    """
    if len(run.angle) < 3 + BLOCK:
        return np.zeros(run.angle.shape[1])
    third, calm = _calm(run)
    last = round(PERIOD / float(np.median(np.diff(run.time))))
    found = np.zeros(third.shape[1])
    for lag in range(APART, min(last, len(third) - 1) + 1):
        pair = third[lag:], third[:-lag]
        both = calm[lag:] & calm[:-lag]
        first, second = (np.square(each * both).sum(0) for each in pair)
        product = np.abs((pair[0] * pair[1] * both).sum(0))
        share = product / np.sqrt(np.maximum(first * second, 1e-36))
        chance = CHANCE / np.sqrt(np.maximum(both.sum(0), 1.0))
        found = np.maximum(found, share / np.maximum(WHITE, chance))
    return found


def _calm(run: JointRun) -> tuple[np.ndarray, np.ndarray]:
    """Third differences [N, J] in whole blocks, and whether their block is calm."""
    third = np.diff(run.angle, 3, axis=0)
    third = third[: len(third) // BLOCK * BLOCK]
    power = np.square(third).reshape(-1, BLOCK, third.shape[1]).mean(1)
    return third, np.repeat(power <= np.quantile(power, CALM, axis=0), BLOCK, axis=0)
