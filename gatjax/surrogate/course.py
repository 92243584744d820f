"""The closed loop that every stand-in robot walks, and what its sensors report."""

from __future__ import annotations

from typing import Protocol, TypeVar, runtime_checkable

import numpy as np

from gatjax import task as tasks
from gatjax.records import Base, Outcome, Reading, Trajectory
from gatjax.surrogate.e1 import Body, Constants
from gatjax.surrogate.servo import encode
from gatjax.surrogate.start import Run
from gatjax.task import Task

Record = TypeVar("Record", Reading, Base)


@runtime_checkable
class Machine(Protocol):
    """The physics of N robots; it knows true angles and true contact forces."""

    def sense(self) -> Reading:
        """Return what was true one sensor delay ago, [N, ...]."""
        ...

    def base(self) -> Base:
        """Return where the torsos are now, [N, ...], seen from where they started."""
        ...

    def advance(self, target: np.ndarray, alive: np.ndarray) -> None:
        """Send targets [N, J] rad and run the living robots [N] for a control tick."""
        ...


def report(
    constants: Constants, body: Body, true: Reading, noise: np.ndarray
) -> Reading:
    """Turn true values [N, ...] into what the robot reports; `noise` is [N, 14]."""
    gyro, accelerometer, force = np.split(noise, [3, 6], axis=-1)
    return Reading(
        angle=encode(constants, true.angle, body.offset),
        gyro=true.gyro + constants.gyro_noise * gyro,
        accelerometer=true.accelerometer
        + constants.accelerometer_noise * accelerometer,
        force=true.force * body.force_gain * (1.0 + constants.force_noise * force),
    )


def walk(
    machine: Machine,
    constants: Constants,
    body: Body,
    runs: list[Run],
    policies: np.ndarray,
    task: Task,
) -> tuple[Trajectory, Outcome]:
    """Let N robots walk: policies [N, 15]; one row per control tick.

    A robot that has fallen or finished is not stepped any more; its rows hold the last
    values, with `alive` False.
    """
    go = np.array([run.go for run in runs])
    noise = np.stack([run.noise for run in runs], axis=1)
    state = tasks.begin(policies)
    target = tasks.pose(policies)
    base = machine.base()
    score = tasks.open_score(base)
    reading = report(constants, body, machine.sense(), noise[0])
    rows = []
    for tick in range(task.ticks):
        if score.alive.any():
            before = score.alive
            base = _keep(before, machine.base(), base)
            new = report(constants, body, machine.sense(), noise[tick])
            reading = _keep(before, new, reading)
            score = tasks.keep_score(task, go, np.asarray(tick), score, base)
            state, wanted = tasks.pilot(task, policies, go, state, reading)
            target = np.where(score.alive[:, None], wanted, target)
        rows.append((target, reading, base, score.alive))
        if score.alive.any():
            machine.advance(target, score.alive)
    return _trajectory(rows, task), tasks.outcome(task, score)


def _keep(alive: np.ndarray, new: Record, old: Record) -> Record:
    """Take the new values of living robots only."""
    fields = (
        np.where(alive[:, None], mine, its) for mine, its in zip(new, old, strict=True)
    )
    return type(new)(*fields)


def _trajectory(rows: list[tuple], task: Task) -> Trajectory:
    command, readings, bases, alive = zip(*rows, strict=True)
    time = np.arange(len(rows)) * task.control_period
    alive = np.stack(alive, axis=1)
    return Trajectory(
        time=np.broadcast_to(time, alive.shape).copy(),
        command=np.stack(command, axis=1),
        reading=Reading(*(np.stack(f, axis=1) for f in zip(*readings, strict=True))),
        base=Base(*(np.stack(f, axis=1) for f in zip(*bases, strict=True))),
        alive=alive,
    )
