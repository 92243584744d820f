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
)
from gatjax.diagnosis.motion import FINE, LEAD, Motion, Ride, cells, spread
from gatjax.diagnosis.regressor import Swing, shifts
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
    ride = Ride(*(np.zeros((len(time), width)) for width in (7, 6, 6)))
    for point in range(len(time)):
        position[point] = data.qpos[tree.qpos]
        velocity[point] = data.qvel[_dofs(tree)]
        ride.position[point], ride.velocity[point] = data.qpos[:7], data.qvel[:6]
        if point % COARSE == 0:
            mujoco.mj_forward(model, data)
            answer = frame.answer(model, data)
            slope[point], inertia[point] = answer.slope, answer.inertia
            state = (data.qpos.copy(), data.qvel.copy(), data.qacc.copy())
            moments.append(Moment(*state, answer))
        for step in range(FINE):
            data.ctrl[:] = targets[point * FINE + step]
            before = data.qvel.copy()
            mujoco.mj_step(model, data)
            given = data.qfrc_actuator + data.qfrc_passive + _bounds(model, data)
            carried[point] += tree.moves.T @ given / FINE
            pushed = (data.qvel - before) / (STEP * FINE)
            acceleration[point] += pushed[_dofs(tree)]
            ride.acceleration[point] += pushed[:6]
    few = np.arange(0, len(time), COARSE)
    slope, inertia = (
        np.stack([np.interp(time, time[few], s) for s in series[few].T], -1)
        for series in (slope, inertia)
    )
    motion = Motion(time, position, velocity, acceleration, ride)
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
    position, velocity, acceleration, answers = zip(*moments, strict=True)
    swing = Swing(tree.model, *map(np.stack, (position, velocity, acceleration)))
    share = np.stack([answer.share for answer in answers])
    own = np.stack(acceleration)[:, _dofs(tree), None]
    found = np.zeros((3, *own.shape[:2], len(tree.body), len(BODY_TERMS)))
    for joint, body in enumerate(tree.body.tolist()):
        terms = shifts(tree.model, body, tree.axis[joint]).T
        inertia = swing.masses(body, tree.moves) @ terms
        rest = share @ swing.forces(body) @ terms - inertia * own
        found[::2, :, :, joint] = rest, inertia
    gravity = np.zeros((3, *own.shape[:2], len(GRAVITY_TERMS)))
    gravity[0] = share @ swing.gravity()
    return found, gravity


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
