"""One joint, simulated alone with every cause of the catalogue as a number.

A neutral number switches a law off, so one compilation serves all hypotheses. Both
plants are integrated by leapfrog (Hairer, Lubich, Wanner 2003: speeds live between the
steps, second order), with damping, gear and dry friction solved implicitly.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp

from gatjax.diagnosis import laws
from gatjax.diagnosis.laws import Drive, Grid, Servo
from gatjax.sim.derived import LIGHT

Array = Any


class Rigid(NamedTuple):
    """A joint whose gear does not give, each [R, S]."""

    q: Array
    v: Array
    carried: Array  # torque that load friction goes by, N m
    bristle: Array  # rad, what dry friction has yielded
    servo: Servo

    def seen(self, p: Drive) -> Array:
        """Angle at the encoder, rad."""
        return self.q


class Geared(NamedTuple):
    """A joint whose motor and link are two inertias, each [R, S]."""

    q: Array  # link
    v: Array
    turned: Array  # motor
    turning: Array
    carried: Array
    bristle: Array  # of the motor
    link_bristle: Array
    servo: Servo

    def seen(self, p: Drive) -> Array:
        """Angle at the encoder, on the motor or on the link, rad."""
        return p.sensed * self.turned + (1.0 - p.sensed) * self.q


def _beyond(twist: Array, half: Array) -> Array:
    return jnp.sign(twist) * jnp.maximum(jnp.abs(twist) - half, 0.0)


def rubbed(
    p: Drive, free: Array, solid: Array, old: tuple[Array, Array, Array], h: float
) -> tuple[Array, Array]:
    """Speed and bristle after dry friction: an elastic, perfectly plastic element.

    It yields like a spring up to `give`, then slips at the friction level (Prandtl
    1928); solved implicitly, so that it neither creeps nor chatters. `free` is the
    speed without friction, `old` as in `driven`.
    """
    speed, carried, bristle = old
    level = laws.dry_friction(p, speed, free, carried)
    stiff = h * level / p.give
    stuck = (solid * free - stiff * bristle) / (solid + h * stiff)
    moved = bristle + h * stuck
    slips = jnp.abs(moved) > p.give
    slid = free - jnp.sign(moved) * h * level / solid
    return (
        jnp.where(slips, slid, stuck),
        jnp.where(slips, jnp.sign(moved) * p.give, moved),
    )


def driven(
    p: Drive, push: laws.Push, old: tuple[Array, Array, Array], mass: Array,
    bound_mass: Array | float, aside: Array, h: float,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Speed, bristle and servo torque of a motor after a step.

    Args:
        p: numbers.
        push: of the servo.
        old: speed rad/s, torque through the gear N m and bristle rad before the step.
        mass: inertia that moves with the motor, kg m^2.
        bound_mass: what a gear adds to it within the step, kg m^2.
        aside: impulse of everything but servo, damping and dry friction, N m s.
        h: step, s.
    """
    speed = old[0]

    def freely(resist: Array, force: Array) -> tuple[Array, Array]:
        solid = mass + bound_mass + 0.5 * h * resist
        given = (mass - 0.5 * h * resist) * speed + aside + h * force
        return given / solid, solid

    free, _ = freely(push.kv + p.damping, push.push)
    asked = push.push - 0.5 * push.kv * (speed + free)
    bound = jnp.clip(asked, push.low, push.high)
    inside = bound == asked
    resist = p.damping + jnp.where(inside, push.kv, 0.0)
    free, solid = freely(resist, jnp.where(inside, push.push, bound))
    new, bristle = rubbed(p, free, solid, old, h)
    done = jnp.where(inside, push.push - 0.5 * push.kv * (speed + new), bound)
    return new, bristle, done


def rigid_step(p: Drive, g: Grid, u: Array, aim: Array, s: Rigid, h: float) -> Rigid:
    """One step of a joint with a rigid gear: told u, drawn to the angle `aim`."""
    p = laws.damped(p, s.v)
    memory, push = laws.servo(p, g, u, s.servo, s.q + p.zero_in, s.v, h)
    inertia, torque = laws.link(p, g, s.q, s.v)
    aside = h * (torque + p.lean + laws.ripple(p, s.q))
    old = s.v, s.carried, s.bristle
    v, bristle, done = driven(p, push, old, inertia + p.armature, 0.0, aside, h)
    through = inertia * (v - s.v) / h - torque
    carried = through + (1.0 - p.of_link) * (done - through)
    off = aim - s.q
    q = s.q + h * (v + p.pull * off)
    v = v + h * p.steer * off
    return Rigid(q, v, carried, bristle, laws.warmed(p, g, memory, done, h))


