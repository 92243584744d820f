"""What flags of several verbs mean: worlds, robots, policies, folders."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from gatjax import loop, runs
from gatjax.grounding import learn as grounders
from gatjax.hardware.links import FORMS, is_hardware
from gatjax.hardware.robot import Hardware
from gatjax.hardware.terminal import Terminal
from gatjax.sim.stored import read_world
from gatjax.sim.walker import walker
from gatjax.sim.world import World, nominal
from gatjax.surrogate import ROBOTS, make_robot
from gatjax.task import Task
from gatjax.walk.parameters import THETA0

MOST = 2**32 - 1  # that a random key takes as its seed


def world_of(path: Path | None, task: Task) -> World:
    """Load a world with its grounding; the ideal simulator without a path."""
    return _grounded(*_read(path, task))


def walker_of(path: Path | None, task: Task) -> World:
    """The same of a NAO that walks; one that hangs is put on its feet.

    Raises:
        ValueError: one line: this robot cannot walk.
    """
    world, folder = _read(path, task)
    return _grounded(walker(world), folder)


def _read(path: Path | None, task: Task) -> tuple[World, Path | None]:
    return (nominal(task), None) if path is None else read_world(path, task)


def _grounded(world: World, folder: Path | None) -> World:
    if folder is None:
        return world
    return grounders.grounded(world, grounders.read_grounding(folder))


def robot_of(
    name: str, body_seed: int, world: Path | None, task: Task, folder: Path,
    read: Callable[[Path | None, Task], World],
) -> Any:  # fmt: skip
    """Return the robot of a command.

    Args:
        name: simulator, a stand-in, or a robot behind a link.
        body_seed: of a stand-in.
        world: of the simulator.
        task: of the simulator.
        folder: gets frames and finished walks of a robot behind a link.
        read: of the simulator's world, `world_of` or `walker_of`.
    """
    if name == "simulator":
        return loop.Simulator(read(world, task))
    if world is not None:
        raise ValueError(f"--world is for --robot simulator, not {name}")
    return robot_named(name, body_seed, folder, ("simulator",))


def robot_named(
    name: str, body_seed: int, folder: Path, besides: tuple[str, ...] = ()
) -> Any:
    """Return a robot that the simulator does not know; `besides` are choices, too."""
    if is_hardware(name):
        return Hardware(name, folder, Terminal())
    if name not in ROBOTS:
        known = ", ".join([*besides, *ROBOTS, FORMS])
        raise ValueError(f"robot {name!r} is unknown; choose from {known}")
    return make_robot(name, body_seed)


def policy_of(path: Path | None) -> np.ndarray:
    """Read a policy, theta0 without a path."""
    return THETA0 if path is None else runs.read_policy(path)


def check_least(least: int, **numbers: int) -> None:
    """Refuse numbers that are too small, by the names of their flags."""
    for name, value in numbers.items():
        flag = f"--{name.replace('_', '-')}"
        if value < least:
            raise ValueError(f"{flag} is {value}; use {least} or more")
        if value > MOST:
            raise ValueError(f"{flag} is {value}; use {MOST} or less")


def check_seconds(seconds: float) -> None:
    """Refuse a length of time that is none."""
    if not 0.0 < seconds < np.inf:
        raise ValueError(f"--seconds is {seconds}; use a number greater than 0")
