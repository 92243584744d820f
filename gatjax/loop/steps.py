"""One generation of a search, for one trial or for many at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from gatjax import search
from gatjax.loop.memory import frugal
from gatjax.ranking import Evaluate
from gatjax.robot.model import model_file
from gatjax.settings import LoopSettings
from gatjax.sim.backend import costs, prepare
from gatjax.sim.contact import law_of
from gatjax.sim.lighter import lighter
from gatjax.sim.spread import everywhere
from gatjax.sim.stored import model_digest
from gatjax.sim.world import World, stacked

Share = Callable[[Evaluate], Evaluate]
Steps = Callable[
    [list[int], list[search.SearchState], int],
    list[tuple[search.SearchState, search.GenerationInfo]],
]
"""(which trials, their states, number of the generation) -> their new states, infos."""


def unshared(evaluate: Evaluate) -> Evaluate:
    """Leave all policies to this host."""
    return evaluate


def searched(settings: LoopSettings, world: World) -> World:
    """Return the world that a search runs in, lighter if the settings say so."""
    return lighter(world) if settings.model == "light" else world


def physics(world: World) -> dict[str, Any]:
    """What is simulated, beside a world's file: searches go on with the same alone."""
    model, (cone, ratio) = world.model, law_of(world.model)
    return {
        "timestep_s": float(model.opt.timestep),
        "solver_iterations": int(model.opt.iterations),
        "degrees_of_freedom": int(model.nv),
        "contact": f"{cone}, {ratio:g}",
        "model": model_digest(model_file(world.source))[:16],
        "mujoco": mujoco.__version__,
    }


def generation(
    settings: LoopSettings,
    world: World,
    space: search.Space,
    share: Share = unshared,
    say: Callable[[str], None] = print,
    trials: int | None = None,
) -> search.Generation:
    """Return one generation: a single compiled call on mjx, on one host.

    Where it does not fit into the device's memory it takes several turns, and says so.

    Args:
        settings: of the run.
        world: what is searched in, as `searched` returns it.
        space: that is searched.
        share: makes of what evaluates policies here what evaluates them on all hosts.
        say: shows a line to the user.
        trials: on mjx, how many are stacked in the state and values that it is given.
    """
    wanted = settings.search

    def build(turns: int) -> search.Generation:
        backend = prepare(world, settings.backend, settings.impl, turns, trials or 1)
        if backend.compiled and share is unshared:
            step = search.generation(space, wanted, costs(backend))
            step = jax.jit(jax.vmap(step, in_axes=(0, 0, None)) if trials else step)
            devices = jax.local_devices()
            return lambda state, *rest: step(everywhere(state, devices), *rest)
        return search.host_generation(space, wanted, share(costs(backend)))

    robots = wanted.population * wanted.rollouts * (trials or 1)
    return frugal(build, lambda *_: robots, say)


def apart(step: search.Generation, values: Any) -> Steps:
    """One generation of one trial."""

    def run(due: list[int], states: list, number: int) -> list:
        return [step(states[0], values, np.int32(number))]

    return run


def together(
    settings: LoopSettings,
    worlds: Sequence[World],
    space: search.Space,
    say: Callable[[str], None],
) -> Steps:
    """One generation of many trials in a single compiled call.

    Args:
        settings: of the runs.
        worlds: that the trials search in, as `alike` returns them.
        space: of one of them; each state carries its own.
        say: shows a line to the user.
    """
    step = generation(settings, worlds[0], space, say=say, trials=len(worlds))

    def run(due: list[int], states: list, number: int) -> list:
        state = jax.tree.map(lambda *leaves: jnp.stack(leaves), *states)
        values = stacked([worlds[index].values for index in due])
        result = step(state, values, np.int32(number))
        return [_of(result, place) for place in range(len(due))]

    return run


def _of(tree: Any, place: int) -> Any:
    """One of stacked trees."""
    return jax.tree.map(lambda leaf: leaf[place], tree)
