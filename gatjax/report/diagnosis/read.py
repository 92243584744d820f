"""What a diagnosis folder holds, as records; what is missing is nan, empty or named.

`diagnosis.json` and `signals.parquet`, as docs/files.md describes them. Of a
gain, `low` and `high` bound 1 - after / before. A `tolerance` of the calibration is in
the unit of its parameter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from gatjax.runs import read_json

WHOLE_LOG = math.inf  # s, horizon of a replay without a new start


class Value(NamedTuple):
    """One parameter of a cause."""

    name: str
    value: float
    low: float  # 90 % interval; nan if unknown
    high: float
    unit: str


class Cause(NamedTuple):
    """A cause that was named or weighed."""

    name: str
    where: list[str]
    variant: str
    values: list[Value]
    probability: float
    evidence: float  # log evidence; nan if unknown
    rms: float  # rad, what it leaves
    equivalent: list[str]
    step: int  # number of the cause that it was weighed for, from 1; 0: unknown


class Joint(NamedTuple):
    """Residuals of one joint on the fit files, rms in rad."""

    name: str
    noise: float
    nominal: float
    tolerance: float  # after fitting tolerances only
    extended: float
    beyond: float  # share of the tolerances' power that no right model leaves
    drawn: bool = False  # towards its measured motion, all three


class Horizon(NamedTuple):
    """Held-out error of one joint, or of all, that far ahead."""

    seconds: float  # inf: the whole log
    joint: str
    before: float  # rad rms
    after: float
    low: float  # of 1 - after / before
    high: float
    learned: float = math.nan  # rad rms of a learned model

    @property
    def learnable(self) -> bool:
        """Whether a learned model is no worse than the nominal one."""
        return self.learned <= self.before


class Trace(NamedTuple):
    """The signals of one joint, each [N]; rad, load in N m; None where missing."""

    command: np.ndarray | None  # rad; None where commands are no angles
    measured: np.ndarray
    nominal: np.ndarray
    extended: np.ndarray | None
    load: np.ndarray | None


class Signals(NamedTuple):
    """signals.parquet."""

    time: np.ndarray  # [N] s
    run: np.ndarray  # [N] int, one number for each part and trajectory
    held: np.ndarray  # [N] bool
    joints: dict[str, Trace]


class Diagnosis(NamedTuple):
    """A diagnosis folder."""

    folder: Path
    raw: dict[str, Any]  # diagnosis.json as it is
    causes: list[Cause]
    candidates: list[Cause]
    joints: list[Joint]
    horizons: list[Horizon]
    signals: Signals | None
    problems: list[str]

    @property
    def verdict(self) -> str:
        """none, named, ambiguous or unknown; empty if missing."""
        return str(self.raw.get("verdict", ""))

    def part(self, key: str) -> dict[str, Any]:
        """A dict of diagnosis.json; empty if missing."""
        found = self.raw.get(key)
        return found if isinstance(found, dict) else {}

    def rows(self, key: str) -> list[dict[str, Any]]:
        """A list of dicts of diagnosis.json; empty if missing."""
        return rows_of(self.raw.get(key))


def read_diagnosis(folder: Path) -> Diagnosis:
    """Reads a diagnosis folder.

    Raises:
        FileNotFoundError: no diagnosis.json.
        ValueError: diagnosis.json is not a JSON object.
    """
    path = folder / "diagnosis.json"
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file; gatjax diagnose writes it")
    raw = read_json(path)
    problems: list[str] = []
    gain, follows = raw.get("gain"), raw.get("command_unit", "rad") == "rad"
    return Diagnosis(
        folder=folder,
        raw=raw,
        causes=[_cause(row) for row in rows_of(raw.get("causes"))],
        candidates=[_cause(row) for row in rows_of(raw.get("candidates"))],
        joints=[_joint(row) for row in rows_of(raw.get("joints"))],
        horizons=[
            _horizon(row)
            for row in rows_of(gain.get("horizons") if isinstance(gain, dict) else None)
        ],
        signals=_read_signals(folder / "signals.parquet", follows, problems),
        problems=problems,
    )


def number_in(row: Mapping[str, Any], key: str) -> float:
    """A number of a JSON object; nan if it is missing or no number."""
    value = row.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return math.nan
    return float(value)


def rows_of(value: Any) -> list[dict[str, Any]]:
    """The objects of a JSON list; empty if it is none."""
    found = value if isinstance(value, list) else []
    return [row for row in found if isinstance(row, dict)]


def texts_of(value: Any) -> list[str]:
    """A JSON list, or a single value, as texts."""
    if value is None:
        return []
    return [str(each) for each in (value if isinstance(value, list) else [value])]


def _cause(row: Mapping[str, Any]) -> Cause:
    parameters = row.get("parameters")
    values = []
    for name, entry in (parameters if isinstance(parameters, dict) else {}).items():
        entry = entry if isinstance(entry, dict) else {"value": entry}
        low, value, high = (number_in(entry, key) for key in ("low", "value", "high"))
        values.append(Value(str(name), value, low, high, str(entry.get("unit", ""))))
    step = number_in(row, "step")
    return Cause(
        name=str(row.get("cause", "")),
        where=texts_of(row.get("where")),
        variant=str(row.get("variant") or ""),
        values=values,
        probability=number_in(row, "probability"),
        evidence=number_in(row, "log_evidence"),
        rms=number_in(row, "rms"),
        equivalent=texts_of(row.get("equivalent")),
        step=int(step) if math.isfinite(step) else 0,
    )


def _joint(row: Mapping[str, Any]) -> Joint:
    return Joint(
        str(row.get("name", "")),
        number_in(row, "noise"),
        number_in(row, "nominal_rms"),
        number_in(row, "tolerance_rms"),
        number_in(row, "extended_rms"),
        number_in(row, "beyond_tolerance"),
        bool(row.get("drawn")),
    )


def _horizon(row: Mapping[str, Any]) -> Horizon:
    ahead = row.get("horizon_s")
    return Horizon(
        WHOLE_LOG if ahead is None else number_in(row, "horizon_s"),
        str(row.get("joint", "all")),
        *(number_in(row, key) for key in ("before", "after", "low", "high", "learned")),
    )


def _read_signals(path: Path, follows: bool, problems: list[str]) -> Signals | None:
    """The signals; None, and a problem in words, if they cannot be read.

    `follows` says whether commands are angles.
    """
    if not path.is_file():
        problems.append("signals.parquet is missing: no pictures of the joints")
        return None
    try:
        with parquet.ParquetFile(path) as file:
            table = file.read()
        columns = {
            name: table.column(name).cast(pa.float64(), safe=False).to_numpy()
            for name in table.column_names
        }
        time = columns["time"]
    except (pa.ArrowException, OSError, KeyError) as error:
        line = str(error).splitlines()[0]
        problems.append(f"signals.parquet cannot be read: {line}")
        return None
    blank = np.zeros(len(time))
    held = columns.get("part", blank) > 0.5
    key = np.stack([held, columns.get("trajectory", blank)], axis=-1)
    _, run = np.unique(key, axis=0, return_inverse=True)
    names = [c.removeprefix("measured.") for c in columns if c.startswith("measured.")]
    joints = {name: _trace(columns, name, follows) for name in names}
    found = {name: trace for name, trace in joints.items() if trace is not None}
    lacking = sorted(set(joints) - set(found))
    if lacking:
        problems.append(f"signals.parquet lacks columns of {', '.join(lacking[:5])}")
    return Signals(time, run.ravel(), held, found)


def _trace(
    columns: Mapping[str, np.ndarray], joint: str, follows: bool
) -> Trace | None:
    """The signals of a joint; None without command or nominal model."""
    optional: Sequence[np.ndarray | None] = [
        columns.get(f"{family}.{joint}")
        for family in ("command", "measured", "nominal", "extended", "load")
    ]
    command, measured, nominal, extended, load = (
        each if each is not None and np.isfinite(each).any() else None
        for each in optional
    )
    if command is None or measured is None or nominal is None:
        return None
    return Trace(command if follows else None, measured, nominal, extended, load)
