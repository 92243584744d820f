"""Signals on their own clocks to one recording, whose rows are those of the positions.

A command counts from its stamp until the next one (zero-order hold): the row of a
position holds the command that was in force. Nothing else is moved but signals that are
slower than the rows or stamped apart from them, which are interpolated and told.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gatjax.data.mapping import ColumnMap, Entry, quantity_of, resolve, to_si
from gatjax.data.readers.drafts import drafted
from gatjax.data.readers.source import Run, Source, Stream
from gatjax.data.recording import Recording, check_one_unit

HELD = ("command.", "stiffness.")  # signals that hold until the next stamp
ROWS = ("time", "trajectory")  # columns that a table's reader has used already
CLOCK = Entry("time", 1.0, 1.0, 0.0)
NAMED = 4  # signals or runs that a note names
Done = dict[str, dict[str, None]]  # what was done, to which signals or in which runs


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
        rows.append(_rows(clear, where, done))
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
    return raw if plain else to_si(entry, raw)


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
        metadata=parts[0].metadata,
    )


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


def _rows(run: Run, where: str, done: Done) -> tuple[np.ndarray, dict]:
    """Time [N] s of the rows of a run, and its columns [N] each."""
    positions = [name for name in run if name.startswith("position.")]
    if not positions:
        raise ValueError(
            f"{where}: no position of any joint; correct the draft of a map that "
            f"gatjax import writes, and give it as --map; it has {', '.join(run)}"
        )
    for name, stream in run.items():
        _check_clock(stream.time, f"{where}, {name}")
    clock = max((run[name].time for name in positions), key=len)
    first = max(
        (s.time[0] for n, s in run.items() if n.startswith(HELD)),
        default=clock[0],
    )
    time = clock if clock[0] >= first else clock[clock >= first]
    if len(time) < len(clock):
        text = f"{len(clock) - len(time)} rows before the first command left out"
        done.setdefault(text, {})[where.rpartition(": ")[2]] = None
    if len(time) == 0:
        raise ValueError(f"{where}: every command comes after the last position")
    return time, {n: _at(time, n, s, done) for n, s in run.items()}


def _at(time: np.ndarray, name: str, stream: Stream, done: Done) -> np.ndarray:
    """A signal at the rows' stamps [N]."""
    if stream.time is time or np.array_equal(stream.time, time):
        return stream.values
    at = np.minimum(np.searchsorted(stream.time, time), len(stream.time) - 1)
    if np.array_equal(stream.time[at], time):
        return stream.values[at]
    rate = 1.0 / float(np.median(np.diff(stream.time))) if len(stream.time) > 1 else 0.0
    if name.startswith(HELD):
        done.setdefault(f"{rate:.3g} Hz, held until the next one", {})[name] = None
        return stream.values[np.searchsorted(stream.time, time, side="right") - 1]
    text = f"{rate:.3g} Hz, interpolated to the rows' stamps"
    done.setdefault(text, {})[name] = None
    return np.interp(time, stream.time, stream.values)


def _check_clock(time: np.ndarray, where: str) -> None:
    """Refuse stamps that stand still or run back."""
    late = np.flatnonzero(np.diff(time) <= 0.0)
    if late.size:
        row = int(late[0]) + 1
        raise ValueError(
            f"{where}: sample {row + 1} is stamped {time[row]:g} s, the one before it "
            f"{time[row - 1]:g} s; stamps must increase ({late.size} do not): sort or "
            f"cut the log there"
        )


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
