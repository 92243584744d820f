"""The evaluation stage: candidates walk on the robot, and the winner walks again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from gatjax import runs
from gatjax.loop.candidates import Candidate, measured
from gatjax.loop.setting import CONFIRMATIONS, ROBOT_UNIT, Away, Setting
from gatjax.records import Array, Outcome
from gatjax.settings import CONFIRMATION, EVALUATION, seeds
from gatjax.sim.poses import write_walk


class Walks(NamedTuple):
    """What one run has to walk on the robot: each candidate with each seed."""

    setting: Setting
    candidates: list[Candidate]
    seeds: Sequence[int]


def begin(asked: Sequence[Walks], stage: str) -> Callable[[], None]:
    """Let candidates of runs with the same robot walk, once, in one call of the robot.

    Returns:
        What waits until all of them have walked, and keeps how they fared. Only a robot
        that walks away from here, while a GPU searches, needs to be waited for.
    """
    left = [each._replace(candidates=_left(each)) for each in asked]
    left = [each for each in left if each.candidates]
    pairs = [
        (candidate.policy, seed)
        for each in left
        for candidate in each.candidates
        for seed in each.seeds
    ]
    setting = asked[0].setting
    robot, progress = setting.robot, setting.progress
    total = sum(len(each.candidates) * len(each.seeds) for each in asked)

    def keep(outcome: Outcome | None) -> None:
        if outcome is not None:
            _keep(left, outcome)
        progress.work(ROBOT_UNIT * total)

    if not pairs:
        keep(None)
        return nothing
    progress.stage(stage)
    policies, every = zip(*pairs, strict=True)
    walks = np.stack(policies), every, setting.task
    if setting.settings.backend == "mjx" and isinstance(robot, Away):
        wait = robot.begin(*walks)
        return lambda: keep(wait())
    keep(robot.walk(*walks)[1])
    return nothing


def nothing() -> None:
    """Wait for nothing."""


def _left(asked: Walks) -> list[Candidate]:
    """Return the candidates that did not walk on the robot yet."""
    known = measured(asked.setting.folder, "robot_rollouts")
    return [c for c in asked.candidates if tuple(c.key.values()) not in known]


def _keep(walked: Sequence[Walks], outcome: Outcome) -> None:
    """Write walks, in the order of runs, candidates and seeds, into their runs."""
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
    """Walk every candidate of searches on the robot, run by run; see `begin`."""
    begun = []
    for run, candidates in found:
        drawn = seeds(EVALUATION, run.settings.seed, run.settings.evaluations)
        stage = f"{candidates[0].method}: walk on the robot"
        begun.append(begin([Walks(run, candidates, drawn)], stage))

    def keep() -> None:
        for one in begun:
            one()

    return keep


def confirm(found: Sequence[tuple[Setting, Candidate]], stage: str) -> None:
    """Walk candidates of runs with fresh seeds.

    A winner was picked on few walks, so those flatter it; these walks judge it.
    """
    fresh = [
        Walks(run, [one], seeds(CONFIRMATION, run.settings.seed, CONFIRMATIONS))
        for run, one in found
    ]
    if fresh:
        begin(fresh, stage)()


def winner(setting: Setting, candidates: list[Candidate]) -> Candidate | None:
    """Return the fastest candidate that never fell on the robot, if there is one.

    As in the paper, the first generation does not count where there are later ones: its
    policies are drawn at random, nothing was learned yet.
    """
    rows = measured(setting.folder, "robot_rollouts")
    last = max(candidate.generation for candidate in candidates)
    speeds = {
        index: rows[tuple(candidate.key.values())]["robot_velocity_m_s"]
        for index, candidate in enumerate(candidates)
        if rows[tuple(candidate.key.values())]["robot_falls"] == 0
        and candidate.generation >= min(1, last)
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
    left = [one for one in wanted if not one.path.exists()]
    if not left:
        return
    runs = [one.setting for one in left]
    ones = [seeds(CONFIRMATION, run.settings.seed, 1)[0] for run in runs]
    policies = np.stack([one.policy for one in left])
    walks, _ = runs[0].robot.walk(policies, ones, runs[0].task)
    for index, one in enumerate(left):
        walk = jax.tree.map(lambda leaf, at=index: np.asarray(leaf)[at], walks)
        write_walk(one.path, one.setting.world.model, walk, one.label)
