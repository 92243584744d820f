"""Walks that are kept until all that were asked for are there: nothing walks twice."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, NamedTuple, Tuple

import numpy as np

from gatjax.files import write_whole
from gatjax.records import Base, Outcome, Reading, Trajectory
from gatjax.task import Task

Array = Any
Entry = Tuple[Trajectory, Outcome]
"""A walk [T, ...] and its verdict []."""


class Order(NamedTuple):
    """What was asked of whom: another answer to any of it is another walk."""

    robot: str  # its identity
    policy: Array  # [15]
    seed: int
    task: Task


def _place(folder: Path, what: Order) -> Path:
    """File of a walk."""
    policy = np.asarray(what.policy, float).tolist()
    asked = repr((what.robot, policy, int(what.seed), tuple(what.task)))
    return folder / f"walk_{hashlib.sha256(asked.encode()).hexdigest()[:16]}.npz"


def keep(folder: Path, what: Order, walk: Entry) -> None:
    """Keep a walk."""
    trajectory, outcome = walk
    path = _place(folder, what)
    named = {
        **{f"reading_{k}": v for k, v in trajectory.reading._asdict().items()},
        **{f"base_{k}": v for k, v in trajectory.base._asdict().items()},
        **{f"outcome_{k}": v for k, v in outcome._asdict().items()},
        **{key: getattr(trajectory, key) for key in ("time", "command", "alive")},
    }
    write_whole({path: lambda file: np.savez(file, **named)})


def kept(folder: Path, what: Order) -> Entry | None:
    """Return a walk that was kept, None if there is none."""
    path = _place(folder, what)
    if not path.is_file():
        return None
    with np.load(path) as file:
        found = {key: file[key] for key in file.files}

    def part(kind: Any, prefix: str) -> Any:
        return kind(*(found[prefix + name] for name in kind._fields))

    trajectory = Trajectory(
        time=found["time"],
        command=found["command"],
        reading=part(Reading, "reading_"),
        base=part(Base, "base_"),
        alive=found["alive"],
    )
    return trajectory, part(Outcome, "outcome_")
