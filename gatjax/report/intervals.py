"""95 % intervals: Student t for means, Fieller for gains, Wilson for shares of falls.

A percentile bootstrap of four walks covers the mean in 83 % of cases instead of 95 %;
Student's t keeps its word for few samples that are about normal.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from scipy.special import stdtrit

LEVEL = 0.95
Z = 1.959964  # 97.5 % quantile of the normal distribution

Samples: TypeAlias = Sequence[float] | np.ndarray  # [N], at least one


class Interval(NamedTuple):
    """A mean and its 95 % interval; infinite ends where too few samples say nothing."""

    mean: float
    low: float
    high: float

    @property
    def known(self) -> bool:
        """Whether there were enough samples for an interval."""
        return math.isfinite(self.low) and math.isfinite(self.high)


class Spread(NamedTuple):
    """Mean of some samples and what is known of its error."""

    mean: float
    variance: float  # of the mean; inf for one sample
    freedom: float  # degrees of freedom


def spread_of(samples: Samples) -> Spread:
    """Mean, variance of the mean and degrees of freedom of independent samples."""
    count = len(samples)
    variance = float(np.var(samples, ddof=1)) / count if count > 1 else math.inf
    return Spread(float(np.mean(samples)), variance, count - 1.0)


def mean_interval(samples: Samples) -> Interval:
    """Mean of independent samples, Student t."""
    one = spread_of(samples)
    if one.freedom < 1:
        return Interval(one.mean, -math.inf, math.inf)
    half = _quantile(one.freedom, LEVEL) * math.sqrt(one.variance)
    return Interval(one.mean, one.mean - half, one.mean + half)


def difference_interval(after: Samples, before: Samples) -> Interval:
    """Mean of `after` minus mean of `before`, Student t for two variances (Welch)."""
    one, other = spread_of(after), spread_of(before)
    mean = one.mean - other.mean
    if min(one.freedom, other.freedom) < 1:
        return Interval(mean, -math.inf, math.inf)
    quantile = _quantile(_welch(one, other, 1.0), LEVEL)
    half = quantile * math.sqrt(one.variance + other.variance)
    return Interval(mean, mean - half, mean + half)


def gain_interval(
    after: Samples, before: Samples, level: float = LEVEL
) -> Interval | None:
    """Change of the mean in per cent of `before`; None where that makes no sense.

    Fieller's interval of a ratio of two means (1954), so that the error of `before`
    counts too, with Welch's degrees of freedom. Its ends are infinite where `before` is
    so uncertain that it may be zero.
    """
    one, other = spread_of(after), spread_of(before)
    if other.mean <= 0.0:
        return None
    ratio = one.mean / other.mean
    gain = 100.0 * (ratio - 1.0)
    if min(one.freedom, other.freedom) < 1:
        return Interval(gain, -math.inf, math.inf)
    reach = _quantile(_welch(one, other, ratio), level) / other.mean
    left = 1.0 - reach**2 * other.variance
    if left <= 0.0:
        return Interval(gain, -math.inf, math.inf)
    half = reach * math.sqrt(left * one.variance + ratio**2 * other.variance)
    low, high = ((ratio + end) / left for end in (-half, half))
    return Interval(gain, 100.0 * (low - 1.0), 100.0 * (high - 1.0))


def share_interval(count: int, total: int) -> Interval:
    """Share `count / total`, Wilson score interval.

    Student t of 0 falls in 10 walks would claim a width of zero; Wilson (1927) does
    not.
    """
    share = count / total
    middle = (share + Z**2 / (2 * total)) / (1 + Z**2 / total)
    half = Z * math.sqrt(share * (1 - share) / total + Z**2 / (4 * total**2))
    half /= 1 + Z**2 / total
    low, high = max(0.0, middle - half), min(1.0, middle + half)
    return Interval(share, min(low, share), max(high, share))


def _quantile(freedom: float, level: float) -> float:
    return float(stdtrit(freedom, 0.5 + 0.5 * level))


def _welch(one: Spread, other: Spread, weight: float) -> float:
    """Degrees of freedom of `one - weight * other` (Welch and Satterthwaite)."""
    parts = (one.variance, weight**2 * other.variance)
    below = parts[0] ** 2 / one.freedom + parts[1] ** 2 / other.freedom
    return sum(parts) ** 2 / below if below > 0.0 else one.freedom + other.freedom
