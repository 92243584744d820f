"""A gear between motor and link: two inertias with a gap and a spring between them.

The motor is integrated here, the link in the physics engine. Over a step, the torque of
the gear is linear in the speed v' that the link will have: T = push - drag v'. The
engine gets that as a torque on the joint and as an armature drag h, so that teeth which
touch make one body of motor and link, however heavy a contact makes the link.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np

from gatjax.effects.effect import Effect
from gatjax.records import Drive, Servo
from gatjax.xp import namespace_of

Array = Any
GIVE = 0.003  # rad, that teeth in contact give way at the torque limit
HARD = 50.0  # reduced inertias per squared step: teeth of a motor without a limit


class Gear(NamedTuple):
    """Parameters; [..., J]. Width 0 and stiffness inf are neutral: no gear at all."""

    width: Array  # rad, total play
    stiffness: Array  # N m/rad
    damping_ratio: Array  # of the spring, or of the teeth, against the two inertias
    link_share: Array  # share of damping and dry friction that is behind the gear
    armature_share: Array  # share of the armature that is behind the gear
    encoder_on_motor: Array  # 1: servo and log see the motor's angle; 0: the link's
    kv_on_link: Array  # share of kv that goes by the link's speed, not the motor's


class Motion(NamedTuple):
    """State; [..., J]: motor and link when a step began, and how the motor goes on."""

    twist: Array  # rad, angle of the motor less that of the link
    angle: Array  # rad, of the link
    own: Array  # rad/s, speed of the motor after the step if the link stands still
    taken: Array  # share of the link's speed that it has beside that
    period: Array  # s, of the step; 0 at the start
    pull: Array  # N m, torque of the servo
    handed: Array  # N m, torque on the link


class Side(NamedTuple):
    """The motor, [..., J]: resist w' = push - gear's torque - slowed v' of the link."""

    push: Array  # N m
    resist: Array  # N m s/rad, inertia over the step included
    slowed: Array  # N m s/rad, kv by the speed of the link
    pull: Array  # N m, torque of the servo


def absent(joints: int) -> Gear:
    """Return the parameters of joints without a gear."""
    none = np.zeros(joints)
    return Gear(none, none + np.inf, none + 0.05, none + 0.1, none, none, none)


def changed(
    gear: Gear, here: Array, params: dict[str, Array], given: Collection[str]
) -> Gear:
    """Set parameters at the joints `here` [J] bool; those not `given` are defaults.

    Defaults are for joints without a gear: one that is there has its own.
    """
    kept, bare = gear._asdict(), here & ~present(gear)
    return gear._replace(**{
        key: np.where(here if key in given else bare, new, kept[key])
        for key, new in params.items()
    })  # fmt: skip


def present(gear: Gear) -> Array:
    """Which joints have a gear, [..., J] bool."""
    xp = namespace_of(gear.width, gear.stiffness)
    return (gear.width > 0.0) | xp.isfinite(gear.stiffness)


def encoder(gear: Gear, motion: Motion, angle: Array) -> Array:
    """Return what the encoders see of joints that moved to `angle` [..., J], rad."""
    xp = namespace_of(angle, motion.twist)
    motor = present(gear) & (gear.encoder_on_motor > 0.5)
    return xp.where(motor, angle + _twist(motion, angle), angle)


def motor(motion: Motion, angle: Array, velocity: Array) -> tuple[Array, Array]:
    """Angle rad and speed rad/s of the motors of joints at `angle`, `velocity`."""
    return angle + _twist(motion, angle), motion.own + motion.taken * velocity


def _twist(motion: Motion, angle: Array) -> Array:
    """Angle of the motor less that of a link which moved to `angle`, rad."""
    turned = motion.period * motion.own
    return motion.twist + turned + (motion.taken - 1.0) * (angle - motion.angle)


