"""Which step of the target could explain a residual, to first order.

The edges of a rounded target move with its step: a step that is off by a thousandth
already rounds some commands otherwise. Far too many to simulate, but what rounding does
to a target is known, and what that does to a linear servo is a convolution.
"""

from __future__ import annotations

import numpy as np
from scipy import fft

from gatjax.diagnosis.joint import STEP, Joint
from gatjax.diagnosis.servo import MEMORY, answer

LEAST, MOST, COUNT = 0.003, 0.3, 6000  # rad; steps that are tried
TOGETHER = 250  # steps that are weighed in one go
CHOSEN = 3
APART = 0.005  # relative distance of the chosen ones


def steps(joint: Joint, residual: np.ndarray) -> list[float]:
    """Steps in rad that explain a residual [n] best, best first."""
    ladder = np.geomspace(LEAST, MOST, COUNT, dtype=np.float32)
    residual = residual.astype(np.float32)
    left, first = np.zeros(COUNT), 0
    for run, valid in enumerate(joint.valid):
        rows, time = int(valid.sum()), joint.time[run][valid]
        if rows < 2:
            continue
        at = joint.lead + np.ceil(time / STEP + 1e-6).astype(int)
        series = joint.grid.target[:, run]
        command = series[np.minimum(at, len(series) - 1)]
        kernel = _tick(joint, float(np.median(np.diff(time))))
        size = fft.next_fast_len(rows + len(kernel), real=True)
        passed = np.asarray(fft.rfft(kernel.astype(np.float32), size))
        for part in range(0, COUNT, TOGETHER):  # whole, it would be GB for a long log
            some = ladder[part : part + TOGETHER, None]
            rounded = np.round(command / some) * some - command
            moved = fft.irfft(np.asarray(fft.rfft(rounded, size)) * passed, size)
            rest = residual[first : first + rows] - np.asarray(moved)[:, :rows]
            left[part : part + TOGETHER] += np.square(rest).sum(1)
        first += rows
    chosen: list[float] = []
    for step in ladder[np.argsort(left)]:
        if all(abs(np.log(step / other)) > APART for other in chosen):
            chosen.append(float(step))
        if len(chosen) == CHOSEN:
            break
    return chosen


def _tick(joint: Joint, period: float) -> np.ndarray:
    """What one tick of 1 rad does to a linear servo, at the next ticks, rad."""
    time = STEP * np.arange(round(MEMORY / STEP))
    late = joint.nominal["delay"]
    force = joint.nominal["kp"] * ((late <= time) & (time < late + period))
    return np.interp(np.arange(0.0, MEMORY, period), time, answer(joint, force))
