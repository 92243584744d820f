"""Effects that are a change of model fields: a table {MuJoCo field: new value}.

Each takes any object with MjModel's arrays, and one value per actuated joint [J] in
actuator order. The backends write the fields their own way.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Array = Any
Fields = dict[str, Array]


def _dofs(model: Any) -> np.ndarray:
    return model.jnt_dofadr[model.actuator_trnid[:, 0]]


def _bodies(model: Any) -> np.ndarray:
    """Links that the actuated joints move."""
    return model.jnt_bodyid[model.actuator_trnid[:, 0]]


def now(model: Any, fields: Fields, name: str) -> np.ndarray:
    """Return a copy of a field, or option `opt.<name>`, as the fields leave it."""
    owner = model.opt if name.startswith("opt.") else model
    return np.array(fields.get(name, getattr(owner, name.removeprefix("opt."))))


def torque_limit(model: Any, fields: Fields, params: dict[str, Array]) -> Fields:
    """Limit the torque of the servos to {limit, raised} [J] N m; limit inf is neutral.

    `raised` is what a servo has beyond its nominal limit, which else stays the bound.
    Of a model as `robot.model.load` makes it: every servo has a limit, maybe inf.
    """
    nominal = now(model, fields, "actuator_forcerange")
    bound = np.asarray(params["limit"])[:, None]
    more = np.where(np.isfinite(bound), np.asarray(params["raised"])[:, None], 0.0)
    nominal += more * np.array([-1.0, 1.0])
    return fields | {"actuator_forcerange": np.clip(nominal, -bound, bound)}


def _plus(name: str, model: Any, fields: Fields, amount: Array) -> Fields:
    """Add `amount` [J] to a field of the joints' degrees of freedom."""
    field = now(model, fields, name)
    field[_dofs(model)] += amount
    return fields | {name: field}


def viscous_friction(model: Any, fields: Fields, coefficient: Array) -> Fields:
    """Add `coefficient` [J] N m s/rad to the joint damping; 0 is neutral."""
    return _plus("dof_damping", model, fields, coefficient)


def armature(model: Any, fields: Fields, inertia: Array) -> Fields:
    """Add `inertia` [J] kg m^2 to the armature of the joints; 0 is neutral."""
    return _plus("dof_armature", model, fields, inertia)


def coulomb_friction(model: Any, fields: Fields, torque: Array) -> Fields:
    """Add `torque` [J] N m to the dry friction of the joints; 0 is neutral.

    A joint with added friction stands still when friction holds it.
    """
    fields = _plus("dof_frictionloss", model, fields, torque)
    return holding(model, fields, np.asarray(torque) != 0.0)


def asymmetric_friction(model: Any, fields: Fields, torque: Array) -> Fields:
    """Add the symmetric part, |torque| / 2 [J] N m; `joint.one_way` adds the rest."""
    return coulomb_friction(model, fields, 0.5 * np.abs(torque))


def holding(model: Any, fields: Fields, where: Array) -> Fields:
    """Let dry friction hold joints `where` [J] still: no creep, stopped in one step.

    MuJoCo's own friction is soft: a joint creeps at (1 - d) / d b of what the load
    would accelerate it with. Here d is 0.9999 and 1 / b the least it takes.
    """
    dofs = _dofs(model)[np.asarray(where, bool)]
    solimp = now(model, fields, "dof_solimp")
    solref = now(model, fields, "dof_solref")
    solimp[dofs, :2] = 0.9999
    solref[dofs] = 2.0 * model.opt.timestep, 1.0
    return fields | {"dof_solimp": solimp, "dof_solref": solref}


def gain_error(model: Any, fields: Fields, scale: Array) -> Fields:
    """Multiply the position gain kp of the servos by `scale` [J]; 1 is neutral."""
    gain = now(model, fields, "actuator_gainprm")
    bias = now(model, fields, "actuator_biasprm")
    gain[:, 0] *= scale
    bias[:, 1] *= scale
    return fields | {"actuator_gainprm": gain, "actuator_biasprm": bias}


