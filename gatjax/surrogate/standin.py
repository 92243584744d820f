"""A stand-in robot: one body of the series, its runs shared out to processes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence, Sized
from functools import partial
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from gatjax import processors
from gatjax import task as tasks
from gatjax.motions import Limbs, standing_nao
from gatjax.records import Outcome, Trajectory
from gatjax.surrogate import course
from gatjax.surrogate.e1 import E1, draw_body, published
from gatjax.surrogate.hung import Hung
from gatjax.surrogate.start import draw_run, playing, series
from gatjax.task import Task
from gatjax.workers import Workers


class Engine(NamedTuple):
    """What a robot of the series is simulated by."""

    words: str
    flock: course.Flock
    hung: course.Flock  # its robots have their torsos held in the air
    together: int  # robots that a process takes at once; what they share costs once


def walk_some(
    flock: course.Flock,
    body_seed: int,
    policies: np.ndarray,
    seeds: Sequence[int] | np.ndarray,
    task: Task,
) -> tuple[Trajectory, Outcome]:
    """Let N robots walk side by side in this process; see `StandIn.walk`."""
    body, floor = series(body_seed)
    runs = [draw_run(body, int(seed), task, E1) for seed in seeds]
    policies = np.asarray(policies, dtype=float)
    machine = flock(body, floor, runs, tasks.pose(policies), task)
    return course.walk(machine, E1, body, runs, policies, task)


def judge_some(*what: Any) -> Outcome:
    """Let N robots walk as `walk_some` does; only how they fared comes back."""
    return walk_some(*what)[1]


def play_some(
    flock: course.Flock,
    body_seed: int,
    targets: np.ndarray,
    rate_hz: float,
    seeds: Sequence[int] | np.ndarray,
) -> Trajectory:
    """Let N robots play targets side by side in this process; see `StandIn.play`."""
    body, floor = series(body_seed)
    task = playing(targets.shape[1], rate_hz)
    runs = [draw_run(body, int(seed), task, E1) for seed in seeds]
    machine = flock(body, floor, runs, targets[:, 0], task)
    return course.play(machine, E1, body, runs, targets, task)


class StandIn:
    """One body of the series in an engine; see `gatjax.surrogate.make_robot`."""

    def __init__(
        self, name: str, engine: Engine, body_seed: int, workers: int | None = None
    ) -> None:
        """Choose a body; `workers` processes (default: all cores) share the runs."""
        self.name, self.engine, self.body_seed = name, engine, body_seed
        self.workers = workers or processors.usable()
        self._processes = Workers(self.workers)

    def constants(self) -> dict:
        """Return what `robot.json` says about this robot."""
        facts = published(self.engine.words, draw_body(self.body_seed))
        return {"identity": f"{self.name}, body {self.body_seed}"} | facts

    def walk(
        self,
        policies: np.ndarray,
        seeds: Sequence[int] | np.ndarray,
        task: Task | None = None,
    ) -> tuple[Trajectory, Outcome]:
        """Let N robots walk.

        Args:
            policies: [N, 15] walk parameters.
            seeds: [N] int, one per run.
            task: the task; by default `Task()`.

        Returns:
            Trajectory [N, T, ...] and Outcome [N]; they do not depend on the number of
            workers.
        """
        found = self._begun(walk_some, self._jobs(policies, seeds, task or Task()))()
        walks, verdicts = zip(*found, strict=True)
        return _join(walks), _join(verdicts)

    def begin_walks(
        self, policies: np.ndarray, seeds: Sequence[int] | np.ndarray, task: Task
    ) -> Callable[[], Outcome]:
        """Let N robots walk while this process does something else; see `walk`.

        Returns:
            What waits for them and gives their Outcome [N]. A single worker walks while
            it is waited for. Who does not wait calls `drop_walks`.
        """
        wait = self._begun(judge_some, self._jobs(policies, seeds, task))
        return lambda: _join(wait())

    def _jobs(
        self, policies: np.ndarray, seeds: Sequence[int] | np.ndarray, task: Task
    ) -> list[tuple]:
        return [
            (self.engine.flock, self.body_seed, policies[some], seeds[some], task)
            for some in self._shares(policies, seeds)
        ]

    def limbs(self) -> Limbs:
        """Return what a motion must know of this robot, which stands."""
        return standing_nao()

    def play(
        self, targets: np.ndarray, rate_hz: float, seeds: Sequence[int] | np.ndarray
    ) -> Trajectory:
        """Let N standing robots follow targets, open loop.

        Args:
            targets: [N, T, J] rad, from `gatjax.motions`; held for a second before.
            rate_hz: rows per second: 50, 100 or 83.3.
            seeds: [N] int, one per run.

        Returns:
            Trajectory [N, T, ...]; `alive` is False from a fall on.

        Raises:
            ValueError: another rate.
        """
        return self._play(self.engine.flock, targets, rate_hz, seeds)

    def hung(self) -> Hung:
        """Return this robot with its torso held in the air."""
        return Hung(self.name, partial(self._play, self.engine.hung))

    def _play(
        self,
        flock: course.Flock,
        targets: np.ndarray,
        rate_hz: float,
        seeds: Sequence[int] | np.ndarray,
    ) -> Trajectory:
        jobs = [
            (flock, self.body_seed, targets[some], rate_hz, seeds[some])
            for some in self._shares(targets, seeds)
        ]
        return _join(self._begun(play_some, jobs)())

    def _shares(self, each: Sized, seeds: Sized) -> list[slice]:
        """Share runs out evenly, up to `together` a worker at a time."""
        count = len(each)
        if count != len(seeds):
            raise ValueError(f"{len(seeds)} seeds for {count} runs; give one for each")
        if not count:
            raise ValueError("no runs are asked for; give one seed or more")
        turns = math.ceil(count / (self.engine.together * self.workers))
        size = math.ceil(count / (turns * self.workers))
        return [slice(first, first + size) for first in range(0, count, size)]

    def _begun(self, run: Callable, jobs: list[tuple]) -> Callable[[], list]:
        """Begin jobs in the worker processes; a single one is done here, when asked."""
        if min(self.workers, len(jobs)) == 1:
            return lambda: [run(*job) for job in jobs]
        results = self._processes.results(run, jobs)
        return lambda: [found for _, found in sorted(results, key=itemgetter(0))]

    def drop_walks(self) -> None:
        """End the worker processes, and what they are at; others begin when needed."""
        self._processes.close()


def _join(parts: Sequence[Any]) -> Any:
    """Put equal records together along their first axis."""
    first = parts[0]
    if isinstance(first, tuple):
        return type(first)(*map(_join, zip(*parts, strict=True)))
    return np.concatenate(parts)
