"""Reading noise of joints, from how third differences of their readings scatter."""

from __future__ import annotations

import numpy as np

from gatjax.data.trajectories import JointRun

SPREAD = np.sqrt(20.0)  # of third differences of white noise, in its deviations
WHITE = 0.25  # correlation of third differences that reading noise does not reach
APART = 4  # rows: third differences of white noise are uncorrelated from here on
PERIOD = 0.25  # s, of the slowest oscillation that is looked for
MOST = 2.0  # deviations: what is more is a motion, and counts as that


def of_joints(runs: list[JointRun]) -> np.ndarray:
    """Standard deviation of the readings of each joint [J], rad.

    Of a joint that hunts (teeth bounce to and fro across a gap while the servo holds)
    third differences tell its motion: it has the middle noise of those that do not.
    """
    own = noise_of(runs)
    hunts = np.mean([_correlation(run, own) for run in runs], axis=0) > WHITE
    if hunts.all():
        return own
    least = np.maximum(_rounding(runs), np.median(own[~hunts]))
    return np.where(hunts, np.minimum(own, least), own)


def noise_of(runs: list[JointRun]) -> np.ndarray:
    """Standard deviation of the readings of each joint [J], rad; the mean over runs.

    Third differences of the calmest third of a run; a coarse encoder counts with its
    rounding error, LSB / sqrt(12), also in a run in which the joint stands still.
    """
    levels = []
    for run in runs:
        third = np.diff(run.angle, 3, axis=0) / SPREAD
        count = len(third) // 20
        calm = third[: count * 20].reshape(count, 20, -1)
        levels.append(np.sqrt(np.quantile(np.square(calm).mean(1), 0.3, axis=0)))
    return np.mean(np.maximum(levels, np.maximum(_rounding(runs), 1e-5)), axis=0)


def _rounding(runs: list[JointRun]) -> np.ndarray:
    """Rounding error of each encoder [J], rad; 0 if nothing tells its step."""
    steps = []
    for run in runs:
        seen = [np.diff(np.unique(np.round(angle, 9))) for angle in run.angle.T]
        steps.append([apart.min() if len(apart) else np.inf for apart in seen])
    lsb = np.min(steps, axis=0)
    return np.where(np.isfinite(lsb), lsb, 0.0) / np.sqrt(12.0)


def _correlation(run: JointRun, noise: np.ndarray) -> np.ndarray:
    """Largest autocorrelation [J] of third differences, at lags up to a period."""
    most = MOST * SPREAD * noise
    third = np.clip(np.diff(run.angle, 3, axis=0), -most, most)
    last = round(PERIOD / float(np.median(np.diff(run.time))))
    power = np.maximum(np.square(third).sum(0), 1e-18)
    found = np.zeros(len(noise))
    for lag in range(APART, min(last, len(third) - 1) + 1):
        product = (third[lag:] * third[:-lag]).sum(0)
        found = np.maximum(found, np.abs(product) / power)
    return found
