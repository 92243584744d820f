"""Dicts of arrays [N] and [N, J]: NPZ files, and the .pt files of PACE."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from gatjax.data.readers.source import (
    Given,
    Run,
    Source,
    Stream,
    numbered,
    rows_of,
    table,
)

TIMES = ("time", "t", "timestamp", "timestamps", "stamps")
RUNS = ("trajectory", "episode", "run")
NAMES = ("joint_names", "joints", "names")
FAMILIES = {
    "command": ("command", "target", "action", "des_dof_pos", "q_des", "q_cmd", "goal"),
    "position": ("position", "dof_pos", "q", "qpos", "state", "angle"),
    "velocity": ("velocity", "dof_vel", "qd", "dq", "qvel"),
    "torque": ("torque", "effort", "tau", "dof_torque"),
}
"""Families of a recording, and what their arrays are called in the wild."""


def read_npz(path: Path, given: Given) -> Source:
    """Read an .npz file; nothing in it is executed.

    Raises:
        ValueError: one line: no such file, objects in it, no time, odd shapes.
    """
    try:
        with path.open("rb") as raw:
            file = np.load(raw, allow_pickle=False)
            if isinstance(file, np.ndarray):
                raise ValueError("it is a single array")
            arrays = {name: file[name] for name in file.files}
    except (ValueError, OSError, EOFError, BadZipFile) as error:
        reason = " ".join(str(error).split())
        raise ValueError(f"{path}: not a plain .npz file: {reason}") from error
    return of_arrays(path, "NPZ", arrays, given)


def stamps_of(names: Collection[str], given: Given) -> str | None:
    """Which name is that of the time: as the map says, or one of `TIMES`."""
    if given.time is not None:
        return given.time if given.time in names else None
    known = {name.lower(): name for name in names}
    return next((known[name] for name in TIMES if name in known), None)


def of_arrays(
    path: Path, kind: str, arrays: Mapping[str, np.ndarray], given: Given
) -> Source:
    """A log that is a dict of arrays whose rows are samples.

    Arrays [N] and [N, J] share the one time [N]; what is shaped otherwise is left out.
    One that numbers the runs, whole numbers [N], parts them.
    """
    stamps = stamps_of(arrays, given)
    time = None if stamps is None else arrays[stamps]
    if time is None or np.ndim(time) != 1:
        raise ValueError(
            f"{path}: no array of times [N] ({given.time or ', '.join(TIMES)}); it has "
            f"{', '.join(f'{n} {a.shape}' for n, a in arrays.items())}"
        )
    time = np.asarray(time, np.float64)
    usual = (n for n in RUNS if not given.skips(n) and _counts(arrays.get(n), time))
    numbers = given.run or next(usual, None)
    if numbers is not None and not _counts(arrays.get(numbers), time):
        raise ValueError(
            f"{path}: {numbers!r} is no array of the runs' numbers {time.shape}; it "
            f"has {', '.join(arrays)}"
        )
    listed = next((arrays[name] for name in NAMES if name in arrays), None)
    joints = None if listed is None else [str(each) for each in np.ravel(listed)]
    run: Run = {}
    draft: dict[str, dict[str, Any]] = {}
    left, taken = [], set[str]()
    for name, array in arrays.items():
        if name in (stamps, numbers) or name in NAMES:
            continue
        fits = array.ndim in (1, 2) and len(array) == len(time)
        if not fits or not np.issubdtype(array.dtype, np.number):
            left.append(f"{name} {array.shape}")
            continue
        if array.ndim == 1 and _family(name) and len(joints or [""]) == 1:
            array = array[:, None]  # of the only joint
        if array.ndim == 1:
            run[name] = Stream(time, array.astype(np.float64))
            continue
        count = array.shape[1]
        whole = joints is None or len(joints) == count
        own = joints if joints and whole else numbered(count)
        run |= table(f"{name}.", own, time, array)
        family = _family(name)
        if whole and family and family not in taken:  # else a base, or another loop
            taken.add(family)
            draft |= {f"{family}.{j}": {"from": f"{name}.{j}"} for j in own}
    notes = []
    if left:
        notes.append(f"{path}: left out, no rows of samples: {', '.join(left)}")
    runs = [run] if numbers is None else [
        {name: Stream(*(part[rows] for part in stream)) for name, stream in run.items()}
        for rows in rows_of(arrays[numbers])
    ]  # fmt: skip
    return Source(str(path), kind, runs, draft, {}, notes)


def _counts(array: np.ndarray | None, time: np.ndarray) -> bool:
    """Whether an array can number the runs of the rows: whole numbers [N]."""
    if array is None or array.shape != time.shape or array.dtype.kind not in "iuf":
        return False
    return bool((np.isfinite(array) & (array == np.round(array))).all())


def _family(name: str) -> str | None:
    """Family of a recording that an array belongs to, if its name tells."""
    low = name.lower()
    return next((f for f, names in FAMILIES.items() if low in names), None)
