"""Where the torso of a walking robot is, from what the robot itself measures.

How it is turned: the gyro says how that changes, and the sole that carries says what is
level, in the long run; the gyro's bias is learned on the way (the explicit
complementary filter of Mahony, Hamel & Pflimlin 2008, IEEE TAC 53(5), eq. 32, with the
sole's normal in the place of the accelerometer). A sole rocks on its edges, but to both
sides. The accelerometer is no reference: read once a control tick, in step with the
impacts of the feet, it was 0.06 rad off in pitch on the robot `stiff`.

Where it is: the lowest points of the soles do not slip.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from gatjax.data.recording import Recording
from gatjax.effects.ground import touching
from gatjax.sim.tied import coupled

Array = Any
LEVEL = 1.0  # s in which the soles' normal replaces what the gyro says
BIAS = 1.0  # s in which the gyro's bias is learned from what the soles say
GRIP = 3  # points of soles that carry, and stay where they are
ANKLES = ("LAnkleRoll", "RAnkleRoll")  # joints, each of which carries a foot
UP = np.array([0.0, 0.0, 1.0])


class Soles(NamedTuple):
    """Spheres under the feet, seen from the torso."""

    centre: Array  # [N, S, 3] m
    normal: Array  # [N, S, 3] unit vector, of the foot that each is under
    radius: Array  # [S] m


def torso_poses(
    model: mujoco.MjModel, recording: Recording, angle: Array, period: float
) -> Array:
    """Torso poses [N, 7] of a recording: position m, quaternion w x y z.

    The torso is turned as `orientation.roll` and `.pitch` say, or else as gyro and
    soles do, and goes where the soles stay; without either it is upright and does not
    travel. A column that never changes says nothing. The lowest sole is on the floor.
    Where a trajectory begins, and where it heads there, means nothing.

    Args:
        model: floating base, spheres under its feet.
        recording: of N rows.
        angle: [N, J] rad, of its joints.
        period: s, control period.

    Raises:
        ValueError: one line: the model's feet have no spheres.
    """
    order = np.argsort(recording.trajectory, kind="stable")  # runs may interleave
    trajectory, soles = recording.trajectory[order], soles_of(model, angle[order])
    told = _given(recording, [f"orientation.{name}" for name in ("pitch", "roll")])
    gyro = _given(recording, [f"gyro.{axis}" for axis in "xyz"])
    first = np.diff(trajectory, prepend=-1) != 0
    if told is not None:
        pitch, roll = told[order].T
        rate = np.zeros((len(order), 3)) if gyro is None else gyro[order]
        turn = _leaning(pitch, roll, _heading(pitch, roll, rate, first, period))
    elif gyro is not None:
        turn = _turned(trajectory, gyro[order], soles, period)
    else:
        turn, first = Rotation.identity(len(order)), np.ones(len(order), bool)
    base = np.empty((len(order), 7))
    base[order] = _placed(turn, soles, first)
    return base


def _given(recording: Recording, names: list[str]) -> Array | None:
    """Columns [N, C] of a recording, None if it lacks one or one never changes."""
    found = [recording.columns.get(name) for name in names]
    known = [each for each in found if each is not None and np.ptp(each)]
    return np.stack(known, axis=-1) if len(known) == len(names) else None


def soles_of(model: mujoco.MjModel, angle: Array) -> Soles:
    """Find the soles of a robot with joint angles [N, J] rad."""
    slots = model.jnt_qposadr[model.actuator_trnid[:, 0]]
    feet = [model.jnt_bodyid[model.joint(name).id] for name in ANKLES]
    sphere = model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE
    soles = np.flatnonzero(sphere & np.isin(model.geom_bodyid, feet))
    balls = np.intersect1d(touching(model), soles)
    if not np.isin(feet, model.geom_bodyid[balls]).all():
        raise ValueError(
            "a foot of this model has no spheres that touch the floor, so the log does "
            "not tell where the torso is: give the feet spheres, or the log base.*"
        )
    data = mujoco.MjData(model)
    centre = np.zeros((len(angle), len(balls), 3))
    normal = np.zeros_like(centre)
    for row, pose in enumerate(angle):
        data.qpos[:7], data.qpos[slots] = (0, 0, 0, 1, 0, 0, 0), pose
        follower, follows = coupled(model, data.qpos)
        data.qpos[follower] = follows
        mujoco.mj_kinematics(model, data)
        centre[row] = data.geom_xpos[balls]
        normal[row] = data.xmat[model.geom_bodyid[balls], 2::3]
    return Soles(centre, normal, model.geom_size[balls, 0])


def _leaning(pitch: Array, roll: Array, heading: Array) -> Rotation:
    """Attitudes with pitch, roll and heading [...] rad."""
    return Rotation.from_euler("ZYX", np.stack([heading, pitch, roll], axis=-1))


def _heading(
    pitch: Array, roll: Array, gyro: Array, first: Array, period: float
) -> Array:
    """How torsos head [N] rad, by the gyro [N, 3] rad/s and how they lean."""
    rate = (np.sin(roll) * gyro[:, 1] + np.cos(roll) * gyro[:, 2]) / np.cos(pitch)
    turned = 0.5 * period * (rate[1:] + rate[:-1])
    return np.append(0.0, np.where(first[1:], 0.0, turned).cumsum())


def _turned(trajectory: Array, gyro: Array, soles: Soles, period: float) -> Rotation:
    """Attitudes [N] by gyro [N, 3] rad/s and soles, all trajectories at once."""
    runs = [np.flatnonzero(trajectory == run) for run in np.unique(trajectory)]
    longest = max(map(len, runs))
    rows = np.stack([run[np.minimum(np.arange(longest), len(run) - 1)] for run in runs])
    found = np.zeros((len(trajectory), 4))
    begin, each = rows[:, 0], np.arange(len(runs))
    level = soles.normal[begin].mean(1)
    level = soles.normal[begin][each, _lowest(soles, begin, level)]
    turn = _leaning(
        np.arctan2(-level[:, 0], np.hypot(level[:, 1], level[:, 2])),
        np.arctan2(level[:, 1], level[:, 2]),
        np.zeros(len(runs)),
    )
    bias = np.zeros((len(runs), 3))
    for tick in range(longest):
        now, going = rows[:, tick], np.array([tick < len(run) for run in runs])
        found[now[going]] = turn.as_quat()[going]
        up = turn.inv().apply(UP)
        wrong = np.cross(soles.normal[now][each, _lowest(soles, now, up)], up)
        following = rows[:, min(tick + 1, longest - 1)]
        rate = 0.5 * (gyro[now] + gyro[following]) - bias + wrong / LEVEL
        turn = turn * Rotation.from_rotvec(period * rate)
        bias = bias - period / (LEVEL * BIAS) * wrong
    return Rotation.from_quat(found)


def _lowest(soles: Soles, rows: Array, up: Array) -> Array:
    """Sphere [R] that lies lowest at some rows [R], the vertical [R, 3] given."""
    height = np.einsum("rsk,rk->rs", soles.centre[rows], up) - soles.radius
    return height.argmin(1)


def _placed(turn: Rotation, soles: Soles, first: Array) -> Array:
    """Poses [N, 7] of torsos that are turned so, standing on their soles.

    Args:
        turn: N attitudes.
        soles: seen from the torso.
        first: [N] bool, rows to which nothing moves from the row before.
    """
    seen = np.einsum("nij,nsj->nsi", turn.as_matrix(), soles.centre)
    height = seen[..., 2] - soles.radius
    step = np.diff(seen[..., :2], axis=0)
    low = np.argsort(height[1:] + height[:-1], axis=1)[:, :GRIP, None]
    moved = -np.take_along_axis(step, low, axis=1).mean(1)
    base = np.zeros((len(seen), 7))
    base[1:, :2] = np.where(first[1:, None], 0.0, moved).cumsum(0)
    base[:, 2] = -height.min(1)
    base[:, 3:] = turn.as_quat()[:, [3, 0, 1, 2]]
    return base
