"""How far the numbers of a nominal model may be off without being a cause."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gatjax.files import read_json

SCHEMA = "gatjax.tolerances/1"
CORRELATED = 0.1  # s after which residuals are taken as independent
SHARES = ("kp", "kv", "damping", "armature", "limit", "friction", "give")
"""Tolerances that are shares of a joint's nominal number."""
MOST = 1e3
ANGLES = ("angle", "zero", "tilt")  # rad
WIDE = 0.5  # rad, more than any simulation that is worth a diagnosis is off
PARTS = (*SHARES, "stribeck", "mass", "inertia")
PLENTY = 10.0  # no share is that uncertain
BY_JOINT = ("angle", "lasting")
"""Tolerances that joints may have each by itself."""


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
    angle: float | dict[str, float] = 0.0
    """How close a simulation has to come, rad: at all joints, or by name."""
    lasting: float | dict[str, float] = CORRELATED
    """How long it stays off, s: residuals within that count as one; or by name."""

    def close(self, joint: str) -> float:
        """How close a simulation of a joint has to come, rad."""
        return (
            self.angle.get(joint, 0.0) if isinstance(self.angle, dict) else self.angle
        )

    def lasts(self, joint: str) -> float:
        """Time after which residuals of a joint are independent, s."""
        own = self.lasting
        told = own.get(joint, CORRELATED) if isinstance(own, dict) else own
        return max(told, CORRELATED)


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
    for name in told:
        if name not in Tolerances._fields:
            known = ", ".join(Tolerances._fields)
            raise ValueError(f"{path}: no tolerance is called {name!r}; use {known}")
    sizes = dict(told)
    for kind in BY_JOINT:
        if isinstance(told.get(kind), dict):
            own = sizes.pop(kind).items()
            sizes |= {f"{kind} of {joint}": size for joint, size in own}
    for name, size in sizes.items():
        number = isinstance(size, int | float) and not isinstance(size, bool)
        if not (number and 0.0 <= size <= MOST):
            raise ValueError(
                f"{path}: {name} is {size!r}; give one standard deviation, 0 or more"
            )
        if name.partition(" ")[0] in ANGLES and size > WIDE:
            raise ValueError(
                f"{path}: {name} is {size:g} rad; angles are in rad, {WIDE:g} at most "
                f"({size:g} deg are {np.deg2rad(size):.3g} rad)"
            )
        if name in PARTS and size > PLENTY:
            raise ValueError(
                f"{path}: {name} is {size:g}, a share of the model's number: 0.1 is "
                f"10 %, {PLENTY:g} the most"
            )
    return Tolerances(**{name: _floats(told[name]) for name in told})


def _floats(told: Any) -> Any:
    """A tolerance, or those of some joints."""
    if isinstance(told, dict):
        return {joint: float(size) for joint, size in told.items()}
    return float(told)


def surer(allowed: Tolerances) -> dict[str, float]:
    """Tolerances of a model's numbers that are smaller than usual."""
    numbers = set(Tolerances._fields) - set(BY_JOINT)
    pairs = allowed._asdict().items()
    return {k: size for k, size in pairs if k in numbers and size < getattr(USUAL, k)}


def check_joints(allowed: Tolerances, joints: tuple[str, ...], path: Path) -> None:
    """Refuse a file that is about joints of another robot.

    Raises:
        ValueError: one line with the first joint that there is not.
    """
    told = (getattr(allowed, kind) for kind in BY_JOINT)
    for name in (name for own in told if isinstance(own, dict) for name in own):
        if name not in joints:
            known = ", ".join(joints)
            raise ValueError(f"{path}: there is no joint {name!r}; joints are {known}")
