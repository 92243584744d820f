"""How well a world predicts a short while ahead of measured states."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from gatjax.data.trajectories import GAP, JointRun
from gatjax.diagnosis import chance
from gatjax.diagnosis.measure import APART, BLOCK, Errors, back, speed, started
from gatjax.sim.causes import reported_late
from gatjax.sim.native import Native
from gatjax.sim.world import World, stiffened

HORIZONS = (0.5, 0.1, 0.0)  # s ahead of a measured state; 0: one step
STRIDE = 0.1  # s between two windows
WARM = 0.12  # s of a window that only fills the effects' memories


def warming(period: float) -> int:
    """Rows of a window up to its start."""
    return round(WARM / period) + back(period)


class Windows(NamedTuple):
    """Pieces of logs, B of them: W rows up to the measured start, T that follow."""

    command: np.ndarray  # [B, W + T, J] rad
    angle: np.ndarray  # [B, W + T, J] rad
    stiffness: np.ndarray  # [B, W + T, J]
    velocity: np.ndarray  # [B, J] rad/s at the start
    block: np.ndarray  # [B]
    number: np.ndarray  # [B] of the run
    start: np.ndarray  # [B] s from the first row of the run to the start
    runs: list[JointRun]


def windows(runs: list[JointRun], period: float) -> Windows | None:
    """Cut runs into windows of the longest horizon after a warm-up, if there are any.

    None of them lacks a row.
    """
    warm, length = warming(period), max(1, round(HORIZONS[0] / period))
    stride, rows = max(1, round(STRIDE / period)), []
    for number, run in enumerate(runs):
        for first in range(0, len(run.time) - warm - length + 1, stride):
            part = slice(first, first + warm + length)
            if np.diff(run.time[part]).max() > (1.0 + GAP) * period:
                continue  # rows are missing
            past = slice(first + warm - back(period), first + warm)
            slope = speed(run, past, first + warm - 1)
            block = number * APART + int((run.time[first] - run.time[0]) / BLOCK)
            series = run.command[part], run.angle[part], run.stiff[part]
            start = run.time[first + warm - 1] - run.time[0]
            rows.append((*series, slope, block, number, start))
    if not rows:
        return None
    columns = (np.array(column) for column in zip(*rows, strict=True))
    return Windows(*columns, runs=runs)


def windowed(world: World, cut: Windows, period: float) -> np.ndarray:
    """Predictions [B, T, J] rad of windows, each from its measured start.

    The joints start where the world's encoders report what was measured, at the time
    at which its clock says that it was. Where they report late, that is as long ago.
    """
    warm, rate = warming(period), _rate(world)
    late = reported_late(world.model, world.causes)
    early, angle, velocity = 0, cut.angle[:, :warm], cut.velocity
    if late.any():  # and a row more, for what is read between two rows
        early = min(int(np.ceil(late.max() / period - 1e-9)) + 1, warm - 2)
        angle, velocity = _before(cut, early, late / period, period)
    # Row t holds the angle when command t comes into force: command warm - 1 acts
    # from the start on.
    commands, stiff = _in_force(cut, rate, period)
    world = world if (stiff == 1.0).all() else stiffened(world)
    native, count = Native(world), world.model.nu
    rows = native.behind(world.values, angle.reshape(-1, count))
    angles = rows.reshape(*angle.shape)
    qpos, qvel = started(world, native, angle[:, -1], velocity / rate)
    drawn = [
        native.replay(world.values, commands, angles[:, :-1], qpos, qvel, stiff, noise)
        for noise in chance.draws(world, commands.shape)
    ]
    return np.mean(drawn, axis=0)[:, early:][:, : cut.angle.shape[1] - warm]


def _before(
    cut: Windows, early: int, late: np.ndarray, period: float
) -> tuple[np.ndarray, np.ndarray]:
    """What windows tell of joints that are seen late, up to some rows before the start.

    Args:
        cut: W rows up to the measured start.
        early: rows.
        late: [J] rows, at most `early`.
        period: s between two rows.

    Returns:
        Angles [B, W - early, J] rad at those rows, and speeds [B, J] rad/s at the last.
    """
    warm = warming(period)
    rows = np.arange(warm)
    spline = CubicSpline(rows, cut.angle[:, :warm], axis=1)
    at = rows[: warm - early, None] + np.minimum(late, early)
    angle = np.stack([spline(at[:, k])[..., k] for k in range(len(late))], -1)
    slopes = []
    for k, row in enumerate(at[-1]):
        last = min(warm, int(np.ceil(row)) + back(period) // 2 + 1)
        near = slice(max(0, last - back(period)), last)
        fitted = np.polyfit(rows[near] - row, cut.angle[:, near, k].T, 2)
        slopes.append(fitted[1] / period)
    return angle, np.stack(slopes, -1)


def _rate(world: World) -> float:
    """True seconds in a second of the log's clock, which is that of all joints."""
    drifts = world.values.log.values() if world.values.log else ()
    return float(np.prod([1.0 - drift[0] for drift in drifts]))


def _in_force(
    cut: Windows, rate: float, period: float
) -> tuple[np.ndarray, np.ndarray]:
    """Commands rad and stiffness [B, rows, J] that led to the angles of windows.

    There are W + T - 1 rows, and more where a second of the log is longer than a true
    one. A start that is stamped t was at rate t, and so is what was in force around it;
    between two rows, it is the mean over a tick.
    """
    if rate == 1.0:
        return cut.command[:, :-1], cut.stiffness[:, :-1]
    warm, length = warming(period), cut.command.shape[1]
    more = int(np.ceil(max(0.0, rate - 1.0) * (length - warm)))
    ahead = period * (np.arange(length - 1 + more) - (warm - 1))
    rows = []
    for number, start in zip(cut.number, cut.start, strict=True):
        run = cut.runs[number]
        true, stamps = rate * start + ahead, run.time - run.time[0]
        rows.append([
            np.stack([np.interp(true, stamps, column) for column in series.T], -1)
            for series in (run.command, run.stiff)
        ])  # fmt: skip
    command, stiff = (np.stack(column) for column in zip(*rows, strict=True))
    return command, stiff


def window_errors(
    cut: Windows, predicted: np.ndarray, horizon: float, period: float
) -> Errors:
    """Errors at the end of a horizon."""
    warm = warming(period)
    row = max(1, round(horizon / period)) - 1
    error = predicted[:, row] - cut.angle[:, warm + row]
    return Errors(np.square(error), cut.block)
