"""Effects on the torques of a joint: friction that is a law, weak motors, ripple.

Each acts on a `Drive` once per physics step: it may change what the servo is now (its
gain, its torque limits, the dry friction of its joint) and add a torque. What the servo
pulls with follows from `pull`; the physics holds or brakes a joint with its friction,
so that a joint which friction can hold stands still. Angle and speed are the motor's,
which are the joint's unless a gear lets them part. Parameters are [J] arrays.
"""

from __future__ import annotations

from typing import Any

from gatjax.effects.effect import Effect, memoryless
from gatjax.records import Drive
from gatjax.xp import namespace_of

Array = Any
LEAST = 0.05  # share of gain and limit that a weak motor keeps
LOCKED = 0.02  # least 1 - coefficient of a gear that can be driven from its link
WARM = 0.25  # share of the limit a motor bears for ever: Aldebaran's motor pages


def pull(drive: Drive) -> Array:
    """Torque of the servos now, [..., J] N m: kp error - kv velocity, in its limits.

    A drive that does not hold a position has its command instead of the error. The
    error is of the angle that the encoder sees; kv is by the motor's speed, here even
    where a gear has it by the link's (`kv_on_link`).
    """
    xp, servo = namespace_of(drive.seen, drive.target), drive.servo
    error = drive.target - servo.hold * drive.seen
    free = servo.gain * error - servo.damping * drive.turning
    return xp.minimum(xp.maximum(free, servo.low), servo.high)


def _rubbed(drive: Drive, torque: Array) -> Drive:
    """Add a dry friction torque, [..., J] N m."""
    servo = drive.servo._replace(friction=drive.servo.friction + torque)
    return drive._replace(servo=servo)


def _weakened(drive: Drive, share: Array) -> Drive:
    """Leave a share of the gain and of the limits, [..., J]."""
    servo = drive.servo
    return drive._replace(
        servo=servo._replace(
            gain=share * servo.gain, low=share * servo.low, high=share * servo.high
        )
    )


def stiffness() -> Effect:
    """Servos with the share of their gain that the log says; no params.

    The gain of the firmware, or the stiffness of a NAO. Without power (0) there is no
    back EMF either.
    """

    def change(params: Any, drive: Drive) -> Drive:
        servo, on = drive.servo, drive.stiffness > 0.0
        servo = servo._replace(
            gain=drive.stiffness * servo.gain, damping=on * servo.damping
        )
        return drive._replace(servo=servo)

    return memoryless(change)


def stiction() -> Effect:
    """Friction near standstill; params: excess N m (0 is neutral), velocity rad/s.

    Stribeck: friction grows by excess exp(-(v / velocity)^2). Of a link behind a gear
    v is its own.
    """

    def change(params: dict[str, Array], drive: Drive) -> Drive:
        xp = namespace_of(drive.velocity, params["excess"])
        own, link = (
            params["excess"] * xp.exp(-((speed / params["velocity"]) ** 2))
            for speed in (drive.turning, drive.velocity)
        )
        return _rubbed(drive._replace(apart=drive.apart + link - own), own)

    return memoryless(change)


def load_friction(period: float) -> Effect:
    """Friction per torque in a gear; params: coefficient (0 is neutral), of_link.

    of_link 0: the torque is the servo's. 1: what it hands on to the link, with ripple,
    after friction, damping and what turns the motor (speed-up in the last `period`, s):
    harder to drive from the link than from the motor, by (1 + coefficient) /
    (1 - coefficient), and self-locking from 1 on. Where a gear with play or a spring
    keeps motor and link apart, it is what that gear has handed on.
    """

    def apply(params: dict[str, Array], before: Array, drive: Drive) -> tuple:
        coefficient, servo = params["coefficient"], drive.servo
        xp = namespace_of(drive.velocity, coefficient)
        of_link = params["of_link"] > 0.5
        pulled, speed = pull(drive), drive.velocity
        turning = servo.rotor * (speed - before) / period
        given = pulled + drive.load + drive.lean - servo.viscous * speed - turning
        ahead, back = (
            _handed_on(coefficient, servo.friction, side * given)
            for side in (1.0, -1.0)
        )
        foreseen = of_link & (drive.geared < 0.5)
        known = xp.where(of_link, drive.handed, pulled)
        friction = xp.where(
            foreseen, 0.5 * (ahead + back), servo.friction + coefficient * xp.abs(known)
        )
        load = drive.load - xp.where(foreseen, 0.5 * (ahead - back), 0.0)
        rubbed = servo._replace(friction=friction)
        return speed, drive._replace(load=load, servo=rubbed)

    return Effect(lambda params, drive: drive.velocity, apply)


def _handed_on(coefficient: Array, dry: Array, given: Array) -> Array:
    """Friction f N m against a motion that torque `given` goes with.

    It solves f = dry + coefficient |given - f|.
    """
    xp = namespace_of(given, coefficient)
    driving = (dry + coefficient * given) / (1.0 + coefficient)
    driven = (dry - coefficient * given) / xp.maximum(1.0 - coefficient, LOCKED)
    return xp.where(given >= dry, driving, driven)


