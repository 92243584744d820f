"""Checks of a recording before anything is concluded from it; nothing is changed.

`check_recording` (recording.py) refuses what is broken: names, NaN, time that does not
increase. Here is what a readable log may still lack: a rate and a resolution that show
effects, motion enough, and columns that mean what their names say.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Literal, TypeAlias

import numpy as np

from gatjax.data import excitation, sampling, starts, stops, tracking
from gatjax.data.excitation import Moves
from gatjax.data.finding import Finding, Level, Ranges
from gatjax.data.metadata import ANGLE
from gatjax.data.recording import Recording
from gatjax.data.trajectories import JointRun, to_arrays

__all__ = [
    "Finding", "Role", "findings", "same_commands", "same_data", "summary", "trusted",
]  # fmt: skip

Role: TypeAlias = Literal["fit", "held-out"]

ALIKE = 3  # findings of one kind in a file that are told one by one
GRAVEST = ("refuse", "warning", "info")
COLUMNS = ("swapped", "sign")  # what they explain looks like other faults as well
COPIED = 50  # rows in a row that two recordings cannot share by chance
MOVED = 0.01  # rad that a joint must move in them
SHARED = 0.25  # share of a trajectory's motion: simulated ones may begin alike


def findings(recording: Recording, ranges: Ranges, role: Role) -> list[Finding]:
    """Looks a recording over.

    Args:
        recording: passed `check_recording`.
        ranges: limits of every joint, rad; infinite ends for a joint without limits.
        role: what the file is for. Too little motion is refused for "fit" and only a
            warning for "held-out".

    Returns:
        Findings in the order of the checks; the caller obeys level "refuse". What
        compares positions with commands is for commands that are angles.
    """
    joints = _told(recording)
    runs = [_powered(run) for run in to_arrays(recording, joints)]
    position = {joint: recording.columns[f"position.{joint}"] for joint in joints}
    steps = {joint: sampling.encoder_step(position[joint]) for joint in joints}
    noise = {joint: sampling.noise_of([run.angle[:, k] for run in runs])
             for k, joint in enumerate(joints)}  # fmt: skip
    follows = recording.command_unit == ANGLE
    moves = excitation.moves_of(runs, joints, steps)
    if not follows:  # any command will do that moves the joint
        moves = {j: move._replace(command=move.position) for j, move in moves.items()}
    poor: Level = "refuse" if role == "fit" else "warning"
    found = [
        *sampling.check_rate(recording, runs),
        *sampling.check_gaps(recording, runs),
        *sampling.check_resolution(recording, steps, noise),
        *sampling.check_units(recording, ranges),
        *(_against_commands(recording, runs, moves, ranges) if follows else []),
        *stops.check_stops(recording, runs, joints, ranges),
        *excitation.check_excitation(recording, runs, moves, poor),
        *excitation.check_coverage(recording, moves, ranges),
        *excitation.check_rest(recording, runs),
        *(starts.check_start(recording, runs, joints) if follows else []),
    ]
    if any(each.check == "rate" and each.level == "refuse" for each in found):
        return found
    if follows:
        found += tracking.check_tracking(recording, runs, joints)
    return [*found, *tracking.check_repeats(recording, runs, joints)]


def _told(recording: Recording) -> list[str]:
    """Joints that a recording has commands of."""
    return [c[8:] for c in recording.columns if c.startswith("command.")]


def _powered(run: JointRun) -> JointRun:
    """A run whose joints without power were told what they did: they follow nothing."""
    return run._replace(command=np.where(run.stiff > 0.0, run.command, run.angle))


def _against_commands(
    recording: Recording, runs: Sequence[JointRun], moves: Mapping[str, Moves],
    ranges: Ranges,
) -> list[Finding]:  # fmt: skip
    """What positions say beside commands that are angles."""
    return [
        *excitation.check_columns(recording, moves),
        *excitation.check_limits(recording, ranges),
        *excitation.check_saturation(recording, runs, list(moves), ranges),
    ]


def trusted(
    recordings: Sequence[Recording], ranges: Ranges, role: Role
) -> list[list[Finding]]:
    """The findings of each of some recordings that are used together.

    One that moves too little is refused only if all do; joints that stand still in all
    of them are a warning.

    Raises:
        ValueError: one line with why they may not be used.
    """
    found = [findings(recording, ranges, role) for recording in recordings]
    if not all(any(map(_dull, own)) for own in found):
        found = [
            [f._replace(level="warning") if _dull(f) else f for f in own]
            for own in found
        ]
    found = _standing(found)
    refused = [each for own in found for each in own if each.level == "refuse"]
    if refused:
        first = min(refused, key=lambda each: each.check not in COLUMNS)
        more = f" (and {len(refused) - 1} more)" if len(refused) > 1 else ""
        raise ValueError(f"{first.text}{more}")
    return found


def _standing(found: list[list[Finding]]) -> list[list[Finding]]:
    """The findings of some recordings, with a warning where a joint never moves."""
    still = [
        {joint for f in own if f.check == excitation.STANDING for joint in f.values}
        for own in found
    ]
    always = set.intersection(*still) if still else set()
    return [
        [
            f._replace(
                level="warning",
                text=f"{f.text}; of a fault of these that shows in motion a verdict "
                f"says nothing",
            )
            if f.check == excitation.STANDING and always & set(f.values)
            else f
            for f in own
        ]
        for own in found
    ]


def _dull(finding: Finding) -> bool:
    """Whether a file is refused because nothing moves enough in it."""
    return finding.level == "refuse" and finding.check == "excitation"


def summary(
    checked: Sequence[tuple[Recording, Sequence[Finding]]],
) -> list[dict[str, str]]:
    """The findings of several files as `data_checks` of diagnosis.json.

    Returns:
        A dict with file, level, check and text for each, the gravest first; of many
        of one kind in a file the first ones and their number.
    """
    rows, told = [], Counter()
    every = Counter((r.name, f.level, f.check) for r, own in checked for f in own)
    for recording, own in checked:
        for f in own:
            kind = recording.name, f.level, f.check
            told[kind] += 1
            if told[kind] > ALIKE:
                continue
            more = every[kind] - ALIKE if told[kind] == ALIKE else 0
            text = f"{f.text} (and {more} more of this kind)" if more > 0 else f.text
            rows.append({"file": recording.name, "level": f.level, "check": f.check,
                         "text": text})  # fmt: skip
    return sorted(rows, key=lambda row: GRAVEST.index(row["level"]))


def same_data(fit: Sequence[Recording], held: Sequence[Recording]) -> str | None:
    """Finds measured rows that fit and held-out files share, whatever their names.

    Compared are the positions of 50 rows in a row, to 0.1 mrad and without their time;
    not those at rest, in which two recordings can be equal by chance. Motions without
    noise may begin alike, so it takes a quarter of a trajectory's motion.

    Returns:
        One line that says where, or None if no rows are shared.
    """
    for there in held:
        for here in fit:
            columns = [c for c in here.columns if c in there.columns]
            columns = [c for c in columns if c.startswith("position.")]
            shared = _shared_rows(here, there, columns) if columns else None
            if shared is not None:
                first, last = shared
                return (
                    f"{there.name}: rows {first + 1} to {last + 1} are also in "
                    f"{here.name}; a gain on data that was fitted proves nothing, "
                    f"hold out a recording of another motion"
                )
    return None


def same_commands(
    fit: Sequence[Recording], held: Sequence[Recording]
) -> list[list[Finding]]:
    """A warning for each held-out recording that was told what a fitted one was."""
    found: list[list[Finding]] = []
    for there in held:
        joints = _told(there)
        known = [
            run
            for each in fit
            if {*joints} <= {*_told(each)}
            for run in to_arrays(each, joints)
        ]
        own = [
            run
            for run in to_arrays(there, joints)
            if any(tracking.same_commands(each, run) for each in known)
        ]
        text = f"{there.name}: {len(own)} of its trajectories carry the commands of a "
        text += (
            "fitted one; that tells little of other motions, hold out one of another"
        )
        found.append([Finding("warning", "held-out motion", text, {})] if own else [])
    return found


def _shared_rows(
    here: Recording, there: Recording, columns: Sequence[str]
) -> tuple[int, int] | None:
    """First and last row of `there`, from 0, that stand in `here` as well."""
    table = [np.stack([r.columns[c] for c in columns], -1) for r in (here, there)]
    both = np.round(np.concatenate(table).astype(np.float32), 4)
    _, ids = np.unique(both, axis=0, return_inverse=True)
    length = min(COPIED, len(here.time), len(there.time))
    split = len(here.time)
    windows = [
        np.lib.stride_tricks.sliding_window_view(part, length)
        for part in (ids[:split].ravel(), ids[split:].ravel())
    ]
    known = {window.tobytes() for window in windows[0]}
    copied = np.array([window.tobytes() in known for window in windows[1]])
    pieces = np.lib.stride_tricks.sliding_window_view(table[1], length, axis=0)
    moving = (pieces.max(-1) - pieces.min(-1)).max(-1) > MOVED
    begins = there.trajectory[: len(moving)]
    for trajectory in np.unique(begins):
        own = moving & (begins == trajectory)
        found = np.flatnonzero(copied & own)
        if len(found) and len(found) > SHARED * own.sum():
            return int(found[0]), int(found[-1]) + length - 1
    return None
