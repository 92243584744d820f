"""Measured and simulated logs of a standing robot as one vector, and its scatter.

All channels are averaged over CORRELATED seconds, after which misfits are taken as
independent. Tolerances move the vector along the directions of the ensemble; what they
leave is noise of unknown size, channel by channel, as in `gatjax.diagnosis.fit`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis.fit import FLOOR
from gatjax.diagnosis.floor.channels import Channels, simulated
from gatjax.diagnosis.floor.played import Rows
from gatjax.diagnosis.floor.standing import Standing
from gatjax.diagnosis.tolerances import CORRELATED
from gatjax.robot.model import joint_names

BIASES = {"gyro": 0.005, "accelerometer": 0.05, "orientation": 0.0017, "force": 0.6}
"""rad/s, m/s^2, rad, N: constant errors of any inertial unit, and of any stand."""
TIME = 0.001  # s, that tolerances of damping and transport are worth
CREEP = 0.01  # rad/s, of a robot that turns on its soles by itself
PIECES = 6  # of the logs, each of which is left out once
CALM = 0.5  # of the noise variance: no fit is better
ROUNDS = 4  # of finding the size of the noise


class Observed(NamedTuple):
    """What was measured, in C channels and B bins, and how it may scatter."""

    names: tuple[str, ...]  # C
    measured: np.ndarray  # [C, B]
    scatter: np.ndarray  # [C, B, D] per standard deviation of a tolerance
    squares: np.ndarray  # [C, D, D] of the scatter, summed over bins
    noise: np.ndarray  # [C] of a bin's mean, and of what tolerances leave


class Weighed(NamedTuple):
    """How well a prediction meets what was measured."""

    evidence: float  # nats
    level: np.ndarray  # [C] misfit in units of the noise
    rest: np.ndarray  # [C, B] measured minus predicted, tolerances still in it
    left: np.ndarray  # [C, B] what tolerances leave of it, in units of the noise
    spare: float  # squared deviations of the tolerances


def binned(run: JointRun, series: np.ndarray) -> np.ndarray:
    """Means [..., b] of series [..., N] over bins of CORRELATED seconds with rows."""
    stamps = run.time - run.time[0]
    edges = np.arange(0.0, stamps[-1], CORRELATED)
    first = np.unique(np.searchsorted(stamps, edges))  # a gap has no bins
    total = np.add.reduceat(series, first, axis=-1)
    return total / np.diff(np.append(first, len(stamps)))


def vector(
    standing: Standing, names: tuple[str, ...], rows: list[Rows],
    zero: np.ndarray | float = 0.0,
) -> np.ndarray:  # fmt: skip
    """Simulated channels [S, C, B] of rows of all runs; zero [S, J] is read too."""
    parts = []
    for run, row in zip(standing.runs, rows, strict=True):
        stamps = run.time - run.time[0]
        angle = row.at(stamps, row.angle) + np.broadcast_to(
            np.asarray(zero)[..., None, :] if np.ndim(zero) else 0.0,
            (len(row.angle), 1, row.angle.shape[-1]),
        )
        found = simulated(standing.model, row, stamps)
        joints = dict(zip(joint_names(standing.model), np.moveaxis(angle, -1, 0),
                          strict=True))  # fmt: skip
        parts.append(binned(run, _stack(joints | found, names)))
    return np.concatenate(parts, -1)


def _stack(channels: Channels, names: tuple[str, ...]) -> np.ndarray:
    """Channels [..., C, N]; where the robot headed at first is nobody's business."""
    series = [channels[name] for name in names]
    if "orientation.yaw" in names:
        k = names.index("orientation.yaw")
        turned = np.unwrap(series[k], axis=-1)
        series[k] = turned - turned.mean(-1, keepdims=True)
    return np.stack(series, -2)


