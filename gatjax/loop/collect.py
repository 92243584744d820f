"""The collecting stage: walks of robot and simulator, and motions of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import jax
import numpy as np

from gatjax.data.recording import Recording, read_recording, write_recording
from gatjax.data.trajectories import at_rate, to_recording
from gatjax.loop.play import Play, Player, played, record_motion, recorded
from gatjax.loop.setting import (
    ROBOT_UNIT,
    Robot,
    Setting,
)
from gatjax.motions import MENU, chosen
from gatjax.records import Array
from gatjax.settings import EXPLANATION, ROBOT_LOG, SIMULATOR_LOG, seeds


def collect(setting: Setting, robot: Robot, name: str, theta: Array) -> Recording:
    """Record walks with one policy, once; where frames were lost they are cut.

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
    recording, gaps = at_rate(read_recording(path), setting.task.control_period)
    if gaps:
        setting.progress.stage(f"{name}: cut at {gaps} gaps in time")
    return recording


def collect_motion(
    setting: Setting, robot: Player, name: str, seconds: float
) -> Recording:
    """Record the robot, standing or hung, playing a motion of the menu, once.

    Raises:
        ValueError: one line: there is nothing to record.
    """
    path = _motion_file(setting, robot, name)
    if not path.exists():
        recording, _ = record_motion(robot, _asked([setting], robot, name, seconds))
        write_recording(path, recording)
    return read_recording(path)


def collect_motion_together(
    trials: Sequence[Setting], robot: Player, name: str, seconds: float
) -> None:
    """Record what `collect_motion` does in several trials, in one call of the robot.

    Trials in which there is nothing to record are left to it.
    """
    left = [each for each in trials if not _motion_file(each, robot, name).exists()]
    if not left:
        return
    play = _asked(left, robot, name, seconds)
    trajectory = played(robot, play)
    for index, setting in enumerate(left):
        run = jax.tree.map(lambda leaf, at=index: np.asarray(leaf)[[at]], trajectory)
        with suppress(ValueError):
            alone = play._replace(seeds=[play.seeds[index]])
            recording = recorded(robot, alone, run)
            write_recording(_motion_file(setting, robot, name), recording)


def _motion_file(setting: Setting, robot: Player, name: str) -> Path:
    file = f"explain_{_base(robot)}_{name}.parquet"
    return setting.folder / "recordings" / file


def _base(robot: Player) -> str:
    return "standing" if robot.limbs().floating else "hung"


def _asked(trials: Sequence[Setting], robot: Player, name: str, seconds: float) -> Play:
    """Announce a motion of the menu; return it, each trial with a draw of its own."""
    text = f"collect the motion {name} of {robot.name}, {_base(robot)}"
    trials[0].progress.stage(text)
    motion, number, limbs = MENU[name], list(MENU).index(name), robot.limbs()
    moving = chosen(limbs, ())
    drawn = [seeds(EXPLANATION, one.settings.seed, len(MENU)) for one in trials]
    return Play(
        motion=motion,
        joints=moving,
        rate_hz=trials[0].settings.rate_hz,
        seeds=[each[number] for each in drawn],
        reach=motion.reach(limbs, moving),
        seconds=seconds,
    )
