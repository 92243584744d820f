"""Stand-in robots: simulated NAOs with effects that the search model does not have."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np

from gatjax.records import Outcome, Trajectory
from gatjax.task import Task

__all__ = ["ROBOTS", "Robot", "make_robot"]

ROBOTS = {
    "dart": "gatjax.surrogate.dart",
    "stiff": "gatjax.surrogate.stiff",
}


@runtime_checkable
class Robot(Protocol):
    """What every robot offers, simulated or real."""

    name: str

    def constants(self) -> dict[str, Any]:
        """Return what `robot.json` says about this robot."""
        ...

    def walk(
        self, policies: np.ndarray, seeds: Sequence[int] | np.ndarray, task: Task = ...
    ) -> tuple[Trajectory, Outcome]:
        """Let N robots walk: policies [N, 15], seeds [N]; records [N, T, ...], [N]."""
        ...


def make_robot(name: str, body_seed: int = 0, workers: int | None = None) -> Robot:
    """Return a stand-in robot by name.

    Args:
        name: one of ROBOTS.
        body_seed: draws its masses and offsets.
        workers: processes that share its runs; by default all cores.
    """
    engine = engine_of(name)
    from gatjax.surrogate.standin import StandIn

    return StandIn(name, engine, body_seed, workers)


def engine_of(name: str) -> Any:
    """Return the `gatjax.surrogate.standin.Engine` of a robot by name."""
    if name not in ROBOTS:
        raise ValueError(f"robot {name!r} is unknown; choose from {sorted(ROBOTS)}")
    return importlib.import_module(ROBOTS[name]).ENGINE
