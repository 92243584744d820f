"""Choose a backend once, as a value: the same three functions on batches."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from gatjax.records import Outcome, Trajectory
from gatjax.sim.spread import in_turns, over_devices
from gatjax.sim.world import World

Array = Any
BACKENDS = ("native", "mjx")
IMPLS = ("auto", "jax", "warp")  # of mjx


class Backend(NamedTuple):
    """Runs of one world; the first argument of each function is the world's values."""

    outcome: Callable[..., Outcome]  # (values, policies [B, 15], keys [B]) -> [B]
    rollout: Callable[..., tuple[Trajectory, Outcome]]  # same, recorded
    replay: Callable[..., Array]  # (values, commands, angles, qpos, qvel), all [B, ...]
    compiled: bool  # True if outcome may be traced into a larger compiled function


def prepare(
    world: World,
    backend: str = "native",
    impl: str = "jax",
    turns: int = 1,
    trials: int = 1,
) -> Backend:
    """Return a world's runs on a backend.

    Args:
        world: what to simulate.
        backend: "native" (CPU threads) or "mjx" (one compiled call).
        impl: "jax" or "warp", for mjx.
        turns: in how many of them robots run on mjx; more take less memory.
        trials: that the caller vmaps the compiled function over.
    """
    if backend == "native":
        from gatjax.sim.native import Native

        native = Native(world)
        return Backend(native.outcome, native.rollout, native.replay, False)
    if backend == "mjx":
        from gatjax.sim import mjx, mjxmodel

        mjxmodel.check(world, impl)

        def batched(one: Callable[..., Any]) -> Callable[..., Any]:
            def many(values: Any, *each: Array) -> Any:
                count = each[0].shape[0]
                run = one(world, impl, trials * count)
                if trials == 1:
                    axes = (None, *(0 for _ in each))
                    return jax.vmap(run, in_axes=axes)(values, *each)

                def own(body: Any, *rest: Array) -> Any:
                    return run(values._replace(body=body), *rest)

                # Warp takes fields with a row a trial for those of robot 0, 1, 2 and
                # so on, again and again: each robot has a row.
                rows = {
                    name: jnp.broadcast_to(field, (count, *jnp.shape(field)))
                    for name, field in values.body.items()
                }
                return jax.vmap(own)(rows, *each)

            return many

        outcome = in_turns(batched(mjx.outcome), turns)
        if len(jax.local_devices()) > 1:
            if impl == "warp":  # Shardy crashes on its calls (segfault, jax 0.11.2)
                jax.config.update("jax_use_shardy_partitioner", False)
            outcome = over_devices(outcome, jax.local_devices())
        rollout = jax.jit(batched(mjx.rollout))
        replay = jax.jit(batched(mjx.replay))
        return Backend(jax.jit(outcome), rollout, replay, True)
    raise ValueError(f"backend {backend!r} is unknown; choose from {list(BACKENDS)}")


def use_compile_cache() -> None:
    """Keep compiled programs in the user's cache folder, across runs.

    Where it cannot be written to, programs are compiled anew each time.
    """
    root = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    folder = root / "gatjax" / "xla"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    if not os.access(folder, os.W_OK):
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)


def default_backend() -> str:
    """Return mjx where there is an accelerator, native elsewhere."""
    return "native" if jax.default_backend() == "cpu" else "mjx"


def costs(backend: Backend) -> Callable[[Any, Array, Array], Array]:
    """Return (values, policies [N, 15], keys [R]) -> costs [N, R].

    Every policy meets the same R keys. On the compiled backend the function can be
    traced; on the native one it runs on the host.
    """

    def evaluate(values: Any, policies: Array, keys: Array) -> Array:
        return pairs(backend.outcome, values, policies, keys).cost

    return evaluate


def pairs(run: Callable, values: Any, policies: Array, keys: Array) -> Any:
    """Run every policy [N, 15] with every key [R]; results [N, R, ...]."""
    count, repeats = len(policies), len(keys)
    each = policies.repeat(repeats, axis=0)
    index = np.tile(np.arange(repeats), count)
    result = run(values, each, keys[index])
    return jax.tree.map(lambda x: x.reshape(count, repeats, *x.shape[1:]), result)
