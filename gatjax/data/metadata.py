"""What a recording says of itself: robot, base, rate, unit of its commands, notes."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import parquet

from gatjax.data.mapping import spelled
from gatjax.runs import read_json

ANGLE = "rad"
COMMAND_UNITS = (ANGLE, "N m", "V")  # of commands; metadata `command_unit`
FOREIGN_METADATA = ("pandas", "ARROW:schema")  # what other writers put in Parquet


def told_of(path: Path) -> dict[str, Any]:
    """Metadata of a table: those in a Parquet file, or in the .json beside a .csv."""
    if path.suffix.lower() != ".parquet":
        return _json_beside(path)
    return _parquet_metadata(parquet.read_schema(path))


def _parquet_metadata(schema: pa.Schema) -> dict[str, Any]:
    """Key-value metadata of a Parquet file, without what other writers add."""
    raw = {k.decode(): v.decode() for k, v in (schema.metadata or {}).items()}
    return {key: value for key, value in raw.items() if key not in FOREIGN_METADATA}


def _json_beside(path: Path) -> dict[str, Any]:
    """The .json beside a .csv; nothing if it is not there."""
    beside = path.with_suffix(".json")
    if not beside.is_file():
        return {}
    return read_json(beside)


def in_one_form(raw: Mapping[str, Any], file: str) -> dict[str, Any]:
    """Metadata in one form for both file types: text, but for `rate_hz`."""
    metadata: dict[str, Any] = {
        key: value if isinstance(value, str) else json.dumps(value, default=str)
        for key, value in raw.items()
    }
    if metadata.get("base", "fixed") not in ("fixed", "floating"):
        raise ValueError(
            f"{file}: metadata base is {metadata['base']!r}; it is fixed or floating"
        )
    if "command_unit" in metadata:
        metadata["command_unit"] = spelled(metadata["command_unit"])
    if metadata.get("command_unit", ANGLE) not in COMMAND_UNITS:
        raise ValueError(
            f"{file}: metadata command_unit is {metadata['command_unit']!r}; it is one "
            f"of {', '.join(COMMAND_UNITS)}"
        )
    if "rate_hz" in metadata:
        try:
            rate = float(metadata["rate_hz"])
        except ValueError:
            rate = math.nan
        if not 0.0 < rate < math.inf:
            raise ValueError(
                f"{file}: metadata rate_hz is {raw['rate_hz']!r}; it is a number > 0"
            )
        metadata["rate_hz"] = rate
    return metadata
