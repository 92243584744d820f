"""Put a policy on a robot: walks under guard, with every frame in a log."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, NamedTuple, Sequence

import numpy as np

from gatjax.files import check_folder, make_folder, read_json, write_json
from gatjax.hardware.attendant import Attendant
from gatjax.hardware.robot import Hardware
from gatjax.records import Outcome
from gatjax.task import RATES, Task, task_at
from gatjax.walk.parameters import THETA0
from gatjax.walk.policy import read_policy

Array = Any

HAND_TUNED = "theta0"  # instead of a policy file
REPORT = "walks.json"  # of what is asked for and of the walks
ORDER = ("parameters", "forward", "seconds")  # in it: all walks of a folder share them


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
    if str(path) == HAND_TUNED:
        return THETA0
    if path.is_dir():
        found = sorted((path / "policies").glob("*.json"))
        names = ", ".join(policy.name for policy in found) or "none"
        raise ValueError(f"{path}: which policy? It has {names}")
    if not path.exists():
        raise FileNotFoundError(
            f"{path}: no such policy; give a file of runs/.../policies, or {HAND_TUNED}"
        )
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
        Lines that say what happened. If it ends early, the person is told of the walks
        that are there.

    Raises:
        ValueError, Stopped, KeyboardInterrupt, Lost: see `Hardware.walk`; or the folder
            has other walks.
    """
    asked.check()
    named = out is not None
    out = out or Path("deployed") / time.strftime("%Y%m%d-%H%M%S")
    theta = policy_at(policy)
    before = _before(out)
    robot = Hardware(address, out, person)
    person.say(f"{address}: {robot.identity}, {robot.state}")
    facts = {
        "policy": str(policy), "parameters": theta.tolist(), "forward": asked.forward,
        "seconds": asked.seconds, "robot": robot.constants(),
    }  # fmt: skip
    _check_same(out, before, facts)
    if not named:
        person.say(f"all goes to {out}; if it is stopped, --out {out} goes on")
    task = task_of(robot.period, forward=asked.forward, duration=asked.seconds)
    most = max(asked.walks, len(before["walks"]) if before else 0)

    def policies(count: int) -> tuple[Array, Sequence[int], Task]:
        return np.tile(theta, (count, 1)), range(count), task

    def told() -> list[str]:
        return _told(out, facts, robot.walked(*policies(most)))

    def done(number: int) -> None:
        line = told()[number]
        if number + 1 < asked.walks:  # the last one is said at the end
            person.say(line)

    make_folder(out)
    told()
    try:
        robot.walk(*policies(asked.walks), done)
    except BaseException:
        for line in told():
            person.say(line)
        raise
    return [*told(), f"{out}: frames_*.csv is for gatjax diagnose --data"]


def _before(out: Path) -> dict[str, Any]:
    """Read what a folder says of the walks in it; nothing if it has none.

    Raises:
        ValueError: one line: a file is there, or another kind of report.
    """
    check_folder(out)
    path = out / REPORT
    found = read_json(path) if path.is_file() else {}
    if found and not {"policy", *ORDER, "robot", "walks"} <= set(found):
        raise ValueError(f"{path}: is of something else; choose another --out")
    return found if found.get("walks") or any(out.glob("walk_*.npz")) else {}


def _check_same(out: Path, before: dict[str, Any], facts: dict[str, Any]) -> None:
    """Refuse a folder whose walks were asked for in another way."""
    for key in ORDER:
        was, now = before.get(key, facts[key]), facts[key]
        if was == now:
            continue
        name = key
        if key == "parameters":
            name = "policy"
            names = before["policy"], facts["policy"]
            was, now = names if names[0] != names[1] else (names[0], "as it is now")
        raise ValueError(
            f"{out}: has walks with {name} {was}, not {now}; choose another --out"
        )
    was, now = before.get("robot", facts["robot"]), facts["robot"]
    if was.get("identity") != now["identity"]:
        raise ValueError(
            f"{out}: has walks of robot {was.get('identity')}, this is "
            f"{now['identity']}; choose another --out"
        )


def _told(out: Path, facts: dict[str, Any], walks: list[Any]) -> list[str]:
    """Write the report of the walks that are there, and say each in a line."""
    there = {number: summary(walk[1]) for number, walk in enumerate(walks) if walk}
    write_json(out / REPORT, {**facts, "walks": list(there.values())})
    return [f"walk {number + 1}: {said(entry)}" for number, entry in there.items()]


def summary(outcome: Outcome) -> dict[str, Any]:
    """Facts of one walk, plain numbers."""
    velocity, fell = float(outcome.velocity), float(outcome.fell_at)
    return {
        "velocity_m_s": velocity if np.isfinite(velocity) else None,
        "fell_at_s": fell if np.isfinite(fell) else None,
    }


def said(facts: dict[str, Any]) -> str:
    """Say the facts of a walk."""
    speed, fell = facts["velocity_m_s"], facts["fell_at_s"]
    end = "stood to the end" if fell is None else f"fell after {fell:.1f} s"
    far = "nobody said how far" if speed is None else f"{100.0 * speed:.1f} cm/s"
    return f"{far}, {end}"
