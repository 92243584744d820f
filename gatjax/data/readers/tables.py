"""Parquet and CSV tables: wide (a column a signal) and long (a row a sample)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from pyarrow import csv, parquet

from gatjax.data.mapping import quantity_of
from gatjax.data.metadata import told_of
from gatjax.data.readers.arrays import RUNS, TIMES, stamps_of
from gatjax.data.readers.source import (
    Given,
    Rows,
    Run,
    Source,
    Stream,
    Tell,
    rows_of,
)
from gatjax.data.recording import check_once
from gatjax.data.spill import Column, release

SUBJECTS = ("joint", "name", "signal", "joint_name")  # columns of text in long tables
DECIMAL = re.compile(rb'[ "]*[-+]?\d*,\d+([eE][-+]?\d+)?[ "]*')
PIECE = 1 << 22  # bytes, or a hundredth of that many rows, that are read at a time


class Marks(NamedTuple):
    """How a table is written."""

    between: str  # cells
    point: str  # of decimals


class Words(NamedTuple):
    """A column of text."""

    names: list[str]
    codes: np.ndarray  # [N] index of each row's name


def read(path: Path, tell: Tell, given: Given) -> Source:
    """Read a table piece by piece.

    An empty cell, or one that is not a number, is no sample of its signal: tables of
    several loops have rows for each.

    Raises:
        ValueError: one line: not a table, no time, text among the numbers.
    """
    given = given._replace(  # as names are taken, too
        time=given.time and given.time.strip(), run=given.run and given.run.strip()
    )
    try:
        marks = _marks(path)
        try:
            numbers, words, left = _columns(path, tell, given, marks, pa.float64())
        except pa.ArrowInvalid:  # what was empty first is text later
            numbers, words, left = _columns(path, tell, given, marks, pa.string())
    except (pa.ArrowException, UnicodeDecodeError, OSError) as error:
        line = str(error).splitlines()[0]
        raise ValueError(f"{path}: not a readable table: {line}") from error
    _check_texts(path, words, marks.point)
    names = [*numbers, *words, *left]
    stamp = stamps_of(numbers, given)
    if stamp is None or len(numbers[stamp]) == 0:
        raise ValueError(f"{path}: {_unstamped(words, names, given)}")
    time = _known(path, stamp, numbers.pop(stamp))
    who = next((words.pop(name) for name in SUBJECTS if name in words), None)
    run = given.run or next((name for name in RUNS if name in numbers), None)
    if given.run is not None and given.run not in numbers:
        raise ValueError(f"{path}: no column {run!r}; it has {', '.join(names)}")
    ids = None if run is None else _known(path, run, numbers.pop(run))
    notes = [
        f"{path}: column {name!r} left out, it holds no numbers"
        for name in [*words, *left]
    ]
    parts = [slice(0, len(time))] if ids is None else rows_of(ids)
    runs = [_run(time, numbers, who, rows) for rows in parts]
    notes += _emptied(path, runs, numbers if who is None else {}, len(time))
    if not all(runs) and any(runs):
        none = [str(number) for number, signals in enumerate(runs) if not signals]
        notes.append(f"{path}: run {', '.join(none)} left out, no number in it")
        runs = [signals for signals in runs if signals]
    draft: dict[str, dict[str, Any]] = {
        name: {"from": name} for name in runs[0] if quantity_of(name)
    }
    kind = "wide table" if who is None else "long table"
    try:
        facts = told_of(path)
    except ValueError as error:  # another program's file of that name
        facts = {}
        notes.append(f"{error}: not used")
    return Source(str(path), kind, runs, draft, facts, notes)


def _unstamped(words: dict[str, Words], names: list[str], given: Given) -> str:
    """Say what a table without stamps lacks."""
    said = stamps_of(words, given)
    first = words[said].names[:1] if said else []
    if first:
        return (
            f"column {said!r} holds text, such as {first[0]!r}; stamps are numbers, or "
            f"dates with the time of day"
        )
    if not names:
        return "no rows below the names of columns"
    wanted = given.time or ", ".join(TIMES)
    return f"no rows, or no column of time ({wanted}); it has {', '.join(names)}"


def _check_texts(path: Path, words: dict[str, Words], point: str) -> None:
    """Refuse a column of numbers with a few texts among them."""
    for name, column in words.items():
        odd = [k for k, text in enumerate(column.names) if _number(text, point) is None]
        if name not in SUBJECTS and 0 < len(odd) < 0.5 * len(column.names):
            row = int(np.flatnonzero(np.isin(column.codes, odd))[0])
            text = column.names[int(column.codes[row])]
            raise ValueError(
                f"{path}: row {row + 1}, column {name!r}: {text!r} is not a number, as "
                f"others of this column are; mend or empty the cell, or list the "
                f"column under drop in --map"
            )


def _number(text: str, point: str) -> float | None:
    """The number of a cell, NaN of an empty one; None if it is another text."""
    try:
        return float(text.replace(point, ".")) if text else np.nan
    except ValueError:
        return None


def _known(path: Path, name: str, values: np.ndarray) -> np.ndarray:
    """Stamps or runs [N], which every row needs."""
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise ValueError(
            f"{path}: row {bad[0] + 1}, column {name!r}: {values[bad[0]]} is not a "
            f"number ({bad.size} such rows); cut these rows out of the log"
        )
    return values


def _emptied(path: Path, runs: list[Run], names: Iterable[str], rows: int) -> list[str]:
    """How many cells of each column are no samples, a line for each number of them."""
    found: dict[int, list[str]] = {}
    for name in names:
        some = sum(len(run[name].time) for run in runs if name in run)
        found.setdefault(rows - some, []).append(name)
    return [
        f"{path}: {count} of {rows} rows have no number in {', '.join(names)}: "
        f"no samples there"
        for count, names in found.items() if count
    ]  # fmt: skip


def _columns(
    path: Path, tell: Tell, given: Given, marks: Marks, empty: pa.DataType
) -> tuple[dict[str, np.ndarray], dict[str, Words], list[str]]:
    """Columns of numbers [N] and of texts, and the names of those of neither.

    Columns of a CSV file whose first cells are empty are read as of the type `empty`.
    """
    numbers: dict[str, Column] = {}
    words: dict[str, list[np.ndarray]] = {}
    seen: dict[str, dict[str, int]] = {}
    left: dict[str, None] = {}
    for batch in _batches(path, tell, given, marks, empty):
        for own_name, column in zip(batch.schema.names, batch.columns, strict=True):
            name = own_name.strip()
            if pa.types.is_dictionary(column.type):
                column = column.dictionary_decode()
            kind = column.type
            if pa.types.is_string(kind) or pa.types.is_large_string(kind):
                known = seen.setdefault(name, {})
                coded = column.dictionary_encode()
                own = [known.setdefault(str(n), len(known)) for n in coded.dictionary]
                codes = coded.indices.fill_null(-1).to_numpy(zero_copy_only=False)
                places = np.array([*own, -1], np.int64)
                words.setdefault(name, []).append(places[codes])
            elif _is_number(kind):
                numbers.setdefault(name, Column()).add(_floats(column))
            else:
                left[name] = None
    found = {name: column.whole() for name, column in numbers.items()}
    texts = {n: Words(list(seen[n]), np.concatenate(words.pop(n))) for n in list(words)}
    for name in [n for n in texts if n not in SUBJECTS]:
        values = [_number(text, marks.point) for text in texts[name].names]
        if values and None not in values:
            found[name] = np.array([*values, np.nan], float)[texts.pop(name).codes]
    return found, texts, list(left)


def _floats(column: pa.Array) -> np.ndarray:
    """Numbers [N] of a column; dates are seconds since 1970."""
    if not pa.types.is_timestamp(column.type):
        values = column.cast(pa.float64(), safe=False)
        return values.to_numpy(zero_copy_only=False)
    whole = column.cast(pa.timestamp("ns", column.type.tz)).cast(pa.int64())
    return 1e-9 * whole.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)


def _wanted(path: Path, names: list[str], given: Given) -> list[str]:
    """Columns that are to be read, of those that a table has."""
    plain = [name.strip() for name in names]
    check_once(path, plain)
    needed = (*TIMES, given.time, given.run)
    return [
        name for name, n in zip(names, plain, strict=True)
        if n.lower() in needed or n in needed or not given.skips(n)
    ]  # fmt: skip


def _batches(
    path: Path, tell: Tell, given: Given, marks: Marks, empty: pa.DataType
) -> Iterator[pa.RecordBatch]:
    """The rows of a table, piece by piece, without columns that are not wanted."""
    if path.suffix.lower() == ".parquet":
        with parquet.ParquetFile(path) as table:
            wanted = _wanted(path, table.schema_arrow.names, given)
            done, every = 0, max(table.metadata.num_rows, 1)
            for group in range(table.num_row_groups):  # else they pile up in memory
                for batch in table.iter_batches(PIECE // 100, [group], wanted):
                    yield batch
                    done += batch.num_rows
                    tell(done / every)
        return
    size, block = max(path.stat().st_size, 1), csv.ReadOptions(block_size=PIECE)
    form = csv.ParseOptions(delimiter=marks.between)
    plain = csv.ConvertOptions(decimal_point=marks.point)
    with csv.open_csv(path, block, form, plain) as first:
        wanted = _wanted(path, first.schema.names, given)
        kinds = {f.name: _kind_to_be(f.type, empty) for f in first.schema}
    with path.open("rb") as file:
        types = csv.ConvertOptions(  # 0, 1, 2.5: no column of int
            column_types=kinds,
            decimal_point=marks.point,
            include_columns=wanted,
            strings_can_be_null=True,
        )
        with csv.open_csv(file, block, form, types) as table:
            for batch in table:
                yield batch
                tell(min(file.tell() / size, 1.0))


def _marks(path: Path) -> Marks:
    """What stands most often between the names of a CSV, and in its first numbers."""
    if path.suffix.lower() == ".parquet":
        return Marks("", ".")
    with path.open("rb") as file:
        head, first = file.readline(1 << 20), file.read(1 << 20)
    between = max(",;\t", key=lambda mark: head.count(mark.encode()))
    cells = re.split(rf"[{between}\r\n]".encode(), first)
    commas = sum(bool(DECIMAL.fullmatch(cell)) for cell in cells)
    points = sum(bool(DECIMAL.fullmatch(cell.replace(b".", b","))) for cell in cells)
    return Marks(between, "," if commas and commas >= points - commas else ".")


def _kind_to_be(kind: pa.DataType, empty: pa.DataType) -> pa.DataType:
    """What a column of a CSV file may turn out to be, by its first rows."""
    if pa.types.is_null(kind):
        return empty
    whole = pa.types.is_integer(kind) or pa.types.is_floating(kind)
    return pa.float64() if whole else kind


def _is_number(kind: pa.DataType) -> bool:
    """Whether a column holds numbers or dates, or nothing yet."""
    tests = (pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean,
             pa.types.is_timestamp)  # fmt: skip
    return any(test(kind) for test in tests) or pa.types.is_null(kind)


def _run(
    time: np.ndarray, numbers: dict[str, np.ndarray], who: Words | None, rows: Rows
) -> Run:
    """The signals of one run; in a long table those of each subject apart."""
    found: Run = {}
    if who is None:
        clock = time[rows]
        for name, values in numbers.items():
            said = np.isfinite(values[rows])
            release(values)
            if said.all():
                found[name] = Stream(clock, values[rows])
            elif said.any():
                found[name] = Stream(clock[said], values[rows][said])
        return found
    for code, subject in enumerate(who.names):
        own = np.flatnonzero(who.codes[rows] == code)
        for name, values in numbers.items():
            said = own[np.isfinite(values[rows][own])]
            if said.size:
                stream = Stream(time[rows][said], values[rows][said])
                found[f"{name}.{subject}"] = stream
    return found
