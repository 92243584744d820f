"""Put a policy on a robot: walks under guard, with every frame in a log."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from gatjax.hardware.frames import Link
from gatjax.hardware.links import open_link
from gatjax.hardware.robot import Attendant, Hardware
from gatjax.records import JOINTS, Outcome
from gatjax.task import Task
from gatjax.walk.parameters import THETA0
from gatjax.walk.policy import read_policy

Array = Any


def policy_at(path: Path) -> Array:
    """Read a policy file, or the winner of a run folder, [15].

    Raises:
        FileNotFoundError, ValueError: one line: there is none.
    """
    if path.is_dir():
        found = sorted((path / "policies").glob("*.json"))
        names = ", ".join(policy.name for policy in found) or "none"
        raise ValueError(f"{path}: which policy? It has {names}")
    return read_policy(path)


def deploy(
    policy: Path, address: str, walks: int, task: Task, out: Path, person: Attendant
) -> list[str]:
    """Let a robot walk a policy some times.

    Args:
        policy: JSON file of the policy; theta0 is the walk that was tuned by hand.
        address: of the robot, see `links`.
        walks: how many.
        task: how fast and how long.
        out: folder for the frames, the finished walks and `walks.json`.
        person: who looks after the robot.

    Returns:
        Lines that say what happened.

    Raises:
        ValueError, Stopped, KeyboardInterrupt, Lost: see `Hardware.walk`.
    """
    theta = THETA0 if str(policy) == "theta0" else policy_at(policy)
    person.say(looked_at(address))
    robot = Hardware(address, out, person)
    _, outcome = robot.walk(np.tile(theta, (walks, 1)), range(walks), task)
    told = [summary(outcome, index) for index in range(walks)]
    lines = [f"walk {index + 1}: {said(entry)}" for index, entry in enumerate(told)]
    report: dict[str, Any] = {"policy": str(policy), "robot": address, "walks": told}
    (out / "walks.json").write_text(json.dumps(report, indent=2) + "\n")
    return [*lines, f"{out}: frames_*.csv is for gatjax diagnose --data"]


def looked_at(address: str) -> str:
    """Say in a line which robot is there, and how it is."""
    link = open_link(address)
    try:
        frame = None
        while frame is None:
            frame = link.receive(1.0)
    finally:
        link.close()
    hottest = int(np.argmax(frame.temperature))
    return (
        f"{address}: {identity(link)}, battery {100.0 * frame.battery:.0f} %, hottest "
        f"motor {JOINTS[hottest]} {frame.temperature[hottest]:.0f} degC"
    )


def identity(link: Link) -> str:
    """Name of the robot itself, where it tells one."""
    return getattr(link, "identity", None) or link.name


def summary(outcome: Outcome, index: int) -> dict[str, Any]:
    """Facts of one walk of a batch, plain numbers."""
    fell = float(outcome.fell_at[index])
    return {
        "velocity_m_s": float(outcome.velocity[index]),
        "fell_at_s": fell if np.isfinite(fell) else None,
    }


def said(facts: dict[str, Any]) -> str:
    """Say the facts of a walk."""
    fell = facts["fell_at_s"]
    end = "stood to the end" if fell is None else f"fell after {fell:.1f} s"
    return f"{100.0 * facts['velocity_m_s']:.1f} cm/s, {end}"
