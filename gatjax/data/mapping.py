"""The YAML map that translates a foreign log (`--map`): names, units, signs, offsets.

    columns:
      time: {from: stamp_ms, unit: ms}
      position.LKneePitch: {from: l_knee_deg, unit: deg, sign: -1, offset: 0.0}
      command.LKneePitch: l_knee_target     # short for {from: l_knee_target}
      velocity.*: {from: speed_*, unit: rpm}
    drop: [comment, diag_*]
    metadata: {robot: nao, base: floating, rate_hz: 50}

A value becomes `factor * (sign * scale * raw + offset)`: `factor` turns `unit` into
SI, so `offset` is in `unit`, and `scale` is in `unit` per number of the log (what a
joint of -100 to 100 needs). Left out, `from` is the column's own name, `unit` the SI
unit, `sign` and `scale` 1 and `offset` 0. A star stands for a joint or sensor; a
spelled-out entry goes before a starred one. Columns that no entry takes keep their
name, unless `drop` lists them. `metadata` overrules what the log says of itself.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Hashable, Sequence
from difflib import get_close_matches
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

GRAVITY = 9.80665  # m/s^2, standard gravity (CGPM 1901), for loads given in kg

UNITS = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "count": {"1": 1.0},
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0, "turn": 2.0 * math.pi},
    "angular velocity": {
        "rad/s": 1.0,
        "deg/s": math.pi / 180.0,
        "rpm": 2.0 * math.pi / 60.0,
    },
    "torque": {
        "N m": 1.0,
        "Nm": 1.0,
        "mN m": 1e-3,
        "N cm": 1e-2,
        "kg cm": GRAVITY / 1e2,
    },
    "current": {"A": 1.0, "mA": 1e-3},
    "temperature": {"degC": 1.0},
    "voltage": {"V": 1.0, "mV": 1e-3},
    "acceleration": {"m/s^2": 1.0, "g": GRAVITY},
    "force": {"N": 1.0, "kN": 1e3, "kg": GRAVITY},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "ratio": {"1": 1.0},
}
"""Factor into the SI unit of a recording (the first one named), by quantity."""

JOINT_FAMILIES = {
    "command": "angle",
    "position": "angle",
    "velocity": "angular velocity",
    "torque": "torque",
    "current": "current",
    "temperature": "temperature",
    "stiffness": "ratio",
}
"""`<family>.<joint>` columns and what they measure."""

COMMANDED = ("angle", "torque", "voltage")
"""What `command.<joint>` may be; all of a recording are the same."""

PLAIN_COLUMNS = {
    "time": "time",
    "trajectory": "count",
    "voltage": "voltage",
    "received": "time",
    "sent": "time",
    **{f"gyro.{axis}": "angular velocity" for axis in "xyz"},
    **{f"accelerometer.{axis}": "acceleration" for axis in "xyz"},
    **{f"orientation.{angle}": "angle" for angle in ("roll", "pitch", "yaw")},
    **{f"base.{axis}": "length" for axis in "xyz"},
    **{f"base.q{part}": "ratio" for part in "wxyz"},
}
"""Columns with a fixed name and what they measure."""

COLUMN_FORMS = ", ".join(
    [f"{family}.<joint>" for family in JOINT_FAMILIES]
    + ["force.<sensor>"]
    + list(PLAIN_COLUMNS)
)
"""Every column a recording may have, for messages."""


class Entry(NamedTuple):
    """How one column of the recording is made from one column of the log."""

    source: str  # column of the log
    factor: float  # SI unit per unit of the log
    slope: float  # sign times scale: unit of the map per number of the log
    offset: float  # in the unit of the log


class ColumnMap(NamedTuple):
    """A parsed map."""

    name: str  # file it came from
    entries: dict[str, Entry]  # by column of the recording; may hold one star
    drop: tuple[str, ...]  # names or patterns of columns left out
    metadata: dict[str, Any]  # overrules the log's own


NO_MAP = ColumnMap(name="no map", entries={}, drop=(), metadata={})


def quantity_of(column: str) -> str | None:
    """What a column measures: a key of `UNITS`, or None for a name no recording has."""
    family, _, place = column.partition(".")
    if place and family == "force":
        return "force"
    if place and family in JOINT_FAMILIES:
        return JOINT_FAMILIES[family]
    return PLAIN_COLUMNS.get(column)


def read_map(path: str | Path) -> ColumnMap:
    """Reads a YAML map.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: one line with the key, unit, sign or offset that is wrong.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such map; --map takes a YAML file")
    try:
        tree = yaml.load(path.read_text(encoding="utf-8"), Loader=_StrictLoader)
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: not YAML: {' '.join(str(error).split())}") from error
    return column_map(tree, str(path))


