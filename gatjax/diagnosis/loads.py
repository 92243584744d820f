"""What each joint went through in a recording: its load along the measured motion.

A joint of a fixed robot obeys (Featherstone 2008, eq. 6.1, one row)

    M_jj(q) q''_j + rest_j = servo torque - damping q'_j - dry friction,
    rest_j = bias_j(q, q') - spring_j(q) + sum_{k != j} M_jk(q) q''_k.

All other joints were measured, so M_jj and rest_j are known functions of time, and each
joint can be simulated alone: the cost of a diagnosis is linear in the joints.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import mujoco
import numpy as np

from gatjax.diagnosis.motion import Motion
from gatjax.diagnosis.regressor import Swing, carried, inertials, shifts
from gatjax.diagnosis.tolerances import Tolerances
from gatjax.sim.tied import ties

DRAWS = 40  # perturbed bodies
TERMS = 4  # load shapes that body tolerances may add
COARSE = 8  # points of a motion between two at which changed bodies are weighed
BODY_TERMS = ("mass", "com_x", "com_y", "com_z", "spin")
GRAVITY_TERMS = ("x", "y", "z")
Rows = np.ndarray | slice


class Load(NamedTuple):
    """What joint j moves at the rows of a run, N m, N m/rad and kg m^2, each [N, J]."""

    rest: np.ndarray
    slope: np.ndarray  # d rest / d q_j
    inertia: np.ndarray  # M_jj, armature included


class Tree:
    """The actuated joints of a model; joints tied by an equality move as one."""

    def __init__(self, model: mujoco.MjModel, joints: np.ndarray) -> None:
        """Keep the model; `joints` [J] are the ids of the actuated joints."""
        self.model = model
        self.qpos = model.jnt_qposadr[joints]
        self.body = model.jnt_bodyid[joints]
        self.axis = model.jnt_axis[joints]  # [J, 3], in the body's frame
        dofs = model.jnt_dofadr[joints]
        self.moves = np.zeros((model.nv, len(joints)))
        self.moves[dofs, np.arange(len(joints))] = 1.0
        self.ties: list[tuple[int, int, np.ndarray]] = []
        for follower, leader, ratio in zip(*ties(model), strict=True):
            if follower in joints or leader not in joints:
                continue
            column = int(np.flatnonzero(joints == leader)[0])
            self.moves[model.jnt_dofadr[follower], column] = ratio[1]
            self.ties.append((model.jnt_qposadr[follower], column, ratio))

    def placed(self, motion: Motion, rows: Rows = slice(None)) -> np.ndarray:
        """Positions of the physics [N, nq] at rows of a motion."""
        position = motion.position[rows]
        qpos = np.tile(self.model.qpos0, (len(position), 1))
        if motion.base is not None:
            qpos[:, :7] = motion.base.position[rows]
        qpos[:, self.qpos] = position
        for address, column, ratio in self.ties:
            turned = position[:, column] - self.model.qpos0[self.qpos[column]]
            qpos[:, address] = self.model.qpos0[address]
            qpos[:, address] += np.polyval(ratio[::-1], turned)
        return qpos

    def speeds(
        self, motion: Motion, rows: Rows = slice(None)
    ) -> tuple[np.ndarray, np.ndarray]:
        """Velocities and accelerations of the physics [N, nv] at rows of a motion."""
        speed = motion.velocity[rows] @ self.moves.T
        pushed = motion.acceleration[rows] @ self.moves.T
        if motion.base is not None:
            speed[:, :6] = motion.base.velocity[rows]
            pushed[:, :6] = motion.base.acceleration[rows]
        return speed, pushed

    def loads(self, motion: Motion) -> Load:
        """Loads of all joints along a motion; slopes are left 0."""
        model, moves = self.model, self.moves
        data, count = mujoco.MjData(model), len(motion.time)
        dense, bias = np.zeros((count, model.nv, model.nv)), np.empty((count, model.nv))
        qpos, (qvel, _) = self.placed(motion), self.speeds(motion)
        for row in range(count):
            data.qpos[:], data.qvel[:] = qpos[row], qvel[row]
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_fwdVelocity(model, data)
            mujoco.mj_fullM(model, data, dense[row])
            bias[row] = data.qfrc_bias - data.qfrc_spring - data.qfrc_gravcomp
        reduced, pushed = moves.T @ dense @ moves, motion.acceleration
        inertia = np.diagonal(reduced, axis1=1, axis2=2).copy()
        rest = bias @ moves - inertia * pushed
        rest += (reduced @ pushed[..., None])[..., 0]
        if motion.base is not None:
            along = motion.base.acceleration[..., None]
            rest += (moves.T @ dense[..., :6] @ along)[..., 0]
        return Load(rest, np.zeros_like(rest), inertia)

    def pulls(self, motion: Motion, rows: np.ndarray) -> np.ndarray:
        """What gravity pulls at each joint [N, J], N m."""
        model, data = self.model, mujoco.MjData(self.model)
        found = []
        for qpos in self.placed(motion, rows):
            data.qpos[:] = qpos
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_fwdVelocity(model, data)
            found.append(self.moves.T @ (data.qfrc_bias - data.qfrc_gravcomp))
        return np.stack(found)

    def slopes(self, motion: Motion, rows: np.ndarray) -> np.ndarray:
        """Derivative of the load of each joint at rest by its own angle [N, J]."""
        model, data = self.model, mujoco.MjData(self.model)
        step, joints = 1e-4, self.moves.shape[1]
        slope = np.zeros((len(rows), joints))
        for joint in range(joints):
            for sign in (-1.0, 1.0):
                position = motion.position.copy()
                position[:, joint] += sign * step
                qpos = self.placed(motion._replace(position=position), rows)
                for row in range(len(rows)):
                    data.qpos[:] = qpos[row]
                    mujoco.mj_kinematics(model, data)
                    mujoco.mj_comPos(model, data)
                    mujoco.mj_fwdVelocity(model, data)
                    force = data.qfrc_bias - data.qfrc_spring - data.qfrc_gravcomp
                    load = float(self.moves[:, joint] @ force)
                    slope[row, joint] += sign * load / (2.0 * step)
        return slope

    def turning(
        self, motion: Motion, rows: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """How what gravity pulls at a joint grows with its angle, per unit of a term.

        A mass with the lever S from an axis e has the potential -g.(c + S) and moves by
        e x S (by e along a slide), which an axis d before e turns with it: second
        derivatives of the potential are -g.(d x (e x S)), tied joints' added up.

        Returns:
            Of body terms [N, J, b, BODY_TERMS] and of gravity [N, J, GRAVITY_TERMS].
        """
        model, (axes, pivots, centres, frames) = self.model, self._places(motion, rows)
        falls = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
        borne = float(falls) * (1.0 - model.body_gravcomp)
        turns = model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
        bodies = np.zeros((len(rows), *2 * (len(self.body),), len(BODY_TERMS)))
        gravity = np.zeros((*bodies.shape[:2], len(GRAVITY_TERMS)))
        for joint, before, dof, part in self._pairs():
            first, axis = (axes[:, model.dof_jntid[d]] for d in (before, dof))
            across = -part * _crossing(first)
            away = np.repeat(axis[:, None], model.nbody, 1)
            if turns[model.dof_jntid[dof]]:
                across = across @ _crossing(axis)
                away = centres - pivots[:, model.dof_jntid[dof], None]
            pull = np.einsum("nji,j->ni", across, model.opt.gravity)
            weight = borne * model.body_mass
            weight = weight * carried(model, int(model.dof_bodyid[dof]))
            gravity[:, joint] += np.einsum("nij,nkj,k->ni", across, away, weight)
            for place, other in enumerate(self.body):
                share = borne[other] * bool(weight[other])
                slope = bodies[:, joint, place]
                slope[:, 0] += share * np.sum(away[:, other] * pull, -1)
                turned = np.einsum("nji,nj->ni", frames[:, other], pull)
                slope[:, 1:4] += weight[other] * turned * turns[model.dof_jntid[dof]]
        return bodies, gravity

    def _pairs(self) -> list[tuple[int, int, int, float]]:
        """Joint, hinge, a dof that it turns or itself, and the share of both in it."""
        found = []
        for joint, moves in enumerate(self.moves.T):
            dofs = np.flatnonzero(moves).tolist()
            for before, dof in itertools.combinations_with_replacement(dofs, 2):
                kind = self.model.jnt_type[self.model.dof_jntid[before]]
                if kind == mujoco.mjtJoint.mjJNT_SLIDE:
                    continue
                body, last = (int(self.model.dof_bodyid[d]) for d in (before, dof))
                if carried(self.model, body)[last]:
                    both = 1.0 if before == dof else 2.0
                    share = float(both * moves[before] * moves[dof])
                    found.append((joint, before, dof, share))
        return found

    def _places(self, motion: Motion, rows: np.ndarray) -> list[np.ndarray]:
        """Axes, anchors, centres of mass and frames [N, ...] in the world."""
        model, data = self.model, mujoco.MjData(self.model)
        found = []
        for qpos in self.placed(motion, rows):
            data.qpos[:] = qpos
            mujoco.mj_kinematics(model, data)
            frames = data.xmat.reshape(-1, 3, 3)
            own = data.xaxis, data.xanchor, data.xipos, frames
            found.append([each.copy() for each in own])
        return [np.stack(series) for series in zip(*found, strict=True)]


def _crossing(vectors: np.ndarray) -> np.ndarray:
    """Matrices [N, 3, 3] that give the cross product of vectors [N, 3] with others."""
    return np.cross(vectors[:, None, :], np.eye(3)).swapaxes(1, 2)


def perturbed(
    model: mujoco.MjModel, allowed: Tolerances, draw: np.random.Generator
) -> mujoco.MjModel:
    """A model with bodies and mounting drawn from their tolerances."""
    other, bodies = copied(model), (model.nbody, 3)
    other.body_mass *= 1.0 + allowed.mass * draw.normal(size=model.nbody)
    other.body_inertia *= 1.0 + allowed.inertia * draw.normal(size=bodies)
    moved = allowed.com * draw.normal(size=bodies)
    other.body_ipos += moved * (model.body_mass > 0)[:, None]
    other.opt.gravity[:] = tilted(model.opt.gravity, allowed.tilt * draw.normal(size=2))
    return other


def copied(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy whose bodies may change: without what the compiler saw it could skip."""
    other = mujoco.MjModel.__copy__(model)
    other.body_sameframe[:] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
    other.dof_simplenum[:] = 0
    return other


