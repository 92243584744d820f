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
import jax.numpy as jnp
import numpy as np

from gatjax.data import starts
from gatjax.data.trajectories import GAP, JointRun
from gatjax.diagnosis import chance
from gatjax.grounding.gat import learn_forward, next_angle
from gatjax.grounding.network import Network
from gatjax.grounding.transitions import HISTORY
from gatjax.records import Played
from gatjax.robot.model import servoed
from gatjax.sim.limbs import floats, moving, put_down
from gatjax.sim.native import Native
from gatjax.sim.replay import replay_many
from gatjax.sim.world import Values, World, stacked, stiffened

UPRIGHT = 0.7  # least upward part of the torso's axis; below, a robot has fallen
SETTLE = 0.5  # s at the first command before a log
HORIZONS = (0.5, 0.1, 0.0)  # s ahead of a measured state; 0: one step
STRIDE = 0.1  # s between two windows
WARM = 0.12  # s of a window that only fills the effects' memories
BRIEF = 1e-3  # s over which a joint's velocity is taken
BACK = 6  # samples of the parabola that gives the velocity at a window's start
APART = 10_000  # blocks between two runs' numbers
BLOCK = 1.0  # s that the bootstrap draws together
DRAWS = 400
PIECE = 2.0  # s of a piece of the fit data, for the learned model's early stopping


class Errors(NamedTuple):
    """Squared errors of one prediction, rad^2: [n, J], and their blocks [n]."""

    squared: np.ndarray
    block: np.ndarray

    def rmse(self) -> np.ndarray:
        """Root mean square [J], rad."""
        return np.sqrt(self.squared.mean(0))


def ticked(run: JointRun, period: float) -> JointRun:
    """What was in force at even ticks of a run; time from 0."""
    stamps = run.time - run.time[0]
    even = np.arange(int(np.ceil(stamps[-1] / period - 1e-6)) + 1) * period
    held = np.searchsorted(stamps, even + 0.25 * period, side="right") - 1
    return run.part(np.maximum(held, 0))._replace(time=even)


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

    They start at rest, at the first command, or pieces of longer runs at the measured
    angle, which their servos are told before; without servos, from the measured angle
    and speed. A log's clock starts with its first row. Where commands may get lost,
    they are means over draws. Each run has values of its own, the world's if none are
    given. A robot that stood predicts nothing (NaN) from its fall on.
    """
    period, follows = world.task.control_period, servoed(world.model)
    lead = round(SETTLE / period) if follows else 0
    played = [ticked(run, period) for run in runs]
    commands, stiff = stretched([run.command for run in played], lead), None
    own = [replace(world, values=v) for v in values] or [world] * len(runs)
    if any(run.stiffness is not None for run in runs):
        world, own = stiffened(world), [stiffened(each) for each in own]
        stiff = stretched([run.stiff for run in played], lead)
    every = stacked([each.values for each in own])
    for told, run in zip(commands, runs, strict=True):
        if run.within:
            told[:lead] = run.angle[0]
    qpos = np.stack([put_down(world.model, told[0]) for told in commands])
    qvel = np.zeros((len(runs), world.model.nv))
    if not follows:
        angles = np.stack([run.angle[0] for run in runs])
        speeds = np.stack([_speed(run, slice(BACK), 0) for run in runs])
        qpos, qvel = _started(world, Native(world), angles, speeds)
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


def fallen(up: np.ndarray) -> np.ndarray:
    """Rows [..., T] from the first on at which a robot leans too far, or diverged.

    Args:
        up: [..., T, 3] unit vector against gravity in the torso's axes.
    """
    return np.logical_or.accumulate(~(up[..., 2] > UPRIGHT), axis=-1)


class Windows(NamedTuple):
    """Pieces of logs, B of them: W rows up to the measured start, T that follow."""

    command: np.ndarray  # [B, W + T, J] rad
    angle: np.ndarray  # [B, W + T, J] rad
    stiffness: np.ndarray  # [B, W + T, J]
    velocity: np.ndarray  # [B, J] rad/s at the start
    block: np.ndarray  # [B]
    number: np.ndarray  # [B] of the run
    start: np.ndarray  # [B] s from the first row of the run to the start
    runs: list[JointRun]


def windows(runs: list[JointRun], period: float) -> Windows | None:
    """Cut runs into windows of the longest horizon after a warm-up, if there are any.

    None of them lacks a row.
    """
    warm, length = round(WARM / period) + BACK, round(0.5 / period)
    stride, rows = max(1, round(STRIDE / period)), []
    for number, run in enumerate(runs):
        for first in range(0, len(run.time) - warm - length, stride):
            part = slice(first, first + warm + length)
            if np.diff(run.time[part]).max() > (1.0 + GAP) * period:
                continue  # rows are missing
            past = slice(first + warm - BACK, first + warm)
            slope = _speed(run, past, first + warm - 1)
            block = number * APART + int(run.time[first] / BLOCK)
            series = run.command[part], run.angle[part], run.stiff[part]
            start = run.time[first + warm - 1] - run.time[0]
            rows.append((*series, slope, block, number, start))
    if not rows:
        return None
    columns = (np.array(column) for column in zip(*rows, strict=True))
    return Windows(*columns, runs=runs)


def _speed(run: JointRun, rows: slice, at: int) -> np.ndarray:
    """Speed [J] rad/s at a row, of a parabola through some rows."""
    time = run.time[rows] - run.time[at]
    return np.polyfit(time, run.angle[rows], 2)[1]


def _started(
    world: World, native: Native, angle: np.ndarray, speed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Physics states [B, nq], [B, nv] in which encoders report angles and speeds."""
    model = world.model
    now = native.behind(world.values, angle)
    later = native.behind(world.values, angle + BRIEF * speed)
    qpos = np.stack([put_down(model, each) for each in now])
    still = np.zeros((len(qpos), model.nv))
    return moving(model, qpos, still, now, (later - now) / BRIEF)


