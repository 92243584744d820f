"""How well a world predicts logs that nothing was fitted to.

A standing robot starts at its first command on the floor, at rest; the middle of a log
is no start for it, since nobody measured how its base moves. From a fall of any of the
compared robots on, rows count for none of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import jax
import numpy as np
from scipy.special import stdtrit

from gatjax.data import starts
from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import chance
from gatjax.diagnosis.motion import lead_of
from gatjax.records import Played
from gatjax.robot.model import servoed
from gatjax.sim.limbs import floats, moving, put_down
from gatjax.sim.native import Native
from gatjax.sim.replay import replay_many
from gatjax.sim.world import Values, World, stacked, stiffened

UPRIGHT = 0.7  # least upward part of the torso's axis; below, a robot has fallen
SETTLE = 0.5  # s at the first command before a log
BACK, LOOK = 6, 0.06  # samples, at least, and s of the parabola that gives a speed
STRAY, EVEN = 0.25, 0.9  # of a tick that so many of the rows may come off it
BRIEF = 1e-3  # s over which a joint's velocity is taken
APART = 10_000  # blocks between two runs' numbers
BLOCK = 1.0  # s of a log that an interval leaves out together
TINY = 1e-18  # rad^2


class Errors(NamedTuple):
    """Squared errors of one prediction, rad^2: [n, J], and their blocks [n]."""

    squared: np.ndarray
    block: np.ndarray

    def rmse(self) -> np.ndarray:
        """Root mean square [J], rad."""
        return np.sqrt(self.squared.mean(0))


def mean_period(stamps: Sequence[np.ndarray]) -> float:
    """Mean time from row to row of runs, s, gaps apart."""
    steps = np.concatenate([np.diff(each) for each in stamps])
    ticks = np.maximum(np.round(steps / np.median(steps)), 1.0)
    return float(steps.sum() / ticks.sum())


def ticked(run: JointRun, period: float) -> JointRun:
    """What was in force at even ticks of a run; time from 0.

    Commands of a run at another rate, or whose stamps wander, come between ticks: of
    these the mean counts.
    """
    stamps = run.time - run.time[0]
    even = np.arange(int(np.ceil(stamps[-1] / period - 1e-6)) + 1) * period
    held = np.searchsorted(stamps, even + STRAY * period, side="right") - 1
    told, begun = run.command, np.diff(held, prepend=-1) > 0
    run = run.part(held)._replace(time=even)
    near = (np.abs(even - stamps[held]) <= STRAY * period)[begun].sum()
    if near >= EVEN * len(stamps):
        return run
    return run._replace(command=_mean(stamps, told, even, period))


def _mean(
    stamps: np.ndarray, told: np.ndarray, even: np.ndarray, period: float
) -> np.ndarray:
    """Mean over each tick of commands [N, J] that hold from their stamps on."""
    ends = np.append(stamps, even[-1] + 2.0 * period)
    sums = np.cumsum(np.diff(ends)[:, None] * told, axis=0)
    sums = np.concatenate([np.zeros((1, told.shape[1])), sums])
    edges = np.append(even, even[-1] + period)
    grown = np.stack([np.interp(edges, ends, column) for column in sums.T], -1)
    return np.diff(grown, axis=0) / period


def stretched(series: Sequence[np.ndarray], lead: int) -> np.ndarray:
    """Series [T, J] as one array [N, lead + longest T, J], their ends held."""
    longest = max(map(len, series))
    return np.stack(
        [np.pad(s, ((lead, longest - len(s)), (0, 0)), mode="edge") for s in series]
    )


class Replayed(NamedTuple):
    """What a world does with the commands of a run, at its stamps, each [N, J]."""

    angle: np.ndarray  # rad, as encoders report it
    velocity: np.ndarray  # rad/s, of the links
    torque: np.ndarray  # N m, of servos or motors


def whole_log(
    world: World, runs: list[JointRun], values: Sequence[Values] = ()
) -> list[np.ndarray]:
    """Open-loop predictions of the angles [N, J] rad of runs; see `replayed`."""
    return [each.angle for each in replayed(world, runs, values)]


def replayed(
    world: World, runs: list[JointRun], values: Sequence[Values] = ()
) -> list[Replayed]:
    """Open-loop predictions of runs.

    They start at rest, at the first command; pieces of longer runs, and joints that had
    not settled, at the measured angle, which their servos are told before; without
    servos, from the measured angle and speed. A log's clock starts with its first row.
    Where commands may get lost, they are means over draws. Each run has values of its
    own, the world's if none are given. A robot that stood predicts nothing (NaN) from
    its fall on.
    """
    period, follows = world.task.control_period, servoed(world.model)
    rest = max(SETTLE, lead_of(world.model))
    lead = round(rest / period) if follows else 0
    played = [ticked(run, period) for run in runs]
    commands, stiff = stretched([run.command for run in played], lead), None
    own = [replace(world, values=v) for v in values] or [world] * len(runs)
    if any(run.stiffness is not None for run in runs):
        world, own = stiffened(world), [stiffened(each) for each in own]
        stiff = stretched([run.stiff for run in played], lead)
    every = stacked([each.values for each in own])
    for told, run in zip(commands, runs, strict=True):
        there = starts.unsettled(run) | run.within
        told[:lead] = np.where(there, run.angle[0], told[:lead])
    qpos = np.stack([put_down(world.model, told[0]) for told in commands])
    qvel = np.zeros((len(runs), world.model.nv))
    if not follows:
        angles = np.stack([run.angle[0] for run in runs])
        speeds = np.stack([speed(run, slice(back(period)), 0) for run in runs])
        qpos, qvel = started(world, Native(world), angles, speeds)
    drawn = _drawn(world, every, commands, qpos, qvel, stiff, lead)
    series = drawn.reading.angle, drawn.velocity, drawn.torque
    means = [each.mean(0) for each in series]
    out = []
    for k, (run, cut) in enumerate(zip(runs, played, strict=True)):
        part = k, slice(lead, lead + len(cut.time))
        down = np.zeros(len(cut.time), bool)
        if floats(world.model):
            leans = fallen(np.asarray(drawn.up)[:, *part])
            down = np.logical_or.reduce(leans)
        stamps = run.time - run.time[0]
        out.append(Replayed(*(
            np.stack([np.interp(stamps, cut.time, s) for s in series.T], -1)
            for series in (np.where(down[:, None], np.nan, m[part]) for m in means)
        )))  # fmt: skip
    return out


def _drawn(
    world: World, values: Values, commands: np.ndarray, qpos: np.ndarray,
    qvel: np.ndarray, stiffness: np.ndarray | None, lead: int,
) -> Played:  # fmt: skip
    """What `replay_many` gives for runs [B, ...], with every draw: [D, B, ...]."""
    noise = chance.draws(world, commands.shape)
    count = noise.shape[:2]

    def each(rows: np.ndarray) -> np.ndarray:
        drawn = np.broadcast_to(rows, (count[0], *np.shape(rows)))
        return drawn.reshape(-1, *drawn.shape[2:])

    every = jax.tree.map(each, values)
    stiff = None if stiffness is None else each(stiffness)
    draw = noise.reshape(-1, *noise.shape[2:])
    played = replay_many(
        world, every, each(commands), each(qpos), each(qvel), draw, stiff, lead
    )
    return jax.tree.map(lambda a: np.reshape(a, (*count, *np.shape(a)[1:])), played)


def back(period: float) -> int:
    """Rows that a speed is taken over."""
    return max(BACK, round(LOOK / period))


def speed(run: JointRun, rows: slice, at: int) -> np.ndarray:
    """Speed [J] rad/s at a row, of a parabola through some rows."""
    time = run.time[rows] - run.time[at]
    return np.polyfit(time, run.angle[rows], 2)[1]


def started(
    world: World, native: Native, angle: np.ndarray, speed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Physics states [B, nq], [B, nv] in which encoders report angles and speeds."""
    model = world.model
    now = native.behind(world.values, angle)
    later = native.behind(world.values, angle + BRIEF * speed)
    qpos = np.stack([put_down(model, each) for each in now])
    still = np.zeros((len(qpos), model.nv))
    return moving(model, qpos, still, now, (later - now) / BRIEF)


