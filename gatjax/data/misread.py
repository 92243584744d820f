"""Readings that cannot be true: glitches of an encoder, and rows that were not read.

Both look like faults of the robot to whatever simulates it. They are interpolated, so
that loads and noise do not come from them, either.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from gatjax.data.finding import Finding, angle, cell
from gatjax.data.recording import Recording
from gatjax.data.trajectories import scatter, stretches

GLITCH = 0.05  # rad that a reading is off the rows beside it, at least
UNLIKE = 20.0  # times what most readings are off those
APART = 5.0  # times what those are off each other
STALE = 2  # rows in a row that repeat the one before, at most
NEAR = 4  # rows on each side that tell how fast a joint moves
CAUGHT_UP = 0.3  # share of the next step that may differ from what was missed
STEPS = 10.0  # steps, or deviations of noise, of a joint that moves
OFTEN = 0.005  # share of rows; fewer may come of chance, as a coarse encoder's do
FEWEST = 8  # rows of a trajectory


def mended(recording: Recording) -> tuple[Recording, list[Finding]]:
    """Interpolate positions that were misread, with a warning.

    Args:
        recording: passed `check_recording`.
    """
    names = [name for name in recording.columns if name.startswith("position.")]
    angles = np.stack([recording.columns[name] for name in names], axis=-1)
    off, old = np.zeros(angles.shape, bool), np.zeros(len(angles), bool)
    out = angles.copy()
    for run in np.unique(recording.trajectory):
        rows = np.flatnonzero(recording.trajectory == run)
        if len(rows) < FEWEST:
            continue
        off[rows], old[rows] = glitches(angles[rows]), stale(angles[rows])
        old[rows] &= old[rows].mean() > OFTEN
        wrong, time = off[rows] | old[rows, None], recording.time[rows]
        for k in np.flatnonzero(wrong.any(0)):
            good, bad = rows[~wrong[:, k]], rows[wrong[:, k]]
            spline = CubicSpline(time[~wrong[:, k]], angles[good, k])
            out[bad, k] = spline(recording.time[bad])
    if not (off.any() or old.any()):
        return recording, []
    columns = recording.columns | dict(zip(names, out.T, strict=True))
    whole = recording._replace(columns=columns)
    return whole, [
        *_glitched(recording, names, off, angles - out),
        *_old(recording, old),
    ]


def glitches(angles: np.ndarray) -> np.ndarray:
    """Readings [N, J] that are far off the rows beside them, which agree."""
    inner = angles[2:-2]
    before, after = angles[1:-3], angles[3:-1]
    cubic = (4.0 * (before + after) - angles[:-4] - angles[4:]) / 6.0
    away = np.abs(inner - cubic)
    usual = np.quantile(away, 0.95, axis=0)
    beside = np.abs(inner - 0.5 * (before + after))
    bent = np.abs(after - before - 0.5 * (angles[4:] - angles[:-4]))
    alone = (beside > APART * bent) & (beside > GLITCH)
    found = np.zeros(angles.shape, bool)
    found[2:-2] = alone & (away > np.maximum(GLITCH, UNLIKE * usual))
    return found


def stale(angles: np.ndarray) -> np.ndarray:
    """Rows [N] that repeat the one before at all joints, though these moved on.

    The step after them makes up for what was missed; that of a joint which stuck does
    not.
    """
    step = np.diff(angles, axis=0, prepend=angles[:1])
    same = (step == 0.0).all(1)
    same[0] = False
    found = np.zeros(len(angles), bool)
    clean = ~same & ~np.roll(same, 1)
    clean[0] = False
    least = STEPS * _resolution(angles)
    for first, end in stretches(same):
        if end - first > STALE or end >= len(angles):
            continue
        near = slice(max(first - NEAR, 0), end + NEAR + 1)
        usual = step[near][clean[near]]
        if len(usual) < 2:
            continue
        missed, jump = (end - first + 1) * usual.mean(0), step[end]
        caught = np.abs(jump - missed) < CAUGHT_UP * np.abs(jump)
        found[first:end] = (caught & (np.abs(jump) > least)).any()
    return found


def _resolution(angles: np.ndarray) -> np.ndarray:
    """What readings [N, J] tell apart [J], rad: noise, or steps of an encoder."""
    steps = [np.diff(np.unique(np.round(each, 9))) for each in angles.T]
    least = [each.min() if len(each) else np.inf for each in steps]
    return np.maximum(scatter(angles), least)


def _glitched(
    recording: Recording, names: list[str], off: np.ndarray, away: np.ndarray
) -> list[Finding]:
    if not off.any():
        return []
    row, k = np.argwhere(off)[0]
    more = f" ({off.sum()} readings like that)" if off.sum() > 1 else ""
    text = (
        f"{cell(recording, row, names[k])}: reads {angle(abs(float(away[row, k])))} "
        f"off the rows beside it{more}; no joint moves like that: interpolated"
    )
    return [Finding("warning", "readings", text, {"glitches": float(off.sum())})]


def _old(recording: Recording, old: np.ndarray) -> list[Finding]:
    if not old.any():
        return []
    row = int(np.flatnonzero(old)[0])
    text = (
        f"{cell(recording, row, 'position')}: repeats the row before at all joints, "
        f"though they move ({old.mean():.1%} of the rows do), as where a bus is not "
        f"read in time: interpolated"
    )
    return [Finding("warning", "readings", text, {"stale": float(old.mean())})]
