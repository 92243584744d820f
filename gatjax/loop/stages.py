"""The loop itself: collect, ground, search, evaluate, and again.

Every stage leaves files in the run folder and is skipped where they are, so a run that
was stopped goes on where it was.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

from gatjax import processors, runs
from gatjax.data.recording import Recording
from gatjax.grounding.learn import grounded
from gatjax.loop.candidates import Candidate, Job
from gatjax.loop.collect import collect
from gatjax.loop.evaluate import confirm, evaluate, show, winner
from gatjax.loop.explain import ahead, explained
from gatjax.loop.ground import ground
from gatjax.loop.optimise import optimise_all
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
    run_all([folder], [settings], robot, progress)


def run_all(
    folders: Sequence[Path],
    settings: Sequence[LoopSettings],
    robot: Robot,
    progress: Progress,
) -> None:
    """Run trials of the loop side by side; on mjx their searches are one call.

    Args:
        folders: one a trial, of `gatjax.runs.open_run`.
        settings: of each trial, checked by `resolved`; their seeds alone may differ.
        robot: of all trials.
        progress: told of every stage.

    Raises:
        ValueError: settings differ in more than their seeds.
    """
    if len({dataclasses.replace(one, seed=0) for one in settings}) > 1:
        raise ValueError("trials side by side may differ in their seeds only")
    task = task_at(settings[0].rate_hz)
    world, trials = nominal(task), []
    for folder, one in zip(folders, settings, strict=True):
        trials.append(Setting(folder, one, task, world, robot, progress))
    begin(trials)
    compared = entries(trials)
    for alike in by_entry(compared):
        name, thetas = alike[0][1].name, [THETA0] * len(alike)
        for iteration in range(settings[0].iterations):
            thetas = improve(alike, iteration, thetas)
        best = [(trial[0], theta) for trial, theta in zip(alike, thetas, strict=True)]
        show(best, f"{name}_best_robot", f"best of {name} on {robot.name}")


def begin(trials: Sequence[Setting]) -> None:
    """Name the robot, and walk theta0 on it."""
    for setting in trials:
        name_robot(setting.folder, setting.robot)
        theta0 = setting.folder / "policies", "theta0", THETA0
        runs.write_policy(*theta0, {"by": "hand"})
    first = Candidate("theta0", 0, 0, "best", THETA0)
    confirm([(setting, first) for setting in trials])
    label = f"theta0 on {trials[0].robot.name}"
    show([(setting, THETA0) for setting in trials], "theta0_robot", label)


def entries(trials: Sequence[Setting]) -> list[tuple[Setting, Entry]]:
    """What is compared: the methods, and GAT on what a diagnosis leaves."""
    explain, found = trials[0].settings.explain, []
    told = ahead(trials, len(processors.usable())) if explain else set()
    for setting in trials:
        methods = setting.settings.methods
        own = [Entry(name, name, setting.world) for name in methods]
        if explain:
            own += explained(setting, 1.0 if setting.folder in told else 0.0)
        found += [(setting, entry) for entry in own]
    return found


def by_entry(
    trials: Sequence[tuple[Setting, Entry]],
) -> list[list[tuple[Setting, Entry]]]:
    """Group trials by what they compare; one may lack an entry that others have."""
    names = dict.fromkeys(entry.name for _, entry in trials)
    return [[each for each in trials if each[1].name == name] for name in names]


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


def improve(
    trials: Sequence[tuple[Setting, Entry]], iteration: int, thetas: Sequence[Array]
) -> list[Array]:
    """One iteration of one entry in all trials.

    Returns:
        Each trial's best walk on the robot, or the theta that it began with.
    """
    each = list(zip(trials, thetas, strict=True))
    if trials[0][1].name == ORACLE:
        found = [oracle(setting, iteration, theta) for (setting, _), theta in each]
    else:
        jobs = [job_of(*trial, iteration, theta) for trial, theta in each]
        setting = trials[0][0]
        found = optimise_all(jobs, setting.settings, setting.progress)
    for ((setting, _), _), candidates in zip(each, found, strict=True):
        evaluate(setting, candidates)
    won = [winner(trial[0], some) for trial, some in zip(trials, found, strict=True)]
    pairs = zip(trials, won, strict=True)
    confirm([(trial[0], one) for trial, one in pairs if one is not None])
    return [
        theta if one is None else one.policy
        for one, theta in zip(won, thetas, strict=True)
    ]


def job_of(setting: Setting, entry: Entry, iteration: int, theta: Array) -> Job:
    """Collect and ground, once, and return what is to be searched."""

    def logs() -> tuple[Recording, Recording]:
        owner = "" if iteration == 0 else f"_{entry.name}"  # theta0 is everybody's
        real = collect(setting, setting.robot, f"robot_{iteration}{owner}", theta)
        if entry.world is not setting.world:  # an extended one walks for itself
            owner = f"_{entry.name}"
        simulator, name = Simulator(entry.world), f"simulator_{iteration}{owner}"
        return real, collect(setting, simulator, name, theta)

    grounding = ground(setting, entry, iteration, theta, logs)
    return Job(
        folder=setting.folder,
        method=entry.name,
        iteration=iteration,
        world=grounded(entry.world, grounding),
        theta=theta,
        key=setting.key(3, iteration),
        check_key=setting.key(4, iteration),
    )
