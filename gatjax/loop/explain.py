"""The explaining stage: what the simulator lacks by a diagnosis of the robot's logs."""

from __future__ import annotations

from collections.abc import Callable

import jax
import numpy as np

from gatjax.data import checks
from gatjax.data.recording import Recording
from gatjax.data.trajectories import split_by_trajectory
from gatjax.diagnosis.diagnose import diagnose
from gatjax.diagnosis.given import Logs
from gatjax.diagnosis.start import Start
from gatjax.files import read_json
from gatjax.loop.bound import bounded
from gatjax.loop.collect import collect, collect_motion
from gatjax.loop.ground import HELD_OUT, STABILITY_ROLLOUTS, count_falls
from gatjax.loop.play import Hangable, Player
from gatjax.loop.setting import DIAGNOSIS_UNIT, Entry, Setting
from gatjax.loop.staged import staged
from gatjax.records import JOINTS
from gatjax.robot.model import HUNG
from gatjax.robot.nao import LIMITS
from gatjax.runs import Progress, write_whole
from gatjax.sim.backend import prepare
from gatjax.sim.stored import read_world, write_world
from gatjax.sim.world import World, add_rows
from gatjax.walk.parameters import THETA0

EXPLAINED = "explained"
SKIPPED = "diagnosis/skipped.txt"
FIT, HELD = ("rich", "steps_small"), ("multisine",)  # motions of the menu
MOUNTING = "gravity_tilt"  # of a hung robot: it is left behind where it walks
SECONDS = 14.0  # of each of them
FIT_WALKS, HELD_WALKS = 4, 2  # of a robot that plays no motions


def explained(setting: Setting) -> list[Entry]:
    """Return GAT on the extended simulation; nothing where there is no such thing.

    The diagnosis and its world are made once. Whatever stands against them is told in
    one line and kept in diagnosis/skipped.txt, and the run goes on without.
    """
    file, skipped = (setting.folder / name for name in ("extended.json", SKIPPED))
    done = 0.0

    def work(share: float) -> None:
        nonlocal done
        done += share
        setting.progress.work(DIAGNOSIS_UNIT * share)

    if not file.exists() and not skipped.exists():
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
    if skipped.exists():
        return []
    return [Entry(EXPLAINED, "gat", read_world(file, setting.task)[0])]


def diagnosed(setting: Setting, work: Callable[[float], None]) -> None:
    """Diagnose the robot into the run folder, once; `work` hears of each share done.

    Raises:
        ValueError: one line: its logs cannot carry a diagnosis.
    """
    folder = setting.folder / "diagnosis"
    if (folder / "diagnosis.json").exists():
        return
    model, fit, held = logs(setting)
    ranges = {
        joint: (float(low), float(high))
        for joint, (low, high) in zip(JOINTS, LIMITS, strict=True)
    }
    found = checks.trusted(fit, ranges, "fit")
    found += checks.trusted(held, ranges, "held-out")
    stage = setting.progress.stage
    tell = staged(Progress(lambda text: stage(f"diagnosis: {text}"), work))
    rows = checks.summary(list(zip([*fit, *held], found, strict=True)))
    diagnose(Start(model), Logs(fit, held, rows), folder, setting.settings.seed, tell)


def logs(setting: Setting) -> tuple[str, list[Recording], list[Recording]]:
    """The model, recordings to explain, and others to measure the gain on.

    A robot that can hang plays motions that move every joint far; one that can only
    stand plays those that it can bear. Of any other one, walks with theta0 have to do;
    none that later tests the prediction is fitted.
    """
    robot, model = setting.robot, setting.world.source
    if isinstance(robot, Hangable):
        robot, model = robot.hung(), HUNG
    if isinstance(robot, Player):
        fit, held = (
            [collect_motion(setting, robot, name, SECONDS) for name in names]
            for names in (FIT, HELD)
        )
        return model, fit, held
    walks = collect(setting, robot, "robot_0", THETA0)
    seen, unseen = split_by_trajectory(
        walks.trajectory, HELD_OUT, setting.settings.seed
    )
    fit, held = _only(walks, seen[:FIT_WALKS]), _only(walks, unseen[:HELD_WALKS])
    return model, [fit], [held]


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


def _only(recording: Recording, ids: np.ndarray) -> Recording:
    """Some trajectories of a recording."""
    kept = np.isin(recording.trajectory, ids)
    return recording._replace(
        time=recording.time[kept],
        trajectory=recording.trajectory[kept],
        columns={name: values[kept] for name, values in recording.columns.items()},
    )
