"""The legs of N NAOs in DART: where they are, and the rotors that turn in them."""

from __future__ import annotations

from typing import NamedTuple

import dartpy
import numpy as np

from gatjax.surrogate.e1 import nominal
from gatjax.surrogate.skeleton import CHAIN, SIDES

TURN, PLACE = 3, 6  # ends of the coordinates that turn, and place, the torso


class Legs(NamedTuple):
    """Both legs of N robots, in the world frame."""

    axis: np.ndarray  # [N, 6, 2, 3] of the joints, unit length
    turn: np.ndarray  # [N, 2, 3, 3] of the feet
    place: np.ndarray  # [N, 2, 3] m, of the feet


def rotations(vector: np.ndarray) -> np.ndarray:
    """Rotation matrices [..., 3, 3] of rotation vectors [..., 3] rad (Rodrigues)."""
    angle = np.sqrt((vector * vector).sum(-1))[..., None, None]
    skew = _skew(vector)
    half = np.sinc(0.5 / np.pi * angle)
    return np.eye(3) + np.sinc(angle / np.pi) * skew + 0.5 * half**2 * (skew @ skew)


def _skew(vector: np.ndarray) -> np.ndarray:
    """Matrices [..., 3, 3] whose product with a vector is the cross product."""
    skew = np.zeros((*vector.shape, 3))
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0] = x, y, z
    skew[..., 1, 2], skew[..., 2, 0], skew[..., 0, 1] = -x, -y, -z
    return skew


class Chains:
    """The legs of any NAO; the frames of all their links are parallel in zero pose."""

    def __init__(self, robot: dartpy.dynamics.Skeleton) -> None:
        """Find them by name in DART's vectors."""
        model = nominal()
        names = [robot.getDof(index).getName() for index in range(robot.getNumDofs())]
        joints = [[side + name for side in SIDES] for name in CHAIN]
        links = np.array(
            [[int(model.joint(name).bodyid[0]) for name in row] for row in joints]
        )
        self.slots = np.array([[names.index(name) for name in row] for row in joints])
        self.axis = model.jnt_axis[model.body_jntadr[links]]  # [6, 2, 3]
        self.offset = model.body_pos[links]  # [6, 2, 3] m, from joint to joint
        self.inertia = model.dof_armature[model.body_dofadr[links]]  # [6, 2] kg m^2
        self._skew = _skew(self.axis)
        self._square = self._skew @ self._skew

    def at(self, position: np.ndarray) -> Legs:
        """Return the legs of robots with DART's positions [N, D]."""
        angle = position[:, self.slots][..., None, None]
        turn = np.eye(3) + np.sin(angle) * self._skew
        turn += (1.0 - np.cos(angle)) * self._square
        torso = rotations(position[:, :TURN])[:, None]
        above = np.empty_like(turn)  # of the links that carry the joints
        for level in range(len(CHAIN)):
            above[:, level] = turn[:, level - 1] if level else torso
            turn[:, level] = above[:, level] @ turn[:, level]
        axis = (turn @ self.axis[..., None])[..., 0]
        down = (above @ self.offset[..., None])[..., 0].sum(1)
        return Legs(axis, turn[:, -1], position[:, None, TURN:PLACE] + down)


class Rotors:
    """The rotors of N robots' legs: they turn against their housings.

    Of the energy in `skeleton` the mixed term is a torque on each link of a joint, the
    inertia times the angular acceleration of the other link about the axis, taken from
    the last two steps (at 1 ms this is a contraction for the NAO: factor 0.87).
    """

    def __init__(
        self, chains: Chains, position: np.ndarray, velocity: np.ndarray
    ) -> None:
        """Begin with DART's positions and velocities [N, D]."""
        self.chains = chains
        self.before = self.last = self._speeds(chains.at(position), velocity)

    def _speeds(self, legs: Legs, velocity: np.ndarray) -> np.ndarray:
        """Rates about the axes: of the links below, and above, [2, N, 6, 2] rad/s."""
        bend = velocity[:, self.chains.slots]
        turned = np.cumsum(legs.axis * bend[..., None], axis=1)
        turned += velocity[:, None, None, :TURN]
        below = (legs.axis * turned).sum(-1)
        return np.stack([below, below - bend])

    def act(self, legs: Legs, velocity: np.ndarray, step: float) -> np.ndarray:
        """Return the mixed torques in DART's coordinates [N, D], N m.

        Those of the torso are about the axes of the world.

        Args:
            legs: of the robots.
            velocity: of DART, [N, D].
            step: s, physics step that is about to be taken.
        """
        now = self._speeds(legs, velocity)
        torque = self.chains.inertia * (now - self.before) / (2.0 * step)
        self.before, self.last = self.last, now
        housing, own = torque[..., None] * legs.axis  # on the links above, and below
        own[:, :-1] += housing[:, 1:]
        carried = np.cumsum(own[:, ::-1], axis=1)[:, ::-1]  # of all links from here on
        force = np.zeros(velocity.shape)
        force[:, self.chains.slots] = (legs.axis * carried).sum(-1)
        force[:, :TURN] = (housing[:, 0] + carried[:, 0]).sum(1)
        return force
