"""The smallest effect of each cause that these logs could have shown."""

from __future__ import annotations

from typing import Any

import numpy as np

from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.bank import CAUSES
from gatjax.diagnosis.claims import PLACE, PRICE, WORTH
from gatjax.diagnosis.hypotheses import Hypothesis, combined
from gatjax.diagnosis.joint import Joint
from gatjax.diagnosis.judge import Judge
from gatjax.effects.catalogue import CATALOGUE

LEVELS = 7  # sizes that are tried between the bounds of a cause


def smallest(judge: Judge) -> list[dict[str, Any]]:
    """Least detectable size of every cause with one number, at its best joint.

    A cause of a size is simulated beside all that is known; what tolerances cannot
    imitate of it, to first order, has to be worth a finding.
    """
    bank = [h for h in CAUSES if len(h.low) == 1 or h.geared]
    best: dict[str, dict[str, Any]] = {}
    for joint, known in zip(judge.joints, judge.known, strict=True):
        base = fits.linearised(joint, [known])[0]
        for hypothesis, sizes, gains in _gains(joint, base, bank):
            size = _threshold(sizes, gains)
            if size is None:
                continue
            values = hypothesis.values(joint, _own(hypothesis, size))
            name, value = next(iter(values.items()))
            row = {
                "cause": hypothesis.cause, "where": [joint.name], "value": float(value),
                "unit": CATALOGUE[hypothesis.cause].main.unit, "parameter": name,
            }  # fmt: skip
            rival = best.get(hypothesis.cause)
            change = abs(value - CATALOGUE[hypothesis.cause].neutral)
            if rival is None or change < abs(
                rival["value"] - CATALOGUE[hypothesis.cause].neutral
            ):
                best[hypothesis.cause] = row
    return list(best.values())


def _gains(
    joint: Joint, base: fits.Fit, bank: list[Hypothesis]
) -> list[tuple[Hypothesis, np.ndarray, np.ndarray]]:
    """Nats that each size of each cause would be worth [LEVELS]."""
    ladders = [np.linspace(h.low[0], h.high[0], LEVELS) for h in bank]
    points = [
        (combined(base.hypothesis, h), np.concatenate([base.x, _own(h, size)]))
        for h, sizes in zip(bank, ladders, strict=True) for size in sizes
    ]  # fmt: skip
    shift = fits.residuals(joint, points) - base.residual[:, None]
    scale = fits.spread(joint)
    imitated = base.slopes @ np.linalg.solve(
        base.information, base.slopes.T @ shift / scale**2
    )
    power = np.mean(np.square(shift - imitated), axis=0) / base.rms() ** 2
    gain = 0.5 * fits.independent(joint) * np.log1p(power) - PRICE - PLACE
    return [
        (h, sizes, gain[k * LEVELS : (k + 1) * LEVELS])
        for k, (h, sizes) in enumerate(zip(bank, ladders, strict=True))
    ]


def _own(hypothesis: Hypothesis, size: float) -> np.ndarray:
    """Coordinates of a size, the others where their search starts."""
    return np.array([size, *hypothesis.starts[0][1:]])


def _threshold(sizes: np.ndarray, gains: np.ndarray) -> float | None:
    """Size at which the gain first reaches a finding, or None."""
    order = np.argsort(gains)
    if gains[order[-1]] < WORTH:
        return None
    # A factor or a signed number is neutral inside its bounds: take the nearer side.
    middle = int(np.argmin(gains))
    for side in (range(middle, len(sizes)), range(middle, -1, -1)):
        index = list(side)
        above = [k for k in index if gains[k] >= WORTH]
        if above and above[0] != middle:
            low = index[index.index(above[0]) - 1]
            return float(
                np.interp(WORTH, gains[[low, above[0]]], sizes[[low, above[0]]])
            )
    return None
