"""The NAO as a DART skeleton, its rotors, and the floor under its soles.

All numbers come from the nominal MuJoCo model and E1. What DART lacks is written here:

- Rotor inertia. A rotor of reflected inertia I, whose housing sits on the parent, has
  the energy I (w_child - w_parent)^2 / 2 about the joint axis. The squares are folded
  into both links; the mixed term is a torque on each link, I times the angular
  acceleration of the other, taken from the last two steps (at 1 ms this is a
  contraction for the NAO: factor 0.87). All of I in the child alone, the usual
  shortcut, gives the legs rotational inertia that they do not have: with it the robots
  of both engines fall far earlier. Head and arms, whose rotors are small, use it.
- A floor with give. DART's contact is rigid; E1's floor is not (solref 0.02 s). Below
  each sole sphere lies a small plate that follows it as the tangent plane of the height
  map, and that a spring and a damper carry. A sphere of 5 mm on a grid of 30 mm touches
  nothing else.
"""

from __future__ import annotations

import dartpy
import mujoco
import numpy as np

from gatjax.records import FORCE_SENSORS
from gatjax.robot import nao
from gatjax.surrogate.e1 import E1, Body, inertials, nominal
from gatjax.surrogate.start import Floor

TORSO, FEET = "torso", ("LFoot", "RFoot")
LEG_JOINTS = ("YawPitch", "HipRoll", "HipPitch", "KneePitch", "AnklePitch", "AnkleRoll")
PLATE = 0.02  # m, side of a plate
PLATE_MASS = 0.3  # kg [A], little beside the foot's load; its damper needs it at 1 ms
LAID = 2e-4  # m, a plate follows its corner once it is this far (height error 2 um)
PLATE_STIFFNESS = 4e4  # N/m, E1's soft contact gives 0.2 mm at 8 N, measured in `stiff`
QUARTER = 0.25 * (nao.TOTAL_MASS + E1.extra_mass)  # kg, on one corner of a foot
PLATE_DAMPING = 2.0 / E1.floor_time_constant * QUARTER  # N s/m, rate of solref
World = dartpy.dynamics.Frame.World


def _hinge(model: mujoco.MjModel, link: int) -> dartpy.dynamics.RevoluteJointProperties:
    """Describe the hinge that carries a link of the nominal model."""
    hinge = dartpy.dynamics.RevoluteJointProperties()
    slot = model.body_jntadr[link]
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, model.body_quat[link])
    hinge.mName = model.joint(slot).name
    hinge.mAxis = model.jnt_axis[slot]
    hinge.mT_ParentBodyToJoint = dartpy.math.Isometry3(
        matrix.reshape(3, 3), model.body_pos[link]
    )
    return hinge


def _armature(model: mujoco.MjModel, link: int) -> np.ndarray:
    """Reflected inertia of a link's motor as a tensor [3, 3] kg m^2, link's frame."""
    slot = model.body_jntadr[link]
    axis = model.jnt_axis[slot]
    return model.dof_armature[model.jnt_dofadr[slot]] * np.outer(axis, axis)


def skeleton(body: Body) -> dartpy.dynamics.Skeleton:
    """Build a drawn robot; joints and links carry their names in the nominal model."""
    model, weights = nominal(), inertials(body)
    robot = dartpy.dynamics.Skeleton("nao")
    nodes = {}
    for link in range(1, model.nbody):
        inertia = weights.inertia[link - 1].copy()
        parent = model.body_parentid[link]
        if parent == 0:
            _, node = robot.createFreeJointAndBodyNodePair()
        else:
            hinge = _hinge(model, link)
            _, node = robot.createRevoluteJointAndBodyNodePair(nodes[parent], hinge)
            inertia += _armature(model, link)
        node.setName(model.body(link).name)
        mass, centre = weights.mass[link - 1], weights.centre[link - 1]
        node.setInertia(dartpy.dynamics.Inertia(mass, centre, inertia))
        nodes[link] = node
    _give_soles(model, robot)
    return robot


def _give_soles(model: mujoco.MjModel, robot: dartpy.dynamics.Skeleton) -> None:
    """Give the feet the sole spheres of the nominal model."""
    for name in FORCE_SENSORS:
        geom = model.geom(name).id
        foot = robot.getBodyNode(model.body(model.geom_bodyid[geom]).name)
        sphere = dartpy.dynamics.SphereShape(model.geom_size[geom, 0])
        _solid(foot, sphere, model.geom_pos[geom])


def _solid(
    node: dartpy.dynamics.BodyNode, shape: dartpy.dynamics.Shape, place: np.ndarray
) -> None:
    """Give a link a shape that touches things, `place` [3] m in the link's frame."""
    part = node.createShapeNode(shape)
    part.createCollisionAspect()
    part.createDynamicsAspect().setFrictionCoeff(E1.floor_friction)
    part.setRelativeTranslation(place)


