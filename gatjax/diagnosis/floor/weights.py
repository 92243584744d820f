"""What each joint of a standing robot carries, from full simulations.

A joint obeys inertia_j q''_j + rest_j + slope_j (q_j - path_j) = servo torque - damping
q'_j - dry friction, as in `gatjax.diagnosis.loads`, but here inertia and slope are what
the joint sees of a body that gives way (`reaction`), and rest is what is left of the
simulated servo torques: base, contacts and the closed chain of two feet are in it.
Along the simulated motion, the equation holds exactly.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis.assembly import TRANSPORT
from gatjax.diagnosis.floor.played import LIFT, SETTLE, Rows
from gatjax.diagnosis.floor.reaction import Answer, Frame, dense
from gatjax.diagnosis.floor.tolerances import Draw
from gatjax.diagnosis.joint import STEP
from gatjax.diagnosis.loads import (
    BODY_TERMS,
    COARSE,
    GRAVITY_TERMS,
    Load,
    Tree,
    changed,
)
from gatjax.diagnosis.motion import FINE, LEAD, Motion, cells, spread
from gatjax.sim.limbs import put_down

CREEP = 0.02  # rad/s: slower joints stick in the rows of a replay


class Moment(NamedTuple):
    """The state of the whole robot at one point of a trace."""

    position: np.ndarray  # [nq]
    velocity: np.ndarray  # [nv]
    acceleration: np.ndarray  # [nv]
    answer: Answer


class Trace(NamedTuple):
    """The nominal robot along a run: its motion, and loads at the points of it."""

    motion: Motion  # M points
    load: Load  # [M, J]
    moments: list[Moment]  # every COARSE points


def trace(
    tree: Tree, run: JointRun, time: np.ndarray, added: np.ndarray | None = None
) -> Trace:
    """Simulate a run from rest on the floor, step by step.

    Args:
        tree: of the model, its base floating.
        run: the commands.
        time: [M] s since the first stamp, FINE steps of the engine apart.
        added: [M, J] rad, to the commands.

    Returns:
        Motion and loads; the load of a point is the mean over the steps up to the next.
    """
    model = mujoco.MjModel.__copy__(tree.model)
    model.opt.timestep = STEP
    data, frame = mujoco.MjData(model), Frame(tree)
    grid = time[0] + STEP * np.arange(len(time) * FINE)
    stamps = run.time - run.time[0]
    targets = cells(stamps + TRANSPORT, run.command, grid)
    if added is not None:
        targets += np.stack([np.interp(grid, time, a) for a in added.T], -1)
    data.qpos[:] = put_down(model, targets[0])
    data.qpos[2] += LIFT
    data.ctrl[:] = targets[0]
    for _ in range(round((SETTLE - LEAD) / STEP)):
        mujoco.mj_step(model, data)
    shape = (len(time), tree.moves.shape[1])
    moments = []
    position, velocity, acceleration, carried, slope, inertia = np.zeros((6, *shape))
    for point in range(len(time)):
        position[point] = data.qpos[tree.qpos]
        velocity[point] = data.qvel[_dofs(tree)]
        if point % COARSE == 0:
            mujoco.mj_forward(model, data)
            answer = frame.answer(model, data)
            slope[point], inertia[point] = answer.slope, answer.inertia
            state = (data.qpos.copy(), data.qvel.copy(), data.qacc.copy())
            moments.append(Moment(*state, answer))
        for step in range(FINE):
            data.ctrl[:] = targets[point * FINE + step]
            before = data.qvel[_dofs(tree)].copy()
            mujoco.mj_step(model, data)
            given = data.qfrc_actuator + data.qfrc_passive + _bounds(model, data)
            carried[point] += tree.moves.T @ given / FINE
            acceleration[point] += (data.qvel[_dofs(tree)] - before) / (STEP * FINE)
    few = np.arange(0, len(time), COARSE)
    slope, inertia = (
        np.stack([np.interp(time, time[few], s) for s in series[few].T], -1)
        for series in (slope, inertia)
    )
    motion = Motion(time, position, velocity, acceleration, position)
    rest = carried - inertia * acceleration
    return Trace(motion, Load(rest, slope, inertia), moments)


def _dofs(tree: Tree) -> np.ndarray:
    return tree.model.jnt_dofadr[tree.model.actuator_trnid[:, 0]]


def _bounds(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Generalised force [nv] of dry friction and joint limits."""
    kinds = (
        mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF,
        mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT,
    )
    rows = np.isin(data.efc_type, [int(kind) for kind in kinds])
    return np.where(rows, data.efc_force, 0.0) @ dense(model, data)


