"""How every stand-in robot walks or plays a motion, and what its sensors report."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np

from gatjax import task as tasks
from gatjax.records import Base, Outcome, Reading, Trajectory
from gatjax.surrogate.e1 import Body, Constants
from gatjax.surrogate.servo import encode
from gatjax.surrogate.start import Floor, Run
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


Flock = Callable[[Body, Floor, list[Run], np.ndarray, Task], Machine]
"""Puts N robots of a body down on a floor, with joint angles [N, J] rad."""


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

    def answer(state: tuple, tick: int, base: Base, reading: Reading) -> tuple:
        pilot, score = state
        score = tasks.keep_score(task, go, np.asarray(tick), score, base)
        pilot, wanted = tasks.pilot(task, policies, go, pilot, reading)
        return (pilot, score), wanted, score.alive

    first = tasks.begin(policies), tasks.open_score(machine.base())
    steered = Steered(first, tasks.pose(policies), answer)
    (_, score), rows = _steer(machine, constants, body, runs, steered, task.ticks)
    return _trajectory(rows, task.control_period), tasks.outcome(task, score)


def play(
    machine: Machine,
    constants: Constants,
    body: Body,
    runs: list[Run],
    targets: np.ndarray,
    task: Task,
) -> Trajectory:
    """Let N robots follow targets [N, T, J] rad, one row per control tick.

    They hold the first target for `task.settle` before the first row. A robot that has
    fallen is not stepped any more, as in `walk`.
    """
    before = round(task.settle / task.control_period)

    def answer(alive: np.ndarray, tick: int, base: Base, reading: Reading) -> tuple:
        del reading
        alive = alive & standing(base)
        return alive, targets[:, max(tick - before, 0)], alive

    steered = Steered(np.ones(len(runs), bool), targets[:, 0], answer)
    ticks = before + targets.shape[1]
    _, rows = _steer(machine, constants, body, runs, steered, ticks)
    return _trajectory(rows[before:], task.control_period)


def standing(base: Base) -> np.ndarray:
    """Return which robots [N] neither fell nor diverged."""
    finite = np.isfinite(base.position).all(-1) & np.isfinite(base.quaternion).all(-1)
    return finite & ~tasks.fallen(base)


class Steered(NamedTuple):
    """Who moves N robots."""

    state: Any  # what `answer` remembers, at the first tick
    target: np.ndarray  # [N, J] rad, before the first tick
    answer: Callable[[Any, int, Base, Reading], tuple]
    # (state, tick, base, reading) -> state, targets [N, J] rad, alive [N]


def _steer(
    machine: Machine,
    constants: Constants,
    body: Body,
    runs: list[Run],
    steered: Steered,
    ticks: int,
) -> tuple[Any, list[tuple]]:
    """Close the loop for some ticks; return the last state and the rows."""
    noise = np.stack([run.noise for run in runs], axis=1)
    state, target, answer = steered
    base, alive = machine.base(), np.ones(len(runs), bool)
    reading = report(constants, body, machine.sense(), noise[0])
    rows = []
    for tick in range(ticks):
        if alive.any():
            base = _keep(alive, machine.base(), base)
            new = report(constants, body, machine.sense(), noise[tick])
            reading = _keep(alive, new, reading)
            state, wanted, alive = answer(state, tick, base, reading)
            target = np.where(alive[:, None], wanted, target)
        rows.append((target, reading, base, alive))
        if alive.any():
            machine.advance(target, alive)
    return state, rows


def _keep(alive: np.ndarray, new: Record, old: Record) -> Record:
    """Take the new values of living robots only."""
    fields = (
        np.where(alive[:, None], mine, its) for mine, its in zip(new, old, strict=True)
    )
    return type(new)(*fields)


def _trajectory(rows: list[tuple], period: float) -> Trajectory:
    command, readings, bases, alive = zip(*rows, strict=True)
    time = np.arange(len(rows)) * period
    alive = np.stack(alive, axis=1)
    return Trajectory(
        time=np.broadcast_to(time, alive.shape).copy(),
        command=np.stack(command, axis=1),
        reading=Reading(*(np.stack(f, axis=1) for f in zip(*readings, strict=True))),
        base=Base(*(np.stack(f, axis=1) for f in zip(*bases, strict=True))),
        alive=alive,
    )