def windowed(world: World, cut: Windows, period: float) -> np.ndarray:
    """Predictions [B, T, J] rad of windows, each from its measured start.

    The joints start where the world's encoders report what was measured, at the time
    at which its clock says that it was.
    """
    warm, rate = round(WARM / period) + BACK, _rate(world)
    # Row t holds the angle when command t comes into force: command warm - 1 acts
    # from the start on.
    commands, stiff = _in_force(cut, rate, period)
    world = world if (stiff == 1.0).all() else stiffened(world)
    native, count = Native(world), world.model.nu
    rows = native.behind(world.values, cut.angle[:, :warm].reshape(-1, count))
    angles = rows.reshape(len(cut.angle), warm, -1)
    speed = cut.velocity / rate
    qpos, qvel = _started(world, native, cut.angle[:, warm - 1], speed)
    drawn = [
        native.replay(world.values, commands, angles[:, :-1], qpos, qvel, stiff, noise)
        for noise in chance.draws(world, commands.shape)
    ]
    return np.mean(drawn, axis=0)[:, : cut.angle.shape[1] - warm]


def _rate(world: World) -> float:
    """True seconds in a second of the log's clock, which is that of all joints."""
    drifts = world.values.log.values() if world.values.log else ()
    return float(np.prod([1.0 - drift[0] for drift in drifts]))


def _in_force(
    cut: Windows, rate: float, period: float
) -> tuple[np.ndarray, np.ndarray]:
    """Commands rad and stiffness [B, rows, J] that led to the angles of windows.

    There are W + T - 1 rows, and more where a second of the log is longer than a true
    one. A start that is stamped t was at rate t, and so is what was in force around it;
    between two rows, it is the mean over a tick.
    """
    if rate == 1.0:
        return cut.command[:, :-1], cut.stiffness[:, :-1]
    warm, length = round(WARM / period) + BACK, cut.command.shape[1]
    more = int(np.ceil(max(0.0, rate - 1.0) * (length - warm)))
    ahead = period * (np.arange(length - 1 + more) - (warm - 1))
    rows = []
    for number, start in zip(cut.number, cut.start, strict=True):
        run = cut.runs[number]
        true, stamps = rate * start + ahead, run.time - run.time[0]
        rows.append([
            np.stack([np.interp(true, stamps, column) for column in series.T], -1)
            for series in (run.command, run.stiff)
        ])  # fmt: skip
    command, stiff = (np.stack(column) for column in zip(*rows, strict=True))
    return command, stiff


