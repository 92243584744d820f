"""The menu: what each motion is good for, and how it is made safe.

Every motion rests at home for a second, moves smoothly to the middle of what it may use
of each joint's range, plays a pattern there, and comes home to rest again. It stays
within the joint limits less a margin, is nowhere faster than it may be, and depends on
nothing but its arguments. That links do not hit each other is not checked.

What each motion separates: design notes, diagnosis.md, sections 6 to 8.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gatjax.motions import patterns
from gatjax.motions.patterns import Pattern, Stage

Array = Any

REST = 1.0  # s at home, before and after
MARGIN = 0.03  # rad that stay free before a joint limit
APPROACH = 0.8  # s at least, from home to the middle and back
HUNG = 0.6  # reach of a robot that can not fall
SHORTEST = 4.0  # s, the least length of a pattern
SLOWEST = 20.0  # Hz, at which a motion still is smooth
PEAK = 15.0 / 8.0  # top speed of `patterns.smooth`, of distance per time


class Limbs(NamedTuple):
    """What a motion needs to know about a robot."""

    names: tuple[str, ...]  # of the J joints
    limits: Array  # [J, 2] rad
    home: Array  # [J] rad, where a motion starts and ends
    speed: Array  # [J] rad/s that no target passes; inf where none is known
    floating: bool  # it stands, and may fall; False: hung up or bolted


class Motion(NamedTuple):
    """One entry of the menu."""

    name: str
    title: str
    separates: tuple[str, ...]  # the causes that it tells apart
    seconds: float  # its usual length, rest included
    standing: float  # reach that a standing NAO keeps its feet with, all joints moving
    pattern: Pattern

    @property
    def use(self) -> str:
        """Say in one line what it is good for."""
        return f"{self.title}; mostly for {', '.join(self.separates)}"

    def reach(self, limbs: Limbs, moving: Array) -> float:
        """Return the share of the joint ranges that is safe for a robot.

        Independent pushes on a standing robot add up like the root of their number, so
        the fewer of its joints [J] bool move, the further each may.
        """
        if not limbs.floating:
            return HUNG
        return min(self.standing * float(np.sqrt(len(moving) / sum(moving))), HUNG)

    def build(
        self,
        limbs: Limbs,
        moving: Array,
        rate_hz: float,
        seed: int,
        *,
        reach: float | None = None,
        seconds: float | None = None,
    ) -> np.ndarray:
        """Return joint targets.

        Args:
            limbs: the robot.
            moving: [J] bool, the joints to move; the rest stay at home.
            rate_hz: rows per second.
            seed: draws phases, levels and orders.
            reach: share of the way from home to the limits that is used, above 0, at
                most 1; by default what is safe for the robot.
            seconds: length with rest; by default the usual one.

        Returns:
            [T, J] rad, T = seconds * rate_hz.

        Raises:
            ValueError: one line that says what can not be.
        """
        moving = np.asarray(moving, bool)
        if not moving.any():
            raise ValueError("no joint to move; name at least one")
        reach = self.reach(limbs, moving) if reach is None else reach
        seconds = self.seconds if seconds is None else seconds
        _check(limbs, rate_hz, reach)
        low, high = _range(limbs, reach)
        low, high = low[moving], high[moving]
        home, speed = limbs.home[moving], limbs.speed[moving]
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        way = float(max(np.max(PEAK * np.abs(middle - home) / speed), APPROACH))
        rest, approach = round(REST * rate_hz), int(np.ceil(way * rate_hz))
        rows = round(seconds * rate_hz) - 2 * (rest + approach)
        if rows < SHORTEST * rate_hz:
            least = np.ceil(2.0 * (REST + way) + SHORTEST)
            raise ValueError(
                f"motion {self.name}: {seconds:g} s is too short for it; "
                f"give it {least:g} s or more"
            )
        stage = Stage(rows, rate_hz, half, speed, np.random.default_rng([seed, 7]))
        played = middle + patterns.within_speed(self.pattern(stage), speed / rate_hz)
        share = patterns.smooth(np.arange(1, approach + 1) / approach)[:, None]
        target = np.tile(np.asarray(limbs.home, float), (round(seconds * rate_hz), 1))
        target[rest:-rest, moving] = np.concatenate(
            [home + share * (middle - home), played, middle + share * (home - middle)]
        )
        return target


def _range(limbs: Limbs, reach: float) -> tuple[Array, Array]:
    """Lowest and highest targets [J] rad."""
    low, high = np.asarray(limbs.limits).T
    down = np.maximum(limbs.home - low - MARGIN, 0.0)
    up = np.maximum(high - limbs.home - MARGIN, 0.0)
    return limbs.home - reach * down, limbs.home + reach * up


def _check(limbs: Limbs, rate_hz: float, reach: float) -> None:
    """Refuse what no motion can be made of."""
    if not 0.0 < reach <= 1.0:
        raise ValueError(f"reach is {reach:g}; use more than 0, at most 1")
    if not rate_hz >= SLOWEST:
        low = f"{SLOWEST:g}"
        raise ValueError(f"a motion at {rate_hz:g} Hz is not smooth; use {low} or more")
    low, high = np.asarray(limbs.limits).T
    for name, home, least, most, speed in zip(
        limbs.names, limbs.home, low, high, limbs.speed
    ):
        if not least <= home <= most:
            raise ValueError(
                f"{name}: home {home:g} rad lies outside its limits {least:g} to "
                f"{most:g} rad"
            )
        if not speed > 0.0:
            raise ValueError(f"{name}: speed is {speed:g} rad/s; use more than 0")


def chosen(limbs: Limbs, names: tuple[str, ...]) -> np.ndarray:
    """Return which joints [J] bool are named; all of them where none is.

    Raises:
        ValueError: a name that the robot lacks, with those that it has.
    """
    unknown = [name for name in names if name not in limbs.names]
    if unknown:
        raise ValueError(
            f"the robot has no joint {unknown[0]!r}; it has {', '.join(limbs.names)}"
        )
    return np.isin(limbs.names, names or limbs.names)


def motion(name: str) -> Motion:
    """Return a motion of the menu.

    Raises:
        ValueError: no such motion, with those that there are.
    """
    if name not in MENU:
        raise ValueError(f"motion {name!r} is unknown; choose from {', '.join(MENU)}")
    return MENU[name]


MENU: dict[str, Motion] = {
    entry.name: entry
    for entry in (
        Motion(
            "rich", "sweep, jumps, ramps and rests: begin with this one",
            ("command_delay", "first_order_lag", "gain_error", "damping_error",
             "coulomb_friction", "backlash", "payload", "armature"),
            30.0, 0.015, patterns.rich,
        ),
        Motion(
            "chirp", "a sweep from 0.2 to 5 Hz",
            ("command_delay", "first_order_lag", "gain_error", "damping_error",
             "armature", "joint_elasticity"),
            20.0, 0.015, patterns.chirp,
        ),
        Motion(
            "multisine", "ten tones at once, 0.15 to 4 Hz",
            ("armature", "payload", "first_order_lag", "viscous_friction",
             "joint_elasticity"),
            20.0, 0.03, patterns.multisine,
        ),
        Motion(
            "steps_small", "jumps of 0.03 rad",
            ("dead_band", "backlash", "coulomb_friction", "stiction",
             "command_quantization"),
            15.0, 0.04, patterns.steps_small,
        ),
        Motion(
            "steps_large", "jumps as far as may be",
            ("torque_limit", "speed_limit", "gain_error", "command_delay",
             "first_order_lag"),
            15.0, 0.015, patterns.steps_large,
        ),
        Motion(
            "slow_reversals", "slow ramps, loops within loops, both signs of the load",
            ("backlash", "coulomb_friction", "load_friction", "asymmetric_friction",
             "joint_elasticity", "torque_ripple"),
            30.0, 0.02, patterns.slow,
        ),
        Motion(
            "creep", "a ramp of 0.03 rad/s",
            ("stiction", "command_quantization", "dead_band", "torque_ripple"),
            30.0, 0.02, patterns.creep,
        ),
        Motion(
            "hold_loaded", "rests in five poses",
            ("gain_error", "payload", "com_shift", "gravity_tilt", "encoder_offset",
             "encoder_scale"),
            30.0, 0.02, patterns.holds,
        ),
        Motion(
            "repeat_five", "the same short motion five times",
            ("dropped_commands", "thermal_derating", "clock_drift"),
            30.0, 0.015, patterns.repeated,
        ),
        Motion(
            "together_alone", "joint after joint (six groups where there are more), "
            "then all at once",
            ("supply_sag", "torque_limit", "torque_saturation", "gain_error"),
            25.0, 0.015, patterns.together_alone,
        ),
    )
}  # fmt: skip
"""Motions by name.

The reach of a standing NAO was found with ten seeds each on `dart` and in the nominal
simulator, all joints moving: none fell. At two to five times of it some did.
"""
