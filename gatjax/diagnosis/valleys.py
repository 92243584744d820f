"""A way along the bent valleys between a cause and a tolerance that imitates it."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from gatjax.diagnosis.hypotheses import (
    COUNT,
    TOLERANCES,
    Hypothesis,
    numbers,
    parts_of,
)
from gatjax.diagnosis.joint import Joint

SLIGHT = 1.0  # standard deviations of a tolerance: less is not worth a simulation


def exchanged(
    joint: Joint, hypothesis: Hypothesis | None, x: np.ndarray
) -> np.ndarray | None:
    """Coordinates of the same joint, causes instead of tolerances that imitate them.

    Friction of a cause and of a tolerance add up, gains multiply: the misfit has narrow
    valleys, bent in these coordinates, along which slopes lead nowhere.

    Args:
        joint: in question.
        hypothesis: causes of a fit.
        x: [COUNT + own] of it.

    Returns:
        [COUNT + own], or None if no tolerance that imitates a cause is far off.
    """
    out, place = x, COUNT
    for part in parts_of(hypothesis):
        if part.imitator and len(part.low) == 1:
            out = _without(joint, hypothesis, out, place, part)
        place += len(part.low)
    return None if out is x else out


def _without(
    joint: Joint, hypothesis: Hypothesis | None, x: np.ndarray, place: int,
    part: Hypothesis,
) -> np.ndarray:  # fmt: skip
    """Coordinates x without the imitator of a part, whose own is at a place."""
    field, index = part.imitator, TOLERANCES.index(part.imitator)
    if abs(x[index]) < SLIGHT:
        return x
    wanted, free = numbers(joint, hypothesis, x).get(field, 0.0), x.copy()
    free[index] = 0.0

    def missed(own: float) -> float:
        free[place] = own
        return float(numbers(joint, hypothesis, free).get(field, 0.0) - wanted)

    low, high = part.low[0], part.high[0]
    if not missed(low) * missed(high) < 0.0:
        return x  # the cause alone cannot be as large
    free[place] = brentq(missed, low, high)
    return free
