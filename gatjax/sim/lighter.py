"""A walker without the joints that its walk never moves: the same walk for less work.

Head, elbows, wrists and hands are held where the walk has them stand. Their bodies
stay, with what causes have made of their masses.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np

from gatjax.effects.catalogue import CATALOGUE
from gatjax.effects.effect import Effect
from gatjax.records import JOINTS, Signal
from gatjax.robot.nao import WALKING_JOINTS
from gatjax.sim.derived import settle
from gatjax.sim.episode import joints_of
from gatjax.sim.world import World, add_cause, add_command, fields_applied, nominal
from gatjax.task import pose
from gatjax.walk.parameters import THETA0

Array = Any
BODIES = ("body_mass", "body_ipos", "body_iquat", "body_inertia")
HELD = tuple(joint for joint in JOINTS if joint not in WALKING_JOINTS)


def lighter(world: World) -> World:
    """Return a walker's world without the joints in HELD.

    Of causes at held joints only what they make of bodies is left; those at "all"
    joints are at all that are left. A learned command effect sees the held joints where
    they stand.
    """
    stand = np.asarray(pose(THETA0))
    angles = {joint: float(stand[JOINTS.index(joint)]) for joint in HELD}
    light = _loaded(
        nominal(world.task, world.source, world.model.opt.timestep, angles), world
    )
    for row in world.causes:
        light = _added(light, row, [p for p in row["where"] if p not in HELD])
    for name in world.learned:
        effect = _among_all(world.command[name], joints_of(light.model), stand)
        light = add_command(light, name, effect, world.values.command[name])
    return light


def _loaded(light: World, world: World) -> World:
    """The lighter world with what causes at held joints make of the bodies."""
    heavy = nominal(world.task, world.source, world.model.opt.timestep)
    for row in world.causes:
        jointed = CATALOGUE[row["cause"]].place == "joint"
        everywhere = jointed and row["where"] == ["all"]
        held = HELD if everywhere else [p for p in row["where"] if p in HELD]
        heavy = _added(heavy, row, list(held))
    changed = fields_applied(heavy)
    settle(light.model, {field: getattr(changed, field) for field in BODIES})
    return light


def _added(world: World, row: dict[str, Any], where: list[str]) -> World:
    """A world with a row of causes at some places, if there are any."""
    if not where:
        return world
    role = row.get("role", "cause")
    return add_cause(world, row["cause"], where, row["values"], role)


def _among_all(effect: Effect, kept: np.ndarray, stand: np.ndarray) -> Effect:
    """An effect that was made for all joints, for a robot that has those `kept` [K]."""

    def whole(signal: Signal) -> Signal:
        zero = jnp.zeros(len(stand), signal.angle.dtype)
        still = zero + stand.astype(signal.angle.dtype)
        return Signal(
            still.at[kept].set(signal.target), still.at[kept].set(signal.angle),
            zero.at[kept].set(signal.velocity), zero.at[kept].set(signal.noise),
        )  # fmt: skip

    def init(params: Any, signal: Signal) -> Any:
        return effect.init(params, whole(signal))

    def apply(params: Any, state: Any, signal: Signal) -> tuple[Any, Signal]:
        state, changed = effect.apply(params, state, whole(signal))
        return state, signal._replace(target=changed.target[kept])

    return Effect(init, apply)