def learned_windows(forward: Network, cut: Windows, period: float) -> np.ndarray:
    """The same by a learned forward model."""
    warm = round(WARM / period) + BACK
    return _rolled(forward, cut.angle[:, :warm], cut.command, warm)


def _rolled(
    forward: Network, past: np.ndarray, command: np.ndarray, warm: int
) -> np.ndarray:
    """Roll the learned model over commands [B, T, J] from past angles [B, W, J]."""
    order = np.arange(warm - 1, warm - 2 - HISTORY, -1)

    def one(angles: jnp.ndarray, actions: jnp.ndarray) -> jnp.ndarray:
        def step(history: jnp.ndarray, now: jnp.ndarray) -> tuple:
            following = next_angle(forward, history, now)
            return jnp.concatenate([following[None], history[:-1]]), following

        steps = jnp.arange(warm - 1, actions.shape[0] - 1)
        stack = actions[steps[:, None] - jnp.arange(HISTORY + 1)[None]]
        return jax.lax.scan(step, angles, stack)[1]

    first = jnp.asarray(past[:, order], jnp.float32)
    rolled = jax.jit(jax.vmap(one))(first, jnp.asarray(command, jnp.float32))
    return np.asarray(rolled, np.float64)


def learn(runs: list[JointRun], seed: int) -> Network:
    """The forward model of GAT, trained on pieces of the fit data."""
    return learn_forward(pieces(runs), seed)[0]


def pieces(runs: list[JointRun]) -> list[JointRun]:
    """Runs cut into pieces of about 2 s, of which some can be left out of training."""
    out = []
    for run in runs:
        count = max(2, round((run.time[-1] - run.time[0]) / PIECE))
        parts = np.array_split(np.arange(len(run.time)), count)
        out += [run.part(rows) for rows in parts]
    return out


def learned_log(forward: Network, runs: list[JointRun]) -> list[np.ndarray]:
    """Open-loop predictions [N, J] of whole runs by the learned model."""
    out = []
    for run in runs:
        warm = HISTORY + 1
        rolled = _rolled(forward, run.angle[None, :warm], run.command[None], warm)
        ends = run.angle.min(0) - 10.0, run.angle.max(0) + 10.0
        out.append(np.concatenate([run.angle[:warm], np.clip(rolled[0], *ends)]))
    return out


def log_errors(
    runs: list[JointRun], predicted: dict[str, list[np.ndarray]]
) -> dict[str, Errors]:
    """Errors of several predictions at the rows of whole logs that all of them have.

    Where a log starts in motion, its first second does not count.
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
        [starts.early(run) & (run.within or starts.underway(run).any()) for run in runs]
    )
    return {name: Errors(each[kept], blocks[kept]) for name, each in squared.items()}


def window_errors(
    cut: Windows, predicted: np.ndarray, horizon: float, period: float
) -> Errors:
    """Errors at the end of a horizon."""
    warm = round(WARM / period) + BACK
    row = max(1, round(horizon / period)) - 1
    error = predicted[:, row] - cut.angle[:, warm + row]
    return Errors(np.square(error), cut.block)


def interval(
    before: Errors, after: Errors, joint: int | None, seed: int
) -> tuple[float, float]:
    """95 % interval of the gain 1 - after / before (block bootstrap, Kunsch 1989)."""
    pick = slice(None) if joint is None else slice(joint, joint + 1)
    names, index = np.unique(before.block, return_inverse=True)
    sums = np.stack(
        [
            np.bincount(index, e.squared[:, pick].mean(1), len(names))
            for e in (before, after)
        ]
    )
    counts = np.bincount(index, minlength=len(names))
    draw = np.random.default_rng(seed).integers(0, len(names), (DRAWS, len(names)))
    total = sums[:, draw].sum(-1) / counts[draw].sum(-1)
    gain = 1.0 - np.sqrt(total[1] / np.maximum(total[0], 1e-18))
    return float(np.quantile(gain, 0.025)), float(np.quantile(gain, 0.975))
