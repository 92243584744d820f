"""Parquet and CSV tables: wide (a column a signal) and long (a row a sample)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import csv, parquet

from gatjax.data.mapping import quantity_of
from gatjax.data.readers.arrays import TIMES
from gatjax.data.readers.source import Run, Source, Stream

SUBJECTS = ("joint", "name", "signal", "joint_name")  # columns of text in long tables
RUNS = ("trajectory", "episode", "run")


def read(path: Path) -> Source:
    """Read a table.

    Raises:
        ValueError: one line: not a table, no time.
    """
    try:
        whole = parquet.read_table(path) if path.suffix == ".parquet" else csv.read_csv(path)
    except (pa.ArrowException, UnicodeDecodeError, OSError) as error:
        line = str(error).splitlines()[0]
        raise ValueError(f"{path}: not a readable table: {line}") from error
    names = whole.column_names
    stamp = next((name for name in TIMES if name in names), None)
    if stamp is None or whole.num_rows == 0:
        raise ValueError(
            f"{path}: no rows, or no column of time ({', '.join(TIMES)}); it has "
            f"{', '.join(names)}"
        )
    subject = next((n for n in SUBJECTS if n in names and _texts(whole, n)), None)
    run = next((n for n in RUNS if n in names), None)
    ids = np.zeros(whole.num_rows) if run is None else whole.column(run).to_numpy()
    numbers = {
        name: whole.column(name).cast(pa.float64(), safe=False).to_numpy()
        for name in names
        if name not in (stamp, subject, run) and _numeric(whole, name)
    }
    time = whole.column(stamp).cast(pa.float64(), safe=False).to_numpy()
    who = None if subject is None else np.array(whole.column(subject).to_pylist())
    runs = [_run(time, numbers, who, ids == number) for number in np.unique(ids)]
    notes = [
        f"{path}: column {name!r} left out, it holds no numbers"
        for name in names
        if name not in (stamp, subject, run) and not _numeric(whole, name)
    ]
    draft: dict[str, dict[str, Any]] = {
        name: {"from": name} for name in runs[0] if quantity_of(name)
    }
    kind = "wide table" if subject is None else "long table"
    return Source(str(path), kind, runs, draft, {}, notes)


def _run(
    time: np.ndarray, numbers: dict[str, np.ndarray], who: np.ndarray | None,
    rows: np.ndarray,
) -> Run:  # fmt: skip
    """The signals of one run; in a long table those of each subject apart."""
    if who is None:
        return {name: Stream(time[rows], values[rows]) for name, values in numbers.items()}
    found: Run = {}
    for subject in np.unique(who[rows]):
        own = rows & (who == subject)
        for name, values in numbers.items():
            said = own & np.isfinite(values)
            if said.any():
                found[f"{name}.{subject}"] = Stream(time[said], values[said])
    return found


def _texts(table: pa.Table, name: str) -> bool:
    """Whether a column holds texts."""
    kind = table.column(name).type
    return pa.types.is_string(kind) or pa.types.is_large_string(kind)


def _numeric(table: pa.Table, name: str) -> bool:
    """Whether a column holds numbers."""
    kind = table.column(name).type
    return pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind)