def fallen(up: np.ndarray) -> np.ndarray:
    """Rows [..., T] from the first on at which a robot leans too far, or diverged.

    Args:
        up: [..., T, 3] unit vector against gravity in the torso's axes.
    """
    return np.logical_or.accumulate(~(up[..., 2] > UPRIGHT), axis=-1)


def log_errors(
    runs: list[JointRun], predicted: dict[str, list[np.ndarray]]
) -> dict[str, Errors]:
    """Errors of several predictions at the rows of whole logs that all of them have.

    Where a log starts in motion, or before a joint settled, its first second does not
    count.
    """
    blocks = np.concatenate(
        [
            number * APART + ((run.time - run.time[0]) / BLOCK).astype(int)
            for number, run in enumerate(runs)
        ]
    )
    measured = np.concatenate([run.angle for run in runs])
    squared = {
        name: np.square(measured - np.concatenate(series))
        for name, series in predicted.items()
    }
    kept = ~np.any([np.isnan(each).any(1) for each in squared.values()], axis=0)
    kept &= ~np.concatenate(
        [
            starts.early(run)
            & (run.within or starts.underway(run).any() or starts.unsettled(run).any())
            for run in runs
        ]
    )
    return {name: Errors(each[kept], blocks[kept]) for name, each in squared.items()}


def interval(before: Errors, after: Errors, joint: int | None) -> tuple[float, float]:
    """95 % interval of the gain 1 - after / before.

    Blocks are left out one by one (jackknife, Tukey 1958) of the logarithm of the
    ratio, whose scatter Student's t widens: of few blocks a bootstrap's interval is too
    narrow, and of one it has no width. The halves of a single block stand for blocks,
    and prove no gain: they are not independent.
    """
    pick = slice(None) if joint is None else slice(joint, joint + 1)
    several, rows = np.ptp(before.block) > 0, np.arange(len(before.block))
    blocks = before.block if several else rows >= 0.5 * len(rows)
    names, index = np.unique(blocks, return_inverse=True)
    sums = np.stack(
        [
            np.bincount(index, e.squared[:, pick].mean(1), len(names)) + TINY
            for e in (before, after)
        ]
    )
    rest = sums.sum(1, keepdims=True) - sums if len(names) > 1 else sums
    whole, left = (0.5 * np.log(s[1] / s[0]) for s in (sums.sum(1), rest))
    count = len(names)
    spread = np.sqrt((count - 1) * np.var(left))
    reach = float(stdtrit(max(count - 1, 1), 0.975)) * spread
    low, high = (float(1.0 - np.exp(whole + way * reach)) for way in (1.0, -1.0))
    return low if several else min(low, 0.0), high
