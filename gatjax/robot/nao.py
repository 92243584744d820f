"""What a NAO v6 is, as numbers with their source; numpy only.

Sources: [S6] NAO6 datasheet H25600, 10/2024 (motors, gears, encoders); [BH] B-Human
code release 2025 @6db9188, Config/Robots/Default (limits, dimensions, masses);
[URDF] ros-naoqi/nao_robot @6747646, naoV50. [A] marks an assumption: nothing published.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from gatjax.records import JOINTS

MODEL_FILE = Path(__file__).with_name("nao.xml")
GEAR_EFFICIENCY = 0.8  # [A]
HIP_DROP = 0.085  # m, hips below the torso origin [BH]
ENCODER_STEP = 2.0 * np.pi / 4096  # rad, 12 bit at the joint [S6]
TOTAL_MASS = 5.35943  # kg, sum of the links [BH]; the whole robot weighs 5.48 [S6]


class Motor(NamedTuple):
    """One kind of motor with its gear, as it acts on a joint."""

    gear: float  # reduction [S6]
    no_load_rpm: float  # of the motor shaft [S6]
    stall: float  # N m, of the motor shaft [S6]
    rotor_inertia: float  # kg m^2 [A]
    gain: float  # N m/rad, position gain of the simulated servo [A]
    effort: float  # N m, effort limit of the URDF [URDF]

    @property
    def no_load_speed(self) -> float:
        """Joint speed without load, rad/s."""
        return self.no_load_rpm * 2.0 * np.pi / 60.0 / self.gear

    @property
    def stall_torque(self) -> float:
        """Joint torque at standstill after gear losses, N m."""
        return GEAR_EFFICIENCY * self.stall * self.gear

    @property
    def damping(self) -> float:
        """Slope of the torque-speed line (back EMF), N m s/rad."""
        return self.stall_torque / self.no_load_speed

    @property
    def armature(self) -> float:
        """Rotor inertia seen at the joint, kg m^2."""
        return self.rotor_inertia * self.gear**2


LEG_ROLL = Motor(201.3, 8700.0, 0.065, 4.5e-7, 100.0, 3.348)
LEG_PITCH = Motor(130.85, 8700.0, 0.065, 4.5e-7, 100.0, 3.023)
YAW = Motor(150.27, 10700.0, 0.0143, 9e-8, 20.0, 1.547)
ROLL = Motor(173.22, 10700.0, 0.0143, 9e-8, 20.0, 1.532)
SHOULDER = Motor(150.27, 11400.0, 0.0224, 1e-7, 20.0, 1.329)
WRIST = Motor(50.61, 8400.0, 0.0094, 1.5e-7, 4.0, 0.4075)
HAND = Motor(36.24, 8400.0, 0.0094, 1.5e-7, 2.0, 0.292)

_BY_NAME = {
    "HeadYaw": YAW, "HeadPitch": ROLL, "ShoulderPitch": SHOULDER, "ShoulderRoll": ROLL,
    "ElbowYaw": YAW, "ElbowRoll": ROLL, "WristYaw": WRIST, "Hand": HAND,
    "HipYawPitch": LEG_ROLL, "HipRoll": LEG_ROLL, "HipPitch": LEG_PITCH,
    "KneePitch": LEG_PITCH, "AnklePitch": LEG_PITCH, "AnkleRoll": LEG_ROLL,
}  # fmt: skip


def motor_of(joint: str) -> Motor:
    """Return the motor that drives a joint of `JOINTS`."""
    if joint not in JOINTS:
        raise ValueError(f"joint {joint!r} is unknown; choose from {list(JOINTS)}")
    return _BY_NAME[joint if joint.startswith("Head") else joint[1:]]


MOTORS = tuple(motor_of(joint) for joint in JOINTS)
SPEEDS = np.array([motor.no_load_speed for motor in MOTORS])  # [J] rad/s, top ones

_LIMITS = {  # rad [BH]; HipPitch [URDF]; Hand: 0 closed, 1 open
    "HeadYaw": (-2.08567, 2.08567), "HeadPitch": (-0.67195, 0.51487),
    "LShoulderPitch": (-2.08567, 2.08567), "RShoulderPitch": (-2.08567, 2.08567),
    "LShoulderRoll": (-0.31416, 1.32645), "RShoulderRoll": (-1.32645, 0.31416),
    "LElbowYaw": (-2.08567, 2.08567), "RElbowYaw": (-2.08567, 2.08567),
    "LElbowRoll": (-1.54462, -0.03491), "RElbowRoll": (0.03491, 1.54462),
    "LWristYaw": (-1.82387, 1.82387), "RWristYaw": (-1.82387, 1.82387),
    "LHand": (0.0, 1.0), "RHand": (0.0, 1.0),
    "LHipYawPitch": (-1.14529, 0.740718),
    "LHipRoll": (-0.37943, 0.79046), "RHipRoll": (-0.79046, 0.37943),
    "LHipPitch": (-1.53589, 0.48398), "RHipPitch": (-1.53589, 0.48398),
    "LKneePitch": (-0.09233, 2.11255), "RKneePitch": (-0.10297, 2.12005),
    "LAnklePitch": (-1.18944, 0.92258), "RAnklePitch": (-1.1863, 0.93201),
    "LAnkleRoll": (-0.39776, 0.76899), "RAnkleRoll": (-0.76899, 0.39794),
}  # fmt: skip
LIMITS = np.array([_LIMITS[joint] for joint in JOINTS])  # [J, 2] rad
LOW, HIGH = LIMITS.T

LEGS = np.array([
    index for index, joint in enumerate(JOINTS)
    if any(part in joint for part in ("Hip", "Knee", "Ankle"))
])  # fmt: skip
"""Joints from the hips down, in JOINTS."""

WALKING_JOINTS = tuple(
    joint
    for joint in JOINTS
    if joint.endswith(("HipYawPitch", "HipRoll", "HipPitch", "KneePitch"))
    or joint.endswith(("AnklePitch", "AnkleRoll", "ShoulderPitch"))
)
"""The 13 joints that a forward walk moves."""
WALKING = np.array([JOINTS.index(joint) for joint in WALKING_JOINTS])