def column_map(tree: Any, name: str) -> ColumnMap:
    """The map that a tree with the keys columns, drop and metadata says.

    Args:
        tree: as YAML gives it.
        name: file it came from, for messages.

    Raises:
        ValueError: one line with the key, unit, sign or offset that is wrong.
    """
    _check_keys(tree, ("columns", "drop", "metadata"), name)
    columns = tree.get("columns") or {}
    drop = tree.get("drop") or []
    metadata = tree.get("metadata") or {}
    if not isinstance(columns, dict) or not isinstance(metadata, dict):
        raise ValueError(f"{name}: 'columns' and 'metadata' must be key: value lists")
    if not isinstance(drop, list) or not all(isinstance(item, str) for item in drop):
        raise ValueError(f"{name}: 'drop' must be a list of column names or patterns")
    told = _command_unit(columns, name)
    stated = metadata.get("command_unit", told.get("command_unit"))
    if told and spelled(str(stated)) != told["command_unit"]:
        raise ValueError(
            f"{name}: metadata command_unit is {stated}, but the commands' unit "
            f"becomes {told['command_unit']}; mend one of the two"
        )
    return ColumnMap(
        name=name,
        entries={
            str(column): _entry(str(column), entry, f"{name}: {column}")
            for column, entry in columns.items()
        },
        drop=tuple(drop),
        metadata=told | {str(key): value for key, value in metadata.items()},
    )


def spelled(unit: str) -> str:
    """A unit as gatjax writes it: N·m and N*m are N m, °C is degC, m/s² m/s^2."""
    plain = unit.translate(
        {ord("·"): " ", ord("⋅"): " ", ord("*"): " ", ord("²"): "^2"}
    )
    return plain.replace("deg C", "degC").replace("°C", "degC").replace("°", "deg")


def _command_unit(columns: dict[Any, Any], name: str) -> dict[str, str]:
    """Metadata `command_unit` if commands are torques or voltages."""
    units = [
        spelled(str(entry.get("unit", "rad"))) if isinstance(entry, dict) else "rad"
        for column, entry in columns.items()
        if str(column).startswith("command.")
    ]
    kinds = {kind for unit in units for kind in COMMANDED if unit in UNITS[kind]}
    if len(kinds) > 1:
        raise ValueError(
            f"{name}: commands are {' and '.join(sorted(kinds))}; those of one "
            f"recording are all the same"
        )
    if kinds <= {"angle"}:
        return {}
    return {"command_unit": next(iter(UNITS[kinds.pop()]))}


def resolve(mapping: ColumnMap, names: Sequence[str], file: str) -> dict[str, Entry]:
    """Finds the log's column, and its scaling, for every column of the recording.

    Args:
        mapping: what to translate.
        names: columns of the log.
        file: the log, for messages.

    Raises:
        ValueError: an entry whose source the log lacks, or two sources for one column.
    """
    where = f"{mapping.name}, used on {file}"
    found = {
        key: e for key, e in mapping.entries.items()
        if "*" not in key and not _dropped(key, mapping)
    }  # fmt: skip
    for entry in found.values():
        if entry.source not in names:
            raise ValueError(_lacks(where, entry.source, names))
    taken = {entry.source for entry in found.values()}
    left = [name for name in names if name not in taken and not _dropped(name, mapping)]
    for name in left:
        starred = _starred(mapping.entries, name)
        target, entry = starred or (name, Entry(name, 1.0, 1.0, 0.0))
        if _dropped(target, mapping):
            continue
        if target in found:
            raise ValueError(
                f"{where}: column {target!r} would come from both "
                f"{found[target].source!r} and {name!r}; put one of them under drop"
            )
        found[target] = entry
    for key, entry in mapping.entries.items():
        if "*" in key and not any(fnmatchcase(n, entry.source) for n in names):
            raise ValueError(_lacks(where, entry.source, names))
    return found


def _dropped(name: str, mapping: ColumnMap) -> bool:
    """Whether `drop` lists a column, of the log or of the recording."""
    return any(fnmatchcase(name, pattern) for pattern in mapping.drop)


def is_dropped(mapping: ColumnMap, name: str) -> bool:
    """Whether a log's column is listed under `drop`, and no entry names it."""
    named = any(entry.source == name for entry in mapping.entries.values())
    return _dropped(name, mapping) and not named


