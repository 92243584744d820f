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
    "dart": ("gatjax.surrogate.dart", "Dart"),
    "stiff": ("gatjax.surrogate.stiff", "Stiff"),
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


def make_robot(name: str, body_seed: int = 0) -> Robot:
    """Return a stand-in robot by name; the body seed draws its masses and offsets."""
    if name not in ROBOTS:
        raise ValueError(f"robot {name!r} is unknown; choose from {sorted(ROBOTS)}")
    module, kind = ROBOTS[name]
    return getattr(importlib.import_module(module), kind)(body_seed)
