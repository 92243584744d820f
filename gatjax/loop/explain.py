"""The explaining stage: what the simulator lacks by a diagnosis of the robot's logs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager, suppress
from pathlib import Path

import jax
import numpy as np

from gatjax.data.recording import Recording
from gatjax.files import read_json
from gatjax.loop.bound import bounded
from gatjax.loop.case import case_of, examine, play_together, tried
from gatjax.loop.collect import collect
from gatjax.loop.ground import STABILITY_ROLLOUTS, count_falls
from gatjax.loop.setting import DIAGNOSIS_UNIT, Entry, Setting
from gatjax.loop.staged import staged
from gatjax.processors import shares
from gatjax.runs import Progress, write_whole
from gatjax.sim.backend import prepare
from gatjax.sim.stored import read_world, write_world
from gatjax.sim.walker import lasting
from gatjax.sim.world import World, add_rows, with_contact
from gatjax.walk.parameters import THETA0
from gatjax.workers import Workers

EXPLAINED = "explained"
EXTENDED, DIAGNOSED = "extended.json", "diagnosis/diagnosis.json"  # in the run folder
SKIPPED = "diagnosis/skipped.txt"
MEMORY = 4e9  # bytes of the machine for a diagnosis, which takes half of them


def explained(setting: Setting, done: float = 0.0) -> list[Entry]:
    """Return GAT on the extended simulation; nothing where there is no such thing.

    The diagnosis and its world are made once. Whatever stands against them is told in
    one line and kept in diagnosis/skipped.txt, and the run goes on without, also when
    it is called again.

    Args:
        setting: of the trial.
        done: share of the diagnosis that the progress has heard of.
    """
    file, skipped = setting.folder / EXTENDED, setting.folder / SKIPPED

    def work(share: float) -> None:
        nonlocal done
        done += share
        setting.progress.work(DIAGNOSIS_UNIT * share)

    if not file.exists() and not skipped.exists():
        walks = collect(setting, setting.robot, "robot_0", THETA0)  # or try again later
        with _skipping(setting):
            diagnosed(setting, work)
            write_world(file, extended(setting, walks), {"verb": "run"}, None)
        work(1.0 - done)
    else:
        setting.progress.past(DIAGNOSIS_UNIT * (1.0 - done))
    if skipped.exists():
        setting.progress.stage(
            f"no GAT after diagnosis: {skipped.read_text().strip()} (to try again, "
            f"delete {skipped.parent})"
        )
        return []
    return [Entry(EXPLAINED, "gat", read_world(file, setting.task)[0])]


@contextmanager
def _skipping(setting: Setting) -> Iterator[None]:
    """Keep what stands against a diagnosis in the block, and go on."""
    try:
        yield
    except np.linalg.LinAlgError:
        raise
    except ValueError as error:
        _skip(setting, str(error))


def _skip(setting: Setting, reason: str) -> None:
    file = setting.folder / SKIPPED
    file.parent.mkdir(exist_ok=True)
    write_whole({file: f"{' '.join(reason.split())}\n".encode()})


def diagnosed(setting: Setting, work: Callable[[float], None]) -> None:
    """Diagnose the robot into the run folder, once; `work` hears of each share done.

    Raises:
        ValueError: one line: its logs cannot carry a diagnosis.
    """
    if (setting.folder / DIAGNOSED).exists():
        return
    stage = setting.progress.stage
    tell = staged(Progress(lambda text: stage(f"diagnosis: {text}"), work))
    examine(case_of(setting), tell)


def _decided(setting: Setting) -> bool:
    """Return whether there is a diagnosis, or something that stands against one."""
    known = DIAGNOSED, EXTENDED, SKIPPED
    return any((setting.folder / name).exists() for name in known)


def ahead(trials: Sequence[Setting], cores: int, memory: float) -> set[Path]:
    """Diagnose the robot in several trials side by side, each on a core or more.

    More cores hardly speed up one of them: two take as long together, on two, as one.

    Args:
        trials: of the run.
        cores: of this machine.
        memory: of this machine, bytes.

    Returns:
        Run folders whose diagnoses are done, and told to the progress.
    """
    left = [each for each in trials if not _decided(each)]
    count, told = int(min(len(left), cores, memory / MEMORY)), set()
    progress = trials[0].progress
    if count < 2:
        return told
    cases = []
    with suppress(ValueError):  # which is told below, trial by trial
        play_together(left)
    for setting in left:
        collect(setting, setting.robot, "robot_0", THETA0)  # or try again later
        with _skipping(setting):
            cases.append((setting, case_of(setting)))
    if not cases:
        return told
    count = min(count, len(cases))
    text = f"diagnose {len(cases)} trials, {count} side by side"
    progress.stage(text)
    jobs = [(case,) for _, case in cases]
    try:
        with closing(Workers(count, shares(count))) as workers:
            for place, reason in workers.results(tried, jobs):
                setting = cases[place][0]
                if reason is not None:
                    _skip(setting, reason)
                told.add(setting.folder)
                progress.work(DIAGNOSIS_UNIT)
                progress.stage(f"{text}: {len(told)} done")
    except BrokenProcessPool:
        progress.stage("a diagnosis died (each needs 2 GB of memory): one by one then")
    return told


def extended(setting: Setting, walks: Recording) -> World:
    """Return the nominal simulator with what the diagnosis found, for a search.

    The search keeps to torques that the robot's walks bear out (`bounded`). The world
    keeps the nominal physics step, so that worlds differ by the causes alone.

    Raises:
        ValueError: nothing was found, it predicts the held-out motion no better or
            diverges, or theta0 falls with it.
    """
    folder = setting.folder / "diagnosis"
    found, _ = read_world(folder / "world.json", setting.task)
    rows, law = lasting(found), found.contact
    if not rows and law is None:
        raise ValueError(
            "the diagnosis changes nothing: GAT after it would be GAT alone"
        )
    gain = read_json(folder / "diagnosis.json")["gain"]
    if gain is None:
        raise ValueError(
            "a robot fell at the start of the held-out motion, in the log or in a "
            "simulation of it: no gain could be measured"
        )
    if not gain["promoted"]:
        raise ValueError(
            f"what the diagnosis found does not surely predict the held-out motion "
            f"better (error {gain['before']:.3g} to {gain['after']:.3g} rad)"
        )
    floor = setting.world if law is None else with_contact(setting.world, law)
    world = add_rows(floor, rows)
    _stand(setting, world, "that the diagnosis extended")
    setting.progress.stage("find the torques that the robot's walks bear out")
    world = bounded(world, walks, setting.settings.seed)
    _stand(setting, world, "kept to the torques that theta0's walks bear out")
    return world


def _stand(setting: Setting, world: World, text: str) -> None:
    """Raise a ValueError where theta0 falls in a simulation."""
    keys = jax.random.split(setting.key(2, 0), STABILITY_ROLLOUTS)
    falls = count_falls(prepare(world, "native"), world.values, THETA0, keys)
    if falls:
        raise ValueError(
            f"theta0 falls in {falls} of {STABILITY_ROLLOUTS} walks in the simulation "
            f"{text}"
        )