def bodies(tree: Tree, moments: list[Moment]) -> tuple[np.ndarray, np.ndarray]:
    """Change of the loads per unit of a body term and of gravity.

    A changed body pulls at all joints at once, and the servos share what it adds.

    Returns:
        Of Loads, slopes left out: [3, m, J, b, BODY_TERMS], [3, m, J, GRAVITY_TERMS].
    """
    model, joints = tree.model, tree.moves.shape[1]
    variants = [
        [_Variant(*pair) for pair in changed(tree, k)] for k in range(len(tree.body))
    ]
    turned = []
    for change in np.eye(len(GRAVITY_TERMS)):
        other = mujoco.MjModel.__copy__(model)
        other.opt.gravity[:] += change
        turned.append(_Variant(other, 1.0))
    plain, dofs = _Variant(model, 1.0), _dofs(tree)
    found = np.zeros((3, len(moments), joints, joints, len(BODY_TERMS)))
    gravity = np.zeros((3, len(moments), joints, len(GRAVITY_TERMS)))
    for k, moment in enumerate(moments):
        force, mass = plain.taken(tree, moment)
        for joint, terms in enumerate(variants):
            for term, variant in enumerate(terms):
                pull, heavy = variant.taken(tree, moment)
                more = (heavy - mass) / variant.size
                rest = moment.answer.share @ (pull - force) / variant.size
                rest -= more * moment.acceleration[dofs]
                found[::2, k, :, joint, term] = rest, more
        for term, variant in enumerate(turned):
            pull, _ = variant.taken(tree, moment)
            gravity[0, k, :, term] = moment.answer.share @ (pull - force)
    return found, gravity


class _Variant:
    """A model that differs from the nominal one by `size` units of a term."""

    def __init__(self, model: mujoco.MjModel, size: float) -> None:
        self.model, self.size = model, size
        self.data = mujoco.MjData(model)
        self.dense = np.zeros((model.nv, model.nv))

    def taken(self, tree: Tree, moment: Moment) -> tuple[np.ndarray, np.ndarray]:
        """Force [nv] that the bodies take in a moment, and inertias M_jj [J]."""
        model, data = self.model, self.data
        data.qpos[:], data.qvel[:] = moment.position, moment.velocity
        data.qacc[:] = moment.acceleration
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        force = np.empty(model.nv)
        mujoco.mj_rne(model, data, 1, force)
        mujoco.mj_crb(model, data)
        mujoco.mj_fullM(model, data, self.dense)
        return force, (tree.moves * (self.dense @ tree.moves)).sum(0)


def drawn(rows: Rows, trace: Trace, robots: list[Draw], tree: Tree) -> np.ndarray:
    """Loads that tolerances of the whole robot add to each joint.

    Args:
        rows: of a run in S worlds of one time step, the first one nominal.
        trace: of the run.
        robots: of the S worlds.
        tree: of the model.

    Returns:
        [m, J, S - 1] N m, at the moments of the trace.
    """
    time, load = trace.motion.time, trace.load
    inertia, slope = (
        np.stack([np.interp(rows.time, time, s) for s in series.T], -1)
        for series in (load.inertia, load.slope)
    )
    rest = []
    for robot, angle, speed, torque in zip(
        robots, rows.angle, rows.velocity, rows.torque, strict=True
    ):
        damping = np.square(tree.moves).T @ robot.model.dof_damping
        friction = np.abs(tree.moves).T @ robot.model.dof_frictionloss
        own = torque - damping * speed - friction * np.tanh(speed / CREEP)
        own -= inertia * np.gradient(speed, rows.time, axis=0)
        rest.append(own - slope * (angle - rows.angle[0]))
    extra = np.stack(rest[1:], -1) - rest[0][..., None]
    return spread(time[::COARSE], rows.time, extra)
