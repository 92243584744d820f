"""The explaining stage: what the simulator lacks by a diagnosis of the robot's logs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import jax
import numpy as np

from gatjax.data.recording import Recording
from gatjax.files import read_json
from gatjax.loop.bound import bounded
from gatjax.loop.case import Case, case_of, examine
from gatjax.loop.collect import collect
from gatjax.loop.ground import STABILITY_ROLLOUTS, count_falls
from gatjax.loop.processes import side_by_side
from gatjax.loop.setting import DIAGNOSIS_UNIT, Entry, Setting
from gatjax.loop.staged import staged
from gatjax.robot.model import HUNG
from gatjax.runs import Progress, write_whole
from gatjax.sim.backend import prepare
from gatjax.sim.stored import read_world, write_world
from gatjax.sim.world import World, add_rows
from gatjax.walk.parameters import THETA0

EXPLAINED = "explained"
SKIPPED = "diagnosis/skipped.txt"
MOUNTING = "gravity_tilt"  # of a hung robot: it is left behind where it walks
CORES = 4  # that one diagnosis keeps busy: part of it is Python, in one thread


def explained(setting: Setting, done: float = 0.0) -> list[Entry]:
    """Return GAT on the extended simulation; nothing where there is no such thing.

    Of a diagnosis that was made `ahead` the progress has heard: all of it is done, 1.

    The diagnosis and its world are made once. Whatever stands against them is told in
    one line and kept in diagnosis/skipped.txt, and the run goes on without.
    """
    file, skipped = setting.folder / "extended.json", setting.folder / SKIPPED

    def work(share: float) -> None:
        nonlocal done
        done += share
        setting.progress.work(DIAGNOSIS_UNIT * share)

    if not file.exists() and not _skipped(setting):
        walks = collect(setting, setting.robot, "robot_0", THETA0)  # or try again later
        try:
            diagnosed(setting, work)
            write_world(file, extended(setting, walks), {"verb": "run"}, None)
        except np.linalg.LinAlgError:
            raise
        except ValueError as error:
            reason = " ".join(str(error).split())
            setting.progress.stage(f"no GAT after diagnosis: {reason}")
            skipped.parent.mkdir(exist_ok=True)
            write_whole({skipped: f"{reason}\n".encode()})
    work(1.0 - done)
    if _skipped(setting):
        return []
    return [Entry(EXPLAINED, "gat", read_world(file, setting.task)[0])]


def _skipped(setting: Setting) -> bool:
    return (setting.folder / SKIPPED).exists()


def diagnosed(setting: Setting, work: Callable[[float], None]) -> None:
    """Diagnose the robot into the run folder, once; `work` hears of each share done.

    Raises:
        ValueError: one line: its logs cannot carry a diagnosis.
    """
    if _is_diagnosed(setting):
        return
    stage = setting.progress.stage
    tell = staged(Progress(lambda text: stage(f"diagnosis: {text}"), work))
    examine(case_of(setting), tell)


def _is_diagnosed(setting: Setting) -> bool:
    return (setting.folder / "diagnosis" / "diagnosis.json").exists()


def ahead(trials: Sequence[Setting], cores: int) -> set[Path]:
    """Diagnose the robot in several trials side by side, where the cores suffice.

    What cannot be diagnosed is left to `explained`, which says why.

    Returns:
        Run folders whose diagnoses the progress has heard of.
    """
    left = [each for each in trials if not (_is_diagnosed(each) or _skipped(each))]
    count, told = min(len(left), cores // CORES), set()
    if count < 2:
        return told
    cases, progress = [case_of(setting) for setting in left], trials[0].progress
    text = f"diagnose {len(left)} trials, {count} side by side"
    progress.stage(text)
    try:
        for done, folder in enumerate(side_by_side(_try, cases, count), 1):
            progress.stage(f"{text}: {done} done")
            if folder is not None:
                told.add(folder)
                progress.work(DIAGNOSIS_UNIT)
    except BrokenProcessPool:
        progress.stage("a diagnosis was killed (each needs 2 GB); go on one by one")
    return told


def _try(case: Case) -> Path | None:
    """Diagnose and return the run folder, if the logs can carry it."""
    try:
        examine(case, lambda stage, share: None)
    except np.linalg.LinAlgError:
        raise
    except ValueError:
        return None
    return case.folder.parent


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
    hung = found.source == HUNG
    rows = [row for row in found.causes if not (hung and row["cause"] == MOUNTING)]
    if not rows:
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
    world = add_rows(setting.world, rows)
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
