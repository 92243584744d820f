"""How the rest of a standing robot answers when one joint moves otherwise.

The base is free and the feet stand, so a joint of a leg does not move its own link
alone: the other servos give way, the whole body tilts. For small deviations, with
joints j, masses M, dampers D and springs K of everything (servos of all joints,
contacts as MuJoCo makes them, gravity), one joint sees the impedance

    Z_j(s) = 1 / [(s^2 M + s D + K)^-1]_jj - own servo,
    Re Z_j(i w) = slope_j - w^2 inertia_j;

a slow and a fast w give slope and inertia, at least what the joint moves when nothing
holds the rest, 1 / [M^-1]_jj. MuJoCo's contacts are springs and dampers
along the normal, dampers across it (Todorov 2014, and its documentation, Computation).
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from gatjax.diagnosis.loads import Tree
from gatjax.effects.ground import touching

SLOW, FAST = 2.0 * np.pi * np.array([0.5, 4.0])  # rad/s, of what joints do


class Answer(NamedTuple):
    """What J joints see of a body that gives way, at one moment."""

    slope: np.ndarray  # [J] N m/rad
    inertia: np.ndarray  # [J] kg m^2
    share: np.ndarray  # [J, nv] of a slow generalised load, that each joint carries
    gives: np.ndarray  # [J] rad per N m that it carries, servo and all
    pushes: np.ndarray  # [nv, W] of unit forces (3), then moments (3), on each foot


class Frame:
    """A model's free coordinates: the base, then the joints with those tied to them."""

    def __init__(self, tree: Tree) -> None:
        """Take the joints of a tree."""
        model = tree.model
        self.tree = tree
        self.base = 6 if model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE else 0
        self.moves = np.zeros((model.nv, self.base + tree.moves.shape[1]))
        self.moves[: self.base, : self.base] = np.eye(self.base)
        self.moves[:, self.base :] = tree.moves
        feet = np.unique(model.geom_bodyid[touching(model)])
        self.feet = feet[model.body_weldid[feet] != 0]
        own = np.square(tree.moves).T @ model.dof_damping
        self.servo = np.zeros((2, self.moves.shape[1]))  # springs, dampers
        self.servo[0, self.base :] = model.actuator_gainprm[:, 0]
        self.servo[1, self.base :] = own - model.actuator_biasprm[:, 2]

    def matrices(
        self, model: mujoco.MjModel, data: mujoco.MjData
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mass, damping and stiffness [C, C] at a state that mj_forward has seen."""
        dense = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, dense)
        mass = self.moves.T @ dense @ self.moves
        spring, damper = self._contacts(model, data)
        spring = spring + np.diag(self.servo[0]) + self._gravity(model, data)
        return mass, damper + np.diag(self.servo[1]), spring

    def _contacts(
        self, model: mujoco.MjModel, data: mujoco.MjData
    ) -> tuple[np.ndarray, np.ndarray]:
        """Springs and dampers [C, C] of the contacts that carry."""
        rows = np.flatnonzero(
            (data.efc_type >= int(mujoco.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS))
            & (data.efc_state == int(mujoco.mjtConstraintState.mjCNSTRSTATE_QUADRATIC))
        )
        across = dense(model, data)[rows] @ self.moves
        stiff, damp, share = data.efc_KBIP.reshape(-1, 4)[rows, :3].T
        owner = data.efc_id[rows]
        along = np.stack(
            [across[owner == contact].mean(0) for contact in owner]
        ) if len(rows) else across  # fmt: skip
        weight = data.efc_D[rows]
        spring = across.T @ ((weight * stiff * share)[:, None] * along)
        return spring, across.T @ ((weight * damp)[:, None] * across)

    def _gravity(self, model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
        """Stiffness [C, C] of gravity and of the contact forces that carry it."""
        other = mujoco.MjData(model)
        held = [_Held(model, data, k) for k in range(data.ncon)]
        step, rows = 1e-4, []
        for column in self.moves.T:
            load = []
            for sign in (-1.0, 1.0):
                other.qpos[:] = data.qpos
                mujoco.mj_integratePos(model, other.qpos, sign * step * column, 1.0)
                mujoco.mj_kinematics(model, other)
                mujoco.mj_comPos(model, other)
                mujoco.mj_fwdVelocity(model, other)
                total = other.qfrc_bias - sum(h.push(model, other) for h in held)
                load.append(self.moves.T @ total)
            rows.append((load[1] - load[0]) / (2.0 * step))
        return np.stack(rows, -1)

    def answer(self, model: mujoco.MjModel, data: mujoco.MjData) -> Answer:
        """What joints see of the body at a state that mj_forward has seen."""
        mass, damper, spring = self.matrices(model, data)
        joints = slice(self.base, None)
        real, shares, gives = [], [], np.zeros(0)
        for rate in (SLOW, FAST):
            whole = spring + 1j * rate * damper - rate**2 * mass
            turned = np.linalg.inv(whole)
            gives = gives if len(gives) else np.real(np.diag(turned))[joints]
            shares.append((turned / np.diag(turned)[:, None]).real[joints])
            own = self.servo[0] + 1j * rate * self.servo[1]
            real.append(np.real(1.0 / np.diag(turned) - own)[joints])
        least = 1.0 / np.diag(np.linalg.inv(mass))[joints]
        inertia = np.maximum((real[0] - real[1]) / (FAST**2 - SLOW**2), least)
        return Answer(
            real[0] + SLOW**2 * inertia, inertia, shares[0] @ self.moves.T, gives,
            self._pushes(model, data),
        )  # fmt: skip

    def _pushes(self, model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
        """Generalised forces of unit wrenches on the bodies that touch the ground."""
        bodies = model.geom_bodyid[data.contact.geom]
        out = np.zeros((len(self.feet), 6, model.nv))
        for foot, push in zip(self.feet, out, strict=True):
            mine = (bodies == foot).any(1)
            if mine.any():
                point = data.contact.pos[mine].mean(0)
                mujoco.mj_jac(model, data, push[:3], push[3:], point, int(foot))
        return out.reshape(-1, model.nv).T


def dense(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Jacobian [rows, nv] of all constraints."""
    if not mujoco.mj_isSparse(model):
        return data.efc_J.reshape(data.nefc, model.nv)
    out = np.zeros((data.nefc, model.nv))
    for row, (first, count) in enumerate(
        zip(data.efc_J_rowadr, data.efc_J_rownnz, strict=True)
    ):
        part = slice(first, first + count)
        out[row, data.efc_J_colind[part]] = data.efc_J[part]
    return out


class _Held:
    """A contact force that stays, at points that stay of the bodies that it pushes."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, index: int) -> None:
        contact = data.contact[index]
        wrench = np.zeros(6)
        mujoco.mj_contactForce(model, data, index, wrench)
        force = contact.frame.reshape(3, 3).T @ wrench[:3]  # on the second geom
        self.sides: list[tuple[int, np.ndarray, np.ndarray]] = []
        for geom, sign in ((contact.geom1, -1.0), (contact.geom2, 1.0)):
            body = int(model.geom_bodyid[geom])
            if model.body_weldid[body] != 0:
                turn = data.xmat[body].reshape(3, 3)
                place = turn.T @ (contact.pos - data.xpos[body])
                self.sides.append((body, place, sign * force))

    def push(self, model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
        """Generalised force [nv] of the contact."""
        out, columns = np.zeros(model.nv), np.zeros((3, model.nv))
        for body, place, force in self.sides:
            point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ place
            mujoco.mj_jac(model, data, columns, None, point, body)
            out += columns.T @ force
        return out
