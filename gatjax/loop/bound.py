"""Torques that the robot's logs bear out, which a search after a diagnosis keeps to.

A robot that hangs loads its motors less than one that walks, and theta0 less than what
a search finds: no log tells what drivers, battery and gears do beyond. A search in a
simulator that is right below, and generous beyond, goes there, and the robot falls.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from gatjax.data.recording import Recording
from gatjax.grounding import prediction
from gatjax.loop.ground import WINDOWS, measured, parted
from gatjax.records import JOINTS
from gatjax.robot.nao import WALKING_JOINTS, Motor, motor_of
from gatjax.sim import causes, derived
from gatjax.sim.backend import prepare
from gatjax.sim.world import World, add_cause

BOUND = "current_limit"
WORSE = 1.05  # error of a prediction by that of one without a bound
PARTS = 20  # in which a torque limit is divided
LOOSE = 1e3  # N m: binds no motor of a humanoid

Limit = tuple[list[str], float]  # of the joints of a kind of motor, N m


def bounded(world: World, walks: Recording, seed: int) -> World:
    """Add limits of the motors' net torque, the least that the walks bear out.

    Each kind of motor has one, unless even its torque limit is too low for one: below
    it, and with no bound of the others, the world predicts the walking joints 0.2 s
    ahead worse by a twentieth. Walks that only test predictions do not count.

    Args:
        world: what a diagnosis made of the nominal NAO.
        walks: of the robot, with theta0.
        seed: of the run.

    Raises:
        ValueError: a prediction diverges without any bound.
    """
    seen, _ = parted(walks, world.task.control_period, seed)
    windows = prediction.cut(world, measured(walks), seen, WINDOWS, seed)
    kinds, step = motors(world), world.task.control_period
    loose = [(joints, LOOSE) for joints, _ in kinds]
    backend = prepare(_limited(world, loose), "native")

    def error(limits: list[Limit]) -> float:
        values = _limited(world, limits).values
        return prediction.error_soon(backend, values, windows, step)

    allowed = WORSE * error(loose)
    if not np.isfinite(allowed):
        raise ValueError(
            "the simulation that the diagnosis extended diverges within a fifth of a "
            "second of a place on the robot's walks"
        )

    def enough(number: int, limit: float) -> bool:
        tried = [*loose]
        tried[number] = (loose[number][0], limit)
        return error(tried) <= allowed

    bounds = [
        (joints, _least(most, partial(enough, number)))
        for number, (joints, most) in enumerate(kinds)
    ]
    return _limited(world, [bound for bound in bounds if bound[1] < LOOSE])


def _least(most: float, enough: Callable[[float], bool]) -> float:
    """The least limit up to `most` that is enough, in parts of it; LOOSE if none is."""
    low, high = 0, PARTS + 1  # too weak, strong enough
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(most * middle / PARTS) else (middle, high)
    return most * high / PARTS if high <= PARTS else LOOSE


def _limited(world: World, limits: list[Limit]) -> World:
    """The world with a limit of the net torque for each kind of motor."""
    for joints, limit in limits:
        world = add_cause(world, BOUND, joints, limit, "bound")
    return world


def motors(world: World) -> list[Limit]:
    """Walking joints of each kind of motor, and its torque limit in the world, N m."""
    fields, _ = causes.of_model(world.model, world.causes)
    strongest = derived.servo(world.model, fields).high
    kinds: dict[Motor, list[str]] = {}
    for joint in WALKING_JOINTS:
        kinds.setdefault(motor_of(joint), []).append(joint)
    return [
        (each, float(max(strongest[JOINTS.index(joint)] for joint in each)))
        for each in kinds.values()
    ]
