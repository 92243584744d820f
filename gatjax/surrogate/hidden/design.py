"""What a case is, before anything runs: robot, motions, effects; from (seed, index)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gatjax.surrogate.hidden.catalogue import CATALOGUE
from gatjax.surrogate.hidden.measure import Channels
from gatjax.surrogate.hidden.motions import LIVELY, OTHERS, commands
from gatjax.surrogate.hidden.numbers import Specimen, draw, nominal
from gatjax.surrogate.hidden.places import LEAST, Effect, allowed, draw_effects
from gatjax.surrogate.hidden.robots import Robot, robot
from gatjax.surrogate.hidden.stances import STANCES, stance
from gatjax.surrogate.hidden.targets import Log

MIX = {"single": 0.6, "null": 0.2, "pair": 0.1, "outside": 0.1}
RATES = (100.0, 250.0 / 3.0, 50.0)
ENGINES = {
    "single": "one joint, exact contact",
    "rigid": "mujoco, explicit servo",
    "dart": "dart, explicit servo",
}
DESIGN, BODY, MOTION, JITTER, NOISE = range(5)  # streams of random numbers


class Case(NamedTuple):
    """One case without the strengths of its effects."""

    name: str
    robot: Robot
    kind: str
    engine: str  # a key of ENGINES
    rate: float
    channels: Channels
    one_file: bool
    fit_motions: tuple[str, ...]
    held_motion: str
    fits: tuple[Log, ...]
    held: Log
    options: tuple[tuple[Effect, ...], ...]  # for each effect, where it may sit
    effects: tuple[Effect, ...]  # one of each, once it is known what shows
    bare: Specimen  # the robot without effects
    others: tuple[Specimen, ...]  # more of the production line, for the scatter
    ideal: Specimen  # nominal


def case_name(seed: int, index: int) -> str:
    """The name of a case's folder."""
    return f"h{seed}_{index:04d}"


def plan(
    seed: int,
    index: int,
    mix: Mapping[str, float],
    robots: Sequence[str],
    causes: Sequence[str] | None,
    least: float = LEAST,
) -> Case:
    """Draws a case.

    Args:
        seed: of the set.
        index: of the case.
        mix: share of each kind.
        robots: names; they take turns.
        causes: of singles and pairs; None: the whole catalogue.
        least: visibility that effects aim at.

    Raises:
        ValueError: an unknown kind, robot or cause, or a robot that can have none.
    """
    _check(mix, causes)
    rng = np.random.default_rng([seed, index, DESIGN])
    machine = robot(robots[index % len(robots)])
    names = [n for n in allowed(machine, CATALOGUE) if causes is None or n in causes]
    if not names:
        raise ValueError(f"{machine.name} can have none of {list(causes or ())}")
    kinds, shares = list(mix), np.array(list(mix.values()), float)
    kind = str(rng.choice(kinds, p=shares / shares.sum()))
    engine = _engine(machine, rng)
    rate = float(rng.choice(RATES))
    fit_motions, held_motion = _motions(machine, rng)
    jitter = rng.uniform(0.2e-3, 0.8e-3)
    logs = [
        _log(machine, motion, rate, jitter, (seed, index, number))
        for number, motion in enumerate((*fit_motions, held_motion))
    ]
    turns, which = divmod(index, len(robots))
    turn = (turns + which * -(-len(names) // len(robots)), seed)
    options = draw_effects(machine, kind, names, turn, logs[0], rng, least)
    bodies = [
        Specimen(draw(machine, np.random.default_rng([seed, index, number, BODY])))
        for number in range(7)
    ]
    return Case(
        name=case_name(seed, index),
        robot=machine,
        kind=kind,
        engine=engine,
        rate=rate,
        channels=Channels(*(bool(rng.uniform() < 0.25) for _ in range(4))),
        one_file=bool(rng.uniform() < 0.4),
        fit_motions=fit_motions,
        held_motion=held_motion,
        fits=tuple(logs[:-1]),
        held=logs[-1],
        options=options,
        effects=(),
        bare=bodies[0],
        others=tuple(bodies[1:]),
        ideal=Specimen(nominal(machine)),
    )


def _motions(machine: Robot, rng: np.random.Generator) -> tuple[tuple[str, ...], str]:
    """Draws one or two motions of the fit logs, and another one that is held out."""
    menu = STANCES if machine.floating else OTHERS
    first = LIVELY if rng.uniform() < 0.8 else str(rng.choice(menu))
    if machine.floating:
        first = str(rng.choice(menu))
    rest = [str(name) for name in rng.permutation(menu) if name != first]
    return (first, *rest[: int(rng.integers(1, 3)) - 1]), rest[-1]


def _check(mix: Mapping[str, float], causes: Sequence[str] | None) -> None:
    unknown = sorted(set(mix) - set(MIX)) + sorted(set(causes or ()) - set(CATALOGUE))
    if unknown:
        raise ValueError(
            f"{', '.join(unknown)}: unknown; kinds are {', '.join(MIX)}, causes "
            f"{', '.join(CATALOGUE)}"
        )


def _engine(machine: Robot, rng: np.random.Generator) -> str:
    """Which plant a case uses."""
    if machine.floating:
        return "rigid"
    if len(machine.joints) == 1:
        return str(rng.choice(["single", "rigid", "dart"], p=[0.6, 0.25, 0.15]))
    dart = 0.0 if machine.model.neq else 0.35
    return str(rng.choice(["rigid", "dart"], p=[1.0 - dart, dart]))


def _log(
    machine: Robot, motion: str, rate: float, jitter: float, seeds: tuple[int, ...]
) -> Log:
    """The commands of one trajectory."""
    rng = np.random.default_rng([*seeds, MOTION])
    shortest, longest = (11.0, 15.0) if motion == LIVELY else (8.0, 11.5)
    if machine.floating:  # a step with contacts costs ten without
        longest = 9.0
    count = int(rng.uniform(shortest, longest) * rate)
    even = np.arange(count) / rate
    make = stance if machine.floating else commands
    targets = make(machine, motion, even, rng)
    shift = jitter * np.random.default_rng([*seeds, JITTER]).standard_normal(count)
    times = even + np.clip(shift, -0.3 / rate, 0.3 / rate)
    times[0] = 0.0
    return Log(np.round(times, 6), targets, (*seeds, NOISE))
