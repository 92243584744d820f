"""What all stages of one run share."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import numpy as np

from gatjax.grounding.learn import METHODS, check_needs
from gatjax.loop.beginning import ungrounded
from gatjax.loop.candidates import KINDS
from gatjax.loop.recheck import rechecks
from gatjax.records import Array, Outcome, Trajectory
from gatjax.runs import Progress
from gatjax.search import checked
from gatjax.settings import LoopSettings, check_seed
from gatjax.sim.backend import BACKENDS, IMPLS, default_backend
from gatjax.sim.versions import mismatch, unused_gpu
from gatjax.sim.world import World
from gatjax.task import Task, task_at

MODELS = ("light", "full")  # that a search may run on
ORACLE = "oracle"  # the search on the robot itself, among the methods
CONFIRMATIONS = 10  # walks on the robot that the winner of a method is judged by
SIMULATOR_UNIT, ROBOT_UNIT = 1.0, 12.0  # relative cost of one run, for the time left
DIAGNOSIS_UNIT = 3000.0  # of a diagnosis


@runtime_checkable
class Robot(Protocol):
    """What the loop needs of a robot."""

    name: str

    def constants(self) -> dict[str, Any]:
        """Facts about the robot for robot.json."""
        ...

    def walk(
        self, policies: Array, seeds: Sequence[int] | np.ndarray, task: Task = ...
    ) -> tuple[Trajectory, Outcome]:
        """Walk policies [N, 15] with seeds [N], one run each; results [N, ...]."""
        ...


@runtime_checkable
class Away(Protocol):
    """A robot that walks in processes of its own: many walks at once cost less.

    Such walks can be made again; those of other robots are kept as they are made.
    """

    def begin_walks(
        self, policies: Array, seeds: Sequence[int] | np.ndarray, task: Task
    ) -> Callable[[], Outcome]:
        """Begin what `Robot.walk` does; returns what waits for how they fared [N]."""
        ...

    def drop_walks(self) -> None:
        """Give up what was begun."""
        ...


def judged(
    robot: Robot, policies: Array, seeds: Sequence[int] | np.ndarray, task: Task
) -> Callable[[], Outcome]:
    """Begin walks where they can be begun; returns what tells how they fared [N].

    A robot in processes of its own does not send whole trajectories then.
    """
    if isinstance(robot, Away):
        return robot.begin_walks(policies, seeds, task)
    return lambda: robot.walk(policies, seeds, task)[1]


class Setting(NamedTuple):
    """What all stages of one run share."""

    folder: Path
    settings: LoopSettings
    task: Task
    world: World  # that the run begins with
    robot: Robot
    progress: Progress

    def key(self, *facts: int) -> Array:
        """Derive a random key from the run's seed and facts, not from call order."""
        key = jax.random.key(self.settings.seed)
        for fact in facts:
            key = jax.random.fold_in(key, fact)
        return key


class Entry(NamedTuple):
    """One line of the comparison: what is learned, on top of which world."""

    name: str
    grounder: str  # a name of `gatjax.grounding.learn.METHODS`
    world: World  # before grounding


def total_work(settings: LoopSettings) -> float:
    """Work units of a whole run, for the time left."""
    one = settings.search
    searched = (one.walks + rechecks(settings.candidates)) * one.generations
    evaluated = len(settings.candidates) * one.generations * settings.evaluations
    methods, rounds = len(settings.methods) + settings.explain, settings.iterations
    ceiling = ORACLE in settings.methods
    collected = settings.robot_trajectories * (1 + (rounds - 1) * (methods - ceiling))
    judged = CONFIRMATIONS * (methods * rounds + 1)
    robot = collected + methods * rounds * evaluated + judged
    explained = DIAGNOSIS_UNIT * settings.explain
    units = (
        rounds
        * searched
        * (SIMULATOR_UNIT * methods + (ROBOT_UNIT - SIMULATOR_UNIT) * ceiling)
    )
    return units + ROBOT_UNIT * robot + explained


def resolved(settings: LoopSettings) -> LoopSettings:
    """Check settings and write out what `auto` stands for on this machine.

    Raises:
        ValueError: one line with the setting that is wrong and what it may be.
    """
    _check_named(settings)
    if ORACLE in settings.methods and "rechecked" in settings.candidates:
        raise ValueError(
            "oracle searches on the robot itself: no simulation to recheck in; "
            "give --candidates best, mean or both"
        )
    for method in settings.methods:
        if method != ORACLE:
            check_needs(method)
    for name in ("iterations", "evaluations"):
        if getattr(settings, name) < 1:
            raise ValueError(f"{name} is {getattr(settings, name)}; use 1 or more")
    check_seed("seed", settings.seed)
    if settings.body_seed < 0:
        raise ValueError(f"body_seed is {settings.body_seed}; use 0 or more")
    for name in ("robot_trajectories", "simulator_trajectories"):
        if getattr(settings, name) < 4:
            raise ValueError(f"{name} is {getattr(settings, name)}; use 4 or more")
    task = task_at(settings.rate_hz)
    if settings.world is not None:
        if settings.explain:
            raise ValueError(
                "explain looks for what the ideal simulator lacks, and world is "
                "another one; leave out one of the two"
            )
        ungrounded(settings.world, task)
    checked(settings.search)
    return _on_this_machine(settings)


def _check_named(settings: LoopSettings) -> None:
    """Refuse methods and candidates that are unknown, missing or named twice."""
    for name, known in (("methods", (*METHODS, ORACLE)), ("candidates", KINDS)):
        given = getattr(settings, name)
        if not given and not (name == "methods" and settings.explain):
            raise ValueError(f"no {name} given; name at least one: {' '.join(known)}")
        for each in given:
            if each not in known:
                raise ValueError(
                    f"{name[:-1]} {each!r} is unknown; choose from {', '.join(known)}"
                )
        if len(set(given)) != len(given):
            raise ValueError(f"{name} {given} name one twice; name each once")


def _on_this_machine(settings: LoopSettings) -> LoopSettings:
    """Check model and backend, and write out what `auto` stands for here."""
    if settings.model not in MODELS:
        raise ValueError(
            f"model {settings.model!r} is unknown; choose from {list(MODELS)}"
        )
    if settings.backend == "auto":
        lacking = mismatch() or unused_gpu()  # else a search on CPUs, unasked for
        if lacking is not None:
            raise ValueError(f"{lacking} (or use --backend native)")
        settings = dataclasses.replace(settings, backend=default_backend())
    if settings.backend not in BACKENDS:
        known = ["auto", *BACKENDS]
        raise ValueError(
            f"backend {settings.backend!r} is unknown; choose from {', '.join(known)}"
        )
    if settings.impl not in IMPLS:
        raise ValueError(
            f"impl {settings.impl!r} is unknown; choose from {', '.join(IMPLS)}"
        )
    if settings.impl == "auto":
        settings = dataclasses.replace(settings, impl=_best_impl(settings.backend))
    if settings.backend == "mjx":
        from gatjax.sim.mjxmodel import check_machine

        check_machine(settings.impl)
    return settings


def _best_impl(backend: str) -> str:
    """What --impl auto means on this machine; on native it means nothing."""
    if backend != "mjx":
        return "jax"
    from gatjax.sim.mjxmodel import lacking_for_warp

    return "jax" if lacking_for_warp() else "warp"
