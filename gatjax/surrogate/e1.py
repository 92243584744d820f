"""What the stand-in robots hide: the constants E1, and bodies drawn from them.

Sources: [F] feasibility study of gatjax, walk_feasibility.md section 3 ("E1"), where
values were chosen before any method of this project was compared on them; the figures
behind it: [BH] B-Human code release 2025, [ND] NaoDevils 2024, [URDF] naoV50 effort,
[S6] NAO6 datasheet, [HULKs] simulator noise, [SPL] SimSpark naov4 hinge friction.
[A] is an assumption of this file where [F] gives no number. Do not tune these values.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import NamedTuple

import mujoco
import numpy as np

from gatjax.records import FORCE_SENSORS, JOINTS
from gatjax.robot import model as robot_model
from gatjax.robot import nao

BODY_STREAM, RUN_STREAM, FLOOR_STREAM = 1, 2, 3  # separate the random numbers


@dataclass(frozen=True)
class Constants:
    """E1: how the stand-in robots differ from the nominal NAO."""

    command_delay: float = 0.024  # s; with the sensors 36 ms [F], [BH] 3 frames
    sensor_delay: float = 0.012  # s [F]
    voltage: float = 0.6  # share of the nominal voltage [F]
    motor_force: float = 0.9  # share of stall torque after gear losses [F]; with
    # `voltage`, no-load 3.8 rad/s pitch and 2.4 roll, as [ND] 3.68 and 2.39
    net_torque_pitch: float = 3.0  # N m, hip, knee, ankle pitch [F], [URDF] 3.02
    net_torque_roll: float = 3.3  # N m, other leg motors [F], [URDF] 3.35
    # arms and head: nao.Motor.effort [URDF]
    play: float = float(np.deg2rad(0.5))  # rad, half width of the dead band [F]
    offset: float = float(np.deg2rad(0.4))  # rad, calibration error, 1 sigma [F]
    friction_leg: float = 0.1  # N m, dry friction of a motor [F], [SPL] 0.1
    friction_arm: float = 0.05  # N m [F]
    encoder_step: float = nao.ENCODER_STEP  # rad, 12 bit [S6]
    gyro_noise: float = 0.005  # rad/s, 1 sigma [F], [HULKs] 2.4-5.5 mrad/s
    accelerometer_noise: float = 0.06  # m/s^2, 1 sigma [HULKs] 0.03-0.09
    force_gain: float = 0.1  # error of a foot force sensor's gain, 1 sigma [F]
    force_noise: float = 0.03  # share of the force, 1 sigma [F]
    mass_error: float = 0.03  # +- share of a link's mass, uniform [F]
    extra_mass: float = 0.12  # kg in the torso [F]; [S6] 5.48 kg, links 5.359 kg
    extra_place: float = 0.03  # m, where it sits about the torso's CoM, 1 sigma [A]
    floor_friction: float = 0.8  # [F]
    floor_time_constant: float = 0.02  # s, solref of a soft contact [F]
    floor_roughness: float = 0.001  # m, 1 sigma of white noise [F]
    floor_step: float = 0.03  # m, grid of the floor [F]
    floor_side: float = 12.0  # m [F] section 7
    start_angle: float = 0.01  # rad, 1 sigma, section 2 of [F]
    start_velocity: float = 0.03  # m/s, horizontal, 1 sigma, section 2 of [F]
    start_turn: float = 0.1  # rad/s, 1 sigma, section 2 of [F]


E1 = Constants()
UNITS = {
    "command_delay": "s", "sensor_delay": "s", "net_torque_pitch": "N m",
    "net_torque_roll": "N m", "play": "rad", "offset": "rad", "friction_leg": "N m",
    "friction_arm": "N m", "encoder_step": "rad", "gyro_noise": "rad/s",
    "accelerometer_noise": "m/s^2", "extra_mass": "kg", "extra_place": "m",
    "floor_time_constant": "s", "floor_roughness": "m", "floor_step": "m",
    "floor_side": "m", "start_angle": "rad", "start_velocity": "m/s",
    "start_turn": "rad/s",
}  # fmt: skip
"""Of the constants that have one, for robot.json; the others are shares and ratios."""


class Body(NamedTuple):
    """One robot of the series: what its maker's tolerances made of it."""

    seed: int
    mass_factor: np.ndarray  # [B] of each link, order of the nominal model
    extra_position: np.ndarray  # [3] m, of the extra mass, from the torso's CoM
    offset: np.ndarray  # [J] rad, true angle minus encoder angle
    force_gain: np.ndarray  # [8] of each foot force sensor


class Inertials(NamedTuple):
    """Mass properties of all links, in their own frames."""

    mass: np.ndarray  # [B] kg
    centre: np.ndarray  # [B, 3] m
    inertia: np.ndarray  # [B, 3, 3] kg m^2 about the centre


@lru_cache(maxsize=1)
def nominal() -> mujoco.MjModel:
    """Return the nominal NAO, the one source of lengths, masses and axes."""
    return robot_model.load()


def draw_body(seed: int, constants: Constants = E1) -> Body:
    """Draw the robot that belongs to a body seed."""
    rng = np.random.default_rng([BODY_STREAM, seed])
    error = constants.mass_error
    return Body(
        seed=seed,
        mass_factor=1.0 + rng.uniform(-error, error, nominal().nbody - 1),
        extra_position=rng.normal(0.0, constants.extra_place, 3),
        offset=rng.normal(0.0, constants.offset, len(JOINTS)),
        force_gain=1.0 + rng.normal(0.0, constants.force_gain, len(FORCE_SENSORS)),
    )


def inertials(body: Body, constants: Constants = E1) -> Inertials:
    """Mass properties of a drawn robot; the torso, link 0, carries the extra mass."""
    model = nominal()
    mass = model.body_mass[1:] * body.mass_factor
    centre = model.body_ipos[1:].copy()
    turn = np.array([_matrix(quaternion) for quaternion in model.body_iquat[1:]])
    principal = model.body_inertia[1:] * body.mass_factor[:, None]
    inertia = np.einsum("bij,bj,bkj->bik", turn, principal, turn)
    added, away = constants.extra_mass, body.extra_position
    reduced = mass[0] * added / (mass[0] + added)
    inertia[0] += reduced * (away @ away * np.eye(3) - np.outer(away, away))
    mass[0] += added
    centre[0] += added / mass[0] * away
    return Inertials(mass, centre, inertia)


def _matrix(quaternion: np.ndarray) -> np.ndarray:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def published(engine: str, body: Body) -> dict:
    """Return what `robot.json` says about a robot; plain numbers and lists."""
    return {
        "engine": engine,
        "constants": asdict(E1),
        "units": UNITS,
        "body_seed": body.seed,
        "mass_kg": float(inertials(body).mass.sum()),
        "mass_factor": body.mass_factor.tolist(),
        "extra_position_m": body.extra_position.tolist(),
        "offset_rad": dict(zip(JOINTS, body.offset.tolist(), strict=True)),
        "force_gain": dict(zip(FORCE_SENSORS, body.force_gain.tolist(), strict=True)),
    }
