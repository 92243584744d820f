"""The NAO as a DART skeleton, built from the nominal MuJoCo model and E1.

DART has no rotors. One of reflected inertia I, whose housing sits on the parent, has
the energy I (w_child - w_parent)^2 / 2 about the joint axis. Here the squares are
folded into both links; the mixed term is `legs.Rotors`. All of I in the child alone,
the usual shortcut, gives the legs rotational inertia that they do not have: with it the
robots of both engines fall far earlier. Head and arms, whose rotors are small, use it.
"""

from __future__ import annotations

import dartpy
import mujoco
import numpy as np

from gatjax.records import FORCE_SENSORS
from gatjax.surrogate.e1 import E1, Body, inertials, nominal

TORSO, SIDES = "torso", "LR"
CHAIN = (
    "HipYawPitch", "HipRoll", "HipPitch", "KneePitch", "AnklePitch", "AnkleRoll",
)  # fmt: skip
"""Joints of a leg, down from the torso."""


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


def _housings(model: mujoco.MjModel, link: int) -> np.ndarray:
    """Tensor [3, 3] kg m^2 of the rotors of leg joints that a link carries."""
    below = np.flatnonzero(model.body_parentid == link).tolist()
    legs = [b for b in below if model.joint(model.body_jntadr[b]).name.endswith(CHAIN)]
    return sum((_armature(model, each) for each in legs), np.zeros((3, 3)))


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
        inertia += _housings(model, link)
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
        solid(foot, sphere, model.geom_pos[geom])


def solid(
    node: dartpy.dynamics.BodyNode, shape: dartpy.dynamics.Shape, place: np.ndarray
) -> None:
    """Give a link a shape that touches things, `place` [3] m in the link's frame."""
    part = node.createShapeNode(shape)
    part.createCollisionAspect()
    part.createDynamicsAspect().setFrictionCoeff(E1.floor_friction)
    part.setRelativeTranslation(place)