class Rotors:
    """The rotors of the leg motors: they turn against their housings."""

    def __init__(self, robot: dartpy.dynamics.Skeleton) -> None:
        """Fold the parents' share into their links; frames are parallel in the NAO."""
        model = nominal()
        hinges = [
            link
            for link in range(2, model.nbody)
            if model.joint(model.body_jntadr[link]).name.endswith(LEG_JOINTS)
        ]
        names = [TORSO, *(model.body(link).name for link in hinges)]
        self.links = [robot.getBodyNode(name) for name in names]
        mixed = np.zeros((len(names), 3, len(names), 3))
        for link in hinges:
            child = names.index(model.body(link).name)
            parent = names.index(model.body(model.body_parentid[link]).name)
            tensor = _armature(model, link)
            mixed[child, :, parent] += tensor
            mixed[parent, :, child] += tensor
            old = self.links[parent].getInertia()
            self.links[parent].setInertia(
                dartpy.dynamics.Inertia(
                    old.getMass(), old.getLocalCOM(), old.getMoment() + tensor
                )
            )
        self.mixed = mixed.reshape(3 * len(names), 3 * len(names))
        self.before = self.last = self._turn()

    def _turn(self) -> np.ndarray:
        """Angular velocities of the links in their own frames, [3 L] rad/s."""
        world = World()
        return np.concatenate(
            [link.getAngularVelocity(world, link) for link in self.links]
        )

    def act(self, step: float) -> None:
        """Apply the mixed torques for a physics step that is about to be taken."""
        now = self._turn()
        change = (now - self.before) / (2.0 * step)
        self.before, self.last = self.last, now
        for link, torque in zip(
            self.links, (self.mixed @ change).reshape(-1, 3), strict=True
        ):
            link.addExtTorque(torque, True)


class Ground:
    """The eight pieces of floor, one under each sole corner."""

    def __init__(self, floor: Floor, robot: dartpy.dynamics.Skeleton) -> None:
        """Build the plates; `lay` puts them under the soles."""
        model = nominal()
        geoms = [model.geom(name).id for name in FORCE_SENSORS]
        self.floor = floor
        self.feet = [robot.getBodyNode(name) for name in FEET]
        self.corners = model.geom_pos[geoms].reshape(2, 4, 3)
        self.spheres = np.zeros((8, 3))  # m, world frame
        self.laid = np.full((8, 3), np.inf)  # where the plates were laid last
        self.place, self.turn = np.zeros((8, 3)), np.zeros((8, 3, 3))  # of the plates
        self.skeleton = dartpy.dynamics.Skeleton("floor")
        self.joints = [self._plate() for _ in FORCE_SENSORS]

    def _plate(self) -> dartpy.dynamics.PrismaticJoint:
        joint, node = self.skeleton.createPrismaticJointAndBodyNodePair()
        joint.setAxis([0.0, 0.0, 1.0])
        joint.setSpringStiffness(0, PLATE_STIFFNESS)
        joint.setDampingCoefficient(0, PLATE_DAMPING)
        node.setMass(PLATE_MASS)
        node.setGravityMode(False)
        box = dartpy.dynamics.BoxShape([PLATE] * 3)
        _solid(node, box, np.array([0.0, 0.0, -0.5 * PLATE]))
        return joint

    def lay(self) -> None:
        """Move each plate under its sole corner, tangent to the floor there."""
        for foot, corners, spheres in zip(
            self.feet, self.corners, (self.spheres[:4], self.spheres[4:]), strict=True
        ):
            frame = foot.getWorldTransform()
            spheres[:] = corners @ frame.rotation().T + frame.translation()
        moved = np.abs(self.spheres - self.laid).max(-1) > LAID
        if not moved.any():
            return
        self.laid[moved] = self.spheres[moved]
        height, slope = self.floor.at(self.spheres[:, :2])
        self._tilt(slope[:, 0], slope[:, 1])
        self.place[:, :2] = self.spheres[:, :2]
        self.place[:, 2] = height
        for plate in np.flatnonzero(moved):
            frame = dartpy.math.Isometry3(self.turn[plate], self.place[plate])
            self.joints[plate].setTransformFromParentBodyNode(frame)

    def _tilt(self, x: np.ndarray, y: np.ndarray) -> None:
        """Turn the plates to slopes x, y [8]: columns along, across, up."""
        up = 1.0 / np.sqrt(1.0 + x * x + y * y)
        along = 1.0 / np.sqrt(1.0 + x * x)
        turn = self.turn
        turn[:, 0, 0], turn[:, 2, 0] = along, x * along
        turn[:, 0, 2], turn[:, 1, 2], turn[:, 2, 2] = -x * up, -y * up, up
        turn[:, 0, 1] = -x * y * up * along
        turn[:, 1, 1] = (1.0 + x * x) * up * along
        turn[:, 2, 1] = y * up * along

    def forces(self, contacts: list) -> np.ndarray:
        """Forces of contacts on the eight sole corners [8], N, along the normals."""
        force = np.zeros(8)
        for contact in contacts:
            near = np.argmin(((self.spheres - contact.point) ** 2).sum(-1))
            force[near] += abs(contact.force @ contact.normal)
        return force