def to_si(entry: Entry, raw: np.ndarray) -> np.ndarray:
    """Scales raw values [N] of the log into SI [N]."""
    return entry.factor * (entry.slope * raw + entry.offset)


def _entry(column: str, entry: Any, where: str) -> Entry:
    """Checks one entry of `columns`."""
    quantity = quantity_of(column)
    if quantity is None:
        raise ValueError(f"{where}: a recording has no such column; {COLUMN_FORMS}")
    kinds = COMMANDED if column.startswith("command.") else (quantity,)
    units = {name: size for kind in kinds for name, size in UNITS[kind].items()}
    if isinstance(entry, str):
        entry = {"from": entry}
    _check_keys(entry, ("from", "unit", "sign", "scale", "offset"), where)
    source = entry.get("from", column)
    if not isinstance(source, str):
        raise ValueError(f"{where}: from is {source!r}; put the column name in quotes")
    if source.count("*") != column.count("*") or column.count("*") > 1:
        raise ValueError(f"{where}: one star in the column needs one star in 'from'")
    unit = spelled(str(entry.get("unit", next(iter(units)))))
    if unit not in units:
        raise ValueError(
            f"{where}: unit {unit!r} is unknown for {' or '.join(kinds)}; "
            f"choose from {', '.join(units)}"
        )
    sign = _number(entry.get("sign", 1), f"{where}: sign")
    if sign not in (1.0, -1.0):
        raise ValueError(f"{where}: sign is {sign:g}; it must be 1 or -1")
    scale = _number(entry.get("scale", 1), f"{where}: scale")
    if scale <= 0.0:
        raise ValueError(f"{where}: scale is {scale:g}; it must be more than 0")
    offset = _number(entry.get("offset", 0), f"{where}: offset")
    return Entry(source, units[unit], sign * scale, offset)


def _starred(entries: dict[str, Entry], name: str) -> tuple[str, Entry] | None:
    """The column that a starred entry makes of the log's column `name`, if one does."""
    for column, entry in entries.items():
        head, star, tail = entry.source.partition("*")
        fits = len(name) > len(head) + len(tail)
        if star and fits and name.startswith(head) and name.endswith(tail):
            middle = name[len(head) : len(name) - len(tail)]
            return column.replace("*", middle), entry._replace(source=name)
    return None


def _number(value: Any, where: str) -> float:
    """A finite number; YAML 1.1 reads 1e-3 as text, so text that is one will do."""
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{where} is {value!r}; it must be a number")
    return number


def _check_keys(tree: Any, known: tuple[str, ...], where: str) -> None:
    """Refuses anything but a mapping with known keys."""
    if not isinstance(tree, dict):
        raise ValueError(f"{where}: expected the keys {', '.join(known)}")
    unknown = [str(key) for key in tree if key not in known]
    if unknown:
        raise ValueError(
            f"{where}: unknown key {', '.join(unknown)}; known are {', '.join(known)}"
        )


def _lacks(where: str, source: str, names: Sequence[str]) -> str:
    """The line for a column that the log does not have."""
    close = get_close_matches(source, names, n=3)
    hint = f"; close: {', '.join(close)}" if close else ""
    return f"{where}: the log has no column {source!r}{hint}; it has {', '.join(names)}"


class _StrictLoader(yaml.SafeLoader):
    """SafeLoader that refuses a key given twice, where YAML would keep the last."""

    def construct_mapping(
        self, node: yaml.MappingNode, deep: bool = False
    ) -> dict[Hashable, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for index, key in enumerate(keys):
            if key in keys[:index]:
                line = node.value[index][0].start_mark.line + 1
                raise yaml.YAMLError(f"key {key!r} is given twice, line {line}")
        return super().construct_mapping(node, deep)


def degrees_map(found: Sequence[str], columns: Collection[str]) -> str:
    """The map of a log of which the columns `found` are in degrees.

    Where they are half of their family or more, its other joints move too little to
    show it.
    """
    wild = {}
    for column in found:
        family = column.partition(".")[0]
        own = [each for each in columns if each.partition(".")[0] == family]
        most = 2 * sum(each in found for each in own) >= len(own)
        most |= family == "orientation"  # one filter gives all three
        wild[f"{family}.*" if most else column] = None
    told = ", ".join(f"{name}: {{unit: deg}}" for name in wild)
    return f"columns: {{{told}}}"
