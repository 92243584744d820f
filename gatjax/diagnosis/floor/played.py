"""Whole robots on the floor, played open loop from rest, and what they would log."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis.measure import stretched, ticked
from gatjax.records import Played
from gatjax.sim.limbs import put_down
from gatjax.sim.replay import replay_many
from gatjax.sim.world import Values, World, stacked
from gatjax.task import Task

SETTLE = 0.8  # s at the first command before a log, after a start on the floor
LIFT = 0.001  # m, of that start: the feet find the floor by themselves


class Rows(NamedTuple):
    """Simulated rows of one run in S worlds, at its ticks, the settling left out."""

    time: np.ndarray  # [T] s since the first stamp
    command: np.ndarray  # [T, J] rad, in force at the ticks
    angle: np.ndarray  # [S, T, J] rad
    velocity: np.ndarray  # [S, T, J] rad/s
    torque: np.ndarray  # [S, T, J] N m, of the servos
    gyro: np.ndarray  # [S, T, 3] rad/s
    accelerometer: np.ndarray  # [S, T, 3] m/s^2
    up: np.ndarray  # [S, T, 3] against gravity, in the axes of the IMU
    heading: np.ndarray  # [S, T] rad, of the torso
    force: np.ndarray  # [S, T, F] N

    def at(self, stamps: np.ndarray, series: np.ndarray) -> np.ndarray:
        """Interpolate series [S, T, C] to stamps [N] s since the first one."""
        place = np.clip(
            np.interp(stamps, self.time, np.arange(len(self.time))), 0, None
        )
        low = np.minimum(place.astype(int), len(self.time) - 2)
        part = (place - low)[:, None]
        return series[:, low] * (1.0 - part) + series[:, low + 1] * part


def world_of(model: mujoco.MjModel, period: float, timestep: float) -> World:
    """Return a world of a model without noise or causes.

    Args:
        model: the robot, its base floating; it is copied.
        period: control period of the logs, s.
        timestep: of the physics, s; it divides the period.
    """
    copied = mujoco.MjModel.__copy__(model)
    copied.opt.timestep = timestep
    return World(
        model=copied, task=Task(control_period=period), command={}, motor={}, sensor={},
        values=Values(command={}, motor={}, sensor={}, body={}),
    )  # fmt: skip


def replayed(
    world: World,
    runs: list[JointRun],
    values: list[Values],
    shift: np.ndarray | None = None,
) -> list[Rows]:
    """Play the commands of runs in many worlds, all in one batch.

    Args:
        world: the structure, its control period that of the runs.
        runs: R logs.
        values: of S worlds of this structure.
        shift: [S, J] rad added to every command, or [S, T, J] per tick of one run.

    Returns:
        What each run would have logged, one for each run.
    """
    period = world.task.control_period
    lead = round(SETTLE / period)
    cut = [ticked(run, period) for run in runs]
    count = len(values)
    commands = stretched([run.command for run in cut], lead)
    start = np.stack([put_down(world.model, command[0]) for command in commands])
    start[:, 2] += LIFT
    commands = np.repeat(commands, count, axis=0)
    if shift is not None:
        rows = (
            shift[:, None]
            if shift.ndim == 2
            else _lengthened(shift, lead, max(len(run.time) for run in cut))
        )
        commands = commands + np.tile(rows, (len(runs), 1, 1))
    played = replay_many(
        world, stacked(values * len(runs)), commands, np.repeat(start, count, axis=0),
        np.zeros(world.model.nv),
    )  # fmt: skip
    out = []
    for k, run in enumerate(cut):
        part = (slice(k * count, (k + 1) * count), slice(lead, lead + len(run.time)))
        out.append(_rows(run.time, run.command, played, part))
    return out


def _lengthened(shift: np.ndarray, lead: int, longest: int) -> np.ndarray:
    rest = longest - shift.shape[1]
    return np.pad(shift, ((0, 0), (lead, rest), (0, 0)), mode="edge")


def _rows(time: np.ndarray, command: np.ndarray, played: Played, part: tuple) -> Rows:
    """Rows of one run."""
    w, x, y, z = np.moveaxis(np.asarray(played.base.quaternion)[part], -1, 0)
    heading = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    reading = played.reading
    return Rows(
        time=time, command=command, angle=np.asarray(reading.angle)[part],
        velocity=np.asarray(played.velocity)[part],
        torque=np.asarray(played.torque)[part], gyro=np.asarray(reading.gyro)[part],
        accelerometer=np.asarray(reading.accelerometer)[part],
        up=np.asarray(played.up)[part], heading=np.unwrap(heading, axis=-1),
        force=np.asarray(reading.force)[part],
    )  # fmt: skip
