"""Which policies of a generation walk on the robot, and what they do in simulation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from gatjax import runs, search
from gatjax.ranking import policy_costs
from gatjax.records import Array, Outcome
from gatjax.sim.backend import pairs
from gatjax.sim.world import World
from gatjax.walk.parameters import THETA0

KINDS = ("best", "mean", "rechecked")

Walk = Callable[..., Outcome]
"""(values of a world, policies [B, 15], keys [B]) -> outcomes [B]."""


class Candidate(NamedTuple):
    """A walk to be tried on the robot."""

    method: str
    iteration: int
    generation: int
    kind: str  # one of KINDS, or chosen: the winner
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


def counts(generation: int, last: int) -> bool:
    """Return whether a walk found in a generation counts, `last` being the last one.

    As in the paper, the first generation does not where there are later ones: its
    policies are drawn at random, nothing was learned yet.
    """
    return generation >= min(1, last)


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


Recheck = Callable[[Job, int, search.GenerationInfo], Array]
"""(search, number of a generation, its policies and costs) -> a policy [15]."""


def write_candidates(
    job: Job,
    number: int,
    info: search.GenerationInfo,
    kinds: Sequence[str],
    seconds: float,
    recheck: Recheck | None,
) -> list[Candidate]:
    """Write the candidates of one generation; see `gatjax.loop.recheck`."""
    found = {"best": info.best_policy, "mean": info.mean_policy}
    if recheck is not None and "rechecked" in kinds:
        found["rechecked"] = recheck(job, number, info)
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


def verify(job: Job, candidates: list[Candidate], walk: Walk, rollouts: int) -> None:
    """Measure every candidate in the world it was found in, with fresh keys; once."""
    path = job.folder / "metrics.csv"
    known = measured(job.folder, "simulator_falls")
    candidates = [c for c in candidates if tuple(c.key.values()) not in known]
    if not candidates:
        return
    keys = jax.random.split(job.check_key, rollouts)
    policies = np.stack([candidate.policy for candidate in candidates])
    result = pairs(walk, job.world.values, policies, keys)
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
