"""Recordings: the measured data that every method starts from.

One Parquet or CSV file, one row per sample, SI units; the columns are in
`docs/files.md`. Reading translates (`mapping.py`) but never resamples, sorts or fills:
what cannot be trusted is refused with its file, row (counted from 1, without the
header) and column.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import pyarrow as pa
from pyarrow import csv, parquet

from gatjax.data.mapping import (
    COLUMN_FORMS,
    JOINT_FAMILIES,
    NO_MAP,
    ColumnMap,
    degrees_map,
    quantity_of,
    resolve,
    to_si,
)
from gatjax.data.metadata import ANGLE, in_one_form, told_of
from gatjax.data.spill import release
from gatjax.runs import write_whole

LARGEST_ANGLE = 6.4  # rad, just over a full turn: no position servo goes there
STIFFEST = 20.0  # times the model's kp
LEANING = ("orientation.roll", "orientation.pitch")  # within half a turn
DEGREES_SHARE = 0.05  # of the rows; fewer are glitches, not a unit
GROUP = 1 << 16  # rows of a Parquet file that are written together


class Recording(NamedTuple):
    """One file of measured data."""

    name: str  # the file, or what made it
    time: np.ndarray  # [N] s, strictly increasing within a trajectory
    trajectory: np.ndarray  # [N] int, which run the row belongs to
    columns: dict[str, np.ndarray]  # each [N], SI
    metadata: dict[str, Any]  # robot, base, notes: text; rate_hz: float

    @property
    def command_unit(self) -> str:
        """What commands are in: one of `metadata.COMMAND_UNITS`."""
        return self.metadata.get("command_unit", ANGLE)


def read_recording(path: str | Path, mapping: ColumnMap | None = None) -> Recording:
    """Reads a .parquet or .csv file (its metadata from the .json beside a .csv).

    Args:
        path: the file.
        mapping: translates names, units, signs and offsets; None reads as it is.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: one line: not a table, no rows, no time, text among the numbers.
    """
    path = Path(path)
    file = str(path)
    table, metadata = _read_table(path)
    chosen = resolve(mapping or NO_MAP, table.column_names, file)
    if "time" not in chosen:
        raise ValueError(
            f"{file}: no column 'time'; translate names with --map; "
            f"it has {', '.join(table.column_names)}"
        )
    columns = {
        column: to_si(entry, _numbers(table.column(entry.source), entry.source, file))
        for column, entry in chosen.items()
    }
    time = columns.pop("time")
    trajectory = columns.pop("trajectory", np.zeros(len(time)))
    return Recording(
        name=file,
        time=time,
        trajectory=_whole_numbers(trajectory, file),
        columns=columns,
        metadata=in_one_form({**metadata, **(mapping or NO_MAP).metadata}, file),
    )


def write_recording(path: str | Path, recording: Recording) -> None:
    """Writes a .parquet file, or a .csv file and its .json, each whole or not at all.

    Raises:
        ValueError: unknown file ending, or columns of different length.
        OSError: one line; nothing was changed (the disk is full, say), or only the
            .json was, since a folder is in the place of the .csv file.
    """
    path = Path(path)
    lengths = {name: len(values) for name, values in recording.columns.items()}
    lengths["trajectory"] = len(recording.trajectory)
    for name, length in lengths.items():
        if length != len(recording.time):
            raise ValueError(
                f"{path}: column {name!r} has {length} rows, "
                f"time has {len(recording.time)}"
            )
    metadata = in_one_form(recording.metadata, str(path))
    if check_ending(path) == ".parquet":
        text = {key: str(value) for key, value in metadata.items()}
        write_whole({path: partial(_write, recording, parquet.ParquetWriter, text)})
    else:
        beside = json.dumps(metadata, indent=2).encode()
        write = partial(_write, recording, csv.CSVWriter, None)
        write_whole({path.with_suffix(".json"): beside, path: write})


def _write(
    recording: Recording, writer: Any, text: dict[str, str] | None, file: BinaryIO
) -> None:
    """Write the rows of a recording, a group at a time."""
    columns = {"time": recording.time, "trajectory": recording.trajectory}
    kinds = {"trajectory": np.int64}
    columns |= recording.columns
    fields = [(name, pa.from_numpy_dtype(kinds.get(name, np.float64)))
              for name in columns]  # fmt: skip
    schema = pa.schema(fields, metadata=text)
    with writer(file, schema) as out:
        for first in range(0, len(recording.time), GROUP):
            rows = slice(first, first + GROUP)
            part = [np.asarray(values[rows], kinds.get(name, np.float64))
                    for name, values in columns.items()]  # fmt: skip
            out.write_table(pa.table(part, schema=schema))
            release(*columns.values())


def check_recording(recording: Recording, joints: Sequence[str]) -> None:
    """Refuses a recording that cannot be trusted.

    Args:
        recording: what was read.
        joints: the names the model has.

    Raises:
        ValueError: one line with file, row and column: no rows, a column or joint that
            is unknown, a command without position, NaN, time that does not increase,
            degrees.
    """
    if len(recording.time) == 0:
        raise ValueError(f"{recording.name}: no rows")
    _check_names(recording, joints)
    _check_pairs(recording)
    _check_numbers(recording)
    _check_time(recording)
    _check_degrees(recording)


def check_one_unit(recordings: Sequence[Recording], advice: str) -> None:
    """Refuses recordings whose commands are different things, with an advice."""
    units = {each.command_unit: each.name for each in recordings}
    if len(units) > 1:
        told = ", ".join(f"{unit} in {name}" for unit, name in units.items())
        raise ValueError(f"commands are in {told}; {advice}")


def _check_names(recording: Recording, joints: Sequence[str]) -> None:
    """Refuses columns that no recording has and joints that the model lacks."""
    for column in recording.columns:
        if quantity_of(column) is None:
            raise ValueError(
                f"{recording.name}: column {column!r} is unknown; translate it with "
                f"--map or list it under drop there; columns are {COLUMN_FORMS}"
            )
        family, _, joint = column.partition(".")
        if family in JOINT_FAMILIES and joint not in joints:
            close = get_close_matches(joint, joints, n=3)
            hint = f"; close: {', '.join(close)}" if close else ""
            raise ValueError(
                f"{recording.name}: column {column!r}: the model has no joint "
                f"{joint!r}{hint}; translate it with --map, or list its columns under "
                f"drop there if it does not matter; the model has {', '.join(joints)}"
            )


def _check_pairs(recording: Recording) -> None:
    """Refuses a joint with a command but no position, or the other way round."""
    named = {
        family: [c.partition(".")[2] for c in recording.columns if c.startswith(family)]
        for family in ("command.", "position.")
    }
    if not any(named.values()):
        raise ValueError(
            f"{recording.name}: no command.<joint> and position.<joint> columns; "
            f"translate names with --map; it has {', '.join(recording.columns)}"
        )
    for family, other in (("command.", "position."), ("position.", "command.")):
        alone = [joint for joint in named[family] if joint not in named[other]]
        if alone:
            raise ValueError(
                f"{recording.name}: {', '.join(family + joint for joint in alone)} "
                f"without {', '.join(other + joint for joint in alone)}; "
                f"a joint needs both; or drop it with --map, and its actuator from the "
                f"model"
            )


def _check_numbers(recording: Recording) -> None:
    """Refuses values that are missing or infinite, and shares that are none."""
    for column, values in recording.columns.items():
        if not column.startswith("stiffness."):
            continue
        bad = np.flatnonzero((values < 0.0) | (values > STIFFEST))
        if bad.size:
            raise ValueError(
                f"{place(recording.name, bad[0], column)}: {values[bad[0]]:g} is no "
                f"share of a gain: 0 is without power, 1 the model's kp; use a map "
                f"with scale (0.01 for percent)"
            )
    for column, values in {"time": recording.time, **recording.columns}.items():
        bad = np.flatnonzero(~np.isfinite(values))
        release(values)
        if bad.size:
            advice = "cut these rows out of the log"
            if not (column == "time" or column.startswith(("command.", "position."))):
                advice = (
                    f"list the column under drop in --map if it is not needed, or "
                    f"{advice}"
                )
            raise ValueError(
                f"{place(recording.name, bad[0], column)}: {values[bad[0]]} is not a "
                f"number ({bad.size} such rows); {advice}"
            )


def _check_time(recording: Recording) -> None:
    """Refuses time that stands still or runs back within a trajectory."""
    runs, time = recording.trajectory, recording.time
    later = (time[1:] > time[:-1]) & (runs[1:] == runs[:-1])
    if (later | (runs[1:] > runs[:-1])).all():
        return
    order = np.argsort(runs, kind="stable")
    same = np.diff(recording.trajectory[order]) == 0
    late = np.flatnonzero(same & (np.diff(recording.time[order]) <= 0.0))
    if late.size:
        first = late[np.argmin(order[late + 1])]
        before, row = int(order[first]), int(order[first + 1])
        raise ValueError(
            f"{place(recording.name, row, 'time')}: {recording.time[row]} s after "
            f"{recording.time[before]} s (row {before + 1}) in trajectory "
            f"{recording.trajectory[row]}; time must increase within a trajectory, "
            f"give every run its own number"
        )


def _check_degrees(recording: Recording) -> None:
    """Refuses angles that can only be degrees; motors may turn on and on."""
    if recording.command_unit != ANGLE:
        return
    large: dict[str, np.ndarray] = {}
    most: dict[str, float] = dict.fromkeys(LEANING, np.pi)
    for column, values in recording.columns.items():
        if column in most or column.startswith(("command.", "position.")):
            largest = most.get(column, LARGEST_ANGLE)
            large[column] = np.flatnonzero(np.abs(values) > largest)
            release(values)
    share = DEGREES_SHARE * len(recording.trajectory)
    found = {column: rows for column, rows in large.items() if rows.size > share}
    if found:
        column, rows = next(iter(found.items()))
        raise ValueError(
            f"{place(recording.name, rows[0], column)}: "
            f"{recording.columns[column][rows[0]]:g} rad looks like degrees "
            f"({rows.size} of {len(recording.trajectory)} rows above "
            f"{most.get(column, LARGEST_ANGLE):.3g}), "
            f"say so in a --map file: {degrees_map(list(found), recording.columns)!r}"
        )


def place(file: str, row: int | np.integer, column: str) -> str:
    """Where a value stands; `row` counts from 0, the words from 1."""
    return f"{file}: row {row + 1}, column {column!r}"


def check_ending(path: Path) -> str:
    """The file's ending, if it is one that recordings have."""
    if path.suffix not in (".parquet", ".csv"):
        raise ValueError(
            f"{path}: a recording ends in .parquet or .csv; `gatjax import` makes one "
            f"of other logs"
        )
    return path.suffix


