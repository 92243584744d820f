"""A walker without the joints that its walk never moves: the same walk for less work.

Head, elbows, wrists and hands are held where the walk has them stand. Their bodies
are one with those that carry them, with what causes have made of their masses. The
NAO's physics steps are longer besides, with fewer iterations of the solver, where
nothing acts once per physics step.
"""

from __future__ import annotations

import functools
from typing import Any

import jax.numpy as jnp
import numpy as np

from gatjax.effects.effect import Effect
from gatjax.records import JOINTS, Sensed, Signal
from gatjax.robot.model import Held
from gatjax.robot.nao import WALKING_JOINTS
from gatjax.sim.contact import law_of
from gatjax.sim.control import KEPT
from gatjax.sim.episode import joints_of
from gatjax.sim.world import (
    World,
    add_cause,
    add_command,
    add_sensor,
    dividing,
    fields_applied,
    nominal,
    with_contact,
)
from gatjax.task import pose
from gatjax.walk.parameters import THETA0

Array = Any
HELD = tuple(joint for joint in JOINTS if joint not in WALKING_JOINTS)
WEIGHING = ("payload", "com_shift")
"""Causes that change what bodies weigh."""
STEP = 0.005
"""Of the NAO's physics, s: ranks walks as its file's 4 ms do (experiments/lighter)."""
ITERATIONS = 3
"""Of the NAO's solver: rank walks as its file's four do (docs/speed.md)."""


def lighter(world: World) -> World:
    """Return a walker's world without the joints in HELD.

    What causes make of the bodies is in its model, as are the bodies that no longer
    move by themselves. Of other causes those at held joints are left out; those at
    "all" joints are at all that are left. Learned effects see the held joints where
    they stand.
    """
    stand = _stand()
    angles = {joint: float(stand[JOINTS.index(joint)]) for joint in HELD}
    held = Held(angles, fields_applied(world))
    light = nominal(world.task, world.source, _timestep(world), held)
    light = with_contact(light, law_of(world.model))
    if _plain(world):
        light.model.opt.iterations = ITERATIONS
    for row in world.causes:
        where = [place for place in row["where"] if place not in HELD]
        if where and row["cause"] not in WEIGHING:
            role, values = row.get("role", "cause"), row["values"]
            if row["cause"] == "supply_sag":  # the held servos' limits count, too
                rated = 0.5 * float(world.values.servo.high.sum())
                values = {"total": rated, **values}
            light = add_cause(light, row["cause"], where, values, role)
    for name in world.learned:
        effect = _among_all(world.command[name], tuple(joints_of(light.model)))
        light = add_command(light, name, effect, world.values.command[name])
    for name in world.learned_sensors:
        effect = _reading_all(world.sensor[name], tuple(joints_of(light.model)))
        light = add_sensor(light, name, effect, world.values.sensor[name])
    return light


def _plain(world: World) -> bool:
    """Whether it is the shipped NAO and nothing acts once per physics step."""
    return world.source == "nao" and not world.motor and not world.joint


def _timestep(world: World) -> float:
    """Physics step of the lighter world, s.

    It is the world's own where that is not the shipped NAO's, or where something acts
    once per physics step.
    """
    own = world.model.opt.timestep
    if not _plain(world):
        return own
    if own != nominal(world.task).model.opt.timestep:
        return own
    return max(own, dividing(world.task.control_period, STEP))


@functools.cache
def _stand() -> np.ndarray:
    """Where all joints [J] of a walker that stands are, rad."""
    return np.asarray(pose(THETA0))


@functools.lru_cache(KEPT)
def _reading_all(effect: Effect, which: tuple[int, ...]) -> Effect:
    """A sensor effect made for all joints, for a robot that has those K of them."""
    stand, kept = _stand(), np.array(which)

    def whole(signal: Sensed) -> Sensed:
        angle, noise = signal.reading.angle, signal.noise.angle
        still = jnp.asarray(stand, angle.dtype)
        return Sensed(
            signal.reading._replace(angle=still.at[kept].set(angle)),
            signal.noise._replace(angle=jnp.zeros_like(still).at[kept].set(noise)),
        )

    def init(params: Any, signal: Sensed) -> Any:
        return effect.init(params, whole(signal))

    def apply(params: Any, state: Any, signal: Sensed) -> tuple[Any, Sensed]:
        state, changed = effect.apply(params, state, whole(signal))
        reading = changed.reading._replace(angle=changed.reading.angle[kept])
        return state, signal._replace(reading=reading)

    return Effect(init, apply)


@functools.lru_cache(KEPT)
def _among_all(effect: Effect, which: tuple[int, ...]) -> Effect:
    """An effect that was made for all joints, for a robot that has those K of them."""
    stand, kept = _stand(), np.array(which)

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