def geared_step(p: Drive, g: Grid, u: Array, aim: Array, s: Geared, h: float) -> Geared:
    """One step of motor, gap with spring, and link; teeth push, they never pull.

    The spring is implicit only where it swings too fast for the step: what that takes
    of the motion counts as damping, else teeth bounce less than they are told to.
    """
    p = laws.damped(p, s.turning)
    near, far = laws.rubbing(p, 1.0 - p.link_share), laws.rubbing(p, p.link_share)
    seen = s.seen(p) + p.zero_in
    memory, push = laws.servo(p, g, u, s.servo, seen, s.turning, h)
    inertia, torque = laws.link(p, g, s.q, s.v)
    rotor = (1.0 - p.behind) * p.armature
    rotor = jnp.where(rotor > 0.0, rotor, LIGHT * inertia)
    inertia = inertia + p.behind * p.armature
    beyond = _beyond(s.turned - s.q, 0.5 * p.width)
    reduced = rotor * inertia / (rotor + inertia)
    loss = 2.0 * p.ratio * jnp.sqrt(p.stiffness * reduced)
    pushes = (p.stiffness * beyond + loss * (s.turning - s.v)) * beyond > 0.0
    beyond = jnp.where(pushes | (p.width == 0.0), beyond, 0.0)
    swift = jnp.clip(h * jnp.sqrt(p.stiffness / reduced) - 1.0, 0.0, 1.0)
    grip = jnp.maximum(swift * h * p.stiffness, loss)
    tie = jnp.where(beyond != 0.0, h * grip, 0.0)
    spring = h * p.stiffness * beyond
    low = inertia + tie + h * far.damping
    onto = inertia * s.v + spring + h * (torque + p.link_share * p.lean)
    own = laws.ripple(p, s.turned) + (1.0 - p.link_share) * p.lean
    aside = -spring + tie * onto / low + h * own
    push = _by_link(p, push, s.v + (onto - tie * s.turning) / low, tie / low)
    old = s.turning, s.carried, s.bristle
    bare = tie - tie * tie / low
    turning, bristle, done = driven(near, push, old, rotor, bare, aside, h)
    free = (onto + tie * turning) / low
    v, link_bristle = rubbed(far, free, low, (s.v, s.carried, s.link_bristle), h)
    through = (spring + tie * (turning - v)) / h
    carried = through + (1.0 - p.of_link) * (done - through)
    memory = laws.warmed(p, g, memory, done, h)
    drawn = _drawn(p, aim - s.seen(p), (beyond != 0.0) | (p.width == 0.0))
    turned, q = (
        at + h * (speed + p.pull * off)
        for at, speed, off in zip((s.turned, s.q), (turning, v), drawn, strict=True)
    )
    turning, v = (
        speed + h * p.steer * off
        for speed, off in zip((turning, v), drawn, strict=True)
    )
    return Geared(q, v, turned, turning, carried, bristle, link_bristle, memory)


def _by_link(p: Drive, push: laws.Push, met: Array, share: Array) -> laws.Push:
    """The servo, some of whose kv goes by the speed that the link will have.

    Twice the link's mean speed over a step is `met` and that `share` of the motor's.
    """
    linked = p.linked * push.kv
    return push._replace(
        push=push.push - 0.5 * linked * met, kv=push.kv - linked + share * linked
    )


def _drawn(p: Drive, off: Array, touching: Array) -> tuple[Array, Array]:
    """How far motor and link are drawn: what no encoder sees, only in touch, rad.

    In flight they part: what moves one of them says nothing of the other.
    """
    felt = jnp.where(touching, 1.0, 0.0)
    return jnp.maximum(felt, p.sensed) * off, jnp.maximum(felt, 1.0 - p.sensed) * off


def advanced(p: Drive, g: Grid, u: Array, aim: Array, s: Any, h: float) -> Any:
    """One step of either kind of joint."""
    step: Any = geared_step if isinstance(s, Geared) else rigid_step
    return step(p, g, u, aim, s, h)


def begun(kind: type, p: Drive, told: Array, aim: Array) -> Any:
    """A joint of a kind at rest, at its first command; if that is none, at an angle."""
    zero = 0.0 * told
    first = jnp.where(p.hold > 0.0, told, aim)
    memory = Servo(told, told, zero, zero)
    if kind is Geared:
        return Geared(first, zero, first, zero, zero, zero, zero, memory)
    return Rigid(first, zero, zero, zero, memory)


def place(p: Drive, time: Array, lead: Array, h: float) -> Array:
    """Row of a simulation's angles at which a stamp was read."""
    return (time * (1.0 - p.drift) - p.late) / h + (lead - 1.0)


def later(p: Drive, clock: Array, h: float) -> Array:
    """Steps until an angle of now is read."""
    return (p.late + p.drift * clock) / (1.0 - p.drift) / h


def encoded(p: Drive, angle: Array) -> Array:
    """What an encoder reads at an angle, with its errors."""
    return (angle + p.zero_in + p.zero_out) * p.scale


def decoded(p: Drive, reading: Array) -> Array:
    """The angle at which an encoder reads that."""
    return reading / p.scale - p.zero_in - p.zero_out


class Outcome(NamedTuple):
    """Of S simulations: readings [R, N, S], angle of the link [K, R, S] rad, heat."""

    readings: Array
    angle: Array
    heat: Array  # [R, S] at the end
