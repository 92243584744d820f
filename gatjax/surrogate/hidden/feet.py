"""The robot on the floor: how it stands, what floor and soles are, what it feels."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch

from gatjax.records import FORCE_SENSORS
from gatjax.surrogate.hidden.numbers import Numbers, Specimen
from gatjax.surrogate.hidden.robots import Robot

BODY_COLUMNS = (
    *(f"gyro.{axis}" for axis in "xyz"),
    *(f"accelerometer.{axis}" for axis in "xyz"),
    *(f"orientation.{angle}" for angle in ("roll", "pitch", "yaw")),
    *(f"force.{name}" for name in FORCE_SENSORS),
)
CHANNELS = len(BODY_COLUMNS)
NOISE = np.array([0.01] * 3 + [0.08] * 3 + [0.004] * 3 + [0.4] * len(FORCE_SENSORS))
"""Standard deviations of the sensors [A]: rad/s, m/s^2, rad, N."""


def dress(batch: Batch, numbers: Numbers) -> None:
    """Writes floor and soles of L specimens into a batch."""
    model = batch.model
    floor = model.geom("floor").id
    soles = [model.geom(name).id for name in FORCE_SENSORS]
    friction, softness = batch.expand("geom_friction"), batch.expand("geom_solref")
    place = batch.expand("geom_pos")
    for geom in (floor, *soles):
        friction[:, geom, 0] = numbers["mu"]
        softness[:, geom, 0] = numbers["softness"]
    place[:, soles, 2] = model.geom_pos[soles, 2] + numbers["wear"]


def stand(robot: Robot, first: np.ndarray) -> np.ndarray:
    """States [L, nq] of robots that stand level in poses [L, J] rad."""
    model, data = robot.model, mujoco.MjData(robot.model)
    soles = [model.geom(name).id for name in FORCE_SENSORS]
    states = np.tile(model.qpos0, (len(first), 1))
    for state, pose in zip(states, first, strict=True):
        state[robot.position] = pose
        for row in range(model.neq):
            one, two = model.eq_obj1id[row], model.eq_obj2id[row]
            state[model.jnt_qposadr[one]] = state[model.jnt_qposadr[two]]
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        state[2] -= (data.geom_xpos[soles, 2] - model.geom_size[soles, 0]).min()
    return states


def turn(vector: np.ndarray) -> np.ndarray:
    """Rotation matrices [L, 3, 3] of rotation vectors [L, 3] rad."""
    out = np.empty((len(vector), 9))
    quaternion = np.empty(4)
    for row, matrix in zip(vector, out, strict=True):
        angle = float(np.linalg.norm(row))
        axis = row / angle if angle > 0.0 else np.array([1.0, 0.0, 0.0])
        mujoco.mju_axisAngle2Quat(quaternion, axis, angle)
        mujoco.mju_quat2Mat(matrix, quaternion)
    return out.reshape(-1, 3, 3)


class Sensors:
    """The body's sensors of L robots."""

    def __init__(self, robot: Robot, batch: Batch, numbers: Numbers) -> None:
        """Binds what is read from the batch."""
        self.data = batch.bind("sensordata")
        self.quaternion = batch.bind("qpos")
        tilt = np.zeros((len(numbers["tilt"]), 3))
        tilt[:, :2] = numbers["tilt"]
        self.ground = turn(tilt)
        self.imu = turn(numbers["imu"])

    def read(self) -> np.ndarray:
        """Gyro, accelerometer, orientation, forces [L, CHANNELS]; one step old."""
        turned = np.empty((len(self.data), 9))
        for row, quaternion in zip(turned, self.quaternion[:, 3:7], strict=True):
            mujoco.mju_quat2Mat(row, quaternion)
        frame = self.ground @ turned.reshape(-1, 3, 3) @ self.imu
        roll = np.arctan2(frame[:, 2, 1], frame[:, 2, 2])
        pitch = -np.arcsin(np.clip(frame[:, 2, 0], -1.0, 1.0))
        yaw = np.arctan2(frame[:, 1, 0], frame[:, 0, 0])
        gyro = np.einsum("lij,li->lj", self.imu, self.data[:, :3])
        pull = np.einsum("lij,li->lj", self.imu, self.data[:, 3:6])
        return np.column_stack([gyro, pull, roll, pitch, yaw, self.data[:, 6:]])


def misalign(
    specimen: Specimen,
    robot: Robot,
    joints: list[int],
    value: float,
    more: dict[str, Any],
) -> Specimen:
    """Turns the IMU about an axis in its horizontal plane."""
    axis = np.array([np.cos(more["heading"]), np.sin(more["heading"]), 0.0])
    numbers = {**specimen.numbers, "imu": specimen.numbers["imu"] + value * axis}
    return specimen._replace(numbers=numbers)


def wear_down(
    specimen: Specimen,
    robot: Robot,
    joints: list[int],
    value: float,
    more: dict[str, Any],
) -> Specimen:
    """Takes height off two neighbouring corners of one sole."""
    wear = specimen.numbers["wear"].copy()
    wear[more["corners"]] += value
    return specimen._replace(numbers={**specimen.numbers, "wear": wear})
