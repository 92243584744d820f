"""SAGE CSV: a folder with control.csv and state_motor.csv, gzipped or not.

Each row of the two files has a vector of all joints in one cell; stamps are in
microseconds (github.com/isaac-sim2real/sage).
"""

from __future__ import annotations

import csv
import gzip
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from gatjax.data.readers.source import Run, Source, numbered, table

CONTROL, STATE, JOINTS = "control.csv", "state_motor.csv", "joint_list.txt"
FAMILIES = {"positions": "position", "velocities": "velocity", "torques": "torque"}


def is_sage(path: Path) -> bool:
    """Whether a folder holds one motion."""
    return path.is_dir() and _file(path, CONTROL) is not None


def read(path: Path) -> Source:
    """Read the folder of one motion.

    Raises:
        ValueError: one line with file, row and column.
    """
    control, state = _needed(path, CONTROL), _needed(path, STATE)
    sent, received = _vectors(control), _vectors(state)
    count = sent["positions"][1].shape[1]
    listed = path / JOINTS
    joints = numbered(count)
    if listed.is_file():
        joints = listed.read_text(encoding="utf-8").split()
    if len(joints) != count:
        raise ValueError(f"{listed}: names {len(joints)} joints, {control} has {count}")
    run: Run = table("control.", joints, *sent["positions"])
    draft: dict[str, dict[str, Any]] = {"time": {"unit": "us"}}
    for joint in joints:
        draft[f"command.{joint}"] = {"from": f"control.{joint}"}
    for column, family in FAMILIES.items():
        if column in received:
            run |= table(f"state.{family}.", joints, *received[column])
            draft |= {f"{family}.{j}": {"from": f"state.{family}.{j}"} for j in joints}
    metadata = {"robot": "sage", "base": "fixed", "motion": path.name}
    return Source(str(path), "SAGE CSV", [run], draft, metadata, [])


def _file(folder: Path, name: str) -> Path | None:
    """A file of a folder, gzipped or not."""
    places = (folder / name, folder / f"{name}.gz")
    return next((place for place in places if place.is_file()), None)


def _needed(folder: Path, name: str) -> Path:
    """A file that has to be there."""
    found = _file(folder, name)
    if found is None:
        raise ValueError(f"{folder}: a SAGE motion has {name}; this has none")
    return found


def _vectors(path: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Stamps [N] and vectors [N, J] of each column that has them."""
    stamps: list[float] = []
    columns: dict[str, list[list[float]]] = {}
    for number, row in enumerate(_rows(path), start=1):
        stamps.append(_number(row.get("timestamp"), path, number, "timestamp"))
        for name, text in row.items():
            if name in FAMILIES:
                columns.setdefault(name, []).append(_vector(text, path, number, name))
    if "positions" not in columns:
        raise ValueError(f"{path}: no column 'positions', or no rows")
    time = np.array(stamps)
    return {name: (time, np.array(rows)) for name, rows in columns.items()}


def _rows(path: Path) -> Iterator[dict[str, str]]:
    """Rows of a csv."""
    opened: TextIO
    if path.suffix == ".gz":
        opened = gzip.open(path, "rt", encoding="utf-8", newline="")
    else:
        opened = path.open(encoding="utf-8", newline="")
    with opened:
        yield from csv.DictReader(opened)


def _number(text: str | None, path: Path, row: int, column: str) -> float:
    """A number of a cell."""
    try:
        return float(text or "")
    except ValueError:
        raise ValueError(
            f"{path}: row {row}, column {column!r}: {text!r} is not a number"
        ) from None


def _vector(text: str, path: Path, row: int, column: str) -> list[float]:
    """A vector of a cell, written as JSON."""
    try:
        found = json.loads(text)
        return [float(each) for each in found]
    except (TypeError, ValueError):
        raise ValueError(
            f"{path}: row {row}, column {column!r}: {str(text)[:40]!r} is no list of "
            f"numbers"
        ) from None
