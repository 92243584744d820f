"""Which effects a case has, and where they may sit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from gatjax.surrogate.hidden.catalogue import CATALOGUE
from gatjax.surrogate.hidden.causes import Cause, Details
from gatjax.surrogate.hidden.numbers import Specimen
from gatjax.surrogate.hidden.outside import OUTSIDE
from gatjax.surrogate.hidden.robots import Robot
from gatjax.surrogate.hidden.targets import Log

LEAST, MOST = 0.8, 15.0  # visibility aimed at
STILL = 0.08  # rad, joints that move less are no place for an effect
ALIKE = (
    {"command_delay", "measurement_delay"},
    {"damping_error", "viscous_friction"},
    {"com_shift", "gravity_tilt"},
    {"backlash", "joint_elasticity"},
)
"""Causes that are never together in a pair: aliases, or two laws for one gear."""


class Effect(NamedTuple):
    """One hidden effect without its strength."""

    name: str
    cause: Cause
    where: tuple[str, ...]
    joints: list[int]
    ladder: np.ndarray  # [RUNGS] values of the scored parameter
    details: Details
    target: float  # visibility aimed at

    def on(self, specimen: Specimen, machine: Robot, value: float) -> Specimen:
        """The specimen with this effect at a strength."""
        return self.cause.apply(specimen, machine, self.joints, value, self.details)


def allowed(machine: Robot, table: Mapping[str, Cause]) -> list[str]:
    """The effects of a table that a robot can have."""
    fits = {
        "all": True,
        "many": len(machine.joints) > 1,
        "floor": machine.floating,
    }
    return [name for name, cause in table.items() if fits[cause.robots]]


def draw_effects(
    machine: Robot,
    kind: str,
    names: list[str],
    turn: tuple[int, int],
    log: Log,
    rng: np.random.Generator,
    least: float,
) -> tuple[tuple[Effect, ...], ...]:
    """The effects of a case of some kind with their possible places.

    Args:
        machine: the robot.
        kind: single, null, pair or outside.
        names: of the catalogue.
        turn: goes round the names: the number of the turn, and the seed.
        log: the first motion; joints that rest in it are no place for an effect.
        rng: draws the rest.
        least: visibility aimed at.
    """
    if kind == "null":
        return ()
    table = CATALOGUE
    if kind == "outside":
        table, names = OUTSIDE, allowed(machine, OUTSIDE)
    round_number, place = divmod(turn[0], len(names))
    order = np.random.default_rng([turn[1], round_number, 99]).permutation(len(names))
    chosen = [names[order[place]]]
    if kind == "pair":
        taken = set(chosen).union(*(group for group in ALIKE if chosen[0] in group))
        others = [name for name in names if name not in taken]
        chosen += [str(rng.choice(others))] if others else []
    moving = np.flatnonzero(np.ptp(log.commands, axis=0) > STILL).tolist()
    options: list[tuple[Effect, ...]] = []
    for name in chosen:
        used = {
            joint for group in options for effect in group for joint in effect.joints
        }
        free = [joint for joint in moving if joint not in used] or moving
        tries = max(table[name].sites, 2 if machine.floating else 1)
        tries = 1 if len(machine.joints) == 1 else tries
        options.append(
            tuple(
                _effect(machine, name, table[name], free, rng, least)
                for _ in range(tries)
            )
        )
    return tuple(options)


def _effect(
    machine: Robot,
    name: str,
    cause: Cause,
    free: list[int],
    rng: np.random.Generator,
    least: float,
) -> Effect:
    """Where an effect sits and what its ladder is."""
    where, joints = _site(machine, cause.where, free, rng)
    ladder, details = cause.ladder(machine, joints, rng)
    target = float(np.exp(rng.uniform(np.log(least), np.log(MOST))))
    return Effect(name, cause, where, joints, ladder, details, target)


def _site(
    machine: Robot, where: str, free: list[int], rng: np.random.Generator
) -> tuple[tuple[str, ...], list[int]]:
    """Names and joint numbers of the place of an effect."""
    every = list(range(len(machine.joints)))
    if where == "foot":
        foot = int(rng.integers(2))
        return (("LFoot", "RFoot")[foot],), [foot]
    if where in ("imu", "ground", "all"):
        return (where,), every
    chance = rng.uniform() if where == "any" and len(every) > 1 else 1.0
    if chance < 0.15:
        return ("all",), every
    joint = int(rng.choice(free))
    twins = [j for j in every if machine.joints[j] in _mirrors(machine.joints[joint])]
    if chance < 0.3 and twins:
        pair = sorted([joint, twins[0]])
        return tuple(machine.joints[j] for j in pair), pair
    return (machine.joints[joint],), [joint]


def _mirrors(joint: str) -> set[str]:
    """Names that the joint on the other side may have (LKnee: RKnee; FL_x: FR_x)."""
    swap = {"L": "R", "R": "L"}
    names = set()
    for place in (0, 1):
        if joint[place] in swap:
            names.add(joint[:place] + swap[joint[place]] + joint[place + 1 :])
    return names
