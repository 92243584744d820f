"""Inverse kinematics of the NAO legs, both at once on the last axis (left, right).

The right leg is computed as a mirrored left leg. Source: Walk2014 (rUNSWift 2014
release, Walk2014Generator and body.hpp), re-derived; see the design notes of gatjax.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Tuple

from gatjax.xp import namespace_of

Array = Any
Vector = Tuple[Any, Any, Any]

THIGH = 0.100  # m, robotDimensions of B-Human, NAO v5 URDF
TIBIA = 0.1029  # m
ANKLE_HEIGHT = 0.04519  # m, ankle over sole
DAMPING = 0.16  # mm^2, damped least squares of the hip-yaw-pitch correction
MILLI = 1000.0  # the correction works in mm, like its damping


class Legs(NamedTuple):
    """Joint angles of both legs; axis [..., 2] is left, right; NAO signs."""

    hip_roll: Array  # [..., 2] rad
    hip_pitch: Array  # [..., 2] rad
    knee_pitch: Array  # [..., 2] rad
    ankle_pitch: Array  # [..., 2] rad
    ankle_roll: Array  # [..., 2] rad


def _rotate_x(angle: Array, v: Vector) -> Vector:
    xp = namespace_of(angle)
    c, s = xp.cos(angle), xp.sin(angle)
    return v[0], c * v[1] - s * v[2], s * v[1] + c * v[2]


def _rotate_y(angle: Array, v: Vector) -> Vector:
    xp = namespace_of(angle)
    c, s = xp.cos(angle), xp.sin(angle)
    return c * v[0] + s * v[2], v[1], c * v[2] - s * v[0]


def _yaw_pitch(angle: Array, v: Vector) -> Vector:
    """Rotate about the hip-yaw-pitch axis (0, 1, -1)/sqrt(2) of the left leg."""
    xp = namespace_of(angle)
    c, s = xp.cos(angle), xp.sin(angle)
    root = 0.5**0.5
    along = root * (v[1] - v[2]) * (1.0 - c) * root
    cross = (root * (v[2] + v[1]), -root * v[0], -root * v[0])
    return (
        c * v[0] + s * cross[0],
        c * v[1] + s * cross[1] + along,
        c * v[2] + s * cross[2] - along,
    )


def _thigh_frame(legs: Legs, v: Vector) -> Vector:
    """Add thigh and tibia to a foot-fixed vector given in the tibia frame, mm."""
    below = (v[0], v[1], v[2] - TIBIA * MILLI)
    x, y, z = _rotate_y(legs.knee_pitch, below)
    return _rotate_y(legs.hip_pitch, (x, y, z - THIGH * MILLI))


def foot_point(yaw_pitch: Array, legs: Legs, v: Vector) -> Vector:
    """Position of a foot-fixed point relative to the hip; mm, `v` in ankle frame."""
    ankle = _rotate_y(legs.ankle_pitch, _rotate_x(legs.ankle_roll, v))
    hip = _rotate_x(legs.hip_roll, _thigh_frame(legs, ankle))
    return _yaw_pitch(yaw_pitch, hip)


def _closed_form(hip: Array, lift: Array, forward: Array, sideways: Array) -> Legs:
    xp = namespace_of(hip, forward)
    height = (hip - lift - ANKLE_HEIGHT) / xp.cos(sideways)
    length = xp.sqrt(height**2 + forward**2)

    def corner(near: float, far: float) -> Array:
        cosine = (near**2 + length**2 - far**2) / (2.0 * near * length)
        return xp.arccos(xp.clip(cosine, -1.0, 1.0))

    thigh, tibia = corner(THIGH, TIBIA), corner(TIBIA, THIGH)
    lean = xp.arctan2(forward, height)
    return Legs(-sideways, lean - thigh, thigh + tibia, -(tibia + lean), sideways)


def _hip_step(yaw_pitch: Array, legs: Legs, target: Vector) -> tuple[Legs, Array]:
    """Take one damped least-squares step of hip pitch and roll; return the old z."""
    zero = 0.0 * legs.hip_roll
    w = _thigh_frame(legs, (zero, zero, zero))
    u = _rotate_x(legs.hip_roll, w)
    at = _yaw_pitch(yaw_pitch, u)
    a = _yaw_pitch(yaw_pitch, _rotate_x(legs.hip_roll, (w[2], zero, -w[0])))
    b = _yaw_pitch(yaw_pitch, (zero, -u[2], u[1]))
    error = tuple(t - p for t, p in zip(target, at))

    def dot(p: Any, q: Any) -> Array:
        return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]

    aa, bb, ab = dot(a, a) + DAMPING, dot(b, b) + DAMPING, dot(a, b)
    ea, eb = dot(a, error), dot(b, error)
    determinant = aa * bb - ab * ab
    legs = legs._replace(
        hip_pitch=legs.hip_pitch + (bb * ea - ab * eb) / determinant,
        hip_roll=legs.hip_roll + (aa * eb - ab * ea) / determinant,
    )
    return legs, at[2]


def solve(
    hip: Array, lift: Array, forward: Array, sideways: Array, yaw_pitch: Array
) -> Legs:
    """Joint angles that put both feet where asked, soles level.

    Args:
        hip: [..., 1] m, hip height over ground.
        lift: [..., 2] m, foot lift.
        forward: [..., 2] m, positive puts the foot behind the hip.
        sideways: [..., 2] rad, positive moves the foot to the robot's right.
        yaw_pitch: [..., 1] rad, the one hip-yaw-pitch motor.

    A point out of reach yields the straight leg.
    """
    xp = namespace_of(hip, forward)
    mirror = xp.asarray([1.0, -1.0], dtype=sideways.dtype)
    mirror = xp.broadcast_to(mirror, sideways.shape)
    legs = _closed_form(hip + 0.0 * lift, lift, forward, mirror * sideways)
    yaw_pitch = yaw_pitch + 0.0 * lift
    zero, one = 0.0 * lift, 0.0 * lift + 1.0
    target = foot_point(zero, legs, (zero, zero, zero))
    z = target[2]
    for _ in range(3):
        legs, z = _hip_step(yaw_pitch, legs, target)
    toe = foot_point(yaw_pitch, legs, (one, zero, zero))
    side = foot_point(yaw_pitch, legs, (zero, one, zero))
    ankle_pitch = legs.ankle_pitch - xp.arcsin(xp.clip(z - toe[2], -1.0, 1.0))
    ankle_roll = legs.ankle_roll + xp.arcsin(xp.clip(z - side[2], -1.0, 1.0))
    return Legs(
        mirror * legs.hip_roll,
        legs.hip_pitch,
        legs.knee_pitch,
        ankle_pitch,
        mirror * ankle_roll,
    )
