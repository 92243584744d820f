"""Parquet and CSV tables: wide (a column a signal) and long (a row a sample)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from pyarrow import csv, parquet

from gatjax.data.mapping import quantity_of
from gatjax.data.readers.arrays import TIMES
from gatjax.data.readers.source import Run, Source, Stream, Tell

SUBJECTS = ("joint", "name", "signal", "joint_name")  # columns of text in long tables
RUNS = ("trajectory", "episode", "run")
PIECE = 1 << 22  # bytes, or a hundredth of that many rows, that are read at a time
Rows = slice | np.ndarray


class Words(NamedTuple):
    """A column of text."""

    names: list[str]
    codes: np.ndarray  # [N] index of each row's name


def read(path: Path, tell: Tell) -> Source:
    """Read a table piece by piece.

    Raises:
        ValueError: one line: not a table, no time.
    """
    try:
        numbers, words, left = _columns(path, tell)
    except (pa.ArrowException, UnicodeDecodeError, OSError) as error:
        line = str(error).splitlines()[0]
        raise ValueError(f"{path}: not a readable table: {line}") from error
    stamp = next((name for name in TIMES if name in numbers), None)
    if stamp is None or len(numbers[stamp]) == 0:
        raise ValueError(
            f"{path}: no rows, or no column of time ({', '.join(TIMES)}); it has "
            f"{', '.join([*numbers, *words, *left])}"
        )
    time = numbers.pop(stamp)
    who = next((words.pop(name) for name in SUBJECTS if name in words), None)
    ids = next((numbers.pop(n) for n in RUNS if n in numbers), np.zeros(len(time)))
    runs = [_run(time, numbers, who, rows) for rows in _parts(ids)]
    notes = [
        f"{path}: column {name!r} left out, it holds no numbers"
        for name in [*words, *left]
    ]
    draft: dict[str, dict[str, Any]] = {
        name: {"from": name} for name in runs[0] if quantity_of(name)
    }
    kind = "wide table" if who is None else "long table"
    return Source(str(path), kind, runs, draft, {}, notes)


def _columns(
    path: Path, tell: Tell
) -> tuple[dict[str, np.ndarray], dict[str, Words], list[str]]:
    """Columns of numbers [N] and of texts, and the names of those of neither."""
    numbers: dict[str, list[np.ndarray]] = {}
    words: dict[str, list[np.ndarray]] = {}
    seen: dict[str, dict[str, int]] = {}
    left: dict[str, None] = {}
    for batch in _batches(path, tell):
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            kind = column.type
            if pa.types.is_string(kind) or pa.types.is_large_string(kind):
                known = seen.setdefault(name, {})
                coded = column.dictionary_encode()
                own = [known.setdefault(str(n), len(known)) for n in coded.dictionary]
                codes = coded.indices.fill_null(-1).to_numpy(zero_copy_only=False)
                words.setdefault(name, []).append(np.append(own, -1)[codes])
            elif _is_number(kind):
                values = column.cast(pa.float64(), safe=False)
                values = values.to_numpy(zero_copy_only=False)
                numbers.setdefault(name, []).append(values)
            else:
                left[name] = None
    return (
        {name: np.concatenate(numbers.pop(name)) for name in list(numbers)},
        {n: Words(list(seen[n]), np.concatenate(words.pop(n))) for n in list(words)},
        list(left),
    )


def _batches(path: Path, tell: Tell) -> Iterator[pa.RecordBatch]:
    """The rows of a table, piece by piece."""
    if path.suffix == ".parquet":
        with parquet.ParquetFile(path) as table:
            done, every = 0, max(table.metadata.num_rows, 1)
            for batch in table.iter_batches(PIECE // 100):
                yield batch
                done += batch.num_rows
                tell(done / every)
        return
    size, block = max(path.stat().st_size, 1), csv.ReadOptions(block_size=PIECE)
    with csv.open_csv(path, block) as first:
        kinds = {f.name: pa.float64() for f in first.schema if _is_number(f.type)}
    with path.open("rb") as file:
        types = csv.ConvertOptions(column_types=kinds)  # 0, 1, 2.5: no column of int
        with csv.open_csv(file, block, convert_options=types) as table:
            for batch in table:
                yield batch
                tell(min(file.tell() / size, 1.0))


def _is_number(kind: pa.DataType) -> bool:
    """Whether a column holds numbers, or nothing yet."""
    tests = (pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean)
    return any(test(kind) for test in tests) or pa.types.is_null(kind)


def _parts(ids: np.ndarray) -> Iterator[Rows]:
    """The rows of each run; a run in one piece is not copied."""
    for each in np.unique(ids):
        rows = np.flatnonzero(ids == each)
        whole = rows[-1] - rows[0] + 1 == len(rows)
        yield slice(int(rows[0]), int(rows[-1]) + 1) if whole else rows


def _run(
    time: np.ndarray, numbers: dict[str, np.ndarray], who: Words | None, rows: Rows
) -> Run:
    """The signals of one run; in a long table those of each subject apart."""
    if who is None:
        return {name: Stream(time[rows], each[rows]) for name, each in numbers.items()}
    found: Run = {}
    for code, subject in enumerate(who.names):
        own = np.flatnonzero(who.codes[rows] == code)
        for name, values in numbers.items():
            said = own[np.isfinite(values[rows][own])]
            if said.size:
                stream = Stream(time[rows][said], values[rows][said])
                found[f"{name}.{subject}"] = stream
    return found
