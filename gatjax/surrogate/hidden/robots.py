"""The robots of the hidden-effect cases: MJCF files beside this code."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

FOLDER = Path(__file__).parent
FLOOR = "nao_floor"
ROBOTS = ("arm_servo", "arm_two", "leg_six", "quad_hung", "nao_hung", FLOOR)
CROUCH = {"HipPitch": -0.44, "KneePitch": 0.92, "AnklePitch": -0.48}
ARMS = {
    "LShoulderPitch": 1.5, "RShoulderPitch": 1.5,
    "LShoulderRoll": 0.2, "RShoulderRoll": -0.2,
    "LElbowRoll": -0.5, "RElbowRoll": 0.5,
}  # fmt: skip
LEG_HOME = {"hip_pitch": -0.3, "knee": 0.6, "ankle_pitch": -0.2}
QUAD_HOME = {"hip": 0.4, "knee": -0.9}


class Robot(NamedTuple):
    """A nominal robot."""

    name: str
    xml: str  # the MJCF text that a solver gets
    model: mujoco.MjModel
    joints: tuple[str, ...]  # names of the J driven joints
    position: np.ndarray  # [J] int, their places in qpos
    velocity: np.ndarray  # [J] int, their places in qvel
    body: np.ndarray  # [J] int, the link that each joint moves
    home: np.ndarray  # [J] rad, centre of the motions
    low: np.ndarray  # [J] rad, where motions end
    high: np.ndarray  # [J] rad
    inertia: np.ndarray  # [J] kg m^2, diagonal of the mass matrix at home
    floating: bool  # stands on the floor


@lru_cache(maxsize=8)
def robot(name: str) -> Robot:
    """Returns a robot by name.

    Raises:
        ValueError: there is no such robot.
    """
    if name not in ROBOTS:
        raise ValueError(f"robot {name!r} is unknown; choose from {list(ROBOTS)}")
    xml = (FOLDER / f"{name}.xml").read_text(encoding="utf-8")
    model = mujoco.MjModel.from_xml_string(xml)
    slots = model.actuator_trnid[:, 0]
    joints = tuple(model.joint(slot).name for slot in slots)
    home = np.array([_home(name, joint) for joint in joints])
    low, high = model.jnt_range[slots].T
    room = 0.04 * (high - low)
    place, speed = model.jnt_qposadr[slots], model.jnt_dofadr[slots]
    return Robot(
        name=name,
        xml=xml,
        model=model,
        joints=joints,
        position=place,
        velocity=speed,
        body=model.jnt_bodyid[slots],
        home=np.clip(home, low + room, high - room),
        low=low + room,
        high=high - room,
        inertia=_inertia(model, place, home)[speed],
        floating=bool(model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE),
    )


def _home(name: str, joint: str) -> float:
    """The angle around which a joint moves, rad."""
    if name.startswith("nao"):
        return ARMS.get(joint, CROUCH.get(joint[1:], 0.0))
    if name == "quad_hung":
        return QUAD_HOME.get(joint.split("_")[-1], 0.0)
    return LEG_HOME.get(joint, 0.0)


def _inertia(model: mujoco.MjModel, place: np.ndarray, home: np.ndarray) -> np.ndarray:
    """Diagonal of the mass matrix [nv] at home, armature included."""
    data = mujoco.MjData(model)
    data.qpos[place] = home
    mujoco.mj_forward(model, data)
    columns = np.eye(model.nv)
    product = np.zeros_like(columns)
    for column, result in zip(columns, product, strict=True):
        mujoco.mj_mulM(model, data, result, column)
    return np.diag(product).copy()
