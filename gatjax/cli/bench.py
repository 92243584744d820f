"""Steps per second of each backend, beside a bare stepping loop of the same engine.

The bare loop steps as many worlds as many times with constant commands and does nothing
else, so the ratio is what the closed loop (sensors, walk engine, effects, task) costs.
Compile time is reported apart. Compare ratios; absolute times only from a quiet machine.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import batch, mjx

from gatjax import task as tasks
from gatjax.sim.backend import prepare
from gatjax.sim.mjx import bare_data, device_memory
from gatjax.sim.world import World, nominal
from gatjax.walk.parameters import THETA0

REPEATS = 3


def _best(run: Callable[[], Any]) -> float:
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


def _stand(world: World) -> tuple[np.ndarray, np.ndarray]:
    """State and command of a robot that stands ready."""
    from gatjax.sim import episode
    from gatjax.robot.model import slots

    start = episode.start(
        world, slots(world.model), jnp.asarray(THETA0, float), jax.random.key(0)
    )
    return np.asarray(start.qpos), np.asarray(tasks.pose(THETA0))


def bare_native(world: World, worlds: int) -> Callable[[], None]:
    """Return a bare stepping loop of `mujoco.batch`, as many steps as a rollout."""
    qpos, command = _stand(world)
    physics = batch.Batch(world.model, nsim=worlds)

    def run() -> None:
        physics.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        physics.qpos[:] = qpos
        physics.ctrl[:] = command
        for _ in range(world.task.ticks - 1):
            physics.step(nstep=world.substeps)

    return run


def bare_mjx(world: World, worlds: int, impl: str) -> Callable[[], Any]:
    """Return a bare MJX loop: vmap and scan over steps, one compiled call."""
    qpos, command = _stand(world)
    model, data = bare_data(world, impl)
    steps = world.task.ticks * world.substeps

    def one(qpos: jax.Array) -> jax.Array:
        begun = data.replace(qpos=qpos, ctrl=jnp.asarray(command, qpos.dtype))

        def step(carry: Any, _: None) -> tuple[Any, None]:
            with jax.numpy_rank_promotion("allow"):
                return mjx.step(model, carry), None

        return jax.lax.scan(step, begun, None, length=steps)[0].qpos

    many = jax.jit(jax.vmap(one))
    start = jnp.broadcast_to(jnp.asarray(qpos, float), (worlds, len(qpos)))
    return lambda: many(start)


def measure(
    backends: Sequence[str], worlds: int, seconds: float
) -> list[dict[str, Any]]:
    """Measure closed loop against bare loop for each backend.

    Args:
        backends: of native, mjx-jax, mjx-warp.
        worlds: robots in parallel.
        seconds: simulated time after the settling, s.
    """
    rows = []
    for name in backends:
        kind, _, impl = name.partition("-")
        world = nominal(tasks.Task(duration=seconds, longest_delay=0.0))
        backend = prepare(world, kind, impl or "jax")
        policies = jnp.tile(jnp.asarray(THETA0, float), (worlds, 1))
        keys = jax.random.split(jax.random.key(0), worlds)

        def closed(backend=backend, world=world, policies=policies, keys=keys) -> Any:
            return backend.outcome(world.values, policies, keys).cost

        bare = (
            bare_native(world, worlds)
            if kind == "native"
            else bare_mjx(world, worlds, impl)
        )
        first, _ = _first(closed), _first(bare)
        closed_s, bare_s = _best(closed), _best(bare)
        # the bare and the closed native loop stop before the last tick's physics
        ticks = world.task.ticks - (1 if kind == "native" else 0)
        steps = worlds * ticks * world.substeps
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
        lines.append(
            f"{row['backend']:<10} {row['worlds']:>6} {row['closed_steps_per_s']:>15,.0f} "
            f"{row['bare_steps_per_s']:>13,.0f} {row['closed_over_bare']:>12.2f} "
            f"{row['compile_s']:>10.1f}  {row['device']}"
        )
    return "\n".join(lines)
