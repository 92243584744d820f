"""The MuJoCo model of a robot and where its joints and sensors lie."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from gatjax.records import JOINTS
from gatjax.robot.nao import MODEL_FILE


class Slots(NamedTuple):
    """Where the actuated joints and the sensors lie in the state vectors."""

    position: np.ndarray  # [J] into qpos
    velocity: np.ndarray  # [J] into qvel
    gyro: np.ndarray  # [3] into sensordata, [0] without one; the same of the next
    accelerometer: np.ndarray
    force: np.ndarray  # [F] of all touch sensors


class Held(NamedTuple):
    """Hinges that do not move, for a model that has no more than the others need."""

    angles: Mapping[str, float]  # rad, by joint
    masses: mujoco.MjModel  # the same model, whose bodies say what each weighs


HUNG = "nao_hung"  # the NAO with its torso held in the air
SHIPPED = ("nao", HUNG)  # models that come with gatjax
BASE = 1  # body that carries all others
HEIGHT = 1.5  # m, of the held torso: no joint angle lets the feet touch the floor


def model_file(path: str | Path) -> Path:
    """Return the MJCF file that a path, or the name of a shipped model, means."""
    return MODEL_FILE if str(path) in SHIPPED else Path(path)


def spec_of(path: str | Path) -> mujoco.MjSpec:
    """Return a model, as `load` takes it, to be changed and compiled.

    Raises:
        ValueError: the file is no MJCF model.
    """
    spec = mujoco.MjSpec.from_file(str(model_file(path)))
    if str(path) == HUNG:
        spec.modelname = HUNG
        spec.delete(spec.joint("base"))
        for key in list(spec.keys):
            spec.delete(key)
        spec.body("torso").pos = [0.0, 0.0, HEIGHT]
    return spec


def load(
    path: str | Path = "nao",
    timestep: float | None = None,
    held: Held | None = None,
) -> mujoco.MjModel:
    """Load a MuJoCo model; `nao` and `nao_hung` come with gatjax.

    MuJoCo leaves the off-diagonal mass terms of a body out that needs none as it is in
    the file (`body/simple`), and would stop when a cause shifts its centre of mass.

    A servo without a torque limit gets an infinite one: it never acts, but it can be
    lowered in compiled code, where it is fixed which servos have one. A limit that the
    joint has (`actuatorfrcrange`) becomes its servo's, so that causes act on it.

    Args:
        path: MJCF file, or a name in SHIPPED.
        timestep: physics step in s, if it shall differ from the file's.
        held: hinges that the model shall lack, with their servos; bodies without a
            joint become one with those that carry them, geoms that touch nothing go.
    """
    file = model_file(path)
    if not file.is_file():
        near = get_close_matches(str(path), SHIPPED, n=1)
        meant = f"did you mean {near[0]}" if near else "give an MJCF file"
        raise FileNotFoundError(f"model file {file} does not exist; {meant}")
    if file.suffix == ".json":
        raise ValueError(f"{file} is no MJCF model; a world file is given as --world")
    try:
        spec = spec_of(path)
        if held is not None:
            _hold(spec, held)
        model = spec.compile()
        if model.body_simple[1:].any():
            for body in spec.bodies[1:]:
                body.simple = 0
            model = spec.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise ValueError(f"{file} is not a valid MJCF model: {reason}") from error
    if timestep is not None:
        model.opt.timestep = timestep
    model.actuator_forcerange[model.actuator_forcelimited == 0] = -np.inf, np.inf
    model.actuator_forcelimited[:] = 1
    _take_over_limits(model)
    _straighten(model)
    return model


def _straighten(model: mujoco.MjModel) -> None:
    """Turn inertial sensors of the torso as it is: logs have its axes (docs/files.md).

    However they are mounted, robots tell rates and accelerations in the torso's frame.
    """
    kinds = mujoco.mjtSensor
    inertial = np.isin(
        model.sensor_type, (kinds.mjSENS_GYRO, kinds.mjSENS_ACCELEROMETER)
    )
    sites = model.sensor_objid[inertial]
    sites = sites[model.site_bodyid[sites] == BASE]
    model.site_quat[sites] = 1.0, 0.0, 0.0, 0.0
    model.site_sameframe[sites] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE


def _take_over_limits(model: mujoco.MjModel) -> None:
    """Make a joint's limit of torque that of the servo that alone drives it."""
    for index, (joint, _) in enumerate(model.actuator_trnid):
        driven = model.actuator_trntype[index] == mujoco.mjtTrn.mjTRN_JOINT
        alone = (model.actuator_trnid[:, 0] == joint).sum() == 1
        gear = model.actuator_gear[index, 0]
        if not (driven and alone and gear and model.jnt_actfrclimited[joint]):
            continue
        ends = np.sort(model.jnt_actfrcrange[joint] / gear)
        low, high = model.actuator_forcerange[index]
        model.actuator_forcerange[index] = max(low, ends[0]), min(high, ends[1])
        model.jnt_actfrclimited[joint] = model.jnt_actgravcomp[joint]  # holds for both