def observe(standing: Standing) -> Observed:
    """Put logs and ensemble into vectors.

    Joints of limbs that touch nothing are left out: each shows by itself what is wrong
    with it, and says little of the rest.
    """
    joints = joint_names(standing.model)
    bearing = [name for k, name in enumerate(joints) if k not in standing.free]
    first = standing.ensembles[0].rows[0]
    known = simulated(standing.model, first, standing.runs[0].time[:2] * 0.0)
    shared = [
        name for name in known
        if all(name in logged and np.ptp(logged[name]) for logged in standing.channels)
    ]  # fmt: skip
    names = (*bearing, *shared)
    measured, noises = [], []
    for run, logged in zip(standing.runs, standing.channels, strict=True):
        angle = dict(zip(joints, run.angle.T, strict=True))
        series = _stack(angle | logged, names)
        measured.append(binned(run, series))
        rough = np.diff(series, 3, axis=-1) / np.sqrt(20.0)
        count = series.shape[-1] / measured[-1].shape[-1]
        noises.append(np.mean(np.square(rough), -1) / count)
    parts = []
    for one in standing.ensembles:
        zero = np.stack([robot.zero for robot in one.robots])
        seen = vector(standing, names, one.rows, zero)
        parts.append(seen[1:] - seen[0])
    drawn = np.concatenate(parts)
    scatter = np.moveaxis(drawn, 0, -1) / np.sqrt(len(drawn))
    reading = _heard(np.mean(noises, 0), len(bearing))
    missed = _missed(drawn, reading)
    own = _own(standing, names)
    parts = [scatter, _biases(names, scatter.shape[1]), _turning(standing, names), own]
    whole = np.concatenate(parts, -1)
    squares = np.swapaxes(whole, 1, 2) @ whole
    noise = np.sqrt(reading + missed)
    return Observed(names, np.concatenate(measured, -1), whole, squares, noise)


def _heard(reading: np.ndarray, joints: int) -> np.ndarray:
    """Mean squares [C] of noise, where the first are those of joints.

    A joint that never moved by a step of its encoder shows none; it has that of the
    quietest joint that did.
    """
    own = reading[:joints]
    floor = own[own > 0.0].min(initial=own.max())
    return np.concatenate([np.maximum(own, floor), reading[joints:]])


def _biases(names: tuple[str, ...], bins: int) -> np.ndarray:
    """Constant errors of inertial sensors [C, B, K], one standard deviation each."""
    chosen = [
        (k, BIASES[name.partition(".")[0]])
        for k, name in enumerate(names) if name.partition(".")[0] in BIASES
    ]  # fmt: skip
    out = np.zeros((len(names), bins, len(chosen)))
    for column, (k, size) in enumerate(chosen):
        out[k, :, column] = size
    return out


def _turning(standing: Standing, names: tuple[str, ...]) -> np.ndarray:
    """A slow turn of the robot on creeping soles [C, B, R], of its own in each run."""
    parts = [binned(run, run.time - run.time.mean()) for run in standing.runs]
    out = np.zeros((len(names), sum(map(len, parts)), len(parts)))
    first = 0
    for number, time in enumerate(parts):
        bins = slice(first, first + len(time))
        first += len(time)
        for name, series in (("orientation.yaw", time), ("gyro.z", 1.0)):
            if name in names:
                out[names.index(name), bins, number] = CREEP * series
    return out


def _own(standing: Standing, names: tuple[str, ...]) -> np.ndarray:
    """What tolerances of a joint do to itself alone [C, B, 3 K], to first order.

    The zero of its encoder; its gain, as a share of the error it follows with; its
    damping and delay, as a time.
    """
    joints = joint_names(standing.model)
    chosen = [joints.index(name) for name in names if name in joints]
    parts, allowed = [], standing.allowed
    for run, row in zip(standing.runs, standing.ensembles[0].rows, strict=True):
        stamps, first = run.time - run.time[0], row.angle[:1]
        rows = np.concatenate([first, row.command[None] - first, row.velocity[:1]])
        seen = row.at(stamps, rows)[..., chosen]
        series = np.stack(
            [allowed.zero + 0.0 * seen[0], allowed.kp * seen[1], TIME * seen[2]], -1
        )
        parts.append(binned(run, np.moveaxis(series, 0, -1)))
    whole = np.concatenate(parts, -1)  # [K, 3, B]
    out = np.zeros((len(names), whole.shape[-1], len(chosen), 3))
    index = np.arange(len(chosen))
    out[index, :, index] = np.swapaxes(whole, 1, 2)
    return out.reshape(len(names), whole.shape[-1], -1)