def tilted(gravity: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Gravity [3] m/s^2 as a mounting feels it, turned about x, then about y, rad."""
    roll, pitch = angles
    about_x = np.array(
        [[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]]
    )
    about_y = np.array(
        [
            [np.cos(pitch), 0, np.sin(pitch)],
            [0, 1, 0],
            [-np.sin(pitch), 0, np.cos(pitch)],
        ]
    )
    return (about_y @ about_x).T @ gravity


class Loads(NamedTuple):
    """Loads of a run: nominal ones, and what tolerances and body causes change.

    M points of the motion, m of them (every COARSE) for changed bodies.
    """

    nominal: Load
    pull: np.ndarray  # of gravity in the nominal rest [M, J], N m: turns with the link
    draws: np.ndarray  # rest and inertia of perturbed bodies [2, m, J, D]
    bodies: np.ndarray  # a Load per unit of a term of body b [3, m, J, b, BODY_TERMS]
    gravity: np.ndarray  # a Load per m/s^2 of gravity [3, m, J, GRAVITY_TERMS]


def weigh(tree: Tree, motion: Motion, others: list[mujoco.MjModel]) -> Loads:
    """Loads along a motion, of the nominal bodies and of changed ones."""
    nominal = tree.loads(motion)
    few = np.arange(0, len(motion.time), COARSE)
    slope, pull = (
        np.stack([np.interp(motion.time, motion.time[few], s) for s in series.T], -1)
        for series in (tree.slopes(motion, few), tree.pulls(motion, few))
    )
    changes = _changes(tree, motion, few, others)
    return Loads(nominal._replace(slope=slope), pull, *changes)


def _changes(
    tree: Tree, motion: Motion, few: np.ndarray, others: list[mujoco.MjModel]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What other bodies, a term of each body, and gravity change: as in Loads."""
    model, moves, pushed = tree.model, tree.moves, motion.acceleration[few]
    swing = Swing(model, tree.placed(motion, few), *tree.speeds(motion, few))
    nominal = inertials(model)
    drawn = np.stack([inertials(other) - nominal for other in others], -1)
    draws = np.zeros((2, *pushed.shape, len(others)))
    bodies = np.zeros((3, *pushed.shape, len(tree.body), len(BODY_TERMS)))
    gravity = np.zeros((3, *pushed.shape, len(GRAVITY_TERMS)))
    for body in range(1, model.nbody):
        inertia = swing.masses(body, moves)
        rest = moves.T @ swing.forces(body)
        load = np.stack([rest - inertia * pushed[..., None], inertia])
        draws += load @ drawn[body]
        for joint in np.flatnonzero(tree.body == body):
            bodies[::2, :, :, joint] = load @ shifts(model, body, tree.axis[joint]).T
    bodies[1], gravity[1] = tree.turning(motion, few)
    gravity[0] = moves.T @ swing.gravity()
    tilts = np.stack([other.opt.gravity - model.opt.gravity for other in others], -1)
    draws[0] += gravity[0] @ tilts
    return draws, bodies, gravity


def shapes(loads: list[Loads]) -> list[Load]:
    """Main load shapes that body tolerances may add, per run [m, J, TERMS].

    A unit of each is one standard deviation (principal components, joint by joint).
    Their slopes are left out: they are a few percent of the nominal one.
    """
    sizes = [(*load.draws[0].shape[:2], TERMS) for load in loads]
    out = [Load(*(np.zeros(size) for _ in Load._fields)) for size in sizes]
    for joint in range(loads[0].draws[0].shape[1]):
        flat = np.concatenate([l.draws[0][:, joint] for l in loads])
        _, right = np.linalg.eigh(flat.T @ flat)
        mix = right[:, : -TERMS - 1 : -1] / np.sqrt(flat.shape[1])
        for shape, load in zip(out, loads, strict=True):
            shape.rest[:, joint] = load.draws[0][:, joint] @ mix
            shape.inertia[:, joint] = load.draws[1][:, joint] @ mix
    return out
