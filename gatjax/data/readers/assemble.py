"""Signals on their own clocks to one recording, whose rows are those of the positions.

A command counts from its stamp until the next one (zero-order hold): the row of a
position holds the command that was in force. Nothing else is moved but signals that are
slower than the rows or stamped apart from them, which are interpolated and told.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gatjax.data.mapping import ColumnMap, Entry, quantity_of, resolve, to_si
from gatjax.data.readers.drafts import drafted
from gatjax.data.readers.rows import Done, row_signals
from gatjax.data.readers.source import Source, Stream
from gatjax.data.recording import Recording, check_one_unit
from gatjax.data.spill import mapped

ROWS = ("time", "trajectory")  # columns that a table's reader has used already
CLOCK = Entry("time", 1.0, 1.0, 0.0)
NAMED = 4  # signals or runs that a note names


class Assembled(NamedTuple):
    """A recording and what was done to get it."""

    recording: Recording
    notes: list[str]


def assemble(source: Source, mapping: ColumnMap | None = None) -> Assembled:
    """Put the signals of a log on the clock of its positions.

    Args:
        source: what was read.
        mapping: translates names, units, signs and offsets, `time` all clocks; None
            takes what the format suggests.

    Raises:
        ValueError: one line: no positions, stamps that do not increase, nothing left.
    """
    draft = drafted(source)
    chosen = mapping or draft
    names = sorted({name for run in source.runs for name in run})
    entries = _entries(chosen, names, source.name)
    clock = chosen.entries.get("time") or draft.entries.get("time") or CLOCK
    rows, done = [], Done()
    for number, run in enumerate(source.runs):
        where = f"{source.name}: run {number}"
        clear = {c: _in_si(run[e.source], e, clock) for c, e in entries.items()
                 if e.source in run}  # fmt: skip
        rows.append(row_signals(clear, where, done, list(run)))
    columns = _shared([set(found) for _, found in rows], done)
    recording = Recording(
        name=source.name,
        time=_strung([time for time, _ in rows]),
        trajectory=_strung([np.full(len(t), k) for k, (t, _) in enumerate(rows)]),
        columns={c: _strung([found[c] for _, found in rows]) for c in columns},
        metadata={**source.metadata, **chosen.metadata},
    )
    return Assembled(recording, [*source.notes, *_told(source, done)])


def _in_si(stream: Stream, entry: Entry, clock: Entry) -> Stream:
    """A signal in s and SI; not copied where it is that already, for logs are large."""
    return Stream(_scaled(clock, stream.time), _scaled(entry, stream.values))


def _scaled(entry: Entry, raw: np.ndarray) -> np.ndarray:
    """Values [N] in SI; the same array where they are that already."""
    plain = (entry.factor, entry.slope, entry.offset) == (1.0, 1.0, 0.0)
    return raw if plain else mapped(lambda part: to_si(entry, part), raw)


def _strung(parts: list[np.ndarray]) -> np.ndarray:
    """Arrays one after the other; one alone is not copied."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def joined(parts: list[Recording], name: str) -> Recording:
    """Recordings one after the other, each run with a number of its own.

    Raises:
        ValueError: one line: they have no joint in common.
    """
    if len(parts) == 1:
        return parts[0]._replace(name=name)
    shared = sorted(set.intersection(*(set(each.columns) for each in parts)))
    if not any(column.startswith("position.") for column in shared):
        raise ValueError(
            f"{', '.join(each.name for each in parts)}: no joint is in all of these "
            f"logs; import logs of one robot together"
        )
    _check_alike(parts, shared)
    ids, first = [], 0
    for each in parts:
        _, index = np.unique(each.trajectory, return_inverse=True)
        ids.append(index + first)
        first += int(index.max()) + 1
    return Recording(
        name=name,
        time=np.concatenate([each.time for each in parts]),
        trajectory=np.concatenate(ids),
        columns={c: np.concatenate([e.columns[c] for e in parts]) for c in shared},
        metadata=_facts(parts),
    )


def _facts(parts: list[Recording]) -> dict[str, Any]:
    """What all recordings say of themselves; the robot is called as in the first."""
    first, *others = (each.metadata for each in parts)
    return {
        key: value for key, value in first.items()
        if key == "robot" or all(other.get(key) == value for other in others)
    }  # fmt: skip


def _check_alike(parts: list[Recording], shared: list[str]) -> None:
    """Refuse logs whose commands mean different things."""
    check_one_unit(parts, "import logs of one unit together")
    for each in parts:
        own = {c for c in each.columns if c.startswith("stiffness.")} - set(shared)
        if own:
            raise ValueError(
                f"{each.name} has {min(own)}, which not all of these logs have; import "
                f"logs with known gains by themselves, or drop the column"
            )


def _entries(mapping: ColumnMap, names: Sequence[str], file: str) -> dict[str, Entry]:
    """The log's signal of every column; signals that no recording has are left out."""
    spoken = {name: e for name, e in mapping.entries.items() if name not in ROWS}
    found = resolve(mapping._replace(entries=spoken), names, file)
    return {column: e for column, e in found.items() if quantity_of(column)}


def _shared(found: list[set[str]], done: Done) -> list[str]:
    """Columns that all runs have."""
    every = set.intersection(*found)
    partly = sorted(set.union(*found) - every)
    if partly:
        done["left out, not in every run"] = dict.fromkeys(partly)
    return sorted(every)


def _told(source: Source, done: Done) -> list[str]:
    """What was done, a line each; the first few signals or runs are named."""
    lines = []
    for text, what in done.items():
        names, more = list(what)[:NAMED], len(what) - NAMED
        rest = f" and {more} more" if more > 0 else ""
        lines.append(f"{source.name}: {', '.join(names)}{rest}: {text}")
    return lines
