"""What a diagnosis works on: a model, logs of one robot, and their runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import mujoco
import numpy as np

from gatjax.data.recording import Recording
from gatjax.data.trajectories import JointRun, to_arrays
from gatjax.diagnosis import noise
from gatjax.diagnosis.case import held, prepare
from gatjax.diagnosis.excerpt import excerpt
from gatjax.diagnosis.floor import channels, contact, standing
from gatjax.diagnosis.floor.judge import StandingJudge
from gatjax.diagnosis.joint import Assumed
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.measure import STRAY, mean_period
from gatjax.diagnosis.start import Start
from gatjax.diagnosis.tolerances import Tolerances
from gatjax.robot import model as robot_model
from gatjax.sim.contact import law_of, with_law
from gatjax.sim.limbs import floats

Tell = Callable[[str, float], None]
LOLA = 250.0 / 3.0  # Hz


def cut(recordings: list[Recording], joints: tuple[str, ...]) -> list[JointRun]:
    """Cut recordings into runs of the model's joints."""
    return [run for recording in recordings for run in to_arrays(recording, joints)]


def control_period(runs: list[JointRun]) -> float:
    """Mean period of the logs, s, gaps apart.

    It is that of whole Hz, or of LoLA, if no run shows a difference: its last row would
    come less than a quarter of a tick off.
    """
    period = mean_period([run.time for run in runs])
    longest = max(run.time[-1] - run.time[0] for run in runs) / period
    usual = (float(round(1.0 / period)), LOLA)
    near = (r for r in usual if r and abs(r * period - 1.0) * longest < STRAY)
    return next((1.0 / r for r in near), period)


class Logs(NamedTuple):
    """Recordings of one robot for its diagnosis.

    Nothing is fitted to those that are held out: they measure the gain, and causes that
    do not predict them are doubted. There may be none.
    """

    fit: list[Recording]
    held: list[Recording]
    checks: Sequence[dict[str, str]] = ()  # what `data.checks.summary` says of them


class Given(NamedTuple):
    """What a diagnosis works on."""

    start: Start
    model: mujoco.MjModel
    joints: tuple[str, ...]
    files: Logs  # of long ones to be explained pieces
    logs: list[JointRun]  # to be explained
    whole: list[JointRun]  # the same, uncut
    unseen: list[JointRun]  # held out
    period: float  # s, of control
    seed: int

    @property
    def floating(self) -> bool:
        """Whether the robot stands on the floor."""
        return floats(self.model)


def given(start: Start, files: Logs, seed: int) -> Given:
    """Load the model, and cut recordings into runs of its joints.

    Raises:
        ValueError: one line: a start or logs that are not diagnosed.
    """
    model = start.model()
    if floats(model) and start.rows:
        raise ValueError(
            "a robot that stands is not diagnosed from a world with causes yet; hang "
            "it, or give its model"
        )
    joints = robot_model.joint_names(model)
    whole = files.fit
    if not floats(model):
        files = files._replace(fit=excerpt(whole, len(joints)))
    logs, unseen, taught = (
        [_limited(model, run) for run in cut(some, joints)]
        for some in (files.fit, files.held, whole)
    )
    pieces = files.fit[0] is not whole[0]
    logs = [run._replace(within=pieces) for run in logs]
    period = control_period(logs)
    return Given(start, model, joints, files, logs, taught, unseen, period, seed)


def _limited(model: mujoco.MjModel, run: JointRun) -> JointRun:
    """A run with its commands as the actuators take them: within their ranges."""
    low, high = robot_model.command_range(model)
    return run._replace(command=np.clip(run.command, low, high))


def ahead_of(model: mujoco.MjModel) -> float:
    """How far a simulation in the model's own steps is ahead of time, s.

    Each step moves by the speed that it ends with: half a step, but for Runge-Kutta's.
    """
    exactly = model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    return 0.0 if exactly else 0.5 * float(model.opt.timestep)


def assumed_of(data: Given) -> list[Assumed]:
    """What is assumed of each joint; simulators, which log no noise, are early."""
    found, ahead = [], ahead_of(data.model)
    known = data.start.joints(data.model)
    for each, exact in zip(known, noise.exact(data.logs), strict=True):
        law = partial(_early, each.law, ahead) if exact else each.law
        found.append(each._replace(law=law))
    return found


def _early(
    law: Callable[[float], dict[str, float]], ahead: float, limit: float
) -> dict[str, float]:
    """A law of a joint whose readings come so many seconds before their time."""
    drive = law(limit)
    return drive | {"late": drive.get("late", 0.0) - ahead}


def judged(data: Given, tell: Tell, allowed: Tolerances) -> Judge:
    """The judge of a case, tolerances fitted."""
    model, logs, seed = data.model, data.logs, data.seed
    if not data.floating:
        base = held(model, logs, seed, allowed, assumed_of(data))
        return Judge(prepare(base, logs, tell), tell)
    felt = [run for recording in data.files.fit for run in channels.cut(recording)]
    base = standing.prepare(model, logs, felt, data.period, tell, seed, allowed)
    law = contact.best(base, tell)
    if law != law_of(model):
        model = with_law(model, law)
        base = standing.prepare(model, logs, felt, data.period, tell, seed, allowed)
    return StandingJudge(prepare(base, base.runs, tell), base, tell)
