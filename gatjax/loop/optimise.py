"""The search stage: CMA-ES in one world, a checkpoint and candidates a generation."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import jax
import numpy as np

from gatjax import checkpoints, search
from gatjax.loop.candidates import (
    Candidate,
    Job,
    Recheck,
    read_candidates,
    verify,
    write_candidates,
)
from gatjax.loop.recheck import rechecking, rechecks
from gatjax.loop.setting import SIMULATOR_UNIT
from gatjax.loop.steps import (
    Share,
    Steps,
    apart,
    generation,
    physics,
    searched,
    together,
    unshared,
)
from gatjax.runs import Progress, check_same, read_json, write_json
from gatjax.settings import LoopSettings
from gatjax.sim.alike import alike
from gatjax.sim.backend import prepare
from gatjax.sim.world import World
from gatjax.walk.parameters import HIGH, LOW, STEP


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
    world = searched(settings, job.world)
    _begin(job, world)
    return _alone(job, world, settings, progress, share)


def optimise_all(
    jobs: Sequence[Job], settings: LoopSettings, progress: Progress
) -> list[list[Candidate]]:
    """Search in trials of one method; on mjx all of them are one compiled call.

    Worlds that differ in their causes are made alike first (`gatjax.sim.alike`); those
    whose physics steps differ are searched apart, so that each search is what it would
    be alone.

    Args:
        jobs: trials of one method, each with a folder of its own.
        settings: of the runs, whose seeds alone may differ.
        progress: told of every generation.
    """
    if settings.backend != "mjx":
        return [optimise(job, settings, progress) for job in jobs]
    worlds = [searched(settings, job.world) for job in jobs]
    for job, world in zip(jobs, worlds, strict=True):
        _begin(job, world)
    found: dict[int, list[Candidate]] = {}
    for places in stepping(worlds):
        some, there = zip(*((jobs[at], worlds[at]) for at in places), strict=True)
        candidates = _at_once(some, there, settings, progress)
        found |= dict(zip(places, candidates, strict=True))
    return [found[place] for place in range(len(jobs))]


def _alone(
    job: Job,
    world: World,
    settings: LoopSettings,
    progress: Progress,
    share: Share = unshared,
) -> list[Candidate]:
    """Search in one trial, in a world that is made for it."""

    def build(space: search.Space) -> Steps:
        step = generation(settings, world, space, share, progress.stage)
        return apart(step, world.values)

    return _found([job], settings, progress, build)[0]


def _begin(job: Job, world: World) -> None:
    """Tell a search's folder its simulator; refuse one that another simulator began.

    Raises:
        ValueError: one line with what differs.
    """
    file, here = job.checkpoints / "simulator.json", physics(world)
    if checkpoints.latest(job.checkpoints) is None:
        job.checkpoints.mkdir(parents=True, exist_ok=True)
        write_json(file, here)
    else:
        check_same(read_json(file) if file.exists() else {}, here, job.checkpoints)


def stepping(worlds: Sequence[World]) -> list[list[int]]:
    """Places of worlds that have the same physics step and solver, in order."""
    groups: dict[tuple, list[int]] = {}
    for place, world in enumerate(worlds):
        option = world.model.opt
        groups.setdefault((option.timestep, option.iterations), []).append(place)
    return [*groups.values()]


def _at_once(
    jobs: Sequence[Job],
    searching: Sequence[World],
    settings: LoopSettings,
    progress: Progress,
) -> list[list[Candidate]]:
    """Search in trials in one call a generation, or one by one if that cannot be."""
    worlds = light = None
    if len(jobs) > 1:
        worlds = alike([job.world for job in jobs])
        light = worlds and alike([searched(settings, world) for world in worlds])
    if worlds is None or light is None:
        pairs = zip(jobs, searching, strict=True)
        return [_alone(job, world, settings, progress) for job, world in pairs]

    def build(space: search.Space) -> Steps:
        return together(settings, light, space, progress.stage)

    pairs = zip(jobs, worlds, strict=True)
    same = [job._replace(world=world) for job, world in pairs]
    return _found(same, settings, progress, build)


def _found(
    jobs: Sequence[Job],
    settings: LoopSettings,
    progress: Progress,
    build: Callable[[search.Space], Steps],
) -> list[list[Candidate]]:
    """Search in worlds that differ in values alone, and measure what is found there."""
    walk = prepare(jobs[0].world, "native").outcome  # compiled once, for all of them
    found = generations(jobs, settings, progress, build, recheck=rechecking(walk))
    for job, candidates in zip(jobs, found, strict=True):
        verify(job, candidates, walk, settings.search.rollouts)
    return found


def generations(
    jobs: Sequence[Job],
    settings: LoopSettings,
    progress: Progress,
    build: Callable[[search.Space], Steps],
    unit: float = SIMULATOR_UNIT,
    recheck: Recheck | None = None,
) -> list[list[Candidate]]:
    """Run the generations that are still to be run, with a checkpoint each.

    Args:
        jobs: what is searched, and where; trials of one method.
        settings: of the run.
        progress: told of every generation.
        build: returns what runs one generation; called only if one is left.
        unit: of work, for one rollout.
        recheck: picks the `rechecked` of a generation, where there are such.
    """
    states, firsts, found = zip(*(begun(job, settings) for job in jobs), strict=True)
    states, found = list(states), list(found)
    total = settings.search.generations
    kinds = settings.candidates
    work = unit * (settings.search.walks + rechecks(kinds))
    progress.past(work * sum(firsts))
    if min(firsts) >= total:
        return found
    step = build(states[0].space)
    for number in range(min(firsts), total):
        due = [index for index, first in enumerate(firsts) if first <= number]
        many = f", {len(due)} trials" if len(jobs) > 1 else ""
        progress.stage(
            f"{jobs[0].method}: generation {number} (last: {total - 1}){many}"
        )
        clock = time.perf_counter()
        results = step(due, [states[index] for index in due], number)
        seconds = (time.perf_counter() - clock) / len(due)
        for index, (state, info) in zip(due, results, strict=True):
            states[index], job = state, jobs[index]
            info = jax.tree.map(np.asarray, info)
            found[index] += write_candidates(job, number, info, kinds, seconds, recheck)
            checkpoints.save(job.checkpoints, number, state)
            progress.work(work)
    return found


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
