"""From a verdict to a World: its causes, and the tolerances fitted beside them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from gatjax.diagnosis import drops, plant
from gatjax.diagnosis.claims import Claim
from gatjax.diagnosis.hypotheses import COUNT, TOLERANCES, numbers
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.verdict import Verdict
from gatjax.effects.catalogue import CATALOGUE
from gatjax.robot import model as robot_model
from gatjax.sim import causes, derived
from gatjax.sim import world as worlds
from gatjax.sim.world import World
from gatjax.task import Task

TIMESTEP = 5e-4  # s: a position servo's angle is off by its motion in half a step
LEAST = 0.25  # of its tolerance: a smaller correction is left out
Row = dict[str, Any]


def parameters(judge: Judge, claim: Claim) -> dict[str, float]:
    """A claim's parameters under the catalogue's names, SI; the scored one first."""
    if claim.stance is not None:
        return claim.stance.values
    case, index = judge.case, claim.where[0]
    if claim.lost:
        pairs = [
            (mask, command)
            for k, masks in claim.lost.items()
            for mask, command in zip(masks, case.commands(k), strict=True)
        ]
        return drops.statistics(*zip(*pairs, strict=True))
    joint = judge.joints[index]
    values = claim.hypothesis.values(joint, claim.own)
    return {name: float(value) for name, value in values.items()}


def world_values(judge: Judge, claim: Claim) -> dict[str, float]:
    """A claim's parameters as the World's effect takes them."""
    values = parameters(judge, claim)
    if claim.stance is not None:
        return values
    cause, nominal = claim.hypothesis.cause, judge.joints[claim.where[0]].nominal
    if cause == "speed_limit":
        on_motor = "no_torque_speed" in values
        limit = values.get("no_torque_speed", values["limit"])
        return {"limit": limit, "on_motor": float(on_motor)}
    if cause == "thermal_derating":
        heat = values["lost_fraction"] * nominal["limit"] ** 2 / np.exp(claim.own[0])
        return values | {"heat": float(max(heat, 1e-12))}
    if cause == "supply_sag":
        return values | {"total": judge.case.supply}
    if cause == "joint_elasticity":
        return values | {"damping_ratio": plant.DAMPING_RATIO}
    return values


def places(judge: Judge, claim: Claim) -> list[str]:
    """Names of the joints of a claim, or ["all"]; imu, ground or a foot."""
    joints = judge.joints
    if claim.stance is not None:
        return [claim.stance.where]
    if CATALOGUE[claim.hypothesis.cause].place == "all":
        return ["all"]
    if len(claim.where) == len(joints) > 1:
        return ["all"]
    return [joints[k].name for k in claim.where]


def calibration(verdict: Verdict) -> list[Row]:
    """Corrections of nominal numbers within their tolerances, as rows of a world."""
    rows: list[Row] = []
    model = verdict.judge.case.model
    for joint, fit in zip(verdict.judge.joints, verdict.judge.known, strict=True):
        if joint.index in verdict.unexplained:
            continue  # its tolerances imitate what is not known
        x = dict(zip(TOLERANCES, fit.x[:COUNT], strict=True))
        drive = joint.nominal | numbers(joint, None, fit.x[:COUNT])
        dof = model.jnt_dofadr[model.actuator_trnid[joint.index, 0]]
        more = {  # of the driven joint alone, where others are tied to it
            name: max(drive[name] - joint.nominal[name], -float(own[dof]))
            for name, own in (
                ("damping", model.dof_damping), ("friction", model.dof_frictionloss),
                ("armature", model.dof_armature),
            )
        }  # fmt: skip
        changes: dict[str, tuple[str, float]] = {
            "kp": ("gain_error", drive["kp"] / joint.nominal["kp"]),
            "kv": ("damping_error", drive["kv"] / max(joint.nominal["kv"], 1e-9)),
            "damping": ("viscous_friction", more["damping"]),
            "friction": ("coulomb_friction", more["friction"]),
            "armature": ("armature", more["armature"]),
            "limit": ("torque_limit", drive["limit"]),
            "zero_out": ("encoder_offset", drive["zero_out"]),
            "delay": ("command_delay", drive["delay"]),
        }
        for name, (cause, value) in changes.items():
            stronger = name == "limit" and drive["limit"] > joint.nominal["limit"]
            if abs(x[name]) < LEAST or stronger:
                continue
            values = {CATALOGUE[cause].main.name: float(value)}
            rows.append(
                {"cause": cause, "where": [joint.name], "values": values,
                 "role": "calibration"}
            )  # fmt: skip
    return sorted(rows, key=lambda row: row["cause"])  # so that they share effects


def extended(
    verdict: Verdict, source: str | Path, period: float, rows: list[Row]
) -> World:
    """The nominal world with the verdict's causes and rows of calibration.

    Args:
        verdict: of the diagnosis.
        source: model file.
        period: control period, s.
        rows: from `calibration`, or none.
    """
    world = worlds.nominal(Task(control_period=period), source, TIMESTEP)
    for cause in verdict.causes:
        claim = cause.claim
        where = places(verdict.judge, claim)
        values = world_values(verdict.judge, claim)
        world = worlds.add_cause(world, claim.hypothesis.cause, where, values)
    for row in rows:
        world = worlds.add_cause(
            world, row["cause"], row["where"], row["values"], row["role"]
        )
    return world


def write_model(path: Path, world: World) -> list[str]:
    """Write what plain MJCF can express of a world; return what it cannot.

    Args:
        path: of the new MJCF file.
        world: with a model file as its source.
    """
    file = robot_model.model_file(world.source).resolve()
    spec, model = mujoco.MjSpec.from_file(str(file)), world.model
    spec.compile()
    fields, _ = causes.of_model(model, world.causes)  # gears left out
    changed = mujoco.MjModel.__copy__(model)
    derived.settle(changed, fields)
    _write_servos(spec, changed)
    if "body_ipos" in fields:
        _write_bodies(spec, changed)
    _write_geoms(spec, model, changed)
    spec.option.gravity[:] = changed.opt.gravity
    spec.option.iterations = changed.opt.iterations
    spec.option.ls_iterations = changed.opt.ls_iterations
    assets = (*spec.meshes, *spec.hfields, *spec.skins, *spec.textures)
    if any(each.file for each in assets):
        compiler = spec.compiler
        compiler.meshdir = str(file.parent / compiler.meshdir)
        compiler.texturedir = str(file.parent / compiler.texturedir)
    path.write_text(spec.to_xml(), encoding="utf-8")
    return lacking(world)


def lacking(world: World) -> list[str]:
    """Causes of a world that plain MJCF cannot express, in words."""
    return [
        f"{row['cause']} at {', '.join(row['where'])}: {_told(row['values'])}"
        for row in world.causes
        if any(part.slot != "body" for part in CATALOGUE[row["cause"]].parts)
    ]


def _write_servos(spec: mujoco.MjSpec, changed: mujoco.MjModel) -> None:
    """Write driven joints and their servos; a torque limit where there is one."""
    joints = {joint.id: joint for joint in spec.joints}
    for servo in spec.actuators:
        k, held = servo.id, int(changed.actuator_trnid[servo.id, 0])
        joint, dof = joints[held], int(changed.jnt_dofadr[held])
        joint.damping[0] = float(changed.dof_damping[dof])
        joint.frictionloss = float(changed.dof_frictionloss[dof])
        joint.armature = float(changed.dof_armature[dof])
        joint.solref_friction[:] = changed.dof_solref[dof]
        joint.solimp_friction[:] = changed.dof_solimp[dof]
        servo.gainprm[:] = changed.actuator_gainprm[k]
        servo.biasprm[:] = changed.actuator_biasprm[k]
        if np.isfinite(changed.actuator_forcerange[k]).all():
            servo.forcerange[:] = changed.actuator_forcerange[k]
            servo.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE


def _write_bodies(spec: mujoco.MjSpec, changed: mujoco.MjModel) -> None:
    """Write the masses of all bodies as they are, whatever their geoms weigh."""
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    spec.compiler.settotalmass = -1.0
    for body in spec.bodies:
        k = body.id
        if k == 0:
            continue  # the world
        body.explicitinertial = True
        body.mass = float(changed.body_mass[k])
        body.ipos[:] = changed.body_ipos[k]
        body.iquat[:] = changed.body_iquat[k]
        body.inertia[:] = changed.body_inertia[k]
        body.fullinertia[:] = np.nan
        body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT


def _write_geoms(
    spec: mujoco.MjSpec, model: mujoco.MjModel, changed: mujoco.MjModel
) -> None:
    """Write what a world changes in floor and soles."""
    for geom in spec.geoms:
        k = geom.id
        geom.friction[:] = changed.geom_friction[k]
        geom.solref[:] = changed.geom_solref[k]
        frames = [np.r_[m.geom_pos[k], m.geom_quat[k]] for m in (model, changed)]
        if not np.allclose(*frames):
            _move(geom, changed)


def _move(geom: mujoco.MjsGeom, changed: mujoco.MjModel) -> None:
    """Write where a geom is; MuJoCo has a mesh where its principal axes are."""
    k, mesh = geom.id, changed.geom_dataid[geom.id]
    place, turn = changed.geom_pos[k].copy(), changed.geom_quat[k].copy()
    if geom.type == mujoco.mjtGeom.mjGEOM_MESH:
        back, offset = np.zeros(4), np.zeros(3)
        mujoco.mju_negQuat(back, changed.mesh_quat[mesh])
        mujoco.mju_mulQuat(turn, changed.geom_quat[k], back)
        mujoco.mju_rotVecQuat(offset, changed.mesh_pos[mesh], turn)
        place -= offset
    else:
        geom.size[:] = changed.geom_size[k]
    geom.pos[:], geom.quat[:] = place, turn
    geom.alt.type, geom.fromto[:] = mujoco.mjtOrientation.mjORIENTATION_QUAT, np.nan


def _told(values: dict[str, float]) -> str:
    """Values of a cause in words."""
    return ", ".join(f"{name} {value:.3g}" for name, value in values.items())