FACTS = {"robot", "base", "rate_hz"}  # one of which a recording by hand tells


def check_output(path: Path) -> None:
    """Refuse a name for a recording to write that has no ending, or costs a file.

    The metadata of `x.csv` go to `x.json`, which may be a policy, a world or a log.
    """
    beside = path.with_suffix(".json")
    if check_ending(path) == ".parquet" or not beside.exists():
        return
    try:
        facts = told_of(path) if path.is_file() else {"schema": None}
    except ValueError:
        facts = {"schema": None}
    own = all(isinstance(v, str) for v in facts.values()) or FACTS & facts.keys()
    if "schema" in facts or not own:
        raise ValueError(
            f"{beside} would be written over by the metadata of {path}, and is no part "
            f"of a recording; choose another --out, or one that ends in .parquet"
        )


def _read_table(path: Path) -> tuple[pa.Table, dict[str, Any]]:
    """The file as it is, and its metadata."""
    ending = check_ending(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file{_neighbours(path.parent)}")
    if path.stat().st_size == 0:
        raise ValueError(f"{path}: the file is empty")
    try:
        if ending == ".parquet":
            with parquet.ParquetFile(path) as file:
                table = file.read()
        else:
            table = csv.read_csv(path)
        metadata = told_of(path)
    except (pa.ArrowException, UnicodeDecodeError) as error:
        line = str(error).splitlines()[0]
        raise ValueError(f"{path}: not a readable {ending} file: {line}") from error
    if table.num_rows == 0:
        raise ValueError(f"{path}: no rows")
    check_once(path, table.column_names)
    return table, metadata


def check_once(path: Path, names: Sequence[str]) -> None:
    """Refuse a table of which two columns have one name."""
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"{path}: column {', '.join(twice)} is there twice")


