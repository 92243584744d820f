"""Put a policy on a robot: walks under guard, with every frame in a log."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gatjax.files import write_json
from gatjax.hardware.attendant import Attendant
from gatjax.hardware.robot import Hardware
from gatjax.records import Outcome
from gatjax.task import RATES, Task, task_at
from gatjax.walk.parameters import THETA0
from gatjax.walk.policy import read_policy

Array = Any


class Asked(NamedTuple):
    """What is asked of a robot."""

    walks: int = 1
    forward: float = 0.75  # share of the policy's top speed
    seconds: float = 7.5  # length of a walk

    def check(self) -> None:
        """Refuse what no robot can do.

        Raises:
            ValueError: one line with the flag that is wrong.
        """
        if self.walks < 1:
            raise ValueError(f"--walks is {self.walks}; use 1 or more")
        if not 0.0 < self.forward <= 1.0:
            raise ValueError(f"--forward is {self.forward}; use more than 0, at most 1")
        if not 0.5 <= self.seconds <= 600.0:
            raise ValueError(f"--seconds is {self.seconds}; use 0.5 to 600")


def task_of(period: float, **changes: Any) -> Task:
    """Return the walking task at the rate of a robot, period s."""
    for rate, (ours, _) in RATES.items():
        if abs(ours - period) < 1e-6:
            return task_at(rate, **changes)
    raise ValueError(f"the walk engine has no rate of {1.0 / period:.1f} Hz")


def policy_at(path: Path) -> Array:
    """Read a policy file, [15]; of a folder, say which policies it has.

    Raises:
        FileNotFoundError, ValueError: one line: there is none.
    """
    if path.is_dir():
        found = sorted((path / "policies").glob("*.json"))
        names = ", ".join(policy.name for policy in found) or "none"
        raise ValueError(f"{path}: which policy? It has {names}")
    return read_policy(path)


def deploy(
    policy: Path, address: str, asked: Asked, out: Path | None, person: Attendant
) -> list[str]:
    """Let a robot walk a policy some times.

    Args:
        policy: JSON file of the policy; theta0 is the walk that was tuned by hand.
        address: of the robot, see `links`.
        asked: how often, how fast and how long.
        out: folder for the frames, the finished walks and `walks.json`; None: one in
            `deployed`, named by the time.
        person: who looks after the robot.

    Returns:
        Lines that say what happened.

    Raises:
        ValueError, Stopped, KeyboardInterrupt, Lost: see `Hardware.walk`.
    """
    asked.check()
    named = out is not None
    out = out or Path("deployed") / time.strftime("%Y%m%d-%H%M%S")
    theta = THETA0 if str(policy) == "theta0" else policy_at(policy)
    robot = Hardware(address, out, person)
    person.say(f"{address}: {robot.identity}, {robot.state}")
    if not named:
        person.say(f"all goes to {out}; if it is stopped, --out {out} goes on")
    task = task_of(robot.period, forward=asked.forward, duration=asked.seconds)
    policies, count = np.tile(theta, (asked.walks, 1)), range(asked.walks)
    _, outcome = robot.walk(policies, count, task)
    told = [summary(outcome, index) for index in count]
    lines = [f"walk {index + 1}: {said(entry)}" for index, entry in enumerate(told)]
    report: dict[str, Any] = {
        "policy": str(policy), "robot": robot.constants(), "walks": told,
    }  # fmt: skip
    write_json(out / "walks.json", report)
    return [*lines, f"{out}: frames_*.csv is for gatjax diagnose --data"]


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
