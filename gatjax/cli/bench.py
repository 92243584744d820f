"""Steps per second of each backend, beside a bare loop of the same engine.

The bare loop plays the commands of the same walks from the same starts and does nothing
else: equal physics, so the ratio is what the closed loop costs (sensors, walk engine,
effects, task). Compile time is reported apart. Compare ratios; absolute times only from
a quiet machine.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import batch, mjx

from gatjax import task as tasks
from gatjax.sim.backend import Backend, prepare
from gatjax.sim.mjx import bare_data, device_memory
from gatjax.sim.native import Native
from gatjax.sim.world import World, nominal
from gatjax.walk.parameters import THETA0

REPEATS = 3


def fastest(run: Callable[[], Any]) -> float:
    """Seconds of the fastest of some calls."""
    seconds = []
    for _ in range(REPEATS):
        begun = time.perf_counter()
        jax.block_until_ready(run())
        seconds.append(time.perf_counter() - begun)
    return min(seconds)


def _first(run: Callable[[], Any]) -> float:
    begun = time.perf_counter()
    jax.block_until_ready(run())
    return time.perf_counter() - begun


class Walk(NamedTuple):
    """What a bare loop plays: the same physics as the closed loop, nothing else."""

    world: World
    policies: Any  # [B, 15]
    keys: Any  # [B]
    qpos: np.ndarray  # [B, nq] at the start
    qvel: np.ndarray  # [B, nv]
    command: np.ndarray  # [T, B, J] rad


def recorded(world: World, worlds: int) -> Walk:
    """Walk theta0 once and keep the starts and commands."""
    policies = jnp.tile(jnp.asarray(THETA0, float), (worlds, 1))
    keys = jax.random.split(jax.random.key(0), worlds)
    native = Native(world)
    start = native.begin(world.values, policies, keys)[0]
    walk, _ = native.rollout(world.values, policies, keys)
    command = np.swapaxes(walk.command, 0, 1)
    return Walk(
        world, policies, keys, np.asarray(start.qpos), np.asarray(start.qvel), command
    )


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
    model, data = bare_data(walk.world, impl)

    def one(qpos: jax.Array, qvel: jax.Array, commands: jax.Array) -> jax.Array:
        def step(carry: Any, _: None) -> tuple[Any, None]:
            with jax.numpy_rank_promotion("allow"):
                return mjx.step(model, carry), None

        def tick(carry: Any, command: jax.Array) -> tuple[Any, None]:
            carry = carry.replace(ctrl=command)
            return jax.lax.scan(step, carry, None, length=walk.world.substeps)

        begun = data.replace(qpos=qpos, qvel=qvel)
        return jax.lax.scan(tick, begun, commands)[0].qpos

    many = jax.jit(jax.vmap(one, in_axes=(0, 0, 1)))
    given = [jnp.asarray(part, float) for part in (walk.qpos, walk.qvel, walk.command)]
    return lambda: many(*given)


def measure(
    backends: Sequence[str], worlds: int, seconds: float
) -> list[dict[str, Any]]:
    """Measure closed loop against bare loop for each backend.

    Args:
        backends: of native, mjx-jax, mjx-warp.
        worlds: robots in parallel.
        seconds: simulated time after the settling, s.
    """
    world = nominal(tasks.Task(duration=seconds, longest_delay=0.0))
    walk, rows = recorded(world, worlds), []
    for name in backends:
        kind, _, impl = name.partition("-")
        backend = prepare(world, kind, impl or "jax")

        def closed(backend: Backend = backend) -> Any:
            return backend.outcome(world.values, walk.policies, walk.keys).cost

        bare = bare_native(walk) if kind == "native" else bare_mjx(walk, impl)
        first, _ = _first(closed), _first(bare)
        closed_s, bare_s = fastest(closed), fastest(bare)
        steps = worlds * (world.task.ticks - (kind == "native")) * world.substeps
        rows.append(
            {
                "backend": name,
                "device": str(jax.devices()[0]) if kind == "mjx" else "cpu",
                "worlds": worlds,
                "closed_steps_per_s": steps / closed_s,
                "bare_steps_per_s": steps / bare_s,
                "closed_over_bare": closed_s / bare_s,
                "compile_s": max(0.0, first - closed_s),
                "peak_memory_gib": device_memory() if kind == "mjx" else None,
            }
        )
    return rows


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Lay the rows out for a person."""
    lines = [
        f"{'backend':<10} {'worlds':>6} {'closed steps/s':>15} {'bare steps/s':>13} "
        f"{'closed/bare':>12} {'compile s':>10}  device"
    ]
    for row in rows:
        closed, bare = row["closed_steps_per_s"], row["bare_steps_per_s"]
        lines.append(
            f"{row['backend']:<10} {row['worlds']:>6} {closed:>15,.0f} {bare:>13,.0f} "
            f"{row['closed_over_bare']:>12.2f} {row['compile_s']:>10.1f}  "
            f"{row['device']}"
        )
    return "\n".join(lines)
