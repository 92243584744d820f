"""95 % intervals: bootstrap for velocities, Wilson for shares of falls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

DRAWS = 4000  # resamples; the ends of the interval then wobble by about 2 % of it
SEED = 20170209  # any fixed number: the same folder must give the same page
Z = 1.959964  # 97.5 % quantile of the normal distribution

Samples: TypeAlias = Sequence[float] | np.ndarray  # [N], at least one


class Interval(NamedTuple):
    """A mean and its 95 % interval; infinite ends where one sample says nothing."""

    mean: float
    low: float
    high: float

    @property
    def known(self) -> bool:
        """Whether there were enough samples for an interval."""
        return math.isfinite(self.low) and math.isfinite(self.high)


def resampled_means(samples: Samples, draw: np.random.Generator) -> np.ndarray:
    """Means [DRAWS] of samples drawn again with replacement."""
    values = np.asarray(samples, dtype=float)
    return values[draw.integers(len(values), size=(DRAWS, len(values)))].mean(axis=1)


def mean_interval(samples: Samples) -> Interval:
    """Mean of independent samples, percentile bootstrap."""
    mean = float(np.mean(samples))
    if len(samples) < 2:
        return Interval(mean, -math.inf, math.inf)
    return _percentiles(mean, resampled_means(samples, np.random.default_rng(SEED)))


def difference_interval(after: Samples, before: Samples) -> Interval:
    """Mean of `after` minus mean of `before`, both resampled."""
    mean = float(np.mean(after) - np.mean(before))
    if min(len(after), len(before)) < 2:
        return Interval(mean, -math.inf, math.inf)
    draw = np.random.default_rng(SEED)
    changes = resampled_means(after, draw) - resampled_means(before, draw)
    return _percentiles(mean, changes)


def gain_interval(after: Samples, before: Samples) -> Interval | None:
    """Change of the mean in per cent of `before`; None where that makes no sense."""
    if np.mean(before) <= 0.0:
        return None
    gain = float(100.0 * (np.mean(after) / np.mean(before) - 1.0))
    if min(len(after), len(before)) < 2:
        return Interval(gain, -math.inf, math.inf)
    draw = np.random.default_rng(SEED)
    above = resampled_means(after, draw)
    below = np.maximum(resampled_means(before, draw), 1e-9)
    return _percentiles(gain, 100.0 * (above / below - 1.0))


def share_interval(count: int, total: int) -> Interval:
    """Share `count / total`, Wilson score interval.

    A bootstrap of 0 falls in 10 walks would claim a width of zero; Wilson (1927) does
    not.
    """
    share = count / total
    middle = (share + Z**2 / (2 * total)) / (1 + Z**2 / total)
    half = Z * math.sqrt(share * (1 - share) / total + Z**2 / (4 * total**2))
    half /= 1 + Z**2 / total
    low, high = max(0.0, middle - half), min(1.0, middle + half)
    return Interval(share, min(low, share), max(high, share))


def _percentiles(mean: float, resampled: np.ndarray) -> Interval:
    low, high = np.percentile(resampled, [2.5, 97.5])
    return Interval(mean, min(float(low), mean), max(float(high), mean))
