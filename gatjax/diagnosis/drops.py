"""Lost commands: which targets of a log never reached the servo.

A target that is lost leaves the one before it in force. To first order the joint then
misses the answer of a linear servo to that difference for one tick; the pattern of
losses that explains a residual best is found by flipping one burst at a time, each at
the price of naming it (minimum description length, Rissanen 1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.signal import savgol_filter

from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis, combined, numbers
from gatjax.diagnosis.joint import STEP, Joint
from gatjax.diagnosis.motion import cells

MEMORY = 0.35  # s that the answer to one tick lasts
BURSTS = (1, 2, 3, 5, 8, 12)  # ticks that are tried together
ODDS = 4.5  # nats that naming one lost tick costs
TOLD = 0.75  # quantile of the changes of a command beyond which a loss is seen
ROUNDS = 4  # of decoding and fitting
SWEEPS = 4


class Losses(NamedTuple):
    """Decoded losses of a joint, and the joint that suffers them."""

    lost: list[np.ndarray]  # per run [N] bool
    joint: Joint
    fit: Fit
    price: float  # nats of naming the lost ticks


def statistics(
    lost: Sequence[np.ndarray], commands: Sequence[np.ndarray]
) -> dict[str, float]:
    """Probability of a loss, and mean burst, of decoded masks [N] and commands [N].

    The share of losses is that among the changes that show best, the largest quarter: a
    loss that changes nothing is not decoded.
    """
    changes = [np.abs(np.diff(command)) for command in commands]
    moving = np.concatenate([change[change > 1e-6] for change in changes])
    least = np.quantile(moving, TOLD) if len(moving) else np.inf
    told = [change > least for change in changes]
    hit = sum(int(mask[1:][t].sum()) for mask, t in zip(lost, told, strict=True))
    count = sum(int(mask.sum()) for mask in lost)
    bursts = sum(int(np.sum(np.diff(mask.astype(int)) > 0)) for mask in lost)
    return {
        "probability": hit / max(sum(int(t.sum()) for t in told), 1),
        "burst": max(count / max(bursts, 1), 1.0),
    }


def held(command: np.ndarray, lost: np.ndarray) -> np.ndarray:
    """Targets in force [N] when some of them are lost."""
    index = np.where(lost, 0, np.arange(len(command)))
    return command[np.maximum.accumulate(index)]


def answer(joint: Joint, x: np.ndarray, period: float) -> np.ndarray:
    """What one tick of 1 rad does to a linear servo, at the next samples, rad."""
    drive = joint.nominal | numbers(joint, None, x[:COUNT])
    inertia = float(jnp.mean(joint.grid.inertia)) + drive["armature"]
    resist = drive["kv"] + drive["damping"]
    h, q, v, out = STEP, 0.0, 0.0, []
    for k in range(round(MEMORY / h)):
        pulse = drive["delay"] <= k * h < drive["delay"] + period
        force = drive["kp"] * (pulse - q)
        v = (inertia * v + h * force) / (inertia + h * (resist + h * drive["kp"]))
        q += h * v
        out.append(q)
    ticks = np.arange(0.0, MEMORY, period)
    return np.interp(ticks, np.arange(len(out)) * h, out)


def decode(
    command: np.ndarray, residual: np.ndarray, lost: np.ndarray, kernel: np.ndarray,
    scale: float,
) -> np.ndarray:  # fmt: skip
    """Flip bursts of losses [N] as long as the residual [N] gets smaller."""
    before = held(command, lost)
    rest, lost = residual.copy(), lost.copy()
    count = len(command)
    for _ in range(SWEEPS):
        changed = False
        for first in range(1, count):
            for burst in BURSTS:
                trial = lost.copy()
                trial[first : first + burst] = ~lost[first]
                after = held(command, trial)
                last = min(count, first + burst + 40)
                delta = after[first:last] - before[first:last]
                if not np.any(np.abs(delta) > 1e-6):
                    continue
                part = np.convolve(delta, kernel)[: count - first]
                old = rest[first : first + len(part)]
                gain = old @ old - (old - part) @ (old - part)
                price = 2.0 * ODDS * (int(trial.sum()) - int(lost.sum()))
                if gain / scale**2 > price + 1.0:
                    rest[first : first + len(part)] -= part
                    lost, before, changed = trial, after, True
        if not changed:
            break
    return lost


def find(joint: Joint, base: Fit, commands: list[np.ndarray]) -> Losses:
    """Decode the losses of a joint beside what is known about it.

    Args:
        joint: with the full commands.
        base: what is known.
        commands: of each run [N], rad.
    """
    tries = [
        _refined(joint, base, commands, first)
        for first in (none_lost(commands), guessed(joint, base, commands))
    ]
    return min(
        tries, key=lambda losses: losses.price - fits.evidence(joint, losses.fit)
    )


def none_lost(commands: list[np.ndarray]) -> list[np.ndarray]:
    """All commands arrive."""
    return [np.zeros(len(command), bool) for command in commands]


def guessed(joint: Joint, base: Fit, commands: list[np.ndarray]) -> list[np.ndarray]:
    """Losses read from the target that the motion implies, tick by tick.

    The target is what a linear servo needs for the measured motion; at each tick the
    nearer of the new command and the one in force is taken.
    """
    drive = joint.nominal | numbers(joint, None, base.x[:COUNT])
    inertia = float(jnp.mean(joint.grid.inertia)) + drive["armature"]
    resist = drive["kv"] + drive["damping"]
    out = []
    for run, command in enumerate(commands):
        rows = len(command)
        time, angle = joint.time[run, :rows], joint.measured[run, :rows]
        speed = np.gradient(np.asarray(savgol_filter(angle, 5, 2)), time)
        rest = np.interp(
            time, (np.arange(joint.grid.rest.shape[0]) - joint.lead) * STEP,
            np.asarray(joint.grid.rest)[:, run],
        )  # fmt: skip
        implied = (
            angle
            + (inertia * np.gradient(speed, time) + resist * speed + rest) / drive["kp"]
        )
        lost, force = np.zeros(rows, bool), command[0]
        for k in range(rows - 1):
            now = implied[min(k + 1, rows - 1)]
            lost[k] = abs(now - force) < abs(now - command[k]) and k > 0
            force = force if lost[k] else command[k]
        out.append(lost)
    return out


def _refined(
    joint: Joint, base: Fit, commands: list[np.ndarray], lost: list[np.ndarray]
) -> Losses:
    """Decode and fit in turns from a first pattern of losses."""
    lost = list(lost)
    owner = combined(base.hypothesis, LOST)
    now = with_commands(joint, commands, lost)
    fit = fits.improve(now, fits.start(now, [(owner, base.x)]), 3)[0]
    for _ in range(ROUNDS):
        start = 0
        for run, command in enumerate(commands):
            rows = len(command)
            period = float(np.median(np.diff(joint.time[run, :rows])))
            residual = fit.residual[start : start + rows]
            start += rows
            kernel = answer(joint, fit.x, period)
            lost[run] = decode(command, residual, lost[run], kernel, fits.spread(joint))
        now = with_commands(joint, commands, lost)
        fit = fits.improve(now, fits.start(now, [(owner, fit.x)]), 4)[0]
    count = sum(int(mask.sum()) for mask in lost)
    period = float(np.median(np.diff(joint.time[0, : len(commands[0])])))
    return Losses(lost, now, fit, ODDS * count * period / fits.CORRELATED)


def with_commands(
    joint: Joint, commands: list[np.ndarray], lost: list[np.ndarray]
) -> Joint:
    """The joint as it moves when some of its commands are lost."""
    steps = joint.grid.target.shape[0]
    grid = (np.arange(steps) - joint.lead) * STEP
    series = [
        cells(joint.time[run, : len(c)], held(c, mask)[:, None], grid)[:, 0]
        for run, (c, mask) in enumerate(zip(commands, lost, strict=True))
    ]
    target = jnp.asarray(np.stack(series, 1), jnp.float32)
    return joint._replace(grid=joint.grid._replace(target=target))


LOST = Hypothesis(
    "dropped_commands", "", lambda drive, joint, x: None, (), (), (), (),
    lambda joint, x: {},
)  # fmt: skip
"""The losses are in the joint's commands: no coordinates of their own."""
