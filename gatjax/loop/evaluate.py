"""The evaluation stage: candidates walk on the robot, and the winner walks again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from gatjax import runs
from gatjax.loop.candidates import Candidate, counts, measured
from gatjax.loop.setting import CONFIRMATIONS, ROBOT_UNIT, Away, Setting, judged
from gatjax.records import Array, Outcome
from gatjax.settings import CONFIRMATION, EVALUATION, seeds
from gatjax.sim.poses import write_walk
from gatjax.task import Task


class Walks(NamedTuple):
    """What one run has to walk on the robot: each candidate with each seed."""

    setting: Setting
    candidates: list[Candidate]
    seeds: Sequence[int]


def begin(asked: Sequence[Walks], stage: str) -> Callable[[], None]:
    """Let candidates of runs with the same robot walk, once, in one call of the robot.

    Returns:
        What waits for the walks, and keeps them when all are done. A robot that is not
        `Away` walks only then.
    """
    left, setting = _left(asked), asked[0].setting
    if left:
        setting.progress.stage(stage)
    wait = judged(setting.robot, *_walks(left)) if left else None

    def keep() -> None:
        if wait is not None:
            _keep(left, wait())
        setting.progress.work(ROBOT_UNIT * _count(left))
        setting.progress.past(ROBOT_UNIT * (_count(asked) - _count(left)))

    return keep


def nothing() -> None:
    """Wait for nothing."""


def _left(asked: Sequence[Walks]) -> list[Walks]:
    """Return the candidates that did not walk on the robot yet."""
    left = []
    for each in asked:
        known = measured(each.setting.folder, "robot_rollouts")
        some = [c for c in each.candidates if tuple(c.key.values()) not in known]
        if some:
            left.append(each._replace(candidates=some))
    return left


def _walks(left: Sequence[Walks]) -> tuple[Array, list[int], Task]:
    """Policies [N, 15] and seeds [N], in the order of runs, candidates and seeds."""
    pairs = [
        (candidate.policy, seed)
        for each in left
        for candidate in each.candidates
        for seed in each.seeds
    ]
    return np.stack([p for p, _ in pairs]), [s for _, s in pairs], left[0].setting.task


def _count(asked: Sequence[Walks]) -> int:
    return sum(len(each.candidates) * len(each.seeds) for each in asked)


def _keep(walked: Sequence[Walks], outcome: Outcome) -> None:
    """Write walks, in the order of `_walks`, into their runs."""
    first = 0
    for each in walked:
        end = first + len(each.candidates) * len(each.seeds)
        _write(each, outcome.velocity[first:end], outcome.fell_at[first:end])
        first = end


def _write(walked: Walks, velocity: Array, fell_at: Array) -> None:
    """Write walks, in the order of candidates, then seeds, m/s and s, into the run."""
    shape = len(walked.candidates), len(walked.seeds)
    velocity, fell_at = np.reshape(velocity, shape), np.reshape(fell_at, shape)
    each, summaries = [], []
    for index, candidate in enumerate(walked.candidates):
        walks = zip(walked.seeds, velocity[index], fell_at[index], strict=True)
        each += [
            candidate.key
            | {"seed": seed, "velocity_m_s": float(v), "fell_at_s": float(f)}
            for seed, v, f in walks
        ]
        summary = {
            "robot_velocity_m_s": float(velocity[index].mean()),
            "robot_falls": int(np.isfinite(fell_at[index]).sum()),
            "robot_rollouts": len(walked.seeds),
        }
        summaries.append(candidate.key | summary)
    runs.add_rows(walked.setting.folder / "evaluations.csv", each)
    runs.add_rows(walked.setting.folder / "metrics.csv", summaries)


def evaluate(
    found: Sequence[tuple[Setting, list[Candidate]]],
) -> Callable[[], None]:
    """Walk every candidate of searches on the robot.

    Returns:
        What waits for the walks, and keeps them. On mjx, where a GPU may search on, an
        `Away` robot only begins here; other ones have walked, run by run.
    """
    setting, candidates = found[0]
    stage = f"{candidates[0].method}: walk on the robot"
    asked = [
        Walks(run, some, seeds(EVALUATION, run.settings.seed, run.settings.evaluations))
        for run, some in found
    ]
    if setting.settings.backend == "mjx" and isinstance(setting.robot, Away):
        return begin(asked, stage)
    for each in asked:
        begin([each], stage)()
    return nothing


def confirm(found: Sequence[tuple[Setting, Candidate]], stage: str) -> None:
    """Walk candidates of runs with fresh seeds.

    A winner was picked on few walks, so those flatter it; these walks judge it.
    """
    fresh = [
        Walks(run, [one], seeds(CONFIRMATION, run.settings.seed, CONFIRMATIONS))
        for run, one in found
    ]
    for some in _calls(fresh):
        begin(some, stage)()


def winner(setting: Setting, candidates: list[Candidate]) -> Candidate | None:
    """Return the fastest candidate that never fell on the robot, if there is one.

    Of the generations that count: see `counts`.
    """
    rows = measured(setting.folder, "robot_rollouts")
    last = max(candidate.generation for candidate in candidates)
    speeds = {
        index: rows[tuple(candidate.key.values())]["robot_velocity_m_s"]
        for index, candidate in enumerate(candidates)
        if rows[tuple(candidate.key.values())]["robot_falls"] == 0
        and counts(candidate.generation, last)
    }
    if not speeds:
        return None
    return candidates[max(speeds, key=speeds.__getitem__)]._replace(kind="chosen")


class Shown(NamedTuple):
    """A walk for the animation of a run."""

    setting: Setting
    policy: Array  # [15]
    name: str
    label: str

    @property
    def path(self) -> Path:
        """File that keeps it."""
        return self.setting.folder / "walks" / f"{self.name}.npz"


def show(wanted: Sequence[Shown]) -> None:
    """Keep one walk on the robot for each of some animations, once."""
    for some in _calls([one for one in wanted if not one.path.exists()]):
        trials = [one.setting for one in some]
        ones = [seeds(CONFIRMATION, run.settings.seed, 1)[0] for run in trials]
        policies = np.stack([one.policy for one in some])
        walks, _ = trials[0].robot.walk(policies, ones, trials[0].task)
        for index, one in enumerate(some):
            walk = jax.tree.map(lambda leaf, at=index: np.asarray(leaf)[at], walks)
            write_walk(one.path, one.setting.world.model, walk, one.label)


def _calls(each: Sequence[Any]) -> list[Sequence[Any]]:
    """Share work out to calls of the robot: all at once if it is `Away`, or singly."""
    if each and isinstance(each[0].setting.robot, Away):
        return [each]
    return [[one] for one in each]