def one_way() -> Effect:
    """Friction in one direction; params: torque N m and viscous N m s/rad.

    The sign of each is the direction in which its size acts; 0 is neutral. Of the dry
    part, |torque| / 2 is friction of the model in both directions, and this a constant
    torque besides. Where torque is 0, viscous counts for nothing. Motor and link share
    it as they share friction.
    """

    def change(params: dict[str, Array], drive: Drive) -> Drive:
        torque, speed = params["torque"], drive.turning
        xp = namespace_of(speed, torque)
        damping = xp.where(torque == 0.0, 0.0, params["viscous"])
        damping = xp.maximum(xp.sign(speed) * damping, 0.0)
        return drive._replace(
            lean=drive.lean - 0.5 * torque - damping * speed,
            lean_apart=drive.lean_apart + damping * (speed - drive.velocity),
        )

    return memoryless(change)


def saturation() -> Effect:
    """Torque that falls short of the current; params: torque N m, inf is neutral.

    What arrives of a torque t is t / (1 + |t| / torque): half of it at `torque`.
    """

    def change(torque: Array, drive: Drive) -> Drive:
        servo, asked = drive.servo, pull(drive)
        share = 1.0 / (1.0 + namespace_of(asked).abs(asked) / torque)
        drive = _weakened(drive, share)
        damping = share * servo.damping
        return drive._replace(servo=drive.servo._replace(damping=damping))

    return memoryless(change)


def ripple() -> Effect:
    """Torque that goes with the angle; params: amplitude in N m, cycles, phase in rad.

    torque = amplitude sin(cycles angle + phase); amplitude 0 is neutral.
    """

    def change(params: dict[str, Array], drive: Drive) -> Drive:
        xp = namespace_of(drive.turned, params["amplitude"])
        wave = xp.sin(params["cycles"] * drive.turned + params["phase"])
        return drive._replace(load=drive.load + params["amplitude"] * wave)

    return memoryless(change)


def speed_line(period: float) -> Effect:
    """Torque-speed line of a motor; params: no-load speed in rad/s, inf is neutral.

    torque <= stall (1 - v / limit) forwards, and the same backwards; stall is the
    torque limit of the servo. The line is not steeper than what stops the joint in one
    step, or its motor where a gear lets them part, so that a light one does not chatter
    on it; that steep it is without a torque limit.
    """

    def change(limit: Array, drive: Drive) -> Drive:
        servo, velocity = drive.servo, drive.turning
        xp = namespace_of(velocity, limit)
        most = (servo.rotor + (1.0 - drive.geared) * servo.link) / period

        def braked(stall: Array, speed: Array) -> Array:
            stall = xp.where(xp.isfinite(stall), stall, most * limit)
            slope = xp.where(xp.isfinite(limit), xp.minimum(stall / limit, most), 0.0)
            return xp.clip(stall - slope * speed, -stall, stall)

        return drive._replace(
            servo=servo._replace(
                high=braked(servo.high, velocity), low=-braked(-servo.low, -velocity)
            )
        )

    return memoryless(change)


def current_limit() -> Effect:
    """Limit of a motor's current; params: its torque in N m, inf is neutral.

    The current drives the motor against its back EMF, which is the damping of the joint
    in the model: |servo torque - damping velocity| <= limit. So a joint that its load
    pushes back brakes with no more than this, while a torque limit alone lets back EMF
    add to it. At speeds whose back EMF is beyond both limits the torque limit holds.
    """

    def change(limit: Array, drive: Drive) -> Drive:
        servo, driven = drive.servo, drive.servo.viscous * drive.turning
        xp = namespace_of(driven, limit)
        high = xp.clip(limit + driven, servo.low, servo.high)
        low = xp.clip(-limit + driven, servo.low, servo.high)
        return drive._replace(servo=servo._replace(low=low, high=high))

    return memoryless(change)


def thermal(period: float) -> Effect:
    """Warm motors lose gain and limit; params: lost_fraction, cooling (s), heat.

    d(warmth)/dt = torque^2 - warmth / cooling, the torque that of the step before; a
    share lost_fraction warmth / heat of gain and torque limits is lost, 95 % at most.
    `heat` in N^2 m^2 s is the warmth at which lost_fraction is lost; NaN means that of
    a motor which has run at a quarter of its rated limit for ever. Motors are cold at
    the start. lost_fraction 0 is neutral.
    """

    def init(params: dict[str, Array], drive: Drive) -> Array:
        return 0.0 * drive.velocity

    def apply(
        params: dict[str, Array], warmth: Array, drive: Drive
    ) -> tuple[Array, Drive]:
        xp = namespace_of(drive.velocity, params["lost_fraction"])
        heat, limit = params["heat"], WARM * drive.rated
        usual = xp.where(xp.isfinite(limit), limit**2 * params["cooling"], 1.0)
        heat = xp.where(xp.isnan(heat), usual, heat)
        warmth = warmth + period * (drive.torque**2 - warmth / params["cooling"])
        share = 1.0 - params["lost_fraction"] * warmth / heat
        return warmth, _weakened(drive, xp.maximum(share, LEAST))

    return Effect(init, apply)


def supply() -> Effect:
    """All motors sag while many pull; params: max_drop (0 is neutral), total (N m).

    A share max_drop min(1, sum |torque| / total) of gain and limits is lost, with the
    torques of the step before. NaN as total means half the sum of all rated limits.
    """

    def change(params: dict[str, Array], drive: Drive) -> Drive:
        xp = namespace_of(drive.velocity, params["max_drop"])
        drawn = xp.abs(drive.torque).sum(-1, keepdims=True)
        usual = 0.5 * drive.rated.sum(-1, keepdims=True)
        total = xp.where(xp.isnan(params["total"]), usual, params["total"])
        loaded = xp.minimum(1.0, drawn / total)
        return _weakened(drive, 1.0 - params["max_drop"] * loaded)

    return memoryless(change)