def _missed(drawn: np.ndarray, reading: np.ndarray) -> np.ndarray:
    """Mean square [C] of what all other draws do not explain of one."""
    count = len(drawn)
    flat = (drawn / np.sqrt(reading)[:, None]).reshape(count, -1)
    inner = flat @ flat.T
    mix = np.empty((count, count))
    for k in range(count):
        others = np.arange(count) != k
        normal = inner[np.ix_(others, others)] + count * np.eye(count - 1)
        mix[k] = 0.0
        mix[k, others] = np.linalg.solve(normal, inner[others, k])
    left = drawn - np.einsum("kd,dcb->kcb", mix, drawn)
    return np.square(left).mean((0, 2))


def widened(seen: Observed, columns: np.ndarray) -> Observed:
    """The same with more tolerances, columns [C, B, K]."""
    scatter = np.concatenate([seen.scatter, columns], -1)
    return seen._replace(scatter=scatter, squares=np.swapaxes(scatter, 1, 2) @ scatter)


def weighed(seen: Observed, predicted: np.ndarray) -> Weighed:
    """Evidence of a prediction [C, B]; see `weighed_rest`."""
    return weighed_rest(seen, seen.measured - predicted)


def weighed_rest(seen: Observed, rest: np.ndarray) -> Weighed:
    """Evidence of measured minus predicted [C, B], tolerances adjusted.

    The size of each channel's noise is found along with the tolerances, so that one
    channel that is wrong by itself does not bend the others. The evidence is that of
    noise of unknown covariance: a torso that wobbles moves all channels, but counts
    once. A share CALM of the nominal noise is always in it.
    """
    count, bins = rest.shape
    pulls = (rest[:, None] @ seen.scatter)[:, 0]
    square = np.square(rest).sum(-1)
    level, spare = np.ones(count), 0.0
    for _ in range(ROUNDS):
        weight = 1.0 / np.square(seen.noise * level)
        normal = np.tensordot(weight, seen.squares, 1) + np.eye(pulls.shape[1])
        used = np.linalg.solve(normal, weight @ pulls)
        left = square - 2.0 * pulls @ used + seen.squares @ used @ used
        level = np.sqrt(np.maximum(left, 0.0) / bins) / seen.noise
        level, spare = np.maximum(level, FLOOR), float(used @ used)
    flat = seen.scatter.reshape(count * bins, -1)
    apart = (rest - (flat @ used).reshape(rest.shape)) / seen.noise[:, None]
    return Weighed(_calm(apart) - 0.5 * spare, level, rest, apart, spare)


def _calm(left: np.ndarray) -> float:
    """Evidence of misfits [C, B], noise of unknown covariance."""
    count, bins = left.shape
    spread = left @ left.T / bins + CALM * np.eye(count)
    return -0.5 * bins * float(np.linalg.slogdet(spread)[1])


def gained(known: Weighed, best: Weighed) -> float:
    """Nats of a prediction over another one, whichever piece of the log is left out.

    A foot that tips over its edge at one moment, but in the simulation does not, looks
    like a worn sole for that moment. A cause is there all the time.
    """
    gains = []
    for piece in np.array_split(np.arange(known.left.shape[1]), PIECES):
        both = (np.delete(one.left, piece, 1) for one in (best, known))
        new, old = (_calm(left) for left in both)
        gains.append(new - old)
    return min(gains) - 0.5 * (best.spare - known.spare)
