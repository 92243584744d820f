"""Robots whose nominal numbers are drawn from their tolerances."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from gatjax.diagnosis.assembly import TRANSPORT
from gatjax.diagnosis.loads import perturbed
from gatjax.diagnosis.tolerances import SHARES, Tolerances
from gatjax.sim.world import Values, World, add_cause

DRAWS = 40
STEPS = (0.002, 0.001)  # s, of the physics: half of the draws each
FIELDS = (
    "body_mass", "body_inertia", "body_ipos", "opt.gravity", "dof_armature",
    "dof_damping", "dof_frictionloss", "actuator_gainprm", "actuator_biasprm",
    "actuator_forcerange",
)  # fmt: skip
"""What a draw changes in a model."""


class Draw(NamedTuple):
    """One robot within its tolerances."""

    model: mujoco.MjModel
    zero: np.ndarray  # [J] rad, of the encoders; the servos see it
    delay: float  # s, of the commands


def draws(
    model: mujoco.MjModel, allowed: Tolerances, count: int, seed: int
) -> list[Draw]:
    """Draw robots; sizes are those of the single-joint engine (docs/diagnosis.md).

    Returns:
        The nominal robot, then `count` others.
    """
    rng = np.random.default_rng(seed)
    nominal = Draw(model, np.zeros(model.nu), TRANSPORT)
    return [nominal, *(_draw(model, allowed, rng) for _ in range(count))]


def _draw(model: mujoco.MjModel, allowed: Tolerances, rng: np.random.Generator) -> Draw:
    other, joints = perturbed(model, allowed, rng), model.nu
    factor = {
        name: np.exp(getattr(allowed, name) * rng.normal(size=joints))
        for name in SHARES
    }
    dofs = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    for name, field in (
        ("armature", other.dof_armature), ("damping", other.dof_damping),
        ("friction", other.dof_frictionloss),
    ):  # fmt: skip
        field[dofs] *= factor[name]
    other.actuator_gainprm[:, 0] *= factor["kp"]
    other.actuator_biasprm[:, 1] *= factor["kp"]
    other.actuator_biasprm[:, 2] *= factor["kv"]
    other.actuator_forcerange[:] *= factor["limit"][:, None]
    delay = max(0.0, TRANSPORT + allowed.late * rng.normal())
    return Draw(other, allowed.zero * rng.normal(size=joints), delay)


def timed(world: World) -> World:
    """A world whose commands take the nominal time to the servos."""
    return add_cause(world, "command_delay", ["all"], TRANSPORT)


def values_of(world: World, draw: Draw) -> Values:
    """Values of a draw in a world made by `timed`."""
    fields = dict(world.values.body)
    for name in FIELDS:
        owner = draw.model.opt if name.startswith("opt.") else draw.model
        fields[name] = np.array(getattr(owner, name.removeprefix("opt.")))
    motor = {
        key: {name: np.full_like(value, draw.delay) for name, value in params.items()}
        if isinstance(params, dict) else np.full_like(params, draw.delay)
        for key, params in world.values.motor.items()
    }  # fmt: skip
    return world.values._replace(body=fields, motor=motor)
