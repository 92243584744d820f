"""Body poses of a recorded walk, for the animation in the report."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from gatjax.records import Trajectory
from gatjax.robot.model import slots as find_slots
from gatjax.runs import write_whole
from gatjax.sim.tied import coupled

Array = Any

FRAME_RATE = 25.0  # per second
SHAPES = {
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
}
SHOWN_GROUP = 1  # geom group of the robot's shell in nao.xml


def states(model: mujoco.MjModel, trajectory: Trajectory) -> Array:
    """Positions [T, nq] of one recorded run [T, ...]."""
    qpos = np.zeros((len(trajectory.time), model.nq))
    qpos[:, :3] = trajectory.base.position
    qpos[:, 3:7] = trajectory.base.quaternion
    qpos[:, find_slots(model).position] = trajectory.reading.angle
    follower, follows = coupled(model, qpos)
    qpos[:, follower] = follows
    return qpos


def write_walk(
    path: Path, model: mujoco.MjModel, trajectory: Trajectory, label: str
) -> None:
    """Write one run [T, ...] as frames for the viewer; the file is in docs/files.md.

    The file is written whole or not at all.
    """
    alive = np.asarray(trajectory.alive)
    last = int(alive.sum()) + 1  # the fall itself is shown
    step = max(1, round(1.0 / FRAME_RATE / float(trajectory.time[1])))
    qpos = states(model, trajectory)[:last:step]
    data = mujoco.MjData(model)
    position = np.zeros((len(qpos), model.nbody, 3))
    quaternion = np.zeros((len(qpos), model.nbody, 4))
    for frame, state in enumerate(qpos):
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        position[frame], quaternion[frame] = data.xpos, data.xquat
    shown = [
        index
        for index in range(model.ngeom)
        if model.geom_group[index] == SHOWN_GROUP and model.geom_type[index] in SHAPES
    ]
    buffer = io.BytesIO()
    np.savez(
        buffer,
        allow_pickle=False,
        time=np.asarray(trajectory.time)[:last:step],
        body_position=position,
        body_quaternion=quaternion,
        geom_body=model.geom_bodyid[shown],
        geom_type=np.array([SHAPES[int(model.geom_type[index])] for index in shown]),
        geom_size=model.geom_size[shown],
        geom_position=model.geom_pos[shown],
        geom_quaternion=model.geom_quat[shown],
        geom_rgba=model.geom_rgba[shown],
        label=np.array(label),
    )
    write_whole({path: buffer.getvalue()})
