"""Cause names and what they mean: parameter, unit, range, equation, source, effect.

The names are a contract (`docs/files.md`, world file). A cause sits in a slot: `motor`
effects run once per physics step, `body` effects change model fields, `command` effects
run once per control tick. The diagnosis extends this table.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from gatjax.effects import body, drive


class Cause(NamedTuple):
    """One entry of the catalogue."""

    parameter: str
    unit: str
    neutral: float  # value that changes nothing
    low: float  # plausible range
    high: float
    slot: str  # motor, command or body
    build: Callable[
        ..., Any
    ]  # period -> Effect; body: (model, fields, values) -> fields
    equation: str
    source: str


CATALOGUE = {
    "command_delay": Cause(
        "delay", "s", 0.0, 0.0, 0.1, "motor", lambda period: drive.delay(period, 0.1),
        "servo sees target(t - delay)", "B-Human: request to motion 36 ms, NAO v6",
    ),
    "first_order_lag": Cause(
        "time_constant", "s", 0.0, 0.0, 0.3, "motor", drive.lag,
        "time_constant y' = target - y", "SimRobot 2 servo: 50 ms",
    ),
    "speed_limit": Cause(
        "limit", "rad/s", float("inf"), 0.5, 20.0, "motor", drive.speed_limit,
        "|d target/dt| <= limit inside the servo", "NAO6 datasheet: 4.5 and 7.0 rad/s",
    ),
    "torque_limit": Cause(
        "limit", "N*m", float("inf"), 0.2, 20.0, "body", body.torque_limit,
        "|servo torque| <= limit", "NAO v5 URDF effort: 3.0 and 3.3 N m",
    ),
    "coulomb_friction": Cause(
        "torque", "N*m", 0.0, 0.0, 2.0, "body", body.coulomb_friction,
        "dry friction torque added to frictionloss", "SimSpark naov4: 0.1 N m",
    ),
    "viscous_friction": Cause(
        "coefficient", "N*m*s/rad", 0.0, 0.0, 5.0, "body", body.viscous_friction,
        "torque = -coefficient velocity", "SimRobot 3: 0.01",
    ),
    "gain_error": Cause(
        "scale", "1", 1.0, 0.2, 3.0, "body", body.gain_error,
        "kp -> scale kp", "servo gain of the NAO is unpublished",
    ),
    "backlash": Cause(
        "width", "rad", 0.0, 0.0, 0.2, "motor", lambda period: drive.backlash(),
        "play operator of total width on the target", "B-Human joint play: 1.0-1.4 deg",
    ),
    "dead_band": Cause(
        "half_width", "rad", 0.0, 0.0, 0.1, "motor", lambda period: drive.dead_band(),
        "no torque while |target - angle| < half_width", "E1 prototype: 0.5 deg",
    ),
    "command_noise": Cause(
        "deviation", "rad", 0.0, 0.0, 0.2, "command", lambda period: drive.noise(),
        "target + deviation N(0, 1) each tick", "Jakobi et al. 1995, noise envelope",
    ),
}  # fmt: skip


def cause(name: str) -> Cause:
    """Look a cause up by name."""
    if name not in CATALOGUE:
        raise ValueError(f"cause {name!r} is unknown; choose from {sorted(CATALOGUE)}")
    return CATALOGUE[name]
