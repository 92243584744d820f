"""Trajectories in and out of recordings, and the split into seen and held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gatjax.data.recording import Recording
from gatjax.records import FORCE_SENSORS, JOINTS, Trajectory

RATE_TOLERANCE = 0.05  # of the control period, for the median time step
GAP = 0.5  # of the control period: a step further off than this is a gap

Columns = dict[str, np.ndarray]
"""Columns [N] of one trajectory by name."""


class JointRun(NamedTuple):
    """What the joints were told and did in one trajectory."""

    trajectory: int  # id in the recording
    time: np.ndarray  # [T] s
    command: np.ndarray  # [T, J] rad
    angle: np.ndarray  # [T, J] rad
    stiffness: np.ndarray | None = None  # [T, J] share of the nominal gain, 0: off
    within: bool = False  # a piece of a longer run: it starts as it was measured

    @property
    def stiff(self) -> np.ndarray:
        """Share of the nominal gain [T, J], 1 where the log does not say."""
        return np.ones_like(self.command) if self.stiffness is None else self.stiffness

    def part(self, rows: np.ndarray) -> JointRun:
        """Return some rows: indices, or bool [T]."""
        cut = {name: getattr(self, name)[rows] for name in ("time", "command", "angle")}
        stiff = None if self.stiffness is None else self.stiffness[rows]
        return self._replace(**cut, stiffness=stiff)


def to_recording(
    trajectory: Trajectory, robot: str, rate_hz: float, notes: Mapping[str, object]
) -> Recording:
    """Turns a batch of runs [N, T, ...] into a recording with ids 0 to N - 1.

    Rows after a fall (`alive` False) are left out, and so is `base.*` where nobody knew
    where the robot was (NaN). The rest is taken as it is, so a run that diverged
    (`Outcome.ok` False) must not be in the batch.

    Raises:
        ValueError: no row is left.
    """
    alive = np.asarray(trajectory.alive, bool)
    if not alive.any():
        raise ValueError(f"{robot}: no trajectory has a row before its fall")
    known = np.isfinite(np.asarray(trajectory.base.position)[alive]).all()
    groups = {
        **_named("command", JOINTS, trajectory.command),
        **_named("position", JOINTS, trajectory.reading.angle),
        **_named("gyro", "xyz", trajectory.reading.gyro),
        **_named("accelerometer", "xyz", trajectory.reading.accelerometer),
        **_named("force", FORCE_SENSORS, trajectory.reading.force),
    }
    if known:
        groups |= _named("base", "xyz", trajectory.base.position)
        groups |= _named("base", ("qw", "qx", "qy", "qz"), trajectory.base.quaternion)
    runs = np.arange(alive.shape[0])[:, None]
    return Recording(
        name=robot,
        time=np.asarray(trajectory.time, np.float64)[alive],
        trajectory=np.broadcast_to(runs, alive.shape)[alive],
        columns={column: values[alive] for column, values in groups.items()},
        metadata={
            **{key: str(value) for key, value in notes.items()},
            "robot": robot,
            "base": "floating",
            "rate_hz": float(rate_hz),
        },
    )


def check_logged(recording: Recording, joints: Sequence[str]) -> None:
    """Refuse a recording that lacks a command or position of one of the joints.

    Raises:
        ValueError: one line with the joints and what to do.
    """
    missing = [
        joint
        for joint in joints
        if not {f"command.{joint}", f"position.{joint}"} <= recording.columns.keys()
    ]
    if missing:
        raise ValueError(
            f"{recording.name}: no command and position of {', '.join(missing)}; a "
            f"joint of the model needs both: log it, or remove its actuator from the "
            f"model"
        )


def channels(
    recording: Recording, names: Sequence[str], ids: np.ndarray | None = None
) -> list[np.ndarray]:
    """Other columns [T, C] of each trajectory, ids ascending.

    Args:
        recording: that has them.
        names: of the columns, C.
        ids: of the trajectories; all if left out.

    Raises:
        ValueError: one line with the columns that are missing.
    """
    missing = [name for name in names if name not in recording.columns]
    if missing:
        raise ValueError(
            f"{recording.name}: no column {', '.join(missing)}; log it, or choose a "
            f"method that does not need it"
        )
    values = np.stack([recording.columns[name] for name in names], axis=-1)
    wanted = np.unique(recording.trajectory) if ids is None else np.sort(ids)
    return [values[recording.trajectory == run] for run in wanted]


def to_arrays(recording: Recording, joints: Sequence[str]) -> list[JointRun]:
    """Cuts a recording into its trajectories, ids ascending, J as in `joints`.

    Raises:
        ValueError: the recording lacks a command or position of one of the joints.
    """
    check_logged(recording, joints)
    command = np.stack([recording.columns[f"command.{j}"] for j in joints], axis=-1)
    angle = np.stack([recording.columns[f"position.{j}"] for j in joints], axis=-1)
    full, stiff = np.ones(len(recording.time)), None
    if any(f"stiffness.{joint}" in recording.columns for joint in joints):
        told = [recording.columns.get(f"stiffness.{joint}", full) for joint in joints]
        told = np.stack(told, axis=-1)
        stiff = told if (told != 1.0).any() else None
    return [
        JointRun(int(run), recording.time, command, angle, stiff).part(
            recording.trajectory == run
        )
        for run in np.unique(recording.trajectory)
    ]


def cut_columns(recording: Recording, names: Sequence[str]) -> list[Columns]:
    """Cuts some columns into trajectories, in the order of `to_arrays`."""
    return [
        {name: recording.columns[name][recording.trajectory == run] for name in names}
        for run in np.unique(recording.trajectory)
    ]


def stretches(rows: np.ndarray) -> np.ndarray:
    """First row and end [K, 2] of each stretch of a mask [N] bool."""
    edges = np.flatnonzero(np.diff(rows.astype(int), prepend=0, append=0))
    return edges.reshape(-1, 2)


def scatter(angle: np.ndarray) -> np.ndarray:
    """Standard deviation [J] of readings [T, J], from their third differences.

    The median of these leaves out what moves fast now and then; 0 of three rows.
    """
    if len(angle) < 4:
        return np.zeros(angle.shape[1])
    third = np.abs(np.diff(angle, 3, axis=0))
    return np.median(third, axis=0) / (0.6745 * np.sqrt(20.0))


def soon_after(time: np.ndarray, happens: np.ndarray, seconds: float) -> np.ndarray:
    """Rows [N] bool at which something happens [N] bool, or did less long ago."""
    last = np.where(happens, time, -np.inf)
    return time - np.maximum.accumulate(last) < seconds


def at_rate(recording: Recording, period: float) -> tuple[Recording, int]:
    """Checks that a recording was sampled once a control period, and cuts its gaps.

    Whoever learns from neighbouring rows takes them to be one period apart. So a step
    that is shorter than half a period or longer than one and a half ends a trajectory:
    the rows after it get a new id. Nothing is resampled.

    Args:
        recording: checked by `check_recording`.
        period: control period, s.

    Returns:
        The recording, trajectory ids from 0 if there were gaps, and how many gaps.

    Raises:
        ValueError: the median time step is more than 5 % off.
    """
    order = np.argsort(recording.trajectory, kind="stable")
    same = np.diff(recording.trajectory[order]) == 0
    steps = np.diff(recording.time[order])
    median = float(np.median(steps[same])) if same.any() else period
    if abs(median / period - 1.0) > RATE_TOLERANCE:
        if abs(median / period / 1000.0 - 1.0) < RATE_TOLERANCE:
            raise ValueError(
                f"{recording.name}: a row every {median:.4g} s looks like "
                f"milliseconds; use a map with time: {{unit: ms}}"
            )
        raise ValueError(
            f"{recording.name}: a row every {1000.0 * median:.4g} ms, the control "
            f"period is {1000.0 * period:.4g} ms; choose the --rate-hz of the log "
            f"(50, 100 or 83.3), or resample it to {1.0 / period:.4g} Hz"
        )
    gaps = same & (np.abs(steps / period - 1.0) > GAP)
    if not gaps.any():
        return recording, 0
    cut = np.empty(len(order), np.int64)
    cut[order] = np.concatenate([[0], np.cumsum(gaps | ~same)])
    return recording._replace(trajectory=cut), int(gaps.sum())


def split_by_trajectory(
    ids: Sequence[int] | np.ndarray, held_out_share: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Draws whole trajectories to hold out: neighbouring rows are no independent test.

    Args:
        ids: trajectory ids, repeated ones count once, order does not matter.
        held_out_share: share of the trajectories to hold out, between 0 and 1.
        seed: same seed, same split.

    Returns:
        Ids to train on and ids held out, both ascending, at least one each.

    Raises:
        ValueError: the share is not between 0 and 1, or fewer than two trajectories.
    """
    unique = np.unique(np.asarray(ids))
    if not 0.0 < held_out_share < 1.0:
        raise ValueError(f"held_out_share is {held_out_share}; choose between 0 and 1")
    if unique.size < 2:
        raise ValueError(
            f"{unique.size} trajectory can not be split; record at least two"
        )
    held_out = min(max(round(held_out_share * unique.size), 1), unique.size - 1)
    shuffled = np.random.default_rng(seed).permutation(unique)
    return np.sort(shuffled[held_out:]), np.sort(shuffled[:held_out])


def _named(
    family: str, parts: Sequence[str], values: np.ndarray
) -> dict[str, np.ndarray]:
    """Columns `<family>.<part>` [N, T] of an array [N, T, len(parts)]."""
    array = np.asarray(values, np.float64)
    return {f"{family}.{part}": array[..., k] for k, part in enumerate(parts)}
