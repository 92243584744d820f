"""The collecting stage: walks of robot and simulator, and motions of the robot."""

from __future__ import annotations

import numpy as np

from gatjax.data.recording import Recording, read_recording, write_recording
from gatjax.data.trajectories import to_recording
from gatjax.loop.play import Play, Player, record_motion
from gatjax.loop.setting import (
    ROBOT_UNIT,
    Robot,
    Setting,
)
from gatjax.motions import MENU, chosen
from gatjax.records import Array
from gatjax.settings import EXPLANATION, ROBOT_LOG, SIMULATOR_LOG, seeds


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


def collect_motion(
    setting: Setting, robot: Player, name: str, seconds: float
) -> Recording:
    """Record the robot, standing or hung, playing a motion of the menu, once."""
    limbs = robot.limbs()
    base = "standing" if limbs.floating else "hung"
    path = setting.folder / "recordings" / f"explain_{base}_{name}.parquet"
    if not path.exists():
        setting.progress.stage(f"collect the motion {name} of {robot.name}, {base}")
        motion, number = MENU[name], list(MENU).index(name)
        moving = chosen(limbs, ())
        drawn = seeds(EXPLANATION, setting.settings.seed, len(MENU))
        play = Play(
            motion=motion,
            joints=moving,
            rate_hz=1.0 / setting.task.control_period,
            seeds=drawn[number : number + 1],
            reach=motion.reach(limbs, moving),
            seconds=seconds,
        )
        recording, _ = record_motion(robot, play)
        write_recording(path, recording)
    return read_recording(path)