def _hold(spec: mujoco.MjSpec, held: Held) -> None:
    """Take hinges away, and all that no longer has to be computed."""
    for number, body in enumerate(spec.bodies[1:], start=1):
        like = held.masses.body(number)
        body.mass, body.explicitinertial = float(like.mass[0]), 1
        body.ipos, body.iquat, body.inertia = like.ipos, like.iquat, like.inertia
        body.fullinertia = np.full(6, np.nan)
    spec.compiler.inertiafromgeom = 0
    for joint, angle in held.angles.items():
        _weld(spec, joint, angle)
    for seen in [*spec.cameras, *spec.lights]:  # MJX-Warp places them in every step
        spec.delete(seen)
    spec.compiler.fusestatic = spec.compiler.discardvisual = 1


def _weld(spec: mujoco.MjSpec, name: str, angle: float) -> None:
    """Turn a hinge's body by an angle, rad, and take the hinge and its servo away."""
    joint = spec.joint(name)
    body = joint.parent
    if body.alt.type != mujoco.mjtOrientation.mjORIENTATION_QUAT:
        raise ValueError(
            f"body {body.name!r}: write its orientation as quat, or take --model full"
        )
    axis, before, at = (np.array(v, float) for v in (joint.axis, body.quat, joint.pos))
    axis, before = axis / np.linalg.norm(axis), before / np.linalg.norm(before)
    zero = np.deg2rad(joint.ref) if spec.compiler.degree else joint.ref
    turn, pose, moved = np.zeros(4), np.zeros(4), np.zeros(3)
    mujoco.mju_axisAngle2Quat(turn, axis, angle - zero)
    mujoco.mju_rotVecQuat(moved, at, turn)
    mujoco.mju_rotVecQuat(moved, at - moved, before)
    mujoco.mju_mulQuat(pose, before, turn)
    body.quat, body.pos = pose, np.array(body.pos) + moved
    for key in list(spec.keys):  # of another size
        spec.delete(key)
    for servo in [each for each in spec.actuators if each.target == name]:
        spec.delete(servo)
    spec.delete(joint)


def joint_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Names of the joints that the actuators drive, in actuator order."""
    ids = model.actuator_trnid[:, 0]
    wrong = model.actuator_trntype != mujoco.mjtTrn.mjTRN_JOINT
    if wrong.any():
        name = model.actuator(int(np.flatnonzero(wrong)[0])).name
        raise ValueError(f"actuator {name!r} drives no joint; use joint actuators")
    return tuple(model.joint(int(index)).name for index in ids)


def servoed(model: mujoco.MjModel) -> bool:
    """Whether the actuators are position servos; else their commands are no angles."""
    return bool((model.actuator_biasprm[:, 1] != 0.0).all())


def command_range(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest command [J] of the actuators; infinite without a limit."""
    free = model.actuator_ctrllimited == 0
    low, high = np.where(free[:, None], [-np.inf, np.inf], model.actuator_ctrlrange).T
    return low, high


def check_walker(model: mujoco.MjModel, name: str) -> None:
    """Refuse a model that the walk is not made for.

    Args:
        model: whose joints must be a NAO's, in the order of `records.JOINTS`.
        name: of the model, for the message.

    Raises:
        ValueError: one line.
    """
    if joint_names(model) != JOINTS:
        raise ValueError(
            f"{name}: only a NAO can walk; gatjax collect --motion rich --robot "
            f"simulator --world records motions of any other robot"
        )
    if model.jnt_type[0] != mujoco.mjtJoint.mjJNT_FREE:
        raise ValueError(
            f"{name}: this NAO hangs and cannot walk; use a world of the model nao "
            f"(of a run with --explain: its extended.json)"
        )


def _sensors(model: mujoco.MjModel, kind: mujoco.mjtSensor) -> np.ndarray:
    """Numbers of the sensors of one kind, in the model's order."""
    return np.flatnonzero(model.sensor_type == kind)


def _inertial(model: mujoco.MjModel, kind: mujoco.mjtSensor) -> np.ndarray:
    """Number of the gyro or accelerometer that counts: [1], or none [0]."""
    ids = _sensors(model, kind)
    bodies = model.site_bodyid[model.sensor_objid[ids]]
    return ids[np.argsort(bodies != BASE, kind="stable")][:1]


def _places(model: mujoco.MjModel, ids: np.ndarray) -> np.ndarray:
    """Where sensors lie in sensordata, one after the other."""
    parts = [model.sensor_adr[k] + np.arange(model.sensor_dim[k]) for k in ids]
    return np.concatenate([np.zeros(0, int), *parts])


def slots(model: mujoco.MjModel) -> Slots:
    """Find the actuated joints and the sensors of a model, once.

    Of several gyros or accelerometers the first at the base counts.
    """
    ids, kinds = model.actuator_trnid[:, 0], mujoco.mjtSensor
    return Slots(
        position=model.jnt_qposadr[ids],
        velocity=model.jnt_dofadr[ids],
        gyro=_places(model, _inertial(model, kinds.mjSENS_GYRO)),
        accelerometer=_places(model, _inertial(model, kinds.mjSENS_ACCELEROMETER)),
        force=_places(model, _sensors(model, kinds.mjSENS_TOUCH)),
    )
