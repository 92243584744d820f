"""Where the time of a generation goes: its parts, each run by itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from mujoco import batch

from gatjax import search
from gatjax.settings import SearchSettings
from gatjax.sim import mjx
from gatjax.sim.native import Native
from gatjax.sim.world import World
from gatjax.speed.worlds import Walk
from gatjax.walk.parameters import HIGH, LOW, STEP, THETA0


class Held:
    """A batch of MuJoCo that is told everything, and never steps."""

    def __init__(self, model: Any, nsim: int) -> None:
        """Make the batch."""
        self._batch = batch.Batch(model, nsim=nsim)

    def __getattr__(self, name: str) -> Any:
        """Everything else is the batch's."""
        return getattr(self._batch, name)

    def step(self, **_: Any) -> None:
        """Leave the robots where they are."""


def hung(model: Any, data: Any) -> Any:
    """Physics that steps nothing, of which XLA can leave no command out."""
    return data.replace(sensordata=data.sensordata + 0.0 * data.ctrl.sum())


def control(world: World, engine: str, impl: str, walk: Walk) -> Callable[[], Any]:
    """Return all runs without a physics step.

    Walk engine, sensors, effects, grounding and task, for robots that hang in the air.
    """
    given = world.values, walk.policies, walk.keys
    if engine == "native":
        native = Native(world, Held)
        return lambda: native.outcome(*given).cost
    one = mjx.outcome(world, impl, len(walk.qpos), hung)
    many = jax.jit(jax.vmap(one, in_axes=(None, 0, 0)))
    return lambda: many(*given).cost


def search_alone(population: int, rollouts: int) -> Callable[[], Any]:
    """Return one generation of CMA-ES whose rollouts cost no time."""
    settings = SearchSettings(population=population, rollouts=rollouts)
    space = search.Space(theta0=THETA0, step=STEP, low=LOW, high=HIGH)
    state = search.start(space, settings, jax.random.key(0))
    costs = np.random.default_rng(0).random((population, rollouts))
    run = search.host_generation(space, settings, lambda *_: costs)
    return lambda: run(state, None, np.int32(0))[1].costs
