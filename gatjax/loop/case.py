"""A diagnosis of the robot in one trial: its logs, and what it is told of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gatjax.data import checks
from gatjax.data.misread import mended
from gatjax.data.recording import Recording
from gatjax.diagnosis.diagnose import diagnose
from gatjax.diagnosis.given import Logs, Tell
from gatjax.diagnosis.start import Start
from gatjax.loop.collect import collect, collect_motion, collect_motion_together
from gatjax.loop.ground import parted
from gatjax.loop.play import Hangable, Player
from gatjax.loop.setting import Away, Robot, Setting
from gatjax.records import JOINTS
from gatjax.robot.model import HUNG
from gatjax.robot.nao import LIMITS
from gatjax.walk.parameters import THETA0

FIT, HELD = ("rich", "steps_small"), ("multisine",)  # motions of the menu
SECONDS = 14.0  # of each of them
FIT_WALKS, HELD_WALKS = 4, 2  # of a robot that plays no motions


class Case(NamedTuple):
    """What a diagnosis of the robot in a trial needs."""

    folder: Path
    model: str
    fit: list[Recording]
    held: list[Recording]
    seed: int


def case_of(setting: Setting) -> Case:
    """Collect the logs of a diagnosis, once."""
    return Case(setting.folder / "diagnosis", *logs(setting), setting.settings.seed)


def examine(case: Case, tell: Tell) -> None:
    """Diagnose into the case's folder.

    Raises:
        ValueError: one line: its logs cannot carry a diagnosis.
    """
    ranges = {
        joint: (float(low), float(high))
        for joint, (low, high) in zip(JOINTS, LIMITS, strict=True)
    }
    whole = [mended(log) for log in (*case.fit, *case.held)]
    files, misread = zip(*whole, strict=True)
    fit, held = list(files[: len(case.fit)]), list(files[len(case.fit) :])
    found = checks.trusted(fit, ranges, "fit")
    found += checks.trusted(held, ranges, "held-out")
    found = [[*a, *b] for a, b in zip(misread, found, strict=True)]
    rows = checks.summary(list(zip(files, found, strict=True)))
    given = Logs(fit, held, rows)
    diagnose(Start(case.model), given, case.folder, case.seed, tell)


def tried(case: Case) -> str | None:
    """Diagnose; return what stands against it."""
    try:
        examine(case, lambda stage, share: None)
    except np.linalg.LinAlgError:
        raise
    except ValueError as error:
        return str(error)
    return None


def play_together(trials: Sequence[Setting]) -> None:
    """Let an `Away` robot play the motions of a diagnosis in all trials at once."""
    robot, _ = _player(trials[0])
    if isinstance(robot, Player) and isinstance(trials[0].robot, Away):
        for name in (*FIT, *HELD):
            collect_motion_together(trials, robot, name, SECONDS)


def _player(setting: Setting) -> tuple[Robot | Player, str]:
    """The robot, hung where it can be, and what models it so."""
    if isinstance(setting.robot, Hangable):
        return setting.robot.hung(), HUNG
    return setting.robot, setting.world.source


def logs(setting: Setting) -> tuple[str, list[Recording], list[Recording]]:
    """The model, recordings to explain, and others to measure the gain on.

    A robot that can hang plays motions that move every joint far; one that can only
    stand plays those that it can bear. Of any other one, walks with theta0 have to do;
    none that later tests the prediction is fitted.
    """
    robot, model = _player(setting)
    if isinstance(robot, Player):
        fit, held = (
            [collect_motion(setting, robot, name, SECONDS) for name in names]
            for names in (FIT, HELD)
        )
        return model, fit, held
    walks = collect(setting, setting.robot, "robot_0", THETA0)
    step, seed = setting.task.control_period, setting.settings.seed
    seen, unseen = parted(walks, step, seed)
    fit, held = _only(walks, seen[:FIT_WALKS]), _only(walks, unseen[:HELD_WALKS])
    return model, [fit], [held]


def _only(recording: Recording, ids: np.ndarray) -> Recording:
    """Some trajectories of a recording."""
    kept = np.isin(recording.trajectory, ids)
    return recording._replace(
        time=recording.time[kept],
        trajectory=recording.trajectory[kept],
        columns={name: values[kept] for name, values in recording.columns.items()},
    )
