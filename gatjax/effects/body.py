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


def torque_limit(model: Any, fields: Fields, limit: Array) -> Fields:
    """Lower the torque limit of the servos to `limit` [J] N m; inf is neutral."""
    if not np.all(model.actuator_forcelimited):
        raise ValueError(
            "torque_limit needs a forcerange on every actuator in the MJCF"
        )
    nominal = fields.get("actuator_forcerange", model.actuator_forcerange)
    bound = np.asarray(limit)[:, None]
    return fields | {"actuator_forcerange": np.clip(nominal, -bound, bound)}


def viscous_friction(model: Any, fields: Fields, coefficient: Array) -> Fields:
    """Add `coefficient` [J] N m s/rad to the joint damping; 0 is neutral."""
    damping = np.array(fields.get("dof_damping", model.dof_damping))
    damping[_dofs(model)] += coefficient
    return fields | {"dof_damping": damping}


def coulomb_friction(model: Any, fields: Fields, torque: Array) -> Fields:
    """Add `torque` [J] N m to the dry friction of the joints; 0 is neutral."""
    friction = np.array(fields.get("dof_frictionloss", model.dof_frictionloss))
    friction[_dofs(model)] += torque
    return fields | {"dof_frictionloss": friction}


def gain_error(model: Any, fields: Fields, scale: Array) -> Fields:
    """Multiply the position gain kp of the servos by `scale` [J]; 1 is neutral."""
    gain = np.array(fields.get("actuator_gainprm", model.actuator_gainprm))
    bias = np.array(fields.get("actuator_biasprm", model.actuator_biasprm))
    gain[:, 0] *= scale
    bias[:, 1] *= scale
    return fields | {"actuator_gainprm": gain, "actuator_biasprm": bias}
