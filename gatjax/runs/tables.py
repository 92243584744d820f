"""The csv tables of a run folder."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from gatjax.files import write_whole


class Table(NamedTuple):
    """Columns of a csv table; one row for each value of the key."""

    key: tuple[str, ...]
    values: tuple[str, ...]


TABLES = {
    "metrics.csv": Table(
        key=("method", "iteration", "generation", "candidate"),
        values=(
            *("simulator_cost", "simulator_velocity_m_s", "simulator_falls", "sigma"),
            *("robot_velocity_m_s", "robot_falls", "robot_rollouts", "seconds"),
        ),
    ),
    "prediction.csv": Table(
        key=("method", "iteration", "joint", "horizon_s"),
        values=("before_rad", "after_rad"),
    ),
    "evaluations.csv": Table(
        key=("method", "iteration", "generation", "candidate", "seed"),
        values=("velocity_m_s", "fell_at_s"),
    ),
}
"""The tables of a run folder, by file name."""
TEXT_COLUMNS = ("method", "candidate", "joint")


def add_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Adds rows to a table of `TABLES`; the file name says which.

    A row whose key is there already fills in that row, so a generation that is run
    again after a kill, or evaluated on the robot later, does not stand there twice.
    Columns that a row leaves out stay empty.

    Raises:
        ValueError: one line: unknown table or column, a key that is not complete, or
            one that comes twice.
        OSError: one line; nothing was changed.
    """
    table = _table(path)
    columns = table.key + table.values
    merged = {
        tuple(row[column] for column in table.key): row
        for row in (read_table(path) if path.is_file() else [])
    }
    seen = set()
    for row in rows:
        unknown = [column for column in row if column not in columns]
        if unknown:
            raise ValueError(
                f"{path}: unknown column {', '.join(unknown)}; it has "
                f"{', '.join(columns)}"
            )
        typed = {c: _value(_cell(v), c, f"{path}") for c, v in row.items()}
        key = tuple(typed.get(column) for column in table.key)
        if None in key:
            raise ValueError(f"{path}: a row needs {', '.join(table.key)}; got {row}")
        if key in seen:
            raise ValueError(f"{path}: two rows for {', '.join(map(str, key))}")
        seen.add(key)
        merged[key] = {**merged.get(key, dict.fromkeys(columns)), **typed}
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in merged.values():
        writer.writerow([_cell(row[column]) for column in columns])
    write_whole({path: text.getvalue().encode()})


def read_table(path: str | Path) -> list[dict[str, Any]]:
    """Reads a table of `TABLES`: text, int or float, None where a cell is empty.

    A last line without its end is a truncated one and is left out.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: one line with the row (from 1, without header) and column.
    """
    path = Path(path)
    table = _table(path)
    columns = list(table.key + table.values)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such table; the run has not got that far")
    text = path.read_text(encoding="utf-8")
    lines = list(csv.reader(text[: text.rfind("\n") + 1].splitlines()))
    if lines and lines[0] != columns:
        raise ValueError(f"{path}: the header is not {','.join(columns)}")
    rows = []
    for number, cells in enumerate(lines[1:], start=1):
        where = f"{path}: row {number}"
        if len(cells) != len(columns):
            raise ValueError(f"{where} has {len(cells)} cells, not {len(columns)}")
        named = zip(columns, cells, strict=True)
        rows.append({column: _value(cell, column, where) for column, cell in named})
    return rows


def _table(path: Path) -> Table:
    """The table that a file name stands for."""
    if path.name not in TABLES:
        raise ValueError(f"{path}: not a table of a run; those are {', '.join(TABLES)}")
    return TABLES[path.name]


def _cell(value: Any) -> str:
    """A value as text; numbers at full precision."""
    if value is None:
        return ""
    return str(value.item() if hasattr(value, "item") else value)


def _value(cell: str, column: str, where: str) -> Any:
    """The text of a cell as what the column holds."""
    if cell == "":
        return None
    if column in TEXT_COLUMNS:
        if not cell.isprintable():
            raise ValueError(f"{where}, column {column!r}: {cell!r} is not one line")
        return cell
    for kind in (int, float):
        try:
            return kind(cell)
        except ValueError:
            continue
    raise ValueError(f"{where}, column {column!r}: {cell!r} is not a number")
