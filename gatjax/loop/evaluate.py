"""The evaluation stage: candidates walk on the robot, and the winner walks again."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np

from gatjax import runs
from gatjax.loop.candidates import Candidate, measured
from gatjax.loop.setting import CONFIRMATIONS, ROBOT_UNIT, Setting
from gatjax.records import Array
from gatjax.settings import CONFIRMATION, EVALUATION, seeds
from gatjax.sim.poses import write_walk


def walk(
    setting: Setting, candidates: list[Candidate], with_seeds: Sequence[int], stage: str
) -> None:
    """Walk candidates on the robot, each with the same seeds; once."""
    count, known = len(with_seeds), measured(setting.folder, "robot_rollouts")
    todo = [c for c in candidates if tuple(c.key.values()) not in known]
    if todo:
        setting.progress.stage(f"{todo[0].method}: {stage}")
        policies = np.repeat([c.policy for c in todo], count, axis=0)
        every = [*with_seeds] * len(todo)
        _, result = setting.robot.walk(policies, every, setting.task)
        velocity = np.reshape(result.velocity, (len(todo), count))
        fell_at = np.reshape(result.fell_at, (len(todo), count))
        each, summaries = [], []
        for index, candidate in enumerate(todo):
            walks = zip(with_seeds, velocity[index], fell_at[index], strict=True)
            each += [
                candidate.key
                | {"seed": seed, "velocity_m_s": float(v), "fell_at_s": float(f)}
                for seed, v, f in walks
            ]
            summary = {
                "robot_velocity_m_s": float(velocity[index].mean()),
                "robot_falls": int(np.isfinite(fell_at[index]).sum()),
                "robot_rollouts": count,
            }
            summaries.append(candidate.key | summary)
        runs.add_rows(setting.folder / "evaluations.csv", each)
        runs.add_rows(setting.folder / "metrics.csv", summaries)
    setting.progress.work(ROBOT_UNIT * count * len(candidates))


def evaluate(setting: Setting, candidates: list[Candidate]) -> None:
    """Walk every candidate of a search on the robot."""
    settings = setting.settings
    drawn = seeds(EVALUATION, settings.seed, settings.evaluations)
    walk(setting, candidates, drawn, "walk on the robot")


def confirm(setting: Setting, candidate: Candidate) -> None:
    """Walk one candidate with fresh seeds.

    The winner was picked on few walks, so those flatter it; these walks judge it.
    """
    fresh = seeds(CONFIRMATION, setting.settings.seed, CONFIRMATIONS)
    walk(setting, [candidate], fresh, "confirm on the robot")


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


def show(setting: Setting, name: str, theta: Array, label: str) -> None:
    """Keep one walk on the robot for the animation, once."""
    path = setting.folder / "walks" / f"{name}.npz"
    if not path.exists():
        one = seeds(CONFIRMATION, setting.settings.seed, 1)
        record, _ = setting.robot.walk(theta[None], one, setting.task)
        first = jax.tree.map(lambda leaf: np.asarray(leaf)[0], record)
        write_walk(path, setting.world.model, first, label)
