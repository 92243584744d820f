"""The search stage: CMA-ES in one world, a checkpoint and two policies a generation."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from gatjax import checkpoints, runs, search
from gatjax.loop.setting import SIMULATOR_UNIT
from gatjax.loop.steps import (
    Share,
    Steps,
    apart,
    generation,
    searched,
    together,
    unshared,
)
from gatjax.ranking import policy_costs
from gatjax.records import Array
from gatjax.runs import Progress
from gatjax.settings import LoopSettings
from gatjax.sim.backend import pairs, prepare
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

    def build(space: search.Space) -> Steps:
        world = searched(settings, job.world)
        step = generation(settings, world, space, share, progress.stage)
        return apart(step, world.values)

    (candidates,) = generations([job], settings, progress, build)
    verify(job, candidates, settings.search.rollouts)
    return candidates


def optimise_all(
    jobs: Sequence[Job], settings: LoopSettings, progress: Progress
) -> list[list[Candidate]]:
    """Search in trials of one method; on mjx all of them are one compiled call.

    Args:
        jobs: trials of one method, each with a folder of its own.
        settings: of the runs, whose seeds alone may differ.
        progress: told of every generation.
    """
    worlds = [job.world for job in jobs]
    if len(jobs) == 1 or settings.backend != "mjx" or any(w.causes for w in worlds):
        return [optimise(job, settings, progress) for job in jobs]

    def build(space: search.Space) -> Steps:
        return together(settings, worlds, space, progress.stage)

    found = generations(jobs, settings, progress, build)
    for job, candidates in zip(jobs, found, strict=True):
        verify(job, candidates, settings.search.rollouts)
    return found


def generations(
    jobs: Sequence[Job],
    settings: LoopSettings,
    progress: Progress,
    build: Callable[[search.Space], Steps],
    unit: float = SIMULATOR_UNIT,
) -> list[list[Candidate]]:
    """Run the generations that are still to be run, with a checkpoint each.

    Args:
        jobs: what is searched, and where; trials of one method.
        settings: of the run.
        progress: told of every generation.
        build: returns what runs one generation; called only if one is left.
        unit: of work, for one rollout.
    """
    states, firsts, found = zip(*(begun(job, settings) for job in jobs), strict=True)
    states, total = list(states), settings.search.generations
    work = unit * settings.search.walks
    progress.work(work * sum(firsts))
    if min(firsts) >= total:
        return list(found)
    step = build(states[0].space)
    for number in range(min(firsts), total):
        due = [index for index, first in enumerate(firsts) if first <= number]
        many = f", {len(due)} trials" if len(jobs) > 1 else ""
        progress.stage(f"{jobs[0].method}: generation {number + 1} of {total}{many}")
        clock = time.perf_counter()
        results = step(due, [states[index] for index in due], number)
        seconds = (time.perf_counter() - clock) / len(due)
        for index, (state, info) in zip(due, results, strict=True):
            states[index], job = state, jobs[index]
            info = jax.tree.map(np.asarray, info)
            kinds = settings.candidates
            found[index].extend(write_candidates(job, number, info, kinds, seconds))
            checkpoints.save(job.checkpoints, number, state)
            progress.work(work)
    return list(found)


def begun(
    job: Job, settings: LoopSettings
) -> tuple[search.SearchState, int, list[Candidate]]:
    """State of a job's search, the generation that comes next, candidates so far."""
    theta = np.clip(job.theta, LOW, HIGH)
    space = search.Space(theta0=theta, step=STEP, low=LOW, high=HIGH)
    state = search.start(space, settings.search, job.key)
    done = checkpoints.latest(job.checkpoints)
    first = 0 if done is None else done + 1
    if done is not None:
        state = checkpoints.restore(job.checkpoints, state, done)
    return state, first, read_candidates(job, first, settings.candidates)


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
            "simulator_cost": float(policy_costs(result.cost[[index]])[0]),
            "simulator_velocity_m_s": float(result.velocity[index].mean()),
            "simulator_falls": int(np.isfinite(result.fell_at[index]).sum()),
        }
        for index, candidate in enumerate(candidates)
    ]
    runs.add_rows(path, rows)
