"""What follows from model fields: constants, servos, and joints with a gear."""

from __future__ import annotations

from functools import partial
from typing import Any

import mujoco
import numpy as np

from gatjax.effects.body import now
from gatjax.effects.gear import Gear, present
from gatjax.records import Servo

Fields = dict[str, Any]
INERTIAL = ("body_mass", "body_ipos", "body_inertia", "body_iquat", "dof_armature")
CONSTANTS = ("dof_M0", "dof_invweight0", "body_invweight0", "body_subtreemass")
ITERATIONS = 50  # of the solver where friction holds; 23 were needed at most on a NAO
LIGHT = 0.05  # rotor of a gear in a joint without armature, share of its inertia


def write(model: mujoco.MjModel, fields: Fields) -> None:
    """Write fields {name: value} into a model; `opt.<name>` are options."""
    for name, value in fields.items():
        owner = model.opt if name.startswith("opt.") else model
        getattr(owner, name.removeprefix("opt."))[...] = value


def moves_frames(fields: Fields) -> bool:
    """Whether MuJoCo has to look again at what it derives from these fields."""
    return any(name in fields for name in (*INERTIAL, "geom_pos", "geom_quat"))


def settle(model: mujoco.MjModel, fields: Fields) -> None:
    """Write fields into a model, and refresh what MuJoCo derives from them."""
    write(model, fields)
    if moves_frames(fields):
        mujoco.mj_setConst(model, mujoco.MjData(model))


def constants(model: mujoco.MjModel, fields: Fields) -> Fields:
    """Return the fields with what MuJoCo derives from masses and inertias."""
    if not any(name in fields for name in INERTIAL):
        return fields
    changed = mujoco.MjModel.__copy__(model)
    settle(changed, fields)
    return fields | {name: np.array(getattr(changed, name)) for name in CONSTANTS}


def solved(model: mujoco.MjModel, fields: Fields) -> mujoco.MjModel:
    """Return the model with as many solver iterations as friction that holds needs.

    Cut off after nao.xml's four, 0.3 N m of friction in all joints makes a NAO walk at
    2 cm/s instead of 15.
    """
    least = ITERATIONS if "dof_solimp" in fields else 0
    if min(model.opt.iterations, model.opt.ls_iterations) >= least:
        return model
    model = mujoco.MjModel.__copy__(model)
    model.opt.iterations = max(model.opt.iterations, least)
    model.opt.ls_iterations = max(model.opt.ls_iterations, least)
    return model


def check(model: mujoco.MjModel, fields: Fields, name: str) -> None:
    """Raise ValueError where fields are not physical; `name` is what made them so."""
    least = {
        "dof_damping": 0.0, "dof_frictionloss": 0.0, "dof_armature": 0.0,
        "body_mass": 0.0, "body_inertia": 0.0,
    }  # fmt: skip
    for field, bound in least.items():
        if field in fields and (fields[field] < bound - 1e-12).any():
            raise ValueError(f"{name}: {field} of the model would be negative")
    if "actuator_gainprm" in fields and (fields["actuator_gainprm"][:, 0] <= 0.0).any():
        raise ValueError(f"{name}: a position gain would not be positive")
    if (
        "actuator_biasprm" in fields
        and (fields["actuator_biasprm"][:, 2] > 1e-12).any()
    ):
        raise ValueError(f"{name}: a velocity gain would be negative")
    if "actuator_forcerange" in fields:
        span = fields["actuator_forcerange"]
        if (span[:, 1] <= span[:, 0])[model.actuator_forcelimited > 0].any():
            raise ValueError(f"{name}: a torque limit would not be positive")


def check_drives(model: mujoco.MjModel, cause: str) -> None:
    """Refuse drives that are not at their joint's side, or have a lag of their own.

    Raises:
        ValueError: one line with the first of them, and what to change.
    """
    odd = ~np.isclose(model.actuator_gear[:, 0], 1.0)
    odd |= model.actuator_dyntype != mujoco.mjtDyn.mjDYN_NONE
    if odd.any():
        name = model.actuator(int(np.flatnonzero(odd)[0])).name
        raise ValueError(
            f"{cause} acts on drives as their joints feel them, but actuator {name!r} "
            f"has a gear or an activation; give kp, kv and forcerange at the joint, "
            f"gear 1, and a lag as the cause first_order_lag"
        )


def servo(model: mujoco.MjModel, fields: Fields) -> Servo:
    """Read the drives [J] off a model with fields."""
    field = partial(now, model, fields)
    dofs = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    bias, span = field("actuator_biasprm"), field("actuator_forcerange")
    gain = field("actuator_gainprm")[:, 0]
    free = model.actuator_forcelimited == 0
    rotor = field("dof_armature")[dofs]
    whole = 1.0 / field("dof_invweight0")[dofs]
    return Servo(
        gain=gain,
        hold=-bias[:, 1] / np.where(gain > 0.0, gain, 1.0),
        damping=-bias[:, 2],
        low=np.where(free, -np.inf, span[:, 0]),
        high=np.where(free, np.inf, span[:, 1]),
        friction=field("dof_frictionloss")[dofs],
        viscous=field("dof_damping")[dofs],
        rotor=rotor,
        link=np.maximum(whole - rotor, 1e-9),
    )


def geared(
    model: mujoco.MjModel, fields: Fields, servos: Servo, gear: Gear
) -> tuple[Fields, Servo]:
    """Take motors off the joints that have a gear.

    The engine keeps the link: no actuator, its share of damping, dry friction and
    armature. Motor and link in the servos then have the inertia of their own side.
    """
    on = np.asarray(present(gear))
    dofs = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    names = (
        "actuator_gainprm", "actuator_biasprm", "dof_armature", "dof_damping",
        "dof_frictionloss",
    )  # fmt: skip
    gain, bias, armature, damping, friction = (
        now(model, fields, name) for name in names
    )
    gain[on], bias[on] = 0.0, 0.0
    behind = np.where(on, gear.armature_share, 0.0)
    armature[dofs] *= np.where(on, behind, 1.0)
    share = np.where(on, gear.link_share, 1.0)
    damping[dofs] *= share
    friction[dofs] *= share
    parts = (gain, bias, armature, damping, friction)
    fields = constants(model, fields | dict(zip(names, parts, strict=True)))
    link = 1.0 / fields["dof_invweight0"][dofs]
    rotor = np.where(servos.rotor > 0.0, (1.0 - behind) * servos.rotor, LIGHT * link)
    return fields, servos._replace(
        rotor=np.where(on, rotor, servos.rotor), link=np.where(on, link, servos.link)
    )
