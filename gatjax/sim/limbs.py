"""A model seen as a robot to be moved: limits, home, speed, a start on the floor."""

from __future__ import annotations

import mujoco
import numpy as np

from gatjax import task as tasks
from gatjax.effects.ground import touching
from gatjax.motions import Limbs
from gatjax.records import JOINTS
from gatjax.robot import nao
from gatjax.robot.model import command_range, joint_names, servoed, slots
from gatjax.sim.tied import coupled, coupled_speed
from gatjax.walk.parameters import THETA0

TIMES, LONGEST = 7.0, 5.0  # time constants until a joint is at rest; s, at most
FAR = 1e3  # m, that a robot may begin above its floor
TOP_SPEED = 10.0  # rad/s, of quick hobby servos (60 degrees in 0.1 s): no servo's here


def put_down(model: mujoco.MjModel, angle: np.ndarray) -> np.ndarray:
    """Return the state [nq] with joint angles [J] rad, feet on the ground."""
    data, floating = mujoco.MjData(model), floats(model)
    data.qpos[:] = home_of(model)
    data.qpos[slots(model).position] = angle
    follower, follows = coupled(model, data.qpos)
    data.qpos[follower] = follows
    if floating:
        mujoco.mj_kinematics(model, data)
        geoms = touching(model)
        fixed = model.body_weldid[model.geom_bodyid[geoms]] == 0
        data.qpos[2] -= min(
            (
                mujoco.mj_geomDistance(model, data, ground, geom, FAR, None)
                for ground in geoms[fixed]
                for geom in geoms[~fixed]
            ),
            default=0.0,
        )
    return data.qpos.copy()


def settling(model: mujoco.MjModel) -> float:
    """How long the slowest servo takes to come to rest, s; LONGEST at most.

    Until a thousandth of what it was off is left: 7 times the longest time constant of
    its inertia (at home), damping and gain. Dry friction only stops it sooner. 0
    without servos.
    """
    if not servoed(model):
        return 0.0
    data = mujoco.MjData(model)
    data.qpos[:] = home_of(model)
    mujoco.mj_forward(model, data)
    whole = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, whole)
    dofs = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    inertia, gain = whole[dofs, dofs], model.actuator_gainprm[:, 0]
    damping = model.dof_damping[dofs] - model.actuator_biasprm[:, 2]
    root = np.sqrt(np.maximum(damping**2 - 4.0 * inertia * gain, 0.0))
    slowest = np.max(2.0 * inertia / np.maximum(damping - root, 1e-9))
    return min(TIMES * float(slowest), LONGEST)


def moving(
    model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray, angle: np.ndarray,
    speed: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return states [B, nq], [B, nv] with other joint angles and speeds [B, J] in them.

    Angles are in rad, speeds in rad/s; joints that follow others follow.
    """
    qpos, qvel, place = qpos.copy(), qvel.copy(), slots(model)
    qpos[:, place.position], qvel[:, place.velocity] = angle, speed
    follower, follows = coupled(model, qpos)
    qpos[:, follower] = follows
    follower, follows = coupled_speed(model, qpos, qvel)
    qvel[:, follower] = follows
    return qpos, qvel


def floats(model: mujoco.MjModel) -> bool:
    """Whether the robot stands by itself instead of hanging or being bolted."""
    return model.njnt > 0 and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE


def home_of(model: mujoco.MjModel) -> np.ndarray:
    """Return the model's first keyframe [nq]; its zero where it has none."""
    return np.array(model.key_qpos[0] if model.nkey else model.qpos0)


def limbs_of(model: mujoco.MjModel) -> Limbs:
    """Return what a motion must know of a model whose joints position servos drive.

    A NAO with all its joints starts from its walking pose, any other robot from the
    model's first keyframe, or its zero. The top speed of a NAO's motors is known; of
    others it is taken to be where the largest torque goes into damping, and at most
    10 rad/s.

    Raises:
        ValueError: one line: motors do not follow angles.
    """
    if not servoed(model):
        raise ValueError(
            "the model has motors that follow no angles; motions need position servos"
        )
    names, place = joint_names(model), slots(model)
    ids = model.actuator_trnid[:, 0]
    low, high = np.where(
        model.jnt_limited[ids, None], model.jnt_range[ids], [-np.pi, np.pi]
    ).T
    least, most = command_range(model)
    low, high = np.maximum(low, least), np.minimum(high, most)
    if names == JOINTS:
        home = tasks.pose(THETA0)
        speed = nao.SPEEDS
    else:
        home, speed = home_of(model)[place.position], _top_speed(model, place.velocity)
    limits = np.stack([low, high], axis=-1)
    return Limbs(names, limits, np.clip(home, low, high), speed, floats(model))


def _top_speed(model: mujoco.MjModel, dofs: np.ndarray) -> np.ndarray:
    """Return the speed [J] rad/s that a servo reaches without load."""
    torque = np.where(
        model.actuator_forcelimited, model.actuator_forcerange[:, 1], np.inf
    )
    damping = model.dof_damping[dofs] - model.actuator_biasprm[:, 2]
    with np.errstate(divide="ignore"):
        return np.minimum(torque / damping, TOP_SPEED)
