"""What a search is measured against: loops that do less, or the same by another road.

A bare loop plays the commands of recorded walks from the same starts and does nothing
else: equal physics, so the ratio is what everything else costs. The environment loop is
what users write around an environment as Brax defines one: reset and step compiled and
vectorised, the policy on the host, observations and actions carried over every tick.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import batch

from gatjax import task as tasks
from gatjax.robot.model import slots
from gatjax.sim import episode
from gatjax.sim.mjxmodel import bare_data, mjx
from gatjax.speed.worlds import Walk

Array = Any


def bare_native(walk: Walk) -> Callable[[], None]:
    """Return a bare loop of `mujoco.batch` over the recorded commands."""
    physics = batch.Batch(walk.world.model, nsim=len(walk.qpos))

    def run() -> None:
        physics.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        physics.qpos[:], physics.qvel[:] = walk.qpos, walk.qvel
        for command in walk.command[:-1]:  # nothing is stepped after the last tick
            physics.ctrl[:] = command
            physics.step(nstep=walk.world.substeps)

    return run


def bare_mjx(walk: Walk, impl: str) -> Callable[[], Any]:
    """Return a bare MJX loop over the recorded commands: one compiled call."""
    model, data = bare_data(walk.world, impl, len(walk.qpos))

    def one(model: Any, qpos: Array, qvel: Array, commands: Array) -> Array:
        def tick(carry: Any, command: Array) -> tuple[Any, None]:
            return _ticked(model, carry, command, walk.world.substeps), None

        begun = data.replace(qpos=qpos, qvel=qvel)
        return jax.lax.scan(tick, begun, commands)[0].qpos

    many = jax.jit(jax.vmap(one, in_axes=(None, 0, 0, 1)))
    given = [jnp.asarray(part, float) for part in (walk.qpos, walk.qvel, walk.command)]
    return lambda: many(model, *given)


class EnvState(NamedTuple):
    """What an environment carries: physics, and what a policy sees of it."""

    data: Any
    seen: episode.Plant
    done: Array  # [] bool, fallen


def environment_loop(walk: Walk) -> Callable[[], np.ndarray]:
    """Return a loop over an environment's step, the walk engine on the host."""
    model, data = bare_data(walk.world, "jax")
    where, task = slots(walk.world.model), walk.world.task

    def see(data: Any) -> EnvState:
        seen = episode.observe(where, data.qpos, data.qvel, data.sensordata)
        return EnvState(data, seen, tasks.fallen(seen.base))

    def reset(qpos: Array, qvel: Array) -> EnvState:
        return see(data.replace(qpos=qpos, qvel=qvel))

    def step(state: EnvState, action: Array) -> EnvState:
        return see(_ticked(model, state.data, action, walk.world.substeps))

    resets, steps = jax.jit(jax.vmap(reset)), jax.jit(jax.vmap(step))
    starts = [jnp.asarray(part, float) for part in (walk.qpos, walk.qvel)]
    policies = np.asarray(walk.policies)
    go = np.full(len(policies), round(task.settle / task.control_period))

    def run() -> np.ndarray:
        state, pilot = resets(*starts), tasks.begin(policies)
        fell = np.zeros(len(policies), bool)
        for _ in range(task.ticks):
            reading = jax.tree.map(np.asarray, state.seen.reading)
            pilot, action = tasks.pilot(task, policies, go, pilot, reading)
            state = steps(state, jnp.asarray(action, float))
            fell |= np.asarray(state.done)
        return fell

    return run


def _ticked(model: Any, data: Any, command: Array, substeps: int) -> Any:
    """Physics after one control tick with a command."""

    def step(carry: Any, _: None) -> tuple[Any, None]:
        with jax.numpy_rank_promotion("allow"):
            return mjx.step(model, carry), None

    return jax.lax.scan(step, data.replace(ctrl=command), None, length=substeps)[0]
