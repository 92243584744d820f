"""The evaluation stage: candidates walk on the robot."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from gatjax import runs
from gatjax.loop.optimise import Candidate
from gatjax.loop.setting import ROBOT_UNIT, Setting
from gatjax.records import Array
from gatjax.sim.poses import write_walk

FIRST_SEED = 1_000_000  # of evaluations on the robot; collections are below


def _robot_rows(setting: Setting) -> dict[tuple, dict[str, Any]]:
    """Rows of metrics.csv by key, for candidates that the robot has walked."""
    path = setting.folder / "metrics.csv"
    rows = runs.read_table(path) if path.exists() else []
    names = ("method", "iteration", "generation", "candidate")
    return {
        tuple(row[name] for name in names): row
        for row in rows
        if row["robot_rollouts"] is not None
    }


def evaluate(setting: Setting, candidates: list[Candidate], repeats: int) -> None:
    """Walk candidates on the robot, `repeats` x evaluations runs each, same seeds."""
    count = setting.settings.evaluations * repeats
    known = _robot_rows(setting)
    todo = [c for c in candidates if tuple(c.key.values()) not in known]
    if todo:
        setting.progress.stage(f"{todo[0].method}: walk on the robot")
        seeds = [FIRST_SEED + index for index in range(count)]
        policies = np.repeat([c.policy for c in todo], count, axis=0)
        _, result = setting.robot.walk(policies, seeds * len(todo), setting.task)
        velocity = np.reshape(result.velocity, (len(todo), count))
        fell_at = np.reshape(result.fell_at, (len(todo), count))
        each, summaries = [], []
        for index, candidate in enumerate(todo):
            runs_of = zip(seeds, velocity[index], fell_at[index], strict=True)
            each += [
                candidate.key
                | {"seed": seed, "velocity_m_s": float(v), "fell_at_s": float(f)}
                for seed, v, f in runs_of
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


def best_on_robot(setting: Setting, candidates: list[Candidate], theta: Array) -> Array:
    """Return the fastest candidate that never fell on the robot, else `theta`."""
    rows = _robot_rows(setting)
    speeds = {
        index: rows[tuple(candidate.key.values())]["robot_velocity_m_s"]
        for index, candidate in enumerate(candidates)
        if rows[tuple(candidate.key.values())]["robot_falls"] == 0
    }
    if not speeds:
        return theta
    return candidates[max(speeds, key=speeds.__getitem__)].policy


def show(setting: Setting, name: str, theta: Array, label: str) -> None:
    """Keep one walk on the robot for the animation, once."""
    path = setting.folder / "walks" / f"{name}.npz"
    if not path.exists():
        walk, _ = setting.robot.walk(theta[None], [FIRST_SEED], setting.task)
        first = jax.tree.map(lambda leaf: np.asarray(leaf)[0], walk)
        write_walk(path, setting.world.model, first, label)
