"""What each body adds to the forces at the joints, linear in its inertial numbers.

A body that turns at w and a (rad/s, rad/s^2), and whose frame accelerates by A beyond
gravity, all along its own axes, takes the force m A + a x h + w x (w x h) and about its
frame the torque h x A + I a + w x I w, with its mass m, first moment h = m c and
inertia I about the frame (Atkeson, An & Hollerbach 1986, load identification). What
it takes at a joint is that along the motion that a unit of the joint's speed gives it.
"""

from __future__ import annotations

import mujoco
import numpy as np

SIZE = 13  # inertial numbers of a body: m kg, h [3] kg m, I [3, 3] kg m^2, row by row


def inertials(model: mujoco.MjModel) -> np.ndarray:
    """Inertial numbers of all bodies [nbody, SIZE], along and about their frames."""
    found, turn = np.empty((model.nbody, SIZE)), np.empty(9)
    for body, row in enumerate(found):
        mujoco.mju_quat2Mat(turn, model.body_iquat[body])
        axes, mass = turn.reshape(3, 3), float(model.body_mass[body])
        centre = model.body_ipos[body]
        own = axes * model.body_inertia[body] @ axes.T
        row[0], row[1:4] = mass, mass * centre
        row[4:] = (own + mass * _away(centre, centre)).ravel()
    return found


def shifts(model: mujoco.MjModel, body: int, axis: np.ndarray) -> np.ndarray:
    """How the inertial numbers of a body grow [5, SIZE], per unit of a term each.

    The terms are a mass at its centre of mass, a shift of that along x, y and z, and a
    moment of inertia about an axis [3] and nothing else.
    """
    mass, centre = float(model.body_mass[body]), model.body_ipos[body]
    rows = [np.concatenate([[1.0], centre, _away(centre, centre).ravel()])]
    for unit in np.eye(3):
        more = _away(centre, unit) + _away(unit, centre)
        rows.append(mass * np.concatenate([[0.0], unit, more.ravel()]))
    spin = np.outer(axis, axis).ravel()
    return np.stack([*rows, np.concatenate([np.zeros(4), spin])])


def _away(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Inertia [3, 3] of a unit mass at a place, or how it grows with two of them."""
    return one @ other * np.eye(3) - np.outer(one, other)


class Swing:
    """How the bodies of a model move at N moments."""

    def __init__(
        self, model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray,
        qacc: np.ndarray,
    ) -> None:  # fmt: skip
        """Follow the bodies; qpos [N, nq], qvel and qacc [N, nv]."""
        self.model = model
        self._borne = np.stack(
            [carried(model, body) for body in model.dof_bodyid.tolist()]
        )
        data, series = mujoco.MjData(model), []
        for position, velocity in zip(qpos, qvel, strict=True):
            data.qpos[:], data.qvel[:] = position, velocity
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            middle = data.subtree_com[model.body_rootid]
            frames = data.xmat.reshape(-1, 3, 3)
            seen = (data.cdof, data.cvel, frames, data.xpos - middle)
            more = (data.xipos - middle, data.cdof_dot)
            series.append([each.copy() for each in (*seen, *more)])
        stacked = [np.stack(each) for each in zip(*series, strict=True)]
        self._dofs, self._speeds, self._frames, self._places = stacked[:4]
        self._centres, turning = stacked[4:]
        self._pushed = turning * qvel[..., None] + self._dofs * qacc[..., None]

    def forces(self, body: int) -> np.ndarray:
        """Force at each joint axis [N, nv, SIZE] per unit of a body's numbers."""
        speed = self._along(body, self._speeds[:, None, body])[:, 0]
        grown = self._borne[:, body] @ self._pushed
        grown = self._along(body, grown[:, None])[:, 0]
        spin, turned, model = speed[:, :3], grown[:, :3], self.model
        if not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
            weight = (1.0 - model.body_gravcomp[body]) * model.opt.gravity
            grown[:, 3:] -= self._turned(body, weight)
        pushed = grown[:, 3:] + np.cross(spin, speed[:, 3:])
        turn, move = np.split(self._moves(body), 2, axis=-1)
        pushed, spin, turned = (each[:, None] for each in (pushed, spin, turned))
        first = np.cross(pushed, turn) + np.cross(move, turned)
        first += np.cross(np.cross(move, spin), spin)
        square = turn[..., None] * turned[..., None, :]
        square += np.cross(turn, spin)[..., None] * spin[..., None, :]
        return _columns(np.sum(move * pushed, -1), first, square)

    def masses(self, body: int, moves: np.ndarray) -> np.ndarray:
        """Inertia that joints feel [N, J, SIZE] per unit of a body's numbers.

        `moves` [nv, J] are the speeds of all axes for a unit of each joint's.
        """
        turn, move = np.split(moves.T @ self._moves(body), 2, axis=-1)
        square = turn[..., None] * turn[..., None, :]
        return _columns(np.square(move).sum(-1), 2.0 * np.cross(move, turn), square)

    def gravity(self) -> np.ndarray:
        """Force at each joint axis [N, nv, 3] per m/s^2 of gravity in the world."""
        model, found = self.model, np.zeros((*self._dofs.shape[:2], 3))
        if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
            return found
        turn, move = np.split(self._dofs, 2, axis=-1)
        weights = model.body_mass * (1.0 - model.body_gravcomp)
        for body in np.flatnonzero(weights).tolist():
            falls = move + np.cross(turn, self._centres[:, None, body])
            found -= weights[body] * self._borne[:, body, None] * falls
        return found

    def _moves(self, body: int) -> np.ndarray:
        """What a unit of each axis' speed gives a body: turn and move [N, nv, 6]."""
        return self._along(body, self._dofs) * self._borne[:, body, None]

    def _along(self, body: int, motion: np.ndarray) -> np.ndarray:
        """Motions [N, k, 6] about the middle of a body's tree, as it sees them."""
        turn, move = np.split(motion, 2, axis=-1)
        move = move + np.cross(turn, self._places[:, None, body])
        turn, move = (self._turned(body, each) for each in (turn, move))
        return np.concatenate([turn, move], -1)

    def _turned(self, body: int, vectors: np.ndarray) -> np.ndarray:
        """Vectors of the world [..., 3] along the axes of a body."""
        return vectors @ self._frames[:, body]


def _columns(mass: np.ndarray, first: np.ndarray, square: np.ndarray) -> np.ndarray:
    flat = square.reshape(*square.shape[:-2], 9)
    return np.concatenate([mass[..., None], first, flat], -1)


def carried(model: mujoco.MjModel, body: int) -> np.ndarray:
    """Whether each body [nbody] moves with one, or is it."""
    found = np.zeros(model.nbody, bool)
    for other in range(body, model.nbody):
        found[other] = other == body or found[model.body_parentid[other]]
    return found
