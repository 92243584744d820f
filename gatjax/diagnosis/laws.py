"""The laws of one servo joint, each switched off by a neutral number. Units are SI."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp

Array = Any
PI_HIGH, PI_LOW = 3.140625, 9.67653589793e-4  # the first part has few digits


class Drive(NamedTuple):
    """Numbers of one simulated joint; arrays [S] when many are simulated."""

    kp: Array
    hold: Array  # 1: a position servo, 0: it is told a torque or a voltage
    kv: Array
    limit: Array
    damping: Array
    friction: Array
    armature: Array
    delay: Array  # s, of the target
    late: Array  # s, of the reading
    drift: Array  # s/s, of the reading
    lag: Array  # s
    quantum: Array  # rad, of the target; 0: none
    dead: Array  # rad, half width
    rate: Array  # rad/s, of the target
    speed: Array  # rad/s, at which the torque-speed line reaches zero
    stiction: Array  # N m
    creep: Array  # rad/s, speed at which stiction has faded
    give: Array  # rad, that dry friction yields before it slips
    loaded: Array  # friction per transmitted torque
    of_link: Array  # 0: that is the servo's torque, 1: what reaches the link
    asymmetric: Array  # N m, positive: when moving in the positive direction
    lean: Array  # N m, constant torque that a gear shares as it shares friction
    one_sided: Array  # N m s/rad, of damping, the same way
    ripple: Array  # N m
    ripple_phase: Array  # rad
    cycles: Array  # 1/rad
    zero_in: Array  # rad, encoder offset that the servo sees too
    zero_out: Array  # rad, encoder offset in the log only
    scale: Array  # of the reading
    heat: Array  # lost share per heat
    cooling: Array  # s
    sag: Array  # lost share when the supply is loaded most
    soft: Array  # 1/(N m): a torque falls short by that share of itself
    width: Array  # rad, play (geared plant only)
    stiffness: Array  # N m/rad (geared plant only)
    ratio: Array  # of damping, of that spring and of teeth (geared plant only)
    sensed: Array  # 1: encoder on the motor, 0: on the link (geared plant only)
    link_share: Array  # of damping and dry friction, behind the gear (geared only)
    behind: Array  # share of the armature that is behind the gear (geared only)
    linked: Array  # share of kv that goes by the speed of the link (geared only)
    pull: Array  # 1/s, towards the measured angle
    steer: Array  # 1/s^2, the same of the speed
    drag: Array  # N m s^2/rad^2
    spring: Array  # N m/rad
    bias: Array  # N m
    wave: Array  # N m
    wave_phase: Array  # rad
    frequency: Array  # rad/s
    integral: Array  # 1/s
    skew: Array  # kp is larger by that share for positive errors, smaller for others
    terms: Array  # [S, B] of the load


class Grid(NamedTuple):
    """Series of one joint on the grid: [K, R] each, terms [K, R, B].

    Once weighed, rest, slope and inertia are those of each simulation, [K, R, S].
    """

    target: Array
    path: Array  # of the link, along which its load was weighed
    reading: Array  # what its encoder read there
    rest: Array
    pull: Array  # of gravity, a part of rest
    slope: Array
    inertia: Array  # of the link, armature excluded
    rest_terms: Array
    slope_terms: Array
    inertia_terms: Array
    stiffness: Array  # share of the servo's gain that the log tells, 0: no power
    supply: Array  # load of the supply, 1 at its largest
    clock: Array  # s since the start of the run
    running: Array  # 1 until the run ends, 0 after


class Servo(NamedTuple):
    """What the servo remembers, each [R, S]."""

    lagged: Array
    held: Array
    heat: Array
    integral: Array


class Push(NamedTuple):
    """Servo torque = push - kv speed, within limits."""

    push: Array
    kv: Array
    low: Array
    high: Array


def weighed(p: Drive, g: Grid) -> Grid:
    """The series with all terms of the load added up, for each of S simulations."""
    inertia = g.inertia[..., None] + g.inertia_terms @ p.terms.T
    rest = g.rest[..., None] + g.rest_terms @ p.terms.T
    slope = g.slope[..., None] + g.slope_terms @ p.terms.T
    done = jnp.zeros((len(g.rest), 0))
    return g._replace(
        inertia=jnp.maximum(inertia, 1e-6), rest=rest, slope=slope,
        inertia_terms=done, rest_terms=done, slope_terms=done,
    )  # fmt: skip


def servo(
    p: Drive, g: Grid, u: Array, s: Servo, seen: Array, speed: Array, h: float
) -> tuple[Servo, Push]:
    """One step of the servo: what it follows, and how it pushes.

    Args:
        p: numbers.
        g: series at this step.
        u: delayed command, rad; of a drive that is told its torque, N m per kp.
        s: memory.
        seen: angle that the servo sees, rad.
        speed: of the motor, rad/s.
        h: step, s.
    """
    safe = jnp.where(p.quantum > 0.0, p.quantum, 1.0)
    u = jnp.where(p.quantum > 0.0, jnp.round(u / safe) * safe, u)
    share = 1.0 - jnp.exp(-h / jnp.maximum(p.lag, 1e-6))
    lagged = s.lagged + (u - s.lagged) * share
    held = s.held + jnp.clip(lagged - s.held, -p.rate * h, p.rate * h)
    error = held - p.hold * seen
    error = jnp.sign(error) * jnp.maximum(jnp.abs(error) - p.dead, 0.0)
    integral = s.integral + h * p.integral * error
    left = jnp.clip(1.0 - p.heat * s.heat, 0.05, 1.0)
    left *= jnp.clip(1.0 - p.sag * g.supply[:, None], 0.05, 1.0)
    stiffness = g.stiffness[:, None]
    most = p.limit * left * (stiffness > 0.0)  # without power no back EMF either
    driven = error + p.skew * jnp.abs(error) + integral
    gain = p.kp * stiffness * left * driven
    low = -most * jnp.clip(1.0 + speed / p.speed, -1.0, 1.0)
    high = most * jnp.clip(1.0 - speed / p.speed, -1.0, 1.0)
    got = 1.0 / (1.0 + p.soft * jnp.abs(jnp.clip(gain - p.kv * speed, low, high)))
    push = Push(got * gain, got * p.kv, got * low, got * high)
    return Servo(lagged, held, s.heat, integral), push


def warmed(p: Drive, g: Grid, s: Servo, torque: Array, h: float) -> Servo:
    """Heat of a motor: grows with torque squared, cools exponentially."""
    grown = jnp.square(torque / p.limit) - s.heat / p.cooling
    return s._replace(heat=s.heat + h * g.running[:, None] * grown)


def dry_friction(p: Drive, speed: Array, heading: Array, carried: Array) -> Array:
    """Largest dry friction torque at a speed: Coulomb, Stribeck, load, direction.

    `heading` has the sign of where a joint moves, or would if it did not stick.
    """
    fade = jnp.exp(-jnp.square(speed / p.creep))
    level = p.friction + p.stiction * fade + p.loaded * jnp.abs(carried)
    side = jnp.where(heading > 0.0, p.asymmetric, -p.asymmetric)
    return level + jnp.maximum(side, 0.0)


def damped(p: Drive, speed: Array) -> Drive:
    """Numbers with the damping that a joint has in the direction of its speed."""
    return p._replace(
        damping=p.damping + jnp.maximum(jnp.sign(speed) * p.one_sided, 0.0)
    )


def rubbing(p: Drive, share: Array) -> Drive:
    """Numbers with a share only of the damping and of all dry friction."""
    return p._replace(
        damping=share * p.damping, friction=share * p.friction,
        stiction=share * p.stiction, loaded=share * p.loaded,
        asymmetric=share * p.asymmetric,
    )  # fmt: skip


def sine(x: Array) -> Array:
    """Sine, within 1e-5 up to 2000 rad; XLA's own on CPUs takes one lane at a time.

    Reduced to a half turn in two steps (Cody & Waite 1980), then Taylor's series.
    """
    turns = jnp.round(x / jnp.pi)
    rest = x - turns * PI_HIGH - turns * PI_LOW
    odd = turns - 2.0 * jnp.floor(0.5 * turns)
    square = rest * rest
    series = 1.0 / 120.0 + square * (-1.0 / 5040.0 + square / 362880.0)
    value = rest + rest * square * (-1.0 / 6.0 + square * series)
    return jnp.where(odd > 0.5, -value, value)


def ripple(p: Drive, angle: Array) -> Array:
    """Torque that repeats with the angle."""
    return p.ripple * sine(p.cycles * angle + p.ripple_phase)


def link(p: Drive, g: Grid, q: Array, v: Array) -> tuple[Array, Array]:
    """Inertia of the link and the torque on it [R, S], from a weighed grid.

    Away from its path the pull of gravity turns with the link.
    """
    off = q - g.path[:, None]
    lost = 2.0 * jnp.square(sine(0.5 * off))  # 1 - cos
    load = g.rest - g.pull[:, None] * lost + g.slope * sine(off)
    outside = p.wave * sine(p.frequency * g.clock[:, None] + p.wave_phase)
    outside += p.bias - p.spring * q - p.drag * jnp.abs(v) * v
    return g.inertia, outside - load
