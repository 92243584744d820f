"""The loop itself: collect, ground, search, evaluate, and again.

Every stage leaves files in the run folder and is skipped where they are, so a run that
was stopped goes on where it was.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from gatjax import runs
from gatjax.data.recording import Recording, read_recording, write_recording
from gatjax.data.trajectories import to_recording
from gatjax.grounding.learn import grounded
from gatjax.loop.evaluate import confirm, evaluate, show, winner
from gatjax.loop.ground import ground
from gatjax.loop.optimise import Candidate, Job, optimise
from gatjax.loop.robots import Simulator
from gatjax.loop.setting import (
    ROBOT_LOG,
    ROBOT_UNIT,
    SIMULATOR_LOG,
    Progress,
    Robot,
    Setting,
    seeds,
)
from gatjax.records import Array
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
    for method in settings.methods:
        theta = THETA0
        for iteration in range(settings.iterations):
            theta = improve(setting, method, iteration, theta)
        show(
            setting, f"{method}_best_robot", theta, f"best of {method} on {robot.name}"
        )


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


def improve(setting: Setting, method: str, iteration: int, theta: Array) -> Array:
    """One iteration of one method; return the best walk on the robot, or `theta`."""
    owner = "" if iteration == 0 else f"_{method}"  # theta0 is everybody's
    robot_log = collect(setting, setting.robot, f"robot_{iteration}{owner}", theta)
    simulator = Simulator(setting.world)
    simulator_log = collect(setting, simulator, f"simulator_{iteration}{owner}", theta)
    grounding = ground(setting, method, iteration, theta, (robot_log, simulator_log))
    job = Job(
        folder=setting.folder,
        method=method,
        iteration=iteration,
        world=grounded(setting.world, grounding),
        theta=theta,
        key=setting.key(3, iteration),
        check_key=setting.key(4, iteration),
    )
    candidates = optimise(job, setting.settings, setting.progress)
    evaluate(setting, candidates)
    found = winner(setting, candidates)
    if found is None:
        return theta
    confirm(setting, found)
    return found.policy


def collect(setting: Setting, robot: Robot, name: str, theta: Array) -> Recording:
    """Record walks with one policy, once.

    Robot and simulator draw from seeds of their own: they share no random numbers.
    """
    path = setting.folder / "recordings" / f"{name}.parquet"
    settings = setting.settings
    real = robot is setting.robot
    count = settings.robot_trajectories if real else settings.simulator_trajectories
    if not path.exists():
        setting.progress.stage(f"collect {count} runs of {robot.name}")
        purpose = ROBOT_LOG if real else SIMULATOR_LOG
        drawn = seeds(purpose, settings.seed, count)
        trajectory, _ = robot.walk(np.tile(theta, (count, 1)), drawn, setting.task)
        rate = 1.0 / setting.task.control_period
        notes = {"policy": name, "seed": settings.seed}
        write_recording(path, to_recording(trajectory, robot.name, rate, notes))
        if real:
            setting.progress.work(ROBOT_UNIT * count)
    return read_recording(path)
