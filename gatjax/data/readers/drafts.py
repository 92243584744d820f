"""The draft of a map: what a format tells of names and units, for users to correct."""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Sequence
from typing import Any

from gatjax.data.mapping import UNITS, ColumnMap, column_map, quantity_of
from gatjax.data.readers.source import Source

HEAD = """\
# Which signal of the log becomes which column of the recording: correct it, then
# gatjax import LOG --map THIS_FILE --out recording.parquet
# A value becomes (sign * scale * raw + offset) in its unit, and then SI.
"""
MARK = "# As gatjax wrote it: "  # and a checksum of the lines below
EXAMPLE = (
    "command.JOINT: {from: SIGNAL, unit: rad, sign: 1, offset: 0}",
    "position.JOINT: {from: SIGNAL, unit: rad, sign: 1, offset: 0}",
)
CLOCK = "  # time: {unit: s}  # or ms, us, ns"
PLAIN = re.compile(r"[A-Za-z_/][A-Za-z0-9_./-]*")


def drafted(source: Source) -> ColumnMap:
    """The map that the format of a log suggests."""
    return column_map({"columns": source.draft}, f"the draft for {source.kind}")


def seconds(source: Source) -> float:
    """Seconds per unit of a log's clocks."""
    return UNITS["time"][source.draft.get("time", {}).get("unit", "s")]


def text(sources: Sequence[Source]) -> str:
    """The same of several logs as YAML, with the signals that it leaves out."""
    entries: dict[str, dict[str, Any]] = {}
    for source in sources:
        entries = source.draft | entries
    lines = [f"  {_quoted(column)}: {_entry(column, entries[column])}"
             for column in entries]  # fmt: skip
    if "time" not in entries:
        lines.insert(0, CLOCK)
    if not any(column.startswith("position.") for column in entries):
        lines += [f"  # {example}" for example in EXAMPLE]
    used = {entry.get("from", column) for column, entry in entries.items()}
    names = dict.fromkeys(n for source in sources for run in source.runs for n in run)
    left = [f"# not used: {_quoted(name)}" for name in names if name not in used]
    said = "\n".join([HEAD + "columns:", *lines, *left]) + "\n"
    return f"{MARK}{zlib.crc32(said.encode('utf-8')):08x}\n{said}"


def is_corrected(text: str) -> bool:
    """Whether a map is not as `text` drafted it."""
    first, _, said = text.partition("\n")
    return first != f"{MARK}{zlib.crc32(said.encode('utf-8')):08x}"


def _entry(column: str, said: dict[str, Any]) -> str:
    """One column's entry, spelled out."""
    quantity = quantity_of(column) or "count"
    unit = said.get("unit", next(iter(UNITS[quantity])))
    signal = _quoted(said.get("from", column))
    if column == "time":
        return f"{{unit: {_quoted(unit)}}}"
    scale = f", scale: {said['scale']:g}" if "scale" in said else ""
    return f"{{from: {signal}, unit: {_quoted(unit)}, sign: 1{scale}, offset: 0}}"


def _quoted(name: str) -> str:
    """A name as YAML, in quotes if it needs them."""
    return name if PLAIN.fullmatch(name) else json.dumps(name, ensure_ascii=False)
