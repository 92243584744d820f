"""The loop itself: collect, ground, search, evaluate, and again.

Every stage leaves files in the run folder and is skipped where they are, so a run that
was stopped goes on where it was.
"""

from __future__ import annotations

import json
from pathlib import Path

from gatjax import runs
from gatjax.grounding.learn import grounded
from gatjax.loop.collect import collect
from gatjax.loop.evaluate import confirm, evaluate, show, winner
from gatjax.loop.explain import explained
from gatjax.loop.ground import ground
from gatjax.loop.optimise import Candidate, Job, optimise
from gatjax.loop.oracle import oracle
from gatjax.loop.robots import Simulator
from gatjax.loop.setting import ORACLE, Entry, Robot, Setting
from gatjax.records import Array
from gatjax.runs import Progress
from gatjax.settings import LoopSettings
from gatjax.sim.world import nominal
from gatjax.task import task_at
from gatjax.walk.parameters import THETA0


def run(folder: Path, settings: LoopSettings, robot: Robot, progress: Progress) -> None:
    """Run the loop in an open run folder; call it again to go on after a stop.

    Args:
        folder: of `gatjax.runs.open_run`.
        settings: checked by `resolved`.
        robot: what the simulator is grounded in.
        progress: told of every stage.
    """
    task = task_at(settings.rate_hz)
    setting = Setting(folder, settings, task, nominal(task), robot, progress)
    name_robot(folder, robot)
    runs.write_policy(folder / "policies", "theta0", THETA0, {"by": "hand"})
    confirm(setting, Candidate("theta0", 0, 0, "best", THETA0))
    show(setting, "theta0_robot", THETA0, f"theta0 on {robot.name}")
    for entry in entries(setting):
        theta = THETA0
        for iteration in range(settings.iterations):
            theta = improve(setting, entry, iteration, theta)
        label = f"best of {entry.name} on {robot.name}"
        show(setting, f"{entry.name}_best_robot", theta, label)


def entries(setting: Setting) -> list[Entry]:
    """What is compared: the methods, and GAT on what a diagnosis leaves."""
    found = [Entry(name, name, setting.world) for name in setting.settings.methods]
    return found + (explained(setting) if setting.settings.explain else [])


def name_robot(folder: Path, robot: Robot) -> None:
    """Write robot.json; refuse to go on with a run that another robot began."""
    path = folder / "robot.json"
    if path.exists():
        begun = json.loads(path.read_text()).get("name")
        if begun != robot.name:
            raise ValueError(
                f"{folder} was begun with the robot {begun!r}, not {robot.name!r}; "
                f"go on with that one (loop.run), or start a new run"
            )
    runs.write_json(path, {"name": robot.name, **robot.constants()})


def improve(setting: Setting, entry: Entry, iteration: int, theta: Array) -> Array:
    """One iteration of one entry; return the best walk on the robot, or `theta`."""
    plain = entry.world is setting.world
    if entry.name == ORACLE:
        return judged(setting, oracle(setting, iteration, theta), theta)
    owner = "" if iteration == 0 else f"_{entry.name}"  # theta0 is everybody's
    robot_log = collect(setting, setting.robot, f"robot_{iteration}{owner}", theta)
    owner = owner if plain else f"_{entry.name}"  # an extended world walks for itself
    simulator = Simulator(entry.world)
    simulator_log = collect(setting, simulator, f"simulator_{iteration}{owner}", theta)
    grounding = ground(setting, entry, iteration, theta, (robot_log, simulator_log))
    job = Job(
        folder=setting.folder,
        method=entry.name,
        iteration=iteration,
        world=grounded(entry.world, grounding),
        theta=theta,
        key=setting.key(3, iteration),
        check_key=setting.key(4, iteration),
    )
    candidates = optimise(job, setting.settings, setting.progress)
    return judged(setting, candidates, theta)


def judged(setting: Setting, candidates: list[Candidate], theta: Array) -> Array:
    """Walk candidates on the robot; return the best walk, or `theta`."""
    evaluate(setting, candidates)
    found = winner(setting, candidates)
    if found is None:
        return theta
    confirm(setting, found)
    return found.policy
