"""An extended World as a model file, as far as plain MJCF can say it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from gatjax.effects.catalogue import CATALOGUE
from gatjax.files import write_whole
from gatjax.robot import model as robot_model
from gatjax.sim import causes, derived
from gatjax.sim.world import World

DELAY = "command_delay"
PROMPT = 5e-4  # s


def write_model(path: Path, world: World) -> None:
    """Write what plain MJCF can express of a world.

    Args:
        path: of the new MJCF file.
        world: with a model file as its source.
    """
    file = robot_model.model_file(world.source).resolve()
    spec, model = robot_model.spec_of(world.source), world.model
    spec.compile()
    fields, _ = causes.of_model(model, world.causes)  # gears left out
    changed = mujoco.MjModel.__copy__(model)
    derived.settle(changed, fields)
    _write_servos(spec, changed)
    _write_delays(spec, world)
    if "body_ipos" in fields:
        _write_bodies(spec, changed)
    _write_geoms(spec, model, changed)
    spec.option.cone, spec.option.impratio = model.opt.cone, model.opt.impratio
    spec.option.gravity[:] = changed.opt.gravity
    spec.option.iterations = changed.opt.iterations
    spec.option.ls_iterations = changed.opt.ls_iterations
    assets = (*spec.meshes, *spec.hfields, *spec.skins, *spec.textures)
    if any(each.file for each in assets):
        compiler = spec.compiler
        compiler.meshdir = str(file.parent / compiler.meshdir)
        compiler.texturedir = str(file.parent / compiler.texturedir)
    head, _, rest = _near(spec, path).partition("\n")
    text = f"{head}\n{_remarks(world, spec.option.timestep)}{rest}"
    write_whole({path: text.encode()})


def _near(spec: mujoco.MjSpec, path: Path) -> str:
    """The text of a spec, its folders told from that of its file."""
    text = spec.to_xml()
    for folder in filter(None, (spec.compiler.meshdir, spec.compiler.texturedir)):
        near = os.path.relpath(folder, path.parent.resolve())
        text = text.replace(f'dir="{folder}"', f'dir="{near}"')
    return text


def lacking(world: World) -> list[str]:
    """Causes of a world that its model file cannot express, in words."""
    step = robot_model.load(world.source).opt.timestep
    return [
        _told(row)
        for row in world.causes
        if not (_expressible(world, row, step) or _prompt(row))
    ]


def _expressible(world: World, row: dict[str, Any], step: float) -> bool:
    """Whether plain MJCF with a physics step, s, has a term for a cause of a world."""
    if row["cause"] != DELAY:
        return all(part.slot == "body" for part in CATALOGUE[row["cause"]].parts)
    every = row["where"] == ["all"]
    names = robot_model.joint_names(world.model) if every else row["where"]
    return any(_late(world, name) > 0.5 * step for name in names)


def _late(world: World, joint: str) -> float:
    """How late the commands of a joint are in a world, s."""
    late = (
        row["values"]["delay"]
        for row in world.causes
        if row["cause"] == DELAY and {joint, "all"} & set(row["where"])
    )
    return sum(late, 0.0)


def _prompt(row: dict[str, Any]) -> bool:
    """Whether a row is a delay that nobody would miss."""
    return row["cause"] == DELAY and row["values"]["delay"] < PROMPT


def _remarks(world: World, step: float) -> str:
    """What the file, with a physics step in s, says of itself, as comments."""
    there = [
        row
        for row in world.causes
        if _expressible(world, row, step) and not _prompt(row)
    ]
    lines = ["made by gatjax diagnose; the whole simulation is in world.json"]
    lines += [f"has {row.get('role', 'cause')} {_told(row)}" for row in there]
    lines += [f"lacks {text}" for text in lacking(world)]
    if any(row["cause"] == DELAY for row in there):
        lines.append(
            "delays are of MuJoCo C, in whole steps, and MJX refuses them; call "
            "mj_initCtrlHistory with the first command after each reset"
        )
    return "".join(f"  <!-- {line.replace('--', '-')} -->\n" for line in lines)


def _write_delays(spec: mujoco.MjSpec, world: World) -> None:
    """Write how late commands are; MuJoCo C has no delay below a step."""
    step = spec.option.timestep
    for servo in spec.actuators:
        delay = _late(world, servo.target)
        if delay > 0.5 * step:
            servo.delay, servo.nsample = delay, int(np.ceil(delay / step)) + 1


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
        if not changed.jnt_actfrclimited[held]:  # `load` made it the servo's
            joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
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
    for pair in spec.pairs:
        pair.friction[:] = changed.pair_friction[pair.id]
        pair.solref[:] = changed.pair_solref[pair.id]
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


def _told(row: dict[str, Any]) -> str:
    """A cause of a world in words."""
    units = {each.name: each.unit for each in CATALOGUE[row["cause"]].parameters}
    values = ", ".join(
        f"{name} {value:.3g}{'' if units[name] == '1' else ' ' + units[name]}"
        for name, value in row["values"].items()
        if name != "in_loop"
    )
    seen = "; the servo sees it too" if row["values"].get("in_loop") else ""
    return f"{row['cause']} at {', '.join(row['where'])}: {values}{seen}"
