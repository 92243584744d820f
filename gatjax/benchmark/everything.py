"""All continuous numbers of a joint fitted at once, as is usual in identification.

Without priors; the number that moved most, in tolerances, is taken for the cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gatjax.benchmark.squares import Solved, solved
from gatjax.diagnosis.assembly import TRANSPORT
from gatjax.diagnosis.hypotheses import Hypothesis, Numbers
from gatjax.diagnosis.joint import Joint
from gatjax.diagnosis.tolerances import SHARES, USUAL
from gatjax.effects.catalogue import CATALOGUE

ROUNDS = 12
NOTABLE = 3.0  # tolerances from which a change is named
PERIOD = 1e-3  # s, tolerance of a servo's loop period and so of its lag
FACTOR = float(np.log(20.0))  # most that a number may differ from nominal


class Number(NamedTuple):
    """One number of a joint: where it goes, and what it is called as a cause."""

    field: str  # of laws.Drive
    cause: str
    tolerance: float  # of the coordinate
    step: float  # of the finite differences
    low: float
    high: float


NUMBERS = (
    *(
        Number(field, cause, getattr(USUAL, field), 0.02, -FACTOR, FACTOR)
        for field, cause in (
            ("kp", "gain_error"), ("kv", "damping_error"),
            ("damping", "viscous_friction"), ("friction", "coulomb_friction"),
            ("armature", "armature"), ("limit", "torque_limit"),
        )
    ),
    Number("delay", "command_delay", USUAL.late, 3e-4, -TRANSPORT, 0.2),
    Number("lag", "first_order_lag", PERIOD, 3e-4, 0.0, 0.3),
    Number("zero_out", "encoder_offset", USUAL.zero, 1e-3, -0.6, 0.6),
    Number("zero_in", "encoder_offset", USUAL.zero, 1e-3, -0.6, 0.6),
)  # fmt: skip
"""Coordinates: logarithms of factors for the first six, then s, s, rad, rad."""


def _put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
    """Put the coordinates into the numbers of a joint."""
    for number, value in zip(NUMBERS, x, strict=True):
        if number.field in SHARES:
            drive[number.field] = joint.nominal[number.field] * float(np.exp(value))
        elif number.field == "delay":
            drive["delay"] = TRANSPORT + float(value)
        else:
            drive[number.field] = float(value)


def _values(joint: Joint, x: np.ndarray) -> Numbers:
    """The numbers under their own names."""
    drive: Numbers = {}
    _put(drive, joint, x)
    return drive


HYPOTHESIS = Hypothesis(
    "", "every number", _put, (), tuple(n.step for n in NUMBERS),
    tuple(n.low for n in NUMBERS), tuple(n.high for n in NUMBERS), _values,
)  # fmt: skip


def fitted(joints: Sequence[Joint]) -> list[Solved]:
    """Fit all numbers of each joint by itself."""
    starts = np.zeros((2, len(NUMBERS)))
    starts[1, [n.field for n in NUMBERS].index("lag")] = 0.01
    return [solved([j], [HYPOTHESIS], [list(starts)], ROUNDS)[0] for j in joints]


def named(joints: Sequence[Joint], fits: Sequence[Solved]) -> dict[str, Any] | None:
    """The largest change as a cause; None if it is within three tolerances.

    A number that moved that far at every one of several joints is said of all.
    """
    tolerance = np.array([number.tolerance for number in NUMBERS])
    moved = np.array([fit.own for fit in fits]) / tolerance  # [J, numbers]
    index, which = divmod(int(np.abs(moved).argmax()), len(NUMBERS))
    if abs(moved[index, which]) <= NOTABLE:
        return None
    whole = len(joints) > 1 and bool((np.abs(moved[:, which]) > NOTABLE).all())
    return {
        "cause": NUMBERS[which].cause,
        "where": ["all"] if whole else [joints[index].name],
        "parameters": _parameters(joints[index], fits[index], which),
        "probability": 1.0,
        "equivalent": [],
    }


def _parameters(joint: Joint, fit: Solved, which: int) -> dict[str, dict[str, Any]]:
    """The parameter of a moved number, with the interval of its deviation."""
    number = NUMBERS[which]
    entry = CATALOGUE[number.cause].parameters[0]
    half = 1.645 * fit.deviation[which]
    ends = []
    for shift in (-half, 0.0, half):
        x = fit.own.copy()
        x[which] = np.clip(x[which] + shift, number.low, number.high)
        ends.append(_parameter(joint, number, _values(joint, x)[number.field]))
    spread = {"low": min(ends), "high": max(ends), "unit": entry.unit}
    return {entry.name: {"value": ends[1], **spread}}


def _parameter(joint: Joint, number: Number, value: float) -> float:
    """A number as the catalogue counts it: factor, added amount, or as it is."""
    if number.cause in ("gain_error", "damping_error"):
        return value / joint.nominal[number.field]
    if number.field == "delay":
        return value - TRANSPORT
    if number.field in ("damping", "friction", "armature"):
        return value - joint.nominal[number.field]
    return value
