"""Response of a joint to its command over frequency: gain and delay.

Averaged cross-spectra of overlapping windows (Welch, IEEE Trans. Audio Electroacoustics
15, 1967): H = S_cm / S_cc. Frequencies at which the command has hardly any power, or
does not go along with the position, say nothing and are left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gatjax.report.diagnosis.read import Signals

SEGMENT = 4.0  # s, so frequencies are 0.25 Hz apart
QUIET = 1e-3  # of the largest power of the command in a band around
COHERENT = 0.5  # least coherence
LOWEST = 1.6 / SEGMENT  # Hz, below it the window mixes in the mean
BAND = 1.15  # half width of a band of frequencies, as a factor


class Response(NamedTuple):
    """Response over frequency, each [F]."""

    frequency: np.ndarray  # Hz
    gain: np.ndarray  # rad per rad
    delay: np.ndarray  # s, phase over angular frequency


def response(signals: Signals, command: np.ndarray, angle: np.ndarray) -> Response:
    """Gain and delay from a command [N] to an angle [N], both rad.

    Returns:
        Empty arrays if no run is as long as a segment or nothing moves.
    """
    period = _period(signals)
    length = max(round(SEGMENT / period), 8)
    window = np.hanning(length)
    sums = np.zeros((3, length // 2 + 1), complex)
    for run in np.unique(signals.run):
        rows = signals.run == run
        time = signals.time[rows]
        grid = np.arange(time[0], time[-1], period)
        sent = np.interp(grid, time, command[rows])
        seen = np.interp(grid, time, angle[rows])
        for begin in range(0, len(grid) - length + 1, length // 2):
            x, y = (
                np.fft.rfft(window * (v - v.mean()))
                for v in (sent[begin : begin + length], seen[begin : begin + length])
            )
            if np.isfinite(y).all():  # no robot fell
                sums += [x * x.conj(), y * y.conj(), y * x.conj()]
    frequency = np.fft.rfftfreq(length, period)
    sums = _banded(np.concatenate([sums, frequency * sums[:1]]), frequency)
    power, answer = sums[0].real, sums[1].real
    if not np.isfinite(sums).all() or power.max() <= 0.0:
        return Response(*(np.array([]),) * 3)
    coherence = np.abs(sums[2]) ** 2 / np.maximum(power * answer, 1e-30)
    frequency = sums[3].real / np.maximum(power, 1e-30)  # where the band's power lies
    good = (power > QUIET * power.max()) & (coherence > COHERENT) & (frequency > LOWEST)
    transfer = sums[2][good] / power[good]
    phase = np.unwrap(np.angle(transfer))
    return Response(
        frequency[good], np.abs(transfer), -phase / (2.0 * np.pi * frequency[good])
    )


def _banded(spectra: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """Spectra [S, F] averaged over bands that are as wide in the log of frequency."""
    total = np.concatenate([np.zeros((len(spectra), 1)), spectra.cumsum(axis=1)], 1)
    low = np.searchsorted(frequency, frequency / BAND)
    high = np.searchsorted(frequency, frequency * BAND, side="right")
    return (total[:, high] - total[:, low]) / (high - low)


def _period(signals: Signals) -> float:
    """Median time between rows of a run, s."""
    steps = np.diff(signals.time)[np.diff(signals.run) == 0]
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if steps.size else 0.01
