"""The servo of the stand-in robots: voltage clamp, torque-speed line, play, friction.

- error = target - encoder, less the dead band of the play
- push = gain error, within what the clamped voltage can drive at standstill
- torque = push - damping velocity (back EMF), within the net torque limit
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gatjax.records import JOINTS
from gatjax.robot import nao
from gatjax.surrogate.e1 import Constants


class Servo(NamedTuple):
    """The 25 motors; every field [J]."""

    gain: np.ndarray  # N m/rad
    push: np.ndarray  # N m, at standstill with the voltage at its clamp
    damping: np.ndarray  # N m s/rad, slope of the torque-speed line
    limit: np.ndarray  # N m, net torque
    friction: np.ndarray  # N m, dry friction


def servo(constants: Constants) -> Servo:
    """Return the motors of a robot with these constants."""
    share = constants.voltage * constants.motor_force
    motors = nao.MOTORS
    return Servo(
        gain=np.array([motor.gain for motor in motors]),
        push=np.array([share * motor.stall_torque for motor in motors]),
        damping=np.array([motor.damping for motor in motors]),
        limit=np.array([_limit(constants, motor) for motor in motors]),
        friction=np.array([_friction(constants, motor) for motor in motors]),
    )


def _limit(constants: Constants, motor: nao.Motor) -> float:
    limits = {
        nao.LEG_PITCH: constants.net_torque_pitch,
        nao.LEG_ROLL: constants.net_torque_roll,
    }
    return limits.get(motor, motor.effort)


def _friction(constants: Constants, motor: nao.Motor) -> float:
    leg = motor in (nao.LEG_PITCH, nao.LEG_ROLL)
    return constants.friction_leg if leg else constants.friction_arm


def within(value: np.ndarray, bound: np.ndarray | float) -> np.ndarray:
    """Clip to +-bound; faster than numpy.clip on short arrays."""
    return np.minimum(np.maximum(value, -bound), bound)


def encode(constants: Constants, angle: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Return what the encoders [..., J] say about true joint angles, rad."""
    step = constants.encoder_step
    return np.rint((angle - offset) / step) * step


def error(constants: Constants, target: np.ndarray, encoder: np.ndarray) -> np.ndarray:
    """Position error that the servo acts on: nothing inside the play, rad."""
    raw = target - encoder
    return raw - within(raw, constants.play)


def torque(motors: Servo, error: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Net torque of the motors [..., J], N m, before dry friction."""
    push = within(motors.gain * error, motors.push)
    return within(push - motors.damping * velocity, motors.limit)


COUPLED = JOINTS.index("LHipYawPitch")
"""The motor that drives both hip-yaw-pitch joints; it is mounted on the left one."""