def _neighbours(folder: Path) -> str:
    """The recordings that do exist in a folder, for a message."""
    names = sorted(p.name for p in folder.glob("*") if p.suffix in (".parquet", ".csv"))
    return f"; there are: {', '.join(names)}" if names else ""


def _numbers(column: pa.ChunkedArray, name: str, file: str) -> np.ndarray:
    """A column as float64 [N]; missing values become NaN."""
    kind = column.type
    if any(test(kind) for test in (pa.types.is_string, pa.types.is_large_string)):
        return np.array(
            [
                _parsed(text, row, name, file)
                for row, text in enumerate(column.to_pylist())
            ]
        )
    number_types = (pa.types.is_integer, pa.types.is_floating, pa.types.is_null)
    if not any(test(kind) for test in number_types):
        raise ValueError(f"{file}: column {name!r} holds {kind}, not numbers")
    return column.cast(pa.float64(), safe=False).to_numpy()


def _parsed(text: str | None, row: int, name: str, file: str) -> float:
    """One cell of a column that came as text."""
    try:
        return float(text) if text else math.nan
    except ValueError:
        where = place(file, row, name)
        raise ValueError(f"{where}: {text!r} is not a number") from None


def _whole_numbers(values: np.ndarray, file: str) -> np.ndarray:
    """The trajectory column as int64 [N]."""
    bad = np.flatnonzero(~(np.isfinite(values) & (values == np.round(values))))
    if bad.size:
        raise ValueError(
            f"{place(file, bad[0], 'trajectory')}: {values[bad[0]]} is not a whole "
            f"number"
        )
    return values.astype(np.int64)
