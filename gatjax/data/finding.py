"""What a check of a recording says, and the words that say where."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from gatjax.data.recording import Recording, place

Level: TypeAlias = Literal["info", "warning", "refuse"]
Ranges: TypeAlias = Mapping[str, tuple[float, float]]  # joint: low, high, rad

DEGREES = 180.0 / np.pi


class Finding(NamedTuple):
    """What one check says of one file."""

    level: Level
    check: str  # short name of the check
    text: str  # one line: file, row and column where it applies, what to do
    values: dict[str, float]  # by joint, or by name of the number; SI


def cell(recording: Recording, row: int | np.integer, column: str) -> str:
    """Where a value of a recording stands: see `place`."""
    return place(recording.name, row, column)


def angle(value: float) -> str:
    """An angle given in rad, in both units."""
    return f"{value:.2g} rad ({DEGREES * value:.2g} deg)"


def listed(values: Mapping[str, float], form: str = ".2g", most: int = 4) -> str:
    """Joints with their values, cut after `most` of them."""
    items = [f"{joint} {value:{form}}" for joint, value in values.items()]
    more = f" and {len(items) - most} more" if len(items) > most else ""
    return ", ".join(items[:most]) + more