def transmission(period: float) -> Effect:
    """Drive the joints through a gear; params: a `Gear`, signal: a `Drive`.

    On the motor: the servo, ripple and the like, and the rotor's friction, which holds
    it still if it can. Between: stiffness times what the twist is beyond the gap, and
    damping, never pulling across a gap. All of it is implicit in both speeds; whether
    teeth touch, friction holds or the servo is at its limit is foreseen with the speed
    that the link has. `servo.rotor` and `load` become what the joint gets of it.
    """

    def init(gear: Gear, drive: Drive) -> Motion:
        none = 0.0 * drive.angle
        return Motion(
            twist=none, angle=drive.angle + none, own=none, taken=none + 1.0,
            period=none, pull=drive.torque + none, handed=none,
        )  # fmt: skip

    def apply(gear: Gear, state: Motion, drive: Drive) -> tuple[Motion, Drive]:
        xp = namespace_of(drive.angle, gear.width, drive.target)
        servo, on = drive.servo, present(gear)
        twist = _twist(state, drive.angle)
        side = _motor(xp, gear, drive, period)
        hard, grip = _touched(xp, gear, drive, twist, side, period)
        free = side.push - hard + (grip - side.slowed) * drive.velocity
        rub = (1.0 - gear.link_share) * servo.friction
        held, whole = xp.abs(free) <= rub, side.resist + grip
        own = (side.push - hard - xp.clip(free, -rub, rub)) / whole
        own = xp.where(held, 0.0, own)
        taken = xp.where(held, 0.0, (grip - side.slowed) / whole)
        drag = grip * (1.0 - taken)
        handed = hard + grip * own - drag * drive.velocity
        state = Motion(
            twist=xp.where(on, twist, 0.0), angle=drive.angle,
            own=xp.where(on, own, 0.0), taken=xp.where(on, taken, 1.0),
            period=period + 0.0 * twist, pull=side.pull,
            handed=xp.where(on, handed, 0.0),
        )  # fmt: skip
        lean = drive.lean + drive.lean_apart
        behind = gear.link_share * (servo.friction + drive.apart)
        friction = xp.where(on, behind, servo.friction)
        behind = gear.armature_share / (1.0 - gear.armature_share) * servo.rotor
        rotor = xp.where(on, behind + period * drag, servo.rotor)
        return state, drive._replace(
            servo=servo._replace(friction=friction, rotor=rotor),
            load=xp.where(on, handed + gear.link_share * lean, drive.load),
            lean=xp.where(on, 0.0, drive.lean),
        )

    return Effect(init, apply)


def _motor(xp: Any, gear: Gear, drive: Drive, period: float) -> Side:
    """Return the motor without the gear.

    Its servo sees the angle of motor or link; kv is the motor's own, as back EMF is,
    or goes by the link's speed, as where an encoder there tells it.
    """
    servo, speed = drive.servo, drive.turning
    error = drive.target - servo.hold * drive.seen
    linked = gear.kv_on_link * servo.damping
    own = servo.damping - linked
    asked = servo.gain * error - own * speed - linked * drive.velocity
    pull = xp.clip(asked, servo.low, servo.high)
    able = pull == asked
    viscous = (1.0 - gear.link_share) * servo.viscous
    return Side(
        push=servo.rotor / period * speed + drive.load
        + (1.0 - gear.link_share) * drive.lean
        + xp.where(able, servo.gain * error, pull),
        resist=servo.rotor / period + viscous + xp.where(able, own, 0.0),
        slowed=xp.where(able, linked, 0.0), pull=pull,
    )  # fmt: skip


def _touched(
    xp: Any, gear: Gear, drive: Drive, twist: Array, side: Side, period: float
) -> tuple[Array, Array]:
    """Torque of the gear if neither side moves, N m, and per slip, N m s/rad.

    Both are 0 where the motor goes through the gap.
    """
    stiffness, damping = _contact(xp, gear, drive.servo, period)
    rub = (1.0 - gear.link_share) * drive.servo.friction

    def slip(push: Array, resist: Array) -> Array:
        left = push - xp.clip(push, -rub, rub)
        return left / resist - drive.velocity

    pushed = side.push - side.slowed * drive.velocity
    ahead = twist + period * slip(pushed, side.resist)
    edge = 0.5 * gear.width * xp.sign(ahead)
    grip = xp.maximum(stiffness * period, damping)  # an implicit spring damps, too
    hard = stiffness * (twist - edge)
    push = pushed - hard + grip * drive.velocity
    torque = hard + grip * slip(push, side.resist + grip)
    touching = (torque * edge > 0.0) & (xp.abs(ahead) > 0.5 * gear.width)
    touching = touching | (gear.width <= 0.0)
    return xp.where(touching, hard, 0.0), xp.where(touching, grip, 0.0)


def _contact(xp: Any, gear: Gear, servo: Servo, period: float) -> tuple[Array, Array]:
    """Stiffness N m/rad and damping N m s/rad of the gear where it transmits."""
    reduced = servo.rotor * servo.link / (servo.rotor + servo.link)
    teeth = xp.where(
        xp.isfinite(servo.high), servo.high / GIVE, HARD * reduced / period**2
    )
    spring = xp.isfinite(gear.stiffness)
    stiffness = xp.where(spring, gear.stiffness, teeth)
    return stiffness, 2.0 * gear.damping_ratio * xp.sqrt(stiffness * reduced)
