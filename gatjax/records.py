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


class Sensed(NamedTuple):
    """What sensor effects transform: they may change `reading` only."""

    reading: Reading  # [...]
    noise: Reading  # [...] unit normal draws of this tick, one per channel
