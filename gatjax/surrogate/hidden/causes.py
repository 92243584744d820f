"""The causes of the catalogue: how strong they come and what they change.

The meaning of every name and number is that of docs/diagnosis.md. `ladder` is a
list of values of the scored parameter from hardly visible to strong, `apply`
makes the specimen.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from gatjax.surrogate.hidden.numbers import Extra, Specimen
from gatjax.surrogate.hidden.robots import Robot

RUNGS = 6
Details = dict[str, Any]
Apply = Callable[[Specimen, Robot, list[int], float, Details], Specimen]
Draw = Callable[[Robot, list[int], np.random.Generator], tuple[np.ndarray, Details]]


class Cause(NamedTuple):
    """One hidden effect that a case may have."""

    parameter: str  # the scored one
    unit: str
    ladder: Draw  # values of the parameter and what else is drawn
    apply: Apply
    where: str = "joint"  # joint, any (joint, pair or all), all, imu, ground, foot
    robots: str = "all"  # all, many (joints), floor
    sites: int = 1  # places to try, for effects that many joints hide


def rungs(mild: float, strong: float) -> np.ndarray:
    """A ladder [RUNGS] in equal ratios."""
    return np.geomspace(mild, strong, RUNGS)


def plain(mild: float, strong: float) -> Draw:
    """A ladder that is the same for every joint."""
    return lambda robot, joints, rng: (rungs(mild, strong), {})


def by_gain(mild: float, strong: float) -> Draw:
    """A torque as the error, rad, that balances it, at most 40 % of the limit."""

    def draw(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
        gain = robot.model.actuator_gainprm[joints[0], 0]
        limit = robot.model.actuator_forcerange[joints[0], 1]
        return rungs(mild * gain, min(strong * gain, 0.4 * limit)), {}

    return draw


def with_details(ladder: Draw, **details: Callable[[np.random.Generator], Any]) -> Draw:
    """A ladder with further numbers."""

    def draw(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
        values, found = ladder(robot, joints, rng)
        return values, {**found, **{name: make(rng) for name, make in details.items()}}

    return draw


def either_sign(ladder: Draw) -> Draw:
    """A ladder up or down from zero."""

    def draw(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
        values, details = ladder(robot, joints, rng)
        return values * rng.choice([-1.0, 1.0]), details

    return draw


def between(low: float, high: float) -> Callable[[np.random.Generator], float]:
    """A uniform draw."""
    return lambda rng: float(rng.uniform(low, high))


def field(name: str, change: Callable[[np.ndarray, float], Any]) -> Apply:
    """Changes a number of the named joints."""

    def apply(
        specimen: Specimen, robot: Robot, joints: list[int], value: float, more: Details
    ) -> Specimen:
        changed = specimen.numbers[name].copy()
        changed[joints] = change(changed[joints], value)
        return specimen._replace(numbers={**specimen.numbers, name: changed})

    return apply


def whole(name: str) -> Apply:
    """Sets a number that belongs to the whole robot."""

    def apply(
        specimen: Specimen, robot: Robot, joints: list[int], value: float, more: Details
    ) -> Specimen:
        return specimen._replace(
            numbers={**specimen.numbers, name: np.array(float(value))}
        )

    return apply


def extra(kind: str, parameter: str, **fixed: float) -> Apply:
    """Adds a law of `terms`; its parameters are the value, details, fixed ones."""

    def apply(
        specimen: Specimen, robot: Robot, joints: list[int], value: float, more: Details
    ) -> Specimen:
        values = {**fixed, **more, parameter: float(value)}
        added = tuple(Extra(kind, joint, values) for joint in joints)
        return specimen._replace(extras=specimen.extras + added)

    return apply


def add(old: np.ndarray, value: float) -> np.ndarray:
    """More of it."""
    return old + value


def scale(old: np.ndarray, value: float) -> np.ndarray:
    """A multiple of it."""
    return old * value


def put(old: np.ndarray, value: float) -> float:
    """Another value."""
    return value
