"""The search stage: CMA-ES in one world, a checkpoint and two policies a generation."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from gatjax import checkpoints, runs, search
from gatjax.loop.memory import frugal
from gatjax.loop.setting import SIMULATOR_UNIT
from gatjax.records import Array
from gatjax.runs import Progress
from gatjax.settings import LoopSettings
from gatjax.sim.backend import costs, pairs, prepare
from gatjax.sim.lighter import lighter
from gatjax.sim.world import World
from gatjax.walk.parameters import HIGH, LOW, STEP, THETA0


class Candidate(NamedTuple):
    """A walk to be tried on the robot."""

    method: str
    iteration: int
    generation: int
    kind: str  # best or mean
    policy: Array  # [15]

    @property
    def key(self) -> dict[str, Any]:
        """Key columns of the tables."""
        return {
            "method": self.method,
            "iteration": self.iteration,
            "generation": self.generation,
            "candidate": self.kind,
        }

    @property
    def name(self) -> str:
        """Name of its policy file."""
        facts = (self.method, self.iteration, self.generation, self.kind)
        return "_".join(map(str, facts))


class Job(NamedTuple):
    """One search: where it writes, in which world, from which policy."""

    folder: Path
    method: str
    iteration: int
    world: World
    theta: Array  # [15]
    key: Array
    check_key: Array  # for measuring the candidates afresh in this world

    @property
    def checkpoints(self) -> Path:
        """Folder of its checkpoints."""
        return self.folder / "checkpoints" / f"{self.method}_{self.iteration}"


Share = Callable[[search.Evaluate], search.Evaluate]


def unshared(evaluate: search.Evaluate) -> search.Evaluate:
    """Leave all policies to this host."""
    return evaluate


def optimise(
    job: Job, settings: LoopSettings, progress: Progress, share: Share = unshared
) -> list[Candidate]:
    """Search, or go on with a search; return the candidates of every generation.

    Args:
        job: what is searched, and where.
        settings: of the run.
        progress: told of every generation.
        share: makes of what evaluates policies here what evaluates them on all hosts.
    """

    def build(space: search.Space) -> tuple[search.Generation, Any]:
        world = searched(settings, job.world)
        return generation(settings, world, space, share, progress.stage), world.values

    candidates = generations(job, settings, progress, build)
    verify(job, candidates, settings.search.rollouts)
    return candidates


def generations(
    job: Job,
    settings: LoopSettings,
    progress: Progress,
    build: Callable[[search.Space], tuple[search.Generation, Any]],
    unit: float = SIMULATOR_UNIT,
) -> list[Candidate]:
    """Run the generations that are still to be run, with a checkpoint each.

    Args:
        job: what is searched, and where.
        settings: of the run.
        progress: told of every generation.
        build: returns one generation and its values; called only if one is left.
        unit: of work, for one rollout.
    """
    theta = np.clip(job.theta, LOW, HIGH)
    space = search.Space(theta0=theta, step=STEP, low=LOW, high=HIGH)
    state = search.start(space, settings.search, job.key)
    done = checkpoints.latest(job.checkpoints)
    first, total = 0 if done is None else done + 1, settings.search.generations
    if done is not None:
        state = checkpoints.restore(job.checkpoints, state, done)
    candidates = read_candidates(job, first, settings.candidates)
    work = unit * settings.search.population * settings.search.rollouts
    progress.work(work * first)
    if first >= total:
        return candidates
    step, values = build(space)
    for number in range(first, total):
        progress.stage(f"{job.method}: generation {number + 1} of {total}")
        begun = time.perf_counter()
        state, info = step(state, values, np.int32(number))
        info = jax.tree.map(np.asarray, info)
        seconds = time.perf_counter() - begun
        candidates += write_candidates(job, number, info, settings.candidates, seconds)
        checkpoints.save(job.checkpoints, number, state)
        progress.work(work)
    return candidates


def searched(settings: LoopSettings, world: World) -> World:
    """Return the world that a search runs in, lighter if the settings say so."""
    return lighter(world) if settings.model == "light" else world


def generation(
    settings: LoopSettings,
    world: World,
    space: search.Space,
    share: Share = unshared,
    say: Callable[[str], None] = print,
) -> search.Generation:
    """Return one generation: a single compiled call on mjx, on one host.

    Where it does not fit into the device's memory it takes several turns, and says so.
    """
    wanted = settings.search

    def build(turns: int) -> search.Generation:
        backend = prepare(world, settings.backend, settings.impl, turns)
        if backend.compiled and share is unshared:
            return jax.jit(search.generation(space, wanted, costs(backend)))
        return search.host_generation(space, wanted, share(costs(backend)))

    return frugal(build, wanted.population * wanted.rollouts, say)


def write_candidates(
    job: Job,
    number: int,
    info: search.GenerationInfo,
    kinds: Sequence[str],
    seconds: float,
) -> list[Candidate]:
    """Write the candidates of one generation."""
    found = {"best": info.best_policy, "mean": info.mean_policy}
    candidates = [
        Candidate(job.method, job.iteration, number, kind, found[kind])
        for kind in kinds
    ]
    for candidate in candidates:
        runs.write_policy(
            job.folder / "policies", candidate.name, candidate.policy, candidate.key
        )
    facts = {"sigma": float(info.sigma), "seconds": seconds}
    rows = [candidate.key | facts for candidate in candidates]
    for row in rows:
        if row["candidate"] == "best":
            row["simulator_cost"] = float(info.best_cost)
    runs.add_rows(job.folder / "metrics.csv", rows)
    return candidates


def read_candidates(
    job: Job, generations: int, kinds: Sequence[str]
) -> list[Candidate]:
    """Read the candidates of generations that are done already."""
    candidates = []
    for number in range(generations):
        for kind in kinds:
            empty = Candidate(job.method, job.iteration, number, kind, THETA0)
            path = job.folder / "policies" / f"{empty.name}.json"
            candidates.append(empty._replace(policy=runs.read_policy(path)))
    return candidates


def measured(folder: Path, column: str) -> dict[tuple, dict[str, Any]]:
    """Rows of metrics.csv by key, where a column is filled in."""
    path = folder / "metrics.csv"
    names = ("method", "iteration", "generation", "candidate")
    return {
        tuple(row[name] for name in names): row
        for row in (runs.read_table(path) if path.exists() else [])
        if row[column] is not None
    }


def verify(job: Job, candidates: list[Candidate], rollouts: int) -> None:
    """Measure every candidate in the world it was found in, with fresh keys; once."""
    path = job.folder / "metrics.csv"
    known = measured(job.folder, "simulator_falls")
    candidates = [c for c in candidates if tuple(c.key.values()) not in known]
    if not candidates:
        return
    keys = jax.random.split(job.check_key, rollouts)
    policies = np.stack([candidate.policy for candidate in candidates])
    backend = prepare(job.world, "native")
    result = pairs(backend.outcome, job.world.values, policies, keys)
    rows = [
        candidate.key
        | {
            "simulator_cost": float(search.policy_costs(result.cost[[index]])[0]),
            "simulator_velocity_m_s": float(result.velocity[index].mean()),
            "simulator_falls": int(np.isfinite(result.fell_at[index]).sum()),
        }
        for index, candidate in enumerate(candidates)
    ]
    runs.add_rows(path, rows)
