"""The records that pass between rooms. All are NamedTuples: immutable, free pytrees.

Axis J of every joint field follows `JOINTS`. Leading axes may be added in front of the
ones that are written here (`[..., J]`): a batch of robots, or the time axis.
"""

from __future__ import annotations

from typing import Any, NamedTuple

Array = Any  # numpy.ndarray or jax.Array

JOINTS = (
    "HeadYaw", "HeadPitch",
    "LShoulderPitch", "LShoulderRoll", "LElbowYaw", "LElbowRoll", "LWristYaw", "LHand",
    "LHipYawPitch", "LHipRoll", "LHipPitch", "LKneePitch", "LAnklePitch", "LAnkleRoll",
    "RHipRoll", "RHipPitch", "RKneePitch", "RAnklePitch", "RAnkleRoll",
    "RShoulderPitch", "RShoulderRoll", "RElbowYaw", "RElbowRoll", "RWristYaw", "RHand",
)  # fmt: skip
"""The 25 motors of a NAO H25; LHipYawPitch drives both hips."""

FORCE_SENSORS = (
    "LFootFrontLeft", "LFootFrontRight", "LFootRearLeft", "LFootRearRight",
    "RFootFrontLeft", "RFootFrontRight", "RFootRearLeft", "RFootRearRight",
)  # fmt: skip
"""The eight foot force sensors, in the order of `Reading.force`."""


class Reading(NamedTuple):
    """What the robot reports at one control tick."""

    angle: Array  # [..., J] rad, encoders
    gyro: Array  # [..., 3] rad/s, torso frame x forward, y left, z up
    accelerometer: Array  # [..., 3] m/s^2, torso frame, +9.81 z when standing
    force: Array  # [..., 8] N, order of FORCE_SENSORS


class Base(NamedTuple):
    """Where the torso is: ground truth, for scoring only."""

    position: Array  # [..., 3] m, world frame
    quaternion: Array  # [..., 4] w x y z, torso to world


class Trajectory(NamedTuple):
    """One recorded run; row t holds the reading and the command that answers it."""

    time: Array  # [..., T] s, 0 at the first control tick
    command: Array  # [..., T, J] rad, target in force from this row's time on
    reading: Reading  # [..., T, ...]
    base: Base  # [..., T, ...]
    alive: Array  # [..., T] bool, False from the fall on


class Played(NamedTuple):
    """Open-loop replays; row t is what is measured when command t comes into force."""

    reading: Reading  # [N, T, ...]
    velocity: Array  # [N, T, J] rad/s, of the joints
    torque: Array  # [N, T, J] N m, of the servos in the physics step before the row
    base: Base  # [N, T, ...] where the ground is level; zeros where nothing floats
    up: Array  # [N, T, 3] unit vector against gravity in the axes of the IMU


class Outcome(NamedTuple):
    """The verdict on one run."""

    cost: Array  # [...] lower is better: -velocity in m/s, +15 for a fall
    velocity: Array  # [...] m/s, mean forward velocity towards the target
    fell_at: Array  # [...] s after the walk request, inf if it never fell
    ok: Array  # [...] bool, False if the simulation diverged (NaN)


class Signal(NamedTuple):
    """What command and motor effects transform: they may change `target` only."""

    target: Array  # [..., J] rad, desired joint position
    angle: Array  # [..., J] rad, joint position now
    velocity: Array  # [..., J] rad/s, joint velocity now
    noise: Array  # [..., J] unit normal draws of this tick


class Servo(NamedTuple):
    """What a drive and its joint are made of."""

    gain: Array  # [..., J] torque per position error, N m/rad, or per command
    hold: Array  # [..., J] 1: a position servo, 0: it is told a torque or a voltage
    damping: Array  # [..., J] N m s/rad, torque of the servo against the speed
    low: Array  # [..., J] N m, least torque of the servo
    high: Array  # [..., J] N m, largest torque of the servo
    friction: Array  # [..., J] N m, dry friction of the joint, at the motor's speed
    viscous: Array  # [..., J] N m s/rad, damping of the joint
    rotor: Array  # [..., J] kg m^2, inertia of the motor seen at the joint
    link: Array  # [..., J] kg m^2, inertia that the joint feels beyond the gear


class Drive(NamedTuple):
    """What joint effects transform: `servo`, `load`, friction and nothing else."""

    target: Array  # [..., J] rad, what the servo was told
    angle: Array  # [..., J] rad, joint position now
    velocity: Array  # [..., J] rad/s, joint velocity now
    seen: Array  # [..., J] rad, what the servo's encoder sees, on motor or link
    turned: Array  # [..., J] rad, of the motor: the joint's but for a gear between them
    turning: Array  # [..., J] rad/s, speed of the motor
    servo: Servo  # as it is now
    rated: Array  # [..., J] N m, its limit before any effect lowers it
    load: Array  # [..., J] N m, torque on the joint beside the servo's
    lean: Array  # [..., J] N m, torque of friction in one direction, shared by a gear
    lean_apart: Array  # [..., J] N m, that at the link's speed, less `lean`
    torque: Array  # [..., J] N m, what the servo gave in the last step
    stiffness: Array  # [..., J] share of its gain that a log says it had; 0: no power
    geared: Array  # [..., J] 1: motor and link are apart, with a gear between
    handed: Array  # [..., J] N m, torque of that gear in the last step
    apart: Array  # [..., J] N m, that friction at the link's speed, less `friction`


class Sensed(NamedTuple):
    """What sensor effects transform: they may change `reading` only."""

    reading: Reading  # [...]
    noise: Reading  # [...] unit normal draws of this tick, one per channel
