"""Speed of a search's generation, by engine and world, beside its peers.

Worlds differ in how long their physics steps are, so speeds are compared in
robot-seconds a second: what all robots together live through. Times of one row are
taken in turns, so that a machine which slows down slows all of them; compare ratios,
absolute times only from a quiet machine.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from gatjax import search
from gatjax.loop.steps import generation
from gatjax.runs import Progress
from gatjax.settings import LoopSettings, SearchSettings
from gatjax.sim.lighter import lighter
from gatjax.sim.mjxmodel import check_machine
from gatjax.sim.world import World
from gatjax.speed import machine, peers, stages
from gatjax.speed.worlds import Walk, recorded, stepped_as, world_of
from gatjax.task import Task
from gatjax.walk.parameters import HIGH, LOW, STEP, THETA0

SCHEMA = "gatjax.bench/3"
REPEATS = 3
ROLLOUTS = 20  # of a policy at most, as in the paper
FEWEST = 4  # policies of a search
NARROW = 1e-9  # steps: all policies walk like theta0, so all worlds do the same work
ENVIRONMENT = "environment"
Call = Callable[[], Any]


class Asked(NamedTuple):
    """What is to be measured."""

    backends: Sequence[str]  # of native, mjx-jax, mjx-warp, environment
    models: Sequence[str]  # of full, light
    worlds: Sequence[str]  # of plain, grounded, explained
    count: int  # robots in parallel
    seconds: float  # simulated time after the settling, s

    @property
    def rows(self) -> int:
        """How many rows that makes."""
        engines = sum(backend != ENVIRONMENT for backend in self.backends)
        alike = len(self.backends) - engines
        return engines * len(self.models) * len(self.worlds) + alike


def shared(count: int) -> tuple[int, int]:
    """Policies and rollouts a policy that make up a number of robots.

    Raises:
        ValueError: too few policies for a search.
    """
    if count < FEWEST:
        raise ValueError(f"--worlds is {count}; a search needs {FEWEST} policies")
    most = min(ROLLOUTS, count // FEWEST)
    rollouts = next(k for k in range(most, 0, -1) if count % k == 0)
    return count // rollouts, rollouts


def measure(asked: Asked, progress: Progress) -> dict[str, Any]:
    """Measure what is asked for.

    Args:
        asked: engines, worlds and sizes.
        progress: one unit a row.

    Returns:
        Content of `gatjax bench --json`.

    Raises:
        ValueError: one line: a backend can't run here; nothing was measured.
    """
    for backend in asked.backends:
        engine, _, impl = backend.partition("-")
        if engine == "mjx":
            check_machine(impl)
    task = Task(duration=asked.seconds, longest_delay=0.0)
    shared(asked.count)
    world = world_of("plain", task)
    plain = {"full": recorded(world, asked.count)}
    if "light" in asked.models:
        plain["light"] = recorded(lighter(world), asked.count)
    rows = []
    for backend in asked.backends:
        if backend == ENVIRONMENT:
            progress.stage(backend)
            rows.append(_environment(plain["full"]))
            progress.work(1.0)
            continue
        for kind, model in itertools.product(asked.worlds, asked.models):
            progress.stage(f"{backend}, {kind}, {model}")
            world = world_of(kind, task)
            world = lighter(world) if model == "light" else world
            about = {"backend": backend, "world": kind, "model": model}
            rows.append(about | _row(backend, world, plain["full"], plain[model]))
            progress.work(1.0)
    return {"schema": SCHEMA, "machine": machine.facts(), "rows": rows}


def _row(backend: str, world: World, whole: Walk, own: Walk) -> dict[str, Any]:
    """A generation of the search in one world on one engine, beside bare steps.

    Args:
        backend: native, mjx-jax or mjx-warp.
        world: that the search runs in.
        whole: plain walk of the full model, which the bare loop plays.
        own: plain walk of the world's own model.
    """
    engine, _, impl = backend.partition("-")
    impl = impl or "jax"
    count = len(own.qpos)
    calls = {
        "closed": searched(world, engine, impl, count),
        "bare": bare(engine, impl, whole),
        "control": stages.control(world, engine, impl, own),
        "search": stages.search_alone(*shared(count)),
    }
    if own is not whole:
        calls["physics"] = bare(engine, impl, stepped_as(own, world))
    first = {name: timed(call) for name, call in calls.items()}
    best = raced(calls)
    closed = best["closed"]
    ticks = count * (world.task.ticks - (engine == "native"))
    lived = ticks * world.task.control_period
    parts = {"physics": best.get("physics", best["bare"])}
    parts |= {name: best[name] for name in ("control", "search")}
    return _facts(engine, own) | {
        "closed_steps_per_s": ticks * world.substeps / closed,
        "bare_steps_per_s": ticks * whole.world.substeps / best["bare"],
        "closed_robot_s_per_s": lived / closed,
        "bare_robot_s_per_s": lived / best["bare"],
        "closed_over_bare": closed / best["bare"],
        "rollouts_per_s": count / closed,
        "generation_s": closed,
        "stages_s": parts | {"rest": closed - sum(parts.values())},
        "compile_s": max(0.0, first["closed"] - closed),
        "joules": energy(calls["closed"]),
    }


def bare(engine: str, impl: str, walk: Walk) -> Call:
    """Return a bare loop of an engine."""
    if engine == "native":
        return peers.bare_native(walk)
    return peers.bare_mjx(walk, impl)


def _environment(walk: Walk) -> dict[str, Any]:
    """The environment loop, plain world."""
    run = peers.environment_loop(walk)
    first = timed(run)
    best = raced({"loop": run})["loop"]
    task = walk.world.task
    ticks = len(walk.qpos) * task.ticks
    return _facts("mjx", walk) | {
        "backend": ENVIRONMENT, "world": "plain", "model": "full",
        "closed_steps_per_s": ticks * walk.world.substeps / best,
        "bare_steps_per_s": None,
        "closed_robot_s_per_s": ticks * task.control_period / best,
        "bare_robot_s_per_s": None,
        "closed_over_bare": None, "rollouts_per_s": len(walk.qpos) / best,
        "generation_s": best, "stages_s": None,
        "compile_s": max(0.0, first - best), "joules": None,
    }  # fmt: skip


def _facts(engine: str, walk: Walk) -> dict[str, Any]:
    """What a row is about."""
    compiled = engine == "mjx"
    return {
        "device": str(jax.devices()[0]) if compiled else "cpu",
        "worlds": len(walk.qpos), "seconds": walk.world.task.duration,
        "peak_process_memory_gib": machine.device_memory() if compiled else None,
    }  # fmt: skip


def searched(world: World, engine: str, impl: str, count: int) -> Call:
    """Return one generation of a search: ask, all rollouts, tell."""
    population, rollouts = shared(count)
    settings = LoopSettings(
        search=SearchSettings(population=population, rollouts=rollouts, sigma=NARROW),
        backend=engine,
        impl=impl,
    )
    space = search.Space(theta0=THETA0, step=STEP, low=LOW, high=HIGH)
    state = search.start(space, settings.search, jax.random.key(0))
    run = generation(settings, world, space)
    return lambda: run(state, world.values, np.int32(0))[1].costs


def timed(call: Call) -> float:
    """Seconds of a call, its results included."""
    begun = time.perf_counter()
    jax.block_until_ready(call())
    return time.perf_counter() - begun


def raced(calls: Mapping[str, Call]) -> dict[str, float]:
    """Seconds of the fastest of some runs of each call, taken in turns."""
    rounds = [{name: timed(run) for name, run in calls.items()} for _ in range(REPEATS)]
    return {name: min(each[name] for each in rounds) for name in calls}


def energy(call: Call) -> float | None:
    """Joules of a call, mean of some; None where no counter says, or one ran over."""
    before = machine.joules()
    if before is None:
        return None
    for _ in range(REPEATS):
        timed(call)
    after = machine.joules()
    return None if after is None or after < before else (after - before) / REPEATS


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Lay the rows out for a person."""
    lines = [
        f"{'backend':<12} {'world':<10} {'model':<6} {'worlds':>6} {'steps/s':>11} "
        f"{'robot s/s':>9} {'bare':>9} "
        f"{'time/bare':>9} {'compile s':>9}  where the time goes"
    ]
    for row in rows:
        bare, ratio = row["bare_robot_s_per_s"], row["closed_over_bare"]
        lines.append(
            f"{row['backend']:<12} {row['world']:<10} {row['model']:<6} "
            f"{row['worlds']:>6} "
            f"{row['closed_steps_per_s']:>11,.0f} "
            f"{row['closed_robot_s_per_s']:>9,.0f} "
            f"{'-' if bare is None else f'{bare:,.0f}':>9} "
            f"{'-' if ratio is None else f'{ratio:.2f}':>9} "
            f"{row['compile_s']:>9.1f}  {_shares(row)}"
        )
    return "\n".join(lines)


def _shares(row: dict[str, Any]) -> str:
    """Stages of a generation in per cent of its time."""
    stages = row["stages_s"] or {}
    whole = row["generation_s"]
    return ", ".join(f"{name} {part / whole:.0%}" for name, part in stages.items())
