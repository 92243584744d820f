"""How far the numbers of a nominal model may be off without being a cause."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gatjax.runs.files import read_json

SCHEMA = "gatjax.tolerances/1"
SHARES = ("kp", "kv", "damping", "armature", "limit", "friction", "give")
"""Tolerances that are shares of a joint's nominal number."""


class Tolerances(NamedTuple):
    """One standard deviation of each; see docs/diagnosis.md, section 3."""

    kp: float = 0.05
    kv: float = 0.1
    damping: float = 0.1
    armature: float = 0.1
    limit: float = 0.06
    friction: float = 0.3
    give: float = 1.0  # of what dry friction yields before it slips, a factor e
    zero: float = float(np.deg2rad(0.1))  # rad, of the encoder
    late: float = 0.0007  # s, of the transport time
    stribeck: float = 0.15  # of the dry friction: excess at standstill of every gear
    mass: float = 0.025  # share
    com: float = 0.002  # m
    inertia: float = 0.05  # share
    tilt: float = float(np.deg2rad(0.2))  # rad, of the mounting
    angle: float = 0.0  # rad, of all angles: how close a simulation has to come


USUAL = Tolerances()


def read_tolerances(path: Path) -> Tolerances:
    """Read the tolerances that differ from the usual ones.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: one line: no such tolerance, or a size that can not be.
    """
    if not path.is_file():
        raise FileNotFoundError(
            f"--tolerances {path} does not exist; docs/diagnosis.md, 3, shows one"
        )
    told = read_json(path)
    if told.pop("schema", SCHEMA) != SCHEMA:
        raise ValueError(f"{path}: not a file of tolerances; its schema is {SCHEMA}")
    for name, size in told.items():
        if name not in Tolerances._fields:
            known = ", ".join(Tolerances._fields)
            raise ValueError(f"{path}: no tolerance is called {name!r}; use {known}")
        number = isinstance(size, int | float) and not isinstance(size, bool)
        if not (number and math.isfinite(size) and size >= 0.0):
            raise ValueError(
                f"{path}: {name} is {size!r}; give one standard deviation, 0 or more"
            )
    return Tolerances(**told)
