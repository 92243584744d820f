"""How a run begins: what its seed draws, the floor under it, and the first state."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import mujoco
import numpy as np

from gatjax.records import FORCE_SENSORS, JOINTS
from gatjax.robot import model as robot_model
from gatjax.surrogate.e1 import (
    E1,
    FLOOR_STREAM,
    RUN_STREAM,
    Body,
    Constants,
    draw_body,
    nominal,
)
from gatjax.task import Task, task_at

SETTLE = 1.0  # s in which a robot comes to rest before it plays a motion
CLEARANCE = 1e-4  # m, lowest sole corner over the floor at the start
NOISES = 3 + 3 + len(FORCE_SENSORS)  # gyro, accelerometer, foot forces


class Run(NamedTuple):
    """What a seed decides about one run."""

    go: int  # control tick of the walk request
    angle: np.ndarray  # [J] rad, error of the first pose
    velocity: np.ndarray  # [2] m/s, horizontal push
    turn: np.ndarray  # [3] rad/s, push
    patch: np.ndarray  # [2] m, where on the floor it starts
    noise: np.ndarray  # [T, 14] unit normal: gyro, accelerometer, foot forces


class Floor(NamedTuple):
    """An uneven floor: heights on a square grid around the origin."""

    height: np.ndarray  # [K, K] m, first axis x, second axis y
    step: float  # m

    def at(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Height [...] m and slope [..., 2] at places [..., 2] m; bilinear."""
        last = self.height.shape[0] - 1
        grid = place / self.step + 0.5 * last
        cell = np.minimum(np.maximum(grid.astype(int), 0), last - 1)
        u, v = (grid - cell)[..., 0], (grid - cell)[..., 1]
        i, j = cell[..., 0], cell[..., 1]
        a, b = self.height[i, j], self.height[i + 1, j]
        c, d = self.height[i, j + 1], self.height[i + 1, j + 1]
        along = b - a + v * (a - b - c + d)
        across = c - a + u * (a - b - c + d)
        slope = np.stack([along, across], axis=-1) / self.step
        return a + u * (b - a) + v * across, slope


def draw_floor(body: Body, constants: Constants) -> Floor:
    """Draw the floor on which a robot walks; it goes with the body seed."""
    rng = np.random.default_rng([FLOOR_STREAM, body.seed])
    count = round(constants.floor_side / constants.floor_step) + 1
    height = rng.normal(0.0, constants.floor_roughness, (count, count))
    return Floor(height, constants.floor_step)


@lru_cache(maxsize=4)
def series(body_seed: int) -> tuple[Body, Floor]:
    """Draw one body of the series, and its floor."""
    body = draw_body(body_seed)
    return body, draw_floor(body, E1)


def draw_run(body: Body, seed: int, task: Task, constants: Constants) -> Run:
    """Draw one run; the start lies in the rear half, with metres of floor ahead."""
    rng = np.random.default_rng([RUN_STREAM, body.seed, seed])
    settle = round(task.settle / task.control_period)
    late = round(task.longest_delay / task.control_period)
    third = constants.floor_side / 6.0
    return Run(
        go=settle + int(rng.integers(0, late + 1)),
        angle=rng.normal(0.0, constants.start_angle, len(JOINTS)),
        velocity=rng.normal(0.0, constants.start_velocity, 2),
        turn=rng.normal(0.0, constants.start_turn, 3),
        patch=rng.uniform([-2.0 * third, -third], [0.0, third]),
        noise=rng.normal(size=(task.ticks, NOISES)),
    )


def playing(rows: int, rate_hz: float) -> Task:
    """Return the timing of a motion as a task: no walk, `rows` rows.

    Raises:
        ValueError: the stand-in robots have no such control rate.
    """
    task = task_at(rate_hz, settle=SETTLE, longest_delay=0.0)
    return task._replace(duration=rows * task.control_period)


def first_state(angle: np.ndarray, run: Run, floor: Floor) -> tuple:
    """MuJoCo state of a robot put down on the floor: qpos [nq] and qvel [nv].

    Args:
        angle: [J] rad, joint angles of the ready robot.
        run: what the seed drew.
        floor: the floor; the lowest sole corner touches it.
    """
    model = nominal()
    data = mujoco.MjData(model)
    data.qpos[robot_model.slots(model).position] = angle + run.angle
    left, right = model.joint("LHipYawPitch"), model.joint("RHipYawPitch")
    data.qpos[right.qposadr] = data.qpos[left.qposadr]
    data.qpos[:3] = *run.patch, 0.0
    mujoco.mj_kinematics(model, data)
    soles = [model.geom(name).id for name in FORCE_SENSORS]
    ground, _ = floor.at(data.geom_xpos[soles, :2])
    gap = data.geom_xpos[soles, 2] - model.geom_size[soles, 0] - ground
    data.qpos[2] = CLEARANCE - gap.min()
    data.qvel[:6] = *run.velocity, 0.0, *run.turn
    return data.qpos.copy(), data.qvel.copy()
