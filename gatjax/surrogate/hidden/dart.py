"""The plant in DART, for robots with a fixed base: another engine, another integrator.

DART gives mass matrix and bias forces of the tree; rotor inertias come on the diagonal
and the step is semi-implicit Euler. What is in the joints is `drive`'s.
"""

from __future__ import annotations

from collections.abc import Sequence

import dartpy
import mujoco
import numpy as np

from gatjax.surrogate.hidden.drive import Drive
from gatjax.surrogate.hidden.numbers import Numbers, stack
from gatjax.surrogate.hidden.plant import PIECE, SETTLE, History, Tape
from gatjax.surrogate.hidden.rigid import gravity
from gatjax.surrogate.hidden.robots import Robot
from gatjax.surrogate.hidden.targets import Lane, Targets

STEP = 0.0005  # s


def _matrix(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrix [3, 3] of a quaternion w x y z."""
    out = np.zeros(9)
    mujoco.mju_quat2Mat(out, quaternion)
    return out.reshape(3, 3)


def _hinge(
    model: mujoco.MjModel, body: int, carrier: dartpy.math.Isometry3
) -> dartpy.dynamics.RevoluteJointProperties:
    """The hinge of a body, in a frame that sits at `carrier` on the link before."""
    own = dartpy.math.Isometry3(_matrix(model.body_quat[body]), model.body_pos[body])
    slot = model.body_jntadr[body]
    hinge = dartpy.dynamics.RevoluteJointProperties()
    hinge.mName = model.joint(slot).name
    hinge.mAxis = model.jnt_axis[slot]
    hinge.mT_ParentBodyToJoint = carrier.multiply(own)
    return hinge


def skeleton(robot: Robot, numbers: Numbers) -> dartpy.dynamics.Skeleton:
    """Builds one specimen.

    Args:
        robot: a tree of hinges at the origins of their links, on bodies that stand.
        numbers: of one specimen.

    Raises:
        ValueError: the robot floats, or has coupled or displaced hinges or a link that
            is welded to another.
    """
    model = robot.model
    if robot.floating or model.neq or np.any(model.jnt_pos):
        raise ValueError(f"{robot.name} is not a plain tree of hinges on a fixed base")
    tree = dartpy.dynamics.Skeleton(robot.name)
    still = dartpy.math.Isometry3()
    nodes: dict[int, dartpy.dynamics.BodyNode] = {}
    stands = {0: still}  # bodies that never move, and where they are
    for body in range(1, model.nbody):
        parent = int(model.body_parentid[body])
        if model.body_jntnum[body] == 0:
            if parent not in stands:
                raise ValueError(f"{robot.name}: link {body} is welded to a link")
            turn, place = _matrix(model.body_quat[body]), model.body_pos[body]
            own = dartpy.math.Isometry3(turn, place)
            stands[body] = stands[parent].multiply(own)
            continue
        hinge = _hinge(model, body, stands.get(parent, still))
        _, node = tree.createRevoluteJointAndBodyNodePair(nodes.get(parent), hinge)
        node.setName(model.body(body).name)
        axes = _matrix(model.body_iquat[body])
        moment = axes @ np.diag(numbers["inertia"][body]) @ axes.T
        mass, centre = float(numbers["mass"][body]), numbers["centre"][body]
        node.setInertia(dartpy.dynamics.Inertia(mass, centre, moment))
        nodes[body] = node
    tree.setGravity(gravity(numbers["tilt"][None])[0])
    return tree


class Flock:
    """The rigid bodies of L robots."""

    def __init__(self, robot: Robot, lanes: Sequence[Lane]) -> None:
        """Builds them at their first commands."""
        self.trees = [skeleton(robot, lane.specimen.numbers) for lane in lanes]
        tree = self.trees[0]
        names = [tree.getDof(index).getName() for index in range(tree.getNumDofs())]
        # joints in DART's order, commands in the actuators' order
        self.slots = np.array([names.index(name) for name in robot.joints])
        self.angle = np.stack([lane.log.commands[0] for lane in lanes])
        self.speed = np.zeros_like(self.angle)

    def advance(self, torque: np.ndarray, armature: np.ndarray) -> None:
        """One step under torques [L, J] N m with rotors [L, J] kg m^2."""
        count = self.angle.shape[1]
        mass = np.empty((len(self.trees), count, count))
        bias = np.empty_like(self.angle)
        angle, speed = np.empty_like(self.angle), np.empty_like(self.speed)
        angle[:, self.slots], speed[:, self.slots] = self.angle, self.speed
        for row, tree in enumerate(self.trees):
            tree.setPositions(angle[row])
            tree.setVelocities(speed[row])
            mass[row] = tree.getMassMatrix()
            bias[row] = tree.getCoriolisAndGravityForces()
        mass = mass[:, self.slots][:, :, self.slots]
        diagonal = np.arange(count)
        mass[:, diagonal, diagonal] += armature
        push = torque - bias[:, self.slots]
        turn = np.linalg.solve(mass, push[..., None])[..., 0]
        self.speed = self.speed + STEP * turn
        self.angle = self.angle + STEP * self.speed


def simulate(robot: Robot, lanes: Sequence[Lane]) -> list[History]:
    """Lets L robots run; see `rigid.simulate`.

    Raises:
        ValueError: not a plain tree of hinges on a fixed base.
    """
    specimens = [lane.specimen for lane in lanes]
    numbers = stack(specimens)
    own = numbers["armature"][:, robot.velocity]
    drive = Drive(specimens, own, STEP)
    armature = drive.link_armature(own)
    flock = Flock(robot, lanes)
    drive.start(flock.angle)
    targets = Targets(lanes, numbers, STEP)
    tape = Tape(lanes, 0, STEP)
    start, size = round(SETTLE / STEP), round(PIECE / STEP)
    none = np.zeros((len(lanes), 0))
    for index in range(tape.steps):
        if index % size == 0:
            piece = targets.piece(index - start, size)
        now = (index - start) * STEP
        torque = drive.act(now, piece[index % size], flock.angle, flock.speed)
        if tape.due(index):
            lost = drive.servo.lost().reshape(torque.shape)
            pull = drive.now.torque.reshape(torque.shape)
            tape.keep(index, (drive.seen(), flock.speed, pull, lost), none)
        flock.advance(torque, armature)
    return tape.histories()
