"""What an entry of the catalogue is, and how its values are read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

Array = Any


class Parameter(NamedTuple):
    """A number of a cause."""

    name: str
    unit: str
    low: float  # plausible range
    high: float
    default: float | None = None  # None: has to be given; NaN: taken from the model


class Part(NamedTuple):
    """What a cause does in one slot.

    Slots and what `build` is there:

        command  per control tick        (period) -> Effect of Signal
        motor    per physics step        (period) -> Effect of Signal
        joint    per physics step        (period) -> Effect of Drive
        gear     per physics step        None: the values become part of a `Gear`
        sensor   per control tick        (period) -> Effect of Sensed
        body     before the simulation   (model, fields, params) -> fields
        log      after the simulation    None: `sensor.drifted`
    """

    slot: str
    build: Callable[..., Any] | None
    takes: tuple[str, ...]  # one name: params are its array; more: a dict of arrays
    variant: tuple[str, float] | None = None  # only where this parameter is 0 or 1
    sees: bool = False  # a motor part that reads the joint's angle or speed
    follows: bool = False  # a motor part of position servos only


class Cause(NamedTuple):
    """One entry of the catalogue; the first parameter is the main one."""

    parameters: tuple[Parameter, ...]
    neutral: float  # main value that changes nothing
    parts: tuple[Part, ...]
    equation: str
    source: str
    place: str = "joint"  # what `where` lists: joint, all, imu, ground or foot
    direction: tuple[str, ...] = ()  # parameters whose norm is the main one

    @property
    def main(self) -> Parameter:
        """The parameter that scores."""
        return self.parameters[0]

    def is_neutral(self, value: float) -> bool:
        """Whether a main value changes nothing."""
        return value == self.neutral or bool(np.isnan(value) and np.isnan(self.neutral))

    def size(self, value: float) -> float:
        """A main value from where it changes nothing; from 0 if that is no number."""
        return value - (self.neutral if np.isfinite(self.neutral) else 0.0)

    def severity(self, value: float) -> float:
        """How much a main value does: from where it does nothing, a limit inversely."""
        return value - self.neutral if np.isfinite(self.neutral) else 1.0 / value

    def active(self, values: Mapping[str, float]) -> tuple[Part, ...]:
        """Return the parts that act in the variant that complete values choose."""
        return tuple(
            part
            for part in self.parts
            if part.variant is None or values[part.variant[0]] == part.variant[1]
        )


def complete(name: str, entry: Cause, values: Mapping[str, Any]) -> dict[str, float]:
    """Check values that were given for a cause and add the defaults.

    Args:
        name: of the cause, for messages.
        entry: the cause.
        values: {parameter: number}. Components of a direction count as they are; with
            the main parameter beside them, only their direction counts.

    Raises:
        ValueError: a parameter is missing, unknown or not a number.
    """
    known = {each.name: each for each in entry.parameters}
    main, axes = entry.main.name, [axis for axis in entry.direction if axis in values]
    extra = [each for each in values if each not in known]
    if extra or not (main in values or axes):
        others = [each for each in known if each != main]
        raise ValueError(
            f"{name} needs {main!r} in values and may have {others}; values is "
            f"{dict(values)!r}"
        )
    for key, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float | np.floating):
            raise ValueError(
                f"{name}: {key} is {value!r}; it must be a number in {known[key].unit}"
            )
    full = {each.name: each.default for each in entry.parameters} | {
        key: float(value) for key, value in values.items()
    }
    for part in entry.parts:
        if part.variant and full[part.variant[0]] not in (0.0, 1.0):
            raise ValueError(
                f"{name}: {part.variant[0]} is {full[part.variant[0]]!r}; it must be "
                "0 or 1"
            )
    if entry.direction:
        if axes:
            full |= {axis: float(values.get(axis, 0.0)) for axis in entry.direction}
        parts = np.array([full[axis] for axis in entry.direction], float)
        size = float(np.linalg.norm(parts))
        length = float(values.get(main, size))
        if size == 0.0 and length != 0.0:
            raise ValueError(
                f"{name}: {', '.join(entry.direction)} are all 0; they are the "
                f"direction of {main}"
            )
        parts = parts * (length / size if size > 0.0 else 0.0)
        full |= {
            main: length,
            **dict(zip(entry.direction, parts.tolist(), strict=True)),
        }
    return {key: float(value) for key, value in full.items() if value is not None}


def check_range(name: str, entry: Cause, values: Mapping[str, float]) -> None:
    """Raise ValueError if complete values of a cause are not plausible."""
    for each in entry.parameters:
        value = values[each.name]
        usual = each.default is not None and (
            value == each.default or bool(np.isnan(value) and np.isnan(each.default))
        )
        if usual or each.low <= value <= each.high:
            continue
        if each is entry.main and entry.is_neutral(value):
            continue
        neutral = f", or {entry.neutral} for none" if each is entry.main else ""
        raise ValueError(
            f"{name}: {each.name} {value} {each.unit} is out of range; use "
            f"{each.low} to {each.high}{neutral}"
        )


def spread(
    entry: Cause, part: Part, names: tuple[str, ...], where: list[str],
    values: Mapping[str, float],
) -> Array:  # fmt: skip
    """Return the params of a part: an array [names], or a dict of them.

    The main parameter is neutral where the cause does not act. Without names, params
    are numbers: the cause acts on the world as a whole.
    """
    here = np.isin(names, where) | (list(where) == ["all"])

    def one(key: str) -> Array:
        if not names:
            return np.float64(values[key])
        elsewhere = entry.neutral if key == entry.main.name else values[key]
        elsewhere = 0.0 if key in entry.direction else elsewhere
        return np.where(here, values[key], elsewhere)

    if len(part.takes) == 1:
        return one(part.takes[0])
    return {key: one(key) for key in part.takes}
