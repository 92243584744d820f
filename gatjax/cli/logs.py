"""What `gatjax ground` refuses to learn from, and what it says of the result."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gatjax.data.recording import Recording, check_recording
from gatjax.data.trajectories import at_rate
from gatjax.diagnosis.suitable import check_commands
from gatjax.robot.model import joint_names
from gatjax.sim.world import World

SHORTEST = 0.7  # s, of a trajectory that predictions can be measured on
BEYOND, BEYOND_SHARE = 0.35, 0.2  # rad past a joint's range; share of the rows
LARGE_ERROR = 20.0  # deg after 0.5 s: no simulator of this robot is that wrong


def checked(recording: Recording, world: World, least: int) -> Recording:
    """Refuse a recording that cannot be trusted in this world; cut its gaps.

    Args:
        recording: as it was read.
        world: whose joints and control period it must have.
        least: how many trajectories longer than 0.7 s are needed.

    Raises:
        ValueError: one line with what is wrong.
    """
    check_commands(world.model, recording)
    check_recording(recording, joint_names(world.model))
    period = world.task.control_period
    recording, gaps = at_rate(recording, period)
    if gaps:
        print(f"{recording.name}: cut at {gaps} gaps in time", flush=True)
    _check_ranges(recording, world)
    rows = np.unique(recording.trajectory, return_counts=True)[1]
    long = int((rows * period > SHORTEST).sum())
    if long < least:
        raise ValueError(
            f"{recording.name}: {long} trajectories longer than {SHORTEST} s, need "
            f"{least}; record more, and number them in the column trajectory"
        )
    return recording


def check_pair(robot: Recording, simulator: Recording) -> None:
    """Refuse logs whose metadata say that they were swapped or are of one robot."""
    first, second = (log.metadata.get("robot") for log in (robot, simulator))
    if second not in (None, "simulator") and first in ("simulator", second):
        raise ValueError(
            f"{simulator.name} is a log of {second!r} and {robot.name} one of "
            f"{first!r}; --simulator-log wants gatjax collect --robot simulator"
        )


def check_own(folder: Path) -> None:
    """Refuse to write a grounding's world over one that is none."""
    there = folder / "world.json"
    if there.exists() and not (folder / "grounder.json").exists():
        raise ValueError(
            f"{there} is not of a grounding, and would be written over; choose "
            f"another --out"
        )


def _check_ranges(recording: Recording, world: World) -> None:
    """Refuse angles that the joint cannot have."""
    model = world.model
    ranges = model.jnt_range[model.actuator_trnid[:, 0]]
    for joint, (low, high) in zip(joint_names(model), ranges, strict=True):
        for column in (f"position.{joint}", f"command.{joint}"):
            values = recording.columns.get(column, np.zeros(1))
            beyond = (values < low - BEYOND) | (values > high + BEYOND)
            if beyond.mean() > BEYOND_SHARE:
                value = values[beyond][0]
                raise ValueError(
                    f"{recording.name}: column {column!r}: {beyond.mean():.0%} of "
                    f"the rows are beyond the joint ({low:.2f} to {high:.2f} rad), for "
                    f"example {value:.2f}; degrees or a wrong sign or offset, see --map"
                )


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Lay out prediction errors, with what is suspicious about them."""
    lines = [f"{'joint':<16} {'after':>7} {'ideal':>8} {'grounded':>9}   deg"]
    for row in rows:
        before, after = np.rad2deg([row["before_rad"], row["after_rad"]])
        horizon = f"{row['horizon_s']:.3g} s"
        lines.append(f"{row['joint']:<16} {horizon:>7} {before:>8.2f} {after:>9.2f}")
    return "\n".join([*lines, *warnings(rows)])


def warnings(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Lines about errors that a good log does not give."""
    last = max(row["horizon_s"] for row in rows)
    far = [row for row in rows if row["horizon_s"] == last]
    found = []
    for row in far:
        error = np.rad2deg(row["before_rad"])
        if error > LARGE_ERROR:
            found.append(
                f"WARNING: {row['joint']} is {error:.0f} deg off after {last:g} s "
                f"without grounding; check its sign, offset and unit in the log"
            )
    before, after = (
        np.rad2deg(np.mean([row[name] for row in far]))
        for name in ("before_rad", "after_rad")
    )
    if after > before:
        found.append(
            f"WARNING: grounding makes the mean error after {last:g} s worse, "
            f"{before:.2f} -> {after:.2f} deg; check the logs, or record more"
        )
    return found


def about(facts: dict[str, Any]) -> str:
    """Say in a few words how well a grounding fits."""
    said = [f"alpha {facts['alpha']:g}"] if "alpha" in facts else []
    for model in ("forward", "inverse"):
        if model in facts:
            error = np.rad2deg(facts[model]["validation_rmse"])
            said.append(f"{model} model {error:.3f} deg on validation runs")
    if "deviation_deg" in facts:
        widest = max(facts["deviation_deg"], key=facts["deviation_deg"].get)
        error = facts["deviation_deg"][widest]
        said.append(f"widest noise {error:.2f} deg ({widest})")
    return ", ".join(said) or "no correction"
