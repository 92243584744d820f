"""Sizes with their units as people read them: degrees beside rad, milliseconds."""

from __future__ import annotations

import math

from gatjax.report.diagnosis.read import Cause, Value
from gatjax.report.wording import DASH, percent, significant

GREEK = {
    "N*m": "N m", "N*m*s/rad": "N m s/rad", "N*m/rad": "N m/rad",
    "kg*m^2": "kg m\N{SUPERSCRIPT TWO}", "1": "",
}  # fmt: skip
NAMES = {"": "cause", "none": "no hidden effect", "unknown": "unknown effect"}


def degrees(value: float) -> str:
    """An angle given in rad, in degrees with three digits."""
    return f"{significant(math.degrees(value))}°" if math.isfinite(value) else DASH


def portion(value: float) -> str:
    """A share of 1 in per cent; a dash if unknown."""
    return percent(value) if math.isfinite(value) else DASH


def size(value: float, unit: str) -> str:
    """A value in SI with its unit, in the multiple that reads best."""
    if not math.isfinite(value):
        return DASH
    if unit == "rad":
        return f"{degrees(value)} ({significant(value)} rad)"
    if unit == "s" and abs(value) < 1.0:
        return f"{significant(1e3 * value)} ms"
    return f"{significant(value)} {GREEK.get(unit, unit)}".rstrip()


def interval(value: Value) -> str:
    """The ends of a parameter's interval; empty if unknown."""
    if not (math.isfinite(value.low) and math.isfinite(value.high)):
        return ""
    scale, unit = 1.0, GREEK.get(value.unit, value.unit)
    if value.unit == "rad":
        scale, unit = math.degrees(1.0), "°"
    elif value.unit == "s" and abs(value.value) < 1.0:
        scale, unit = 1e3, "ms"
    ends = f"{significant(scale * value.low)} to {significant(scale * value.high)}"
    return f"{ends}{'' if unit == '°' else ' '}{unit}".rstrip()


def cause_name(name: str) -> str:
    """A cause as words."""
    return NAMES.get(name, name.replace("_", " "))


def place(where: list[str], most: int = 3) -> str:
    """Where a cause sits, as words."""
    if where == ["all"]:
        return "all joints"
    more = f" and {len(where) - most} more" if len(where) > most else ""
    return ", ".join(where[:most]) + more


def title(cause: Cause) -> str:
    """Cause and place."""
    where = place(cause.where)
    return cause_name(cause.name) + (f" at {where}" if where else "")
