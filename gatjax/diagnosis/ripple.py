"""Which rate along the angle a torque ripple could have, to first order.

Slopes lead to a rate from nearby only, a half wave over the joint's range away. What a
ripple of any rate does to a linear servo is a convolution.
"""

from __future__ import annotations

import numpy as np
from scipy import fft

from gatjax.diagnosis.joint import STEP, Joint
from gatjax.diagnosis.servo import MEMORY, answer

LADDER = np.arange(4.6, 48.8, 0.2)  # 1/rad, rates that are tried
TOGETHER = 40  # of them that are weighed in one go
EVERY = 4  # steps of the simulation from one torque to the next
CHOSEN = 3
APART = 0.8  # 1/rad, distance of the chosen ones


def rates(joint: Joint, residual: np.ndarray) -> list[float]:
    """Rates in 1/rad whose sine and cosine explain a residual [n] best, best first."""
    products = np.zeros((len(LADDER), 2, 2))
    shares = np.zeros((len(LADDER), 2))
    pulse = (np.arange(round(MEMORY / STEP)) < EVERY).astype(float)
    kernel = np.append(0.0, answer(joint, pulse)[EVERY - 1 :: EVERY])
    first = 0
    for run, valid in enumerate(joint.valid):
        rows = int(valid.sum())
        own = residual[first : first + rows]
        first += rows
        path = np.asarray(joint.grid.path)[::EVERY, run]
        place = (joint.lead + joint.time[run][valid] / STEP) / EVERY
        low = np.minimum(place.astype(int), len(path) - 2)
        over = np.clip(place - low, 0.0, 1.0)
        size = fft.next_fast_len(len(path) + len(kernel), real=True)
        passed = np.asarray(fft.rfft(kernel, size))
        for part in range(0, len(LADDER), TOGETHER):
            some = slice(part, part + TOGETHER)
            phase = LADDER[some, None] * path
            torque = np.stack([np.sin(phase), np.cos(phase)], 1)
            moved = np.asarray(fft.irfft(np.asarray(fft.rfft(torque, size)) * passed))
            seen = (1.0 - over) * moved[..., low] + over * moved[..., low + 1]
            products[some] += seen @ seen.swapaxes(1, 2)
            shares[some] += seen @ own
    return _chosen(products, shares)


def _chosen(products: np.ndarray, shares: np.ndarray) -> list[float]:
    """The rates that take most away, from normal equations [K, 2, 2] and [K, 2]."""
    ridge = 1e-9 * np.trace(products, axis1=1, axis2=2).max() * np.eye(2) + 1e-30
    sizes = np.linalg.solve(products + ridge, shares[..., None])[..., 0]
    chosen: list[float] = []
    for rate in LADDER[np.argsort(-(sizes * shares).sum(1))]:
        if all(abs(rate - other) > APART for other in chosen):
            chosen.append(float(rate))
        if len(chosen) == CHOSEN:
            break
    return chosen
