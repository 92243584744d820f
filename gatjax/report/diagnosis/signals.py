"""What is read from the signals of one joint before it is drawn; numpy only."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from gatjax.report.diagnosis.read import Signals, Trace

WINDOW = 3.0  # s of the close-up
POINTS = 700  # most points of a drawn line
BINS = 16
LEAST = 12  # samples in a bin
SETTLE = 0.4  # s after a fast move that are no slow motion yet
SMOOTH = 0.05  # s, over which speed is measured


class Binned(NamedTuple):
    """A residual against a variable, in bins of equal count; each [B]."""

    centre: np.ndarray
    mean: np.ndarray
    spread: np.ndarray  # standard deviation


def speed(signals: Signals, values: np.ndarray) -> np.ndarray:
    """Speed [N] of a signal [N], within its runs and smoothed over 50 ms."""
    result = np.zeros(len(values))
    for run in np.unique(signals.run):
        rows = np.flatnonzero(signals.run == run)
        if len(rows) < 3:
            continue
        slope = np.gradient(values[rows], signals.time[rows])
        width = max(1, round(SMOOTH / float(np.median(np.diff(signals.time[rows])))))
        width = min(width, len(rows))
        weight = np.convolve(np.ones(len(rows)), np.ones(width), mode="same")
        result[rows] = np.convolve(slope, np.ones(width), mode="same") / weight
    return result


def close_up(signals: Signals, trace: Trace) -> np.ndarray:
    """Rows [M] of the 3 s in which the nominal model errs most beyond the extended."""
    missed = np.square(trace.measured - trace.nominal)
    if trace.extended is not None:
        missed = missed - np.square(trace.measured - trace.extended)
    missed = np.nan_to_num(missed)
    best, found = -np.inf, np.arange(min(len(missed), POINTS))
    for run in np.unique(signals.run):
        rows = np.flatnonzero(signals.run == run)
        time = signals.time[rows]
        total = np.concatenate([[0.0], np.cumsum(missed[rows])])
        ends = np.searchsorted(time, time + WINDOW, side="right")
        gain = total[ends] - total[:-1]
        whole = ends < len(rows) if time[-1] - time[0] > WINDOW else ends == len(rows)
        gain = np.where(whole, gain, -np.inf)
        first = int(np.argmax(gain))
        if gain[first] > best:
            best, found = float(gain[first]), rows[first : ends[first]]
    return found


def thinned(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A line of many points [N] as its lows and highs, so that no peak is lost."""
    if len(time) <= POINTS:
        return time, values
    edges = np.linspace(0, len(time), POINTS // 2 + 1).astype(int)
    kept = []
    for begin, end in itertools.pairwise(edges.tolist()):
        part = np.nan_to_num(values[begin:end])
        kept += sorted({begin + int(np.argmin(part)), begin + int(np.argmax(part))})
    return time[kept], values[kept]


def binned(variable: np.ndarray, residual: np.ndarray) -> Binned | None:
    """Mean and spread of a residual [N] against a variable [N]; None if it stands."""
    good = np.isfinite(variable) & np.isfinite(residual)
    variable, residual = variable[good], residual[good]
    if len(variable) < 2 * LEAST or np.ptp(variable) < 1e-6:
        return None
    order = np.argsort(variable, kind="stable")
    parts = np.array_split(order, min(BINS, len(order) // LEAST))
    columns = [
        [function(values[part]) for part in parts]
        for function, values in (
            (np.mean, variable),
            (np.mean, residual),
            (np.std, residual),
        )
    ]
    return Binned(*(np.array(column) for column in columns))


def slow_ways(signals: Signals, command: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows where the command rises, and where it falls, slower than it mostly does."""
    rate = speed(signals, command)
    moving = np.abs(rate) > 0.02
    if not moving.any():
        return np.array([], int), np.array([], int)
    limit = np.median(np.abs(rate[moving]))
    past = round(SETTLE / float(np.median(np.abs(np.diff(signals.time)))))
    before = np.concatenate([np.full(past, np.inf), np.abs(rate)])
    fastest = np.lib.stride_tricks.sliding_window_view(before, past + 1).max(axis=-1)
    slow = moving & (np.abs(rate) <= limit) & (fastest <= 3.0 * limit)
    return np.flatnonzero(slow & (rate > 0)), np.flatnonzero(slow & (rate < 0))