def damping_error(model: Any, fields: Fields, scale: Array) -> Fields:
    """Multiply the velocity gain kv of the servos by `scale` [J]; 1 is neutral."""
    bias = now(model, fields, "actuator_biasprm")
    bias[:, 2] *= scale
    return fields | {"actuator_biasprm": bias}


def gravity_tilt(model: Any, fields: Fields, params: dict[str, Array]) -> Fields:
    """Tilt mounting or ground by {roll, pitch} rad: about x, then about y; 0 neutral.

    The world's axes stay those of the mounting, so gravity turns the other way.
    """
    roll, pitch = -float(params["roll"]), -float(params["pitch"])
    x, y, z = now(model, fields, "opt.gravity")
    x, z = np.cos(pitch) * x + np.sin(pitch) * z, np.cos(pitch) * z - np.sin(pitch) * x
    y, z = np.cos(roll) * y - np.sin(roll) * z, np.sin(roll) * y + np.cos(roll) * z
    return fields | {"opt.gravity": np.array([x, y, z])}


def com_shift(model: Any, fields: Fields, params: dict[str, Array]) -> Fields:
    """Move the centre of mass of links by {x, y, z} [J] m in the link's frame."""
    centre = now(model, fields, "body_ipos")
    shift = np.stack([params[axis] for axis in "xyz"], axis=-1)
    np.add.at(centre, _bodies(model), shift)
    return fields | {"body_ipos": centre}


def payload(model: Any, fields: Fields, params: dict[str, Array]) -> Fields:
    """Fix a point mass to links: {mass kg, x, y, z m in the link's frame}, all [J].

    NaN as place means the link's centre of mass. Mass 0 is neutral.
    """
    names = ("body_mass", "body_ipos", "body_inertia", "body_iquat")
    mass, centre, inertia, attitude = (now(model, fields, name) for name in names)
    for joint, link in enumerate(_bodies(model)):
        extra = params["mass"][joint]
        if extra == 0.0:
            continue
        point = np.array([params[axis][joint] for axis in "xyz"])
        arm = np.where(np.isnan(point), 0.0, point - centre[link])
        share = extra / (mass[link] + extra)
        axes = matrix(attitude[link])
        about = axes @ np.diag(inertia[link]) @ axes.T
        about += mass[link] * share * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        mass[link] += extra
        centre[link] += share * arm
        if arm.any():
            inertia[link], attitude[link] = _principal(about)
    return fields | dict(zip(names, (mass, centre, inertia, attitude), strict=True))


def matrix(quaternion: Array) -> np.ndarray:
    """Rotation matrix [3, 3] of a unit quaternion w x y z."""
    w, v = quaternion[0], quaternion[1:]
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross


def _principal(inertia: Array) -> tuple[np.ndarray, np.ndarray]:
    """Principal moments [3] kg m^2 of an inertia [3, 3], and w x y z of their axes."""
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    # Unit quaternion as the eigenvector of the matrix that it maximises (Bar-Itzhack).
    a = axes
    table = np.array([
        [a[0, 0] - a[1, 1] - a[2, 2], a[1, 0] + a[0, 1], a[2, 0] + a[0, 2],
         a[2, 1] - a[1, 2]],
        [0.0, a[1, 1] - a[0, 0] - a[2, 2], a[2, 1] + a[1, 2], a[0, 2] - a[2, 0]],
        [0.0, 0.0, a[2, 2] - a[0, 0] - a[1, 1], a[1, 0] - a[0, 1]],
        [0.0, 0.0, 0.0, a[0, 0] + a[1, 1] + a[2, 2]],
    ])  # fmt: skip
    vector = np.linalg.eigh(table, UPLO="U")[1][:, -1]
    return moments, vector[[3, 0, 1, 2]]
