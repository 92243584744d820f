"""Checks of what was moved: dead columns, limits, excitation, rest, repeats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gatjax.data.finding import Finding, Level, Ranges, cell, listed
from gatjax.data.recording import Recording
from gatjax.data.trajectories import JointRun

LEAST_RANGE = 0.05  # rad, least motion that a verdict on a joint may rest on
LEAST_STEPS = 20  # encoder steps, the same
LEAST_REVERSALS = 1  # turning points: friction and play show only there
LEAST_SECONDS = 2.0
SWING = 0.02  # rad, a shorter way back is no reversal
STILL = 0.002  # rad, what moves less stands still
BEYOND = 0.01  # rad, how far a command may pass a joint limit
AT_LIMIT = 0.03  # rad
FLAT = 0.15  # s, standing that long while the command moves on
REST = 0.5  # s
STANDING = "held still"  # name of a check
ODD = 30.0  # times as far as a joint moves, that it is told to: another unit?
AWAY = 0.2  # rad that a position moves while its command stands still


class Moves(NamedTuple):
    """How much one joint moved in a recording."""

    command: float  # rad, from lowest to highest
    position: float  # rad, the same
    reversals: int  # of the position, all trajectories
    step: float  # rad, encoder; 0 if none shows

    @property
    def excited(self) -> bool:
        """Whether a verdict may rest on this joint."""
        least = max(LEAST_RANGE, LEAST_STEPS * self.step)
        moved = min(self.command, self.position) >= least
        return moved and self.reversals >= LEAST_REVERSALS


def moves_of(
    runs: Sequence[JointRun], joints: Sequence[str], steps: Mapping[str, float]
) -> dict[str, Moves]:
    """How much every joint moved."""
    return {
        joint: Moves(
            command=float(np.ptp(np.concatenate([run.command[:, k] for run in runs]))),
            position=float(np.ptp(np.concatenate([run.angle[:, k] for run in runs]))),
            reversals=sum(reversals(run.angle[:, k], SWING) for run in runs),
            step=steps[joint],
        )
        for k, joint in enumerate(joints)
    }


def reversals(values: np.ndarray, swing: float) -> int:
    """Counts the turning points of a signal [N] with a way of `swing` or more back."""
    count, heading = 0, 0
    low = high = extreme = float(values[0])
    for value in values.tolist():
        if heading == 0:
            low, high = min(low, value), max(high, value)
            if high - low >= swing:
                heading, extreme = (1 if value == high else -1), value
        elif (value - extreme) * heading > 0.0:
            extreme = value
        elif abs(value - extreme) >= swing:
            count, heading, extreme = count + 1, -heading, value
    return count


def check_columns(recording: Recording, moves: Mapping[str, Moves]) -> list[Finding]:
    """Joints whose position does not answer to the command, or the reverse."""
    found = []
    for joint, move in moves.items():
        column = f"position.{joint}"
        least = max(STILL, 2.0 * move.step)
        if move.command > LEAST_RANGE and move.position <= least:
            text = (
                f"{cell(recording, 0, column)}: stays at "
                f"{recording.columns[column][0]:.3g} rad in every row while its "
                f"command moves {move.command:.2g} rad; repair the log, or drop the "
                f"joint with --map and take its actuator out of the model"
            )
            found.append(Finding("refuse", "dead column", text, {joint: move.position}))
        elif move.command < STILL and move.position > AWAY:
            text = (
                f"{recording.name}: column '{column}' moves {move.position:.2g} rad "
                f"while its command stands still; is it the column of another joint?"
            )
            found.append(Finding("warning", "columns", text, {joint: move.position}))
    held = {
        joint: move.position
        for joint, move in moves.items()
        if max(move.command, move.position) < LEAST_RANGE
    }
    if held and len(held) < len(moves):
        text = f"{recording.name}: joints that hardly move show only what their load "
        text += f"does to them (range in rad): {listed(held)}"
        found.append(Finding("info", STANDING, text, held))
    return found


def check_limits(recording: Recording, ranges: Ranges) -> list[Finding]:
    """Commands beyond the joint limits."""
    found = []
    for joint, (low, high) in ranges.items():
        column = f"command.{joint}"
        if column not in recording.columns:
            continue
        values = recording.columns[column]
        out = np.flatnonzero((values > high + BEYOND) | (values < low - BEYOND))
        if out.size:
            text = (
                f"{cell(recording, out[0], column)}: {values[out[0]]:.3g} rad lies "
                f"beyond the joint limits {low:.3g} to {high:.3g} rad ({out.size} such "
                f"rows); the simulation stops there, so check the model's limits"
            )
            found.append(Finding("warning", "limits", text, {joint: float(out.size)}))
    return found


def check_saturation(
    recording: Recording,
    runs: Sequence[JointRun],
    joints: Sequence[str],
    ranges: Ranges,
) -> list[Finding]:
    """Positions that stand at a joint limit while the command moves on."""
    found = []
    for k, joint in enumerate(joints):
        low, high = ranges.get(joint, (-np.inf, np.inf))
        seconds, first = 0.0, -1
        for run in runs:
            at = np.minimum(
                np.abs(run.angle[:, k] - low), np.abs(run.angle[:, k] - high)
            )
            for begin, end in stretches(at < AT_LIMIT):
                long = run.time[end - 1] - run.time[begin]
                if long >= FLAT and np.ptp(run.command[begin:end, k]) > LEAST_RANGE:
                    rows = np.flatnonzero(recording.trajectory == run.trajectory)
                    first = first if first >= 0 else int(rows[begin])
                    seconds += float(long)
        if first >= 0:
            column = f"position.{joint}"
            text = (
                f"{cell(recording, first, column)}: stands at a joint limit while the "
                f"command moves on ({seconds:.2g} s in all); effects in the drive do "
                f"not show there, keep the motion inside the limits"
            )
            found.append(Finding("warning", "saturation", text, {joint: seconds}))
    return found


def check_excitation(
    recording: Recording,
    runs: Sequence[JointRun],
    moves: Mapping[str, Moves],
    bad: Level,
) -> list[Finding]:
    """Whether there is motion enough; `bad` is the level when there is not."""
    seconds = sum(float(run.time[-1] - run.time[0]) for run in runs)
    limit = (
        f"a joint needs {LEAST_RANGE} rad of motion (and {LEAST_STEPS} encoder steps) "
        f"with at least {LEAST_REVERSALS} reversal"
    )
    turns = {joint: float(move.reversals) for joint, move in moves.items()}
    if seconds < LEAST_SECONDS:
        text = (
            f"{recording.name}: {seconds:.3g} s are too short for a verdict, it takes "
        )
        text += f"{LEAST_SECONDS:g} s; record a longer motion"
        return [Finding(bad, "excitation", text, {"seconds": seconds})]
    if not any(move.excited for move in moves.values()):
        most = max(moves, key=lambda joint: moves[joint].position)
        move = moves[most]
        text = (
            f"{recording.name}: no joint moves enough for a verdict: {limit}; the most "
            f"has {most}, {move.position:.2g} rad with {move.reversals} reversals, "
            f"told to move {move.command:.2g} rad; {_mend(move)}"
        )
        return [Finding(bad, "excitation", text, turns)]
    text = f"{recording.name}: {seconds:.3g} s; reversals of the position per joint: "
    text += listed(dict(sorted(turns.items(), key=lambda item: item[1])), ".0f")
    found = [Finding("info", "reversals", text, turns)]
    poor = {
        joint: move.position
        for joint, move in moves.items()
        if not move.excited and max(move.command, move.position) >= LEAST_RANGE
    }
    if poor:
        text = (
            f"{recording.name}: too little motion to show most faults of some joints "
        )
        text += f"(rad moved): {listed(poor)}; {limit}"
        found.append(Finding("warning", "excitation", text, poor))
    return found


def _mend(move: Moves) -> str:
    """What to do about a joint that moves too little."""
    if not ODD * move.position < move.command < 4.0 * ODD * move.position:
        return "record a livelier motion"
    return (
        f"that is {move.command / move.position:.0f} times as far as it moved (a "
        f"radian has 57 degrees): check the units in --map, or record a livelier motion"
    )


def check_coverage(
    recording: Recording, moves: Mapping[str, Moves], ranges: Ranges
) -> list[Finding]:
    """Share of the joint range that was visited."""
    shares = {
        joint: move.position / (ranges[joint][1] - ranges[joint][0])
        for joint, move in moves.items()
        if joint in ranges and np.isfinite(ranges[joint]).all()
        if ranges[joint][1] > ranges[joint][0]
    }
    if not shares:
        return []
    text = f"{recording.name}: share of the joint range that was visited: "
    text += listed(dict(sorted(shares.items(), key=lambda item: item[1])), ".0%")
    return [Finding("info", "range", text, shares)]


def check_rest(recording: Recording, runs: Sequence[JointRun]) -> list[Finding]:
    """Stretches in which every command stands still."""
    count, seconds = 0, 0.0
    for run in runs:
        steady = np.all(np.abs(np.diff(run.command, axis=0)) < 1e-6, axis=1)
        for begin, end in stretches(steady):
            long = float(run.time[end] - run.time[begin])
            if long >= REST:
                count, seconds = count + 1, seconds + long
    text = (
        f"{recording.name}: {count} rests of at least {REST} s, {seconds:.2g} s in all"
    )
    if count == 0:
        text += "; without one, noise and slow motion are harder to tell apart"
    return [Finding("info", "rest", text, {"rests": float(count), "seconds": seconds})]


def stretches(true: np.ndarray) -> list[tuple[int, int]]:
    """Begin and end (exclusive) of every run of True in [N]."""
    edges = np.diff(np.concatenate([[0], true.astype(np.int8), [0]]))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return list(zip(begins.tolist(), ends.tolist(), strict=True))
