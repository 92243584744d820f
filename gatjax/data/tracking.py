"""Checks of columns against each other: sign, shift, swapped joints, units, repeats."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gatjax.data.finding import DEGREES, Finding, Level, angle
from gatjax.data.mapping import degrees_map
from gatjax.data.recording import Recording
from gatjax.data.trajectories import JointRun

WINDOW = 1.0  # s, shifts that are looked for, either way
LATEST = 0.3  # s, servos answer sooner
EARLIEST = -0.05  # s, readings cannot lead their command by more
ALIKE = 0.7  # correlation that counts as the same motion
UNLIKE = 0.4  # correlation that does not
SLACK = 0.05  # of its motion by which a late joint may miss it, if only clocks differ
APART = 0.1  # s between the halves of a run: no shift but a clock that drifts
REPEATS = 0.02  # of correlation by which a lag that no servo has must be better
LIVELY = 0.01  # rad rms of fast motion that a shift may be read from
REPEATED = 0.02  # of its motion by which a repeated command may differ


class Shifts(NamedTuple):
    """Seconds that a position lags behind its command; None where it cannot be read."""

    whole: float | None
    first: float | None  # half of the run
    second: float | None

    @property
    def drift(self) -> float:
        """By how much the lags of the halves differ, s; 0 if unknown."""
        if self.first is None or self.second is None:
            return 0.0
        return abs(self.second - self.first)


def check_tracking(
    recording: Recording, runs: Sequence[JointRun], joints: Sequence[str]
) -> list[Finding]:
    """Position columns that do not follow the command column of their name.

    Joints that hardly move are left out. Correlations are of the longest trajectory.
    """
    run = max(runs, key=lambda each: len(each.time))
    period = float(np.median(np.diff(run.time)))
    grid = np.arange(run.time[0], run.time[-1], period)
    command, position = (
        np.stack([np.interp(grid, run.time, column) for column in table.T], axis=-1)
        for table in (run.command, run.angle)
    )
    moved = np.minimum(np.ptp(command, axis=0), np.ptp(position, axis=0)) > 5 * LIVELY
    if len(grid) * period < 2.0 * WINDOW or not moved.any():
        return []
    alike = _correlation(command, position, period)  # [J command, J position, 2]
    found: list[Finding] = []
    lags: dict[str, Shifts] = {}
    slopes, reach = {}, {}
    for k in np.flatnonzero(moved).tolist():
        joint, own = joints[k], alike[k, k]
        others = np.where(moved, alike[:, k, 1], -1.0)
        others[k] = -1.0
        other = int(np.argmax(others))
        column = f"{recording.name}: column 'position.{joint}'"
        strange = own[1] < UNLIKE and others[other] > ALIKE
        against = own[0] < -ALIKE and own[1] < -own[0] - 0.1
        if against and not (strange and alike[other, other, 1] < UNLIKE):
            text = f"{column} moves against its command (correlation {own[0]:.2f}); "
            text += "use a map with sign: -1"
            found.append(Finding("refuse", "sign", text, {joint: float(own[0])}))
        elif strange:
            text = f"{column} follows command.{joints[other]} (correlation "
            text += f"{others[other]:.2f}) and not its own ({own[1]:.2f}); are columns "
            text += "swapped? rename them with --map"
            found.append(Finding("refuse", "swapped", text, {joint: float(own[1])}))
        else:
            lags[joint] = _shifts(command[:, k], position[:, k], period)
            reach[joint] = float(np.std(position[:, k]) / np.std(command[:, k]))
            if own[1] > ALIKE:
                slopes[joint] = reach[joint]
    late = _delays(recording, lags, reach, period)
    return [*found, *_units(recording, slopes), *late]


def check_repeats(
    recording: Recording, runs: Sequence[JointRun], joints: Sequence[str]
) -> list[Finding]:
    """Trajectories with the same commands, and how far their positions differ."""
    first: list[JointRun] = []
    spread: dict[str, float] = {}
    pairs = []
    for run in runs:
        same = next((each for each in first if same_commands(each, run)), None)
        if same is None:
            first.append(run)
            continue
        pairs.append(f"{same.trajectory} and {run.trajectory}")
        for k, joint in enumerate(joints):
            since = same.time - same.time[0]
            there = np.interp(run.time - run.time[0], since, same.angle[:, k])
            apart = float(np.sqrt(np.mean(np.square(run.angle[:, k] - there))))
            spread[joint] = max(spread.get(joint, 0.0), apart)
    if not pairs:
        return []
    worst = max(spread, key=lambda joint: spread[joint])
    text = (
        f"{recording.name}: column 'trajectory': {', '.join(pairs[:3])} carry the same "
        f"commands and differ by up to {angle(spread[worst])} rms (position.{worst}); "
        f"more than noise means a cause that changes with time, heat or chance"
    )
    return [Finding("info", "repeats", text, spread)]


def same_commands(one: JointRun, other: JointRun) -> bool:
    """Whether two trajectories were told the same, but for jitter of time."""
    count = min(len(one.time), len(other.time))
    if count < 0.95 * max(len(one.time), len(other.time)):
        return False
    apart = np.sqrt(np.mean(np.square(one.command[:count] - other.command[:count])))
    moved = np.sqrt(np.mean(np.var(one.command[:count], axis=0)))
    stiff = np.mean(np.abs(one.stiff[:count] - other.stiff[:count])) < REPEATED
    return bool(moved > 0.0 and apart < REPEATED * moved and stiff)


def _correlation(
    command: np.ndarray, position: np.ndarray, period: float
) -> np.ndarray:
    """Least and largest correlation [J, J, 2] over delays from 0 to `LATEST`."""
    high = round(LATEST / period)
    values = []
    for lag in np.unique(np.linspace(0, high, 16).astype(int)):
        sent = command[: len(command) - lag] - command[: len(command) - lag].mean(
            axis=0
        )
        seen = position[lag:] - position[lag:].mean(axis=0)
        size = np.linalg.norm(sent, axis=0)[:, None] * np.linalg.norm(seen, axis=0)
        values.append(sent.T @ seen / np.maximum(size, 1e-12))
    return np.stack([np.min(values, axis=0), np.max(values, axis=0)], axis=-1)


def _shift(command: np.ndarray, position: np.ndarray, period: float) -> float | None:
    """Seconds [within `WINDOW`] that the position lags, read from its fast motion.

    What repeats itself fits at many lags: one that a servo can have goes first.
    """
    width = max(round(1.0 / period), 3)
    box = np.ones(width) / width
    fast = [
        each
        - np.convolve(np.pad(each, width, mode="edge"), box, mode="same")[width:-width]
        for each in (command, position)
    ]
    if min(np.std(each) for each in fast) < LIVELY:
        return None
    most = min(round(WINDOW / period), len(command) // 3)
    inner = fast[1][most:-most] - fast[1][most:-most].mean()
    score = []
    for lag in range(-most, most + 1):
        sent = fast[0][most - lag : len(command) - most - lag]
        size = len(inner) * np.std(sent) * np.std(inner)
        score.append(float(sent @ inner / max(size, 1e-12)))
    lags = period * np.arange(-most, most + 1)
    usual = (lags > EARLIEST - period) & (lags <= LATEST)
    best = int(np.argmax(np.where(usual, np.array(score) + REPEATS, score)))
    return float(lags[best]) if score[best] > ALIKE else None


def _shifts(command: np.ndarray, position: np.ndarray, period: float) -> Shifts:
    """Lag of the whole run, and of its two halves."""
    half = len(command) // 2
    return Shifts(
        *(
            _shift(command[part], position[part], period)
            for part in (slice(None), slice(None, half), slice(half, None))
        )
    )


def _delays(
    recording: Recording, lags: dict[str, Shifts], reach: dict[str, float],
    period: float,
) -> list[Finding]:  # fmt: skip
    """Words for the delays of all joints, and for those that few servos have.

    A servo that lags so much, or a limit of its speed, takes some of the motion away;
    clocks that differ do not.
    """
    known = {
        joint: each.whole for joint, each in lags.items() if each.whole is not None
    }
    if not known:
        return []
    middle = 1e3 * float(np.median(list(known.values())))
    text = f"{recording.name}: positions follow their commands after {middle:.0f} ms "
    text += "(median of the joints)"
    early = middle < -1e3 * period
    if early:
        text += ": before them; are commands and positions swapped?"
    found = [Finding("warning" if early else "info", "delay", text, known)]
    for joint, lag in known.items():
        if EARLIEST - period < lag <= LATEST:
            continue
        way = "after" if lag > 0 else "before"
        text = f"{recording.name}: column 'position.{joint}' moves {abs(lag):.2g} s "
        text += f"{way} its command; "
        slow = lag > LATEST and abs(reach[joint] - 1.0) > SLACK
        if lags[joint].drift > APART:
            text += f"{lags[joint].drift:.2g} s more in one half of the log than in "
            text += "the other: the clocks of commands and positions run apart"
        elif slow:
            text += f"it moves {reach[joint]:.2f} times as far: a slow servo, or "
            text += "clocks that differ"
        else:
            text += "commands and positions come from different clocks, align them"
        constant = abs(lag) > LATEST and lags[joint].drift <= APART and not slow
        level: Level = "refuse" if constant else "warning"
        found.append(Finding(level, "shifted", text, {joint: lag}))
    return found


def _units(recording: Recording, slopes: dict[str, float]) -> list[Finding]:
    """Positions in another unit than their commands; how far they move beside them."""
    wrong = {
        joint: f"{family}.{joint}"
        for family, size in (("position", DEGREES), ("command", 1.0 / DEGREES))
        for joint, factor in slopes.items()
        if 0.8 < factor / size < 1.25
    }
    advice = repr(degrees_map(list(wrong.values()), recording.columns))
    found = []
    for joint, column in wrong.items():
        text = f"{recording.name}: column 'position.{joint}' moves {slopes[joint]:.2g} "
        text += f"times as far as its command: its {column.partition('.')[0]} looks "
        text += f"like degrees; say so in a --map file: {advice}"
        found.append(Finding("refuse", "units", text, {joint: slopes[joint]}))
    return found
