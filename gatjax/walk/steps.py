"""From a request to step sizes: speed limits, ratchet, slip calibration; time profiles.

Source: the ut15 variant of Walk2014 (LARG/robotics-2018, WalkEnginePreProcessor and
Walk2014Generator), described in our own words in the design notes of gatjax.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from gatjax.walk.parameters import Constants, Gait
from gatjax.xp import namespace_of

Array = Any

SLACK = 1e-6  # s; times are tick counts, thresholds may lie exactly on a tick
CALIBRATION = (1.0, 0.82, 1.43)  # forward, left, turn: slip compensation
SPEED_FLOOR = 0.66  # share of the limits that is left at speed 0
VOLUME_EXPONENT = 2.0 / 1.05


class Request(NamedTuple):
    """What is asked of the walk; read at the start of every step."""

    forward: Array  # [...] m/s
    left: Array  # [...] m/s
    turn: Array  # [...] rad/s, counter-clockwise positive
    power: Array  # [...] 0..1, stiffness when standing
    bend: Array  # [...] 0 stand tall, 1 crouch and be ready, else march on the spot
    speed: Array  # [...] 0..1, scales the limits from 66 % to 100 %


class Steps(NamedTuple):
    """Step sizes of the next step."""

    period: Array  # [...] s
    forward: Array  # [...] m, over two steps
    left: Array  # [...] m, over two steps
    turn: Array  # [...] rad, clockwise positive


def _volume(forward: Array, left: Array, turn: Array) -> Array:
    r = VOLUME_EXPONENT
    return (forward**r + left**r) ** (2.0 / r) + turn**2


def limit(gait: Gait, request: Request) -> tuple[Array, Array, Array]:
    """Clip the request to the ellipsoid of feasible speeds; turn has priority."""
    xp = namespace_of(gait.max_forward, request.forward)
    scale = SPEED_FLOOR + (1 - SPEED_FLOOR) * xp.clip(request.speed, 0.0, 1.0)
    tops = (gait.max_forward * scale, gait.max_left * scale, gait.max_turn * scale)
    asked = (request.forward, request.left, request.turn)
    forward, left, turn = (xp.clip(a, -m, m) for a, m in zip(asked, tops))
    x, y, z = (xp.abs(a) / m for a, m in zip((forward, left, turn), tops))
    outside = _volume(x, y, z) > 1.0
    factor, low, high = 0.5 + 0.0 * x, 0.0 * x, 1.0 + 0.0 * x
    for _ in range(10):
        over = _volume(factor * x, factor * y, z) > 1.0
        low, high = xp.where(over, low, factor), xp.where(over, factor, high)
        factor = 0.5 * (low + high)
    factor = xp.where(outside, factor, 1.0)
    return forward * factor, left * factor, turn


def _ratchet(wanted: Array, before: Array, change: Array) -> Array:
    xp = namespace_of(wanted, before)
    difference = wanted - before
    return xp.where(
        xp.abs(difference) > change, before + xp.sign(difference) * change, wanted
    )


def plan(
    gait: Gait, constants: Constants, request: Request, before: tuple[Array, Array]
) -> Steps:
    """Turn a request into step sizes.

    Args:
        gait: the 15 parameters.
        constants: engine constants.
        request: what is asked.
        before: forward and left step size of the step before, m. The engine compares
            these lengths with speeds; that is its behaviour, kept as it is.
    """
    xp = namespace_of(gait.max_forward, request.forward)
    forward, left, turn = limit(gait, request)
    period = (
        gait.base_walk_period
        + constants.sidestep_extra_period * xp.abs(left) / gait.max_left
    )
    forward = _ratchet(forward, before[0], gait.forward_change)
    left = _ratchet(left, before[1], gait.left_change)
    turn = _ratchet(turn, request.turn, gait.turn_change)
    two = 2.0 * period
    return Steps(
        period=period,
        forward=forward * two * CALIBRATION[0],
        left=left * two * CALIBRATION[1],
        turn=-(turn * two * CALIBRATION[2]),
    )


def smooth(time: Array, period: Array, dead: float, dt: float) -> Array:
    """Constant acceleration then deceleration from 0 to 1; snaps half a tick early.

    `dead` is the share of the period without motion, half of it at each end.
    """
    xp = namespace_of(time, period)
    wait = 0.5 * period * dead
    u = (time - wait) / xp.maximum(period - 2.0 * wait, SLACK)
    curve = xp.where(
        time < 0.5 * period - SLACK, 2.0 * u**2, 4.0 * u - 2.0 * u**2 - 1.0
    )
    curve = xp.where(time > period - wait - 0.5 * dt + SLACK, 1.0, curve)
    return xp.where(time < wait + 0.5 * dt - SLACK, 0.0, curve)


def bump(fraction: Array) -> Array:
    """Up and down once over [0, 1] in four parabola pieces; 0 afterwards."""
    xp = namespace_of(fraction)
    rise = xp.where(
        fraction < 0.25, 8.0 * fraction**2, 1.0 - 8.0 * (0.5 - fraction) ** 2
    )
    fall = xp.where(
        fraction < 0.75, 1.0 - 8.0 * (fraction - 0.5) ** 2, 8.0 * (1.0 - fraction) ** 2
    )
    return xp.where(fraction > 1.0, 0.0, xp.where(fraction < 0.5, rise, fall))
