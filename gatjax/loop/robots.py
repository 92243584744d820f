"""A simulated world in the place of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from gatjax.records import Array, Outcome, Trajectory
from gatjax.sim.backend import prepare
from gatjax.sim.world import World
from gatjax.task import Task


class Simulator:
    """A world that walks policies as a robot does."""

    name = "simulator"

    def __init__(self, world: World) -> None:
        """Prepare the runs of a world on the CPU."""
        self.world = world
        self._backend = prepare(world, "native")

    def constants(self) -> dict[str, Any]:
        """Return the causes that the world carries."""
        return {"model": self.world.source, "causes": list(self.world.causes)}

    def walk(
        self,
        policies: Array,
        seeds: Sequence[int] | np.ndarray,
        task: Task | None = None,
    ) -> tuple[Trajectory, Outcome]:
        """Walk policies [N, 15] with seeds [N]."""
        if task is not None and task != self.world.task:
            raise ValueError("this simulator was prepared for another task")
        keys = jax.vmap(jax.random.key)(np.asarray(list(seeds)))
        return self._backend.rollout(self.world.values, policies, keys)
