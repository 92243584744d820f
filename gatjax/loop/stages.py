"""The loop itself: collect, ground, search, evaluate, and again.

Every stage leaves files in the run folder and is skipped where they are, so a run that
was stopped goes on where it was.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from gatjax import processors, runs
from gatjax.data.recording import Recording
from gatjax.grounding.learn import grounded
from gatjax.loop.beginning import beginning
from gatjax.loop.candidates import Candidate, Job
from gatjax.loop.collect import collect
from gatjax.loop.evaluate import Shown, confirm, evaluate, nothing, show, winner
from gatjax.loop.explain import ahead, explained
from gatjax.loop.ground import ground
from gatjax.loop.optimise import optimise_all
from gatjax.loop.oracle import oracle
from gatjax.loop.robots import Simulator
from gatjax.loop.setting import ORACLE, Away, Entry, Robot, Setting
from gatjax.records import Array
from gatjax.runs import Progress
from gatjax.settings import LoopSettings
from gatjax.task import task_at
from gatjax.walk.parameters import THETA0

COMPARED = ("methods", "explain")  # settings that may change when a run goes on


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
        ValueError: settings differ in more than their seeds, or from those that a run
            was begun with in more than what is compared; or another process is at
            work in a folder.
    """
    if len({dataclasses.replace(one, seed=0) for one in settings}) > 1:
        raise ValueError("trials side by side may differ in their seeds only")
    with contextlib.ExitStack() as all_held:
        for folder in folders:
            all_held.enter_context(runs.held(folder))
        _run_all(folders, settings, robot, progress)


def _run_all(
    folders: Sequence[Path],
    settings: Sequence[LoopSettings],
    robot: Robot,
    progress: Progress,
) -> None:
    """As `run_all`, in folders that nobody else writes to."""
    task = task_at(settings[0].rate_hz)
    trials = []
    for folder, one in zip(folders, settings, strict=True):
        runs.resume_run(folder, one, COMPARED)
        world = beginning(folder, one, task)
        trials.append(Setting(folder, one, task, world, robot, progress))
    begin(trials)
    compared = [each for alike in by_entry(entries(trials)) for each in alike]
    thetas: list[Array] = [THETA0] * len(compared)
    for iteration in range(settings[0].iterations):
        thetas = improve(compared, iteration, thetas)
    best = []
    for (setting, entry), theta in zip(compared, thetas, strict=True):
        if theta is THETA0:  # nothing that was found stands
            continue
        label = f"best of {entry.name} on {robot.name}"
        best.append(Shown(setting, theta, f"{entry.name}_best_robot", label))
    show(best)


def begin(trials: Sequence[Setting]) -> None:
    """Name the robot, and walk theta0 on it."""
    for setting in trials:
        name_robot(setting.folder, setting.robot)
        theta0 = setting.folder / "policies", "theta0", THETA0
        runs.write_policy(*theta0, {"by": "hand"})
    first = Candidate("theta0", 0, 0, "best", THETA0)
    confirm([(setting, first) for setting in trials], "walk theta0 on the robot")
    label = f"theta0 on {trials[0].robot.name}"
    show([Shown(setting, THETA0, "theta0_robot", label) for setting in trials])


def entries(trials: Sequence[Setting]) -> list[tuple[Setting, Entry]]:
    """What is compared: the methods, and GAT on what a diagnosis leaves."""
    explain, found, told = trials[0].settings.explain, [], set()
    if explain:
        told = ahead(trials, processors.usable(), processors.memory())
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
    path, now = folder / "robot.json", {"name": robot.name, **robot.constants()}
    if path.exists():
        begun = json.loads(path.read_text())
        for known in ("name", "identity"):
            one, other = begun.get(known), now.get(known)
            if one != other and (known == "name" or (one and other)):
                raise ValueError(
                    f"{folder} was begun with the robot {one!r}, not {other!r}; "
                    f"go on with that one (loop.run), or start a new run"
                )
    runs.write_json(path, now)


def improve(
    compared: Sequence[tuple[Setting, Entry]], iteration: int, thetas: Sequence[Array]
) -> list[Array]:
    """One iteration of entries in their trials, each in the order of `by_entry`.

    Args:
        compared: N entries.
        iteration: from 0.
        thetas: N policies [15] that they begin with.

    Returns:
        The best walk of each on the robot, or the theta that it began with.
    """
    found = _tried(compared, iteration, thetas)
    tried = zip(compared, found, strict=True)
    won = [winner(setting, candidates) for (setting, _), candidates in tried]
    pairs = zip(compared, won, strict=True)
    walking = [(setting, one) for (setting, _), one in pairs if one is not None]
    confirm(walking, "winners walk again on the robot")
    return [
        theta if one is None else one.policy
        for one, theta in zip(won, thetas, strict=True)
    ]


def _tried(
    compared: Sequence[tuple[Setting, Entry]], iteration: int, thetas: Sequence[Array]
) -> list[list[Candidate]]:
    """Search, and try what is found on the robot: on mjx, beside the next search.

    A stop drops walks that were begun, those of one entry; they are made again.
    """
    begun, walking = iter(thetas), nothing
    found: list[list[Candidate]] = []
    try:
        for alike in by_entry(compared):
            some = search(alike, iteration, list(islice(begun, len(alike))))
            found += some
            trials = [setting for setting, _ in alike]
            before, walking = walking, evaluate(list(zip(trials, some, strict=True)))
            before()
        walking()
    except BaseException:
        robot = compared[0][0].robot
        if isinstance(robot, Away):
            robot.drop_walks()
        raise
    return found


def search(
    alike: Sequence[tuple[Setting, Entry]], iteration: int, thetas: Sequence[Array]
) -> list[list[Candidate]]:
    """Collect, ground and search for one entry in all trials; return candidates."""
    each = list(zip(alike, thetas, strict=True))
    if alike[0][1].name == ORACLE:
        return [oracle(setting, iteration, theta) for (setting, _), theta in each]
    jobs = [job_of(*trial, iteration, theta) for trial, theta in each]
    setting = alike[0][0]
    return optimise_all(jobs, setting.settings, setting.progress)


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
