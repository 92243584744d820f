"""The evaluation stage: candidates walk on the robot, and the winner walks again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np

from gatjax import runs
from gatjax.loop.candidates import Candidate, measured
from gatjax.loop.setting import CONFIRMATIONS, ROBOT_UNIT, Setting
from gatjax.records import Array
from gatjax.settings import CONFIRMATION, EVALUATION, seeds
from gatjax.sim.poses import write_walk


class Walks(NamedTuple):
    """What one run has to walk on the robot: each candidate with each seed."""

    setting: Setting
    candidates: list[Candidate]
    seeds: Sequence[int]


def walk(asked: Sequence[Walks], stage: str) -> None:
    """Walk candidates of runs with the same robot, once, in one call of the robot.

    It is kept when all of them have walked.
    """
    left = [each._replace(candidates=_left(each)) for each in asked]
    left = [each for each in left if each.candidates]
    setting = asked[0].setting
    if left:
        setting.progress.stage(f"{left[0].candidates[0].method}: {stage}")
        pairs = [
            (candidate.policy, seed)
            for each in left
            for candidate in each.candidates
            for seed in each.seeds
        ]
        policies, every = zip(*pairs, strict=True)
        _, result = setting.robot.walk(np.stack(policies), every, setting.task)
        first = 0
        for each in left:
            end = first + len(each.candidates) * len(each.seeds)
            _write(each, result.velocity[first:end], result.fell_at[first:end])
            first = end
    count = sum(len(each.candidates) * len(each.seeds) for each in asked)
    setting.progress.work(ROBOT_UNIT * count)


def _left(asked: Walks) -> list[Candidate]:
    """Return the candidates that did not walk on the robot yet."""
    known = measured(asked.setting.folder, "robot_rollouts")
    return [c for c in asked.candidates if tuple(c.key.values()) not in known]


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


def evaluate(setting: Setting, candidates: list[Candidate]) -> None:
    """Walk every candidate of a search on the robot."""
    settings = setting.settings
    drawn = seeds(EVALUATION, settings.seed, settings.evaluations)
    walk([Walks(setting, candidates, drawn)], "walk on the robot")


def confirm(found: Sequence[tuple[Setting, Candidate]]) -> None:
    """Walk one candidate of each run with fresh seeds.

    A winner was picked on few walks, so those flatter it; these walks judge it.
    """
    fresh = [
        Walks(run, [one], seeds(CONFIRMATION, run.settings.seed, CONFIRMATIONS))
        for run, one in found
    ]
    if fresh:
        walk(fresh, "confirm on the robot")


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


def show(wanted: Sequence[tuple[Setting, Array]], name: str, label: str) -> None:
    """Keep one walk on the robot with each run's policy for the animation, once."""
    path = f"walks/{name}.npz"
    left = [(run, theta) for run, theta in wanted if not (run.folder / path).exists()]
    if not left:
        return
    trials, policies = zip(*left, strict=True)
    ones = [seeds(CONFIRMATION, run.settings.seed, 1)[0] for run in trials]
    robot, task = trials[0].robot, trials[0].task
    walks, _ = robot.walk(np.stack(policies), ones, task)
    for index, run in enumerate(trials):
        walk = jax.tree.map(lambda leaf, at=index: np.asarray(leaf)[at], walks)
        write_walk(run.folder / path, run.world.model, walk, label)
