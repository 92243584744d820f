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
ODDS = 4.5  # nats at most that naming one lost tick costs
TOLD = 0.75  # quantile of the changes of a command beyond which a loss is seen
ROUNDS = 4  # of decoding and fitting
SWEEPS = 4
OLDEST, GUESS = 25, 0.2  # ticks that a target stays at most; share lost at first


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


def odds(lost: Sequence[np.ndarray]) -> float:
    """Nats that one more lost tick costs beside masks [N]: rare losses cost more."""
    share = (sum(m.sum() for m in lost) + 1.0) / (sum(m.size for m in lost) + 2.0)
    return float(min(np.log((1.0 - share) / share), ODDS))


def length(lost: Sequence[np.ndarray]) -> float:
    """Nats that it takes to write masks [N] down, losses being independent."""
    share = (sum(m.sum() for m in lost) + 1.0) / (sum(m.size for m in lost) + 2.0)
    count = sum(m.size for m in lost)
    return float(
        -count * (share * np.log(share) + (1.0 - share) * np.log(1.0 - share))
    )


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
    scale: float, odd: float = ODDS,
) -> np.ndarray:  # fmt: skip
    """Flip bursts of losses [N] as long as the residual [N] gets smaller.

    A residual of `scale` is one standard deviation; a lost tick costs `odd` nats.
    """
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
                price = 2.0 * odd * (int(trial.sum()) - int(lost.sum()))
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

    The target is what a linear servo needs for the measured motion.
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
        out.append(likeliest(command, implied))
    return out


def likeliest(command: np.ndarray, implied: np.ndarray) -> np.ndarray:
    """Losses [N] that explain best which target [N] was in force (Viterbi 1967).

    States are the ages of the target in force, up to `OLDEST` ticks; what is implied
    is noisy, as its second differences tell, and lags the command by a tick.
    """
    rows, ages = len(command), np.arange(OLDEST + 1)
    seen = np.append(implied[1:], implied[-1])
    noise = 1.48 * np.median(np.abs(np.diff(implied, 2))) / np.sqrt(6.0) + 1e-9
    past = command[np.maximum(np.arange(rows)[:, None] - ages, 0)]
    misfit = 0.5 * np.square((seen[:, None] - past) / noise)
    came = np.zeros((rows, OLDEST + 1), int)
    cost = np.where(ages == 0, misfit[0], np.inf)
    arrived, missed = -np.log(1.0 - GUESS), -np.log(GUESS)
    for k in range(1, rows):
        came[k, 0], came[k, 1:] = int(np.argmin(cost)), ages[:-1]
        cost = np.append(cost.min() + arrived, cost[:-1] + missed) + misfit[k]
    age = np.empty(rows, int)
    age[-1] = int(np.argmin(cost))
    for k in range(rows - 1, 0, -1):
        age[k - 1] = came[k, age[k]]
    return age > 0


def _refined(
    joint: Joint, base: Fit, commands: list[np.ndarray], lost: list[np.ndarray]
) -> Losses:
    """Decode and fit in turns from a first pattern of losses."""
    lost = list(lost)
    owner = combined(base.hypothesis, LOST)
    now = with_commands(joint, commands, lost)
    fit = fits.improve(now, fits.start(now, [(owner, base.x)]), 3)[0]
    for _ in range(ROUNDS):
        start, odd = 0, odds(lost)
        for run, command in enumerate(commands):
            rows = len(command)
            period = float(np.median(np.diff(joint.time[run, :rows])))
            residual = fit.residual[start : start + rows]
            start += rows
            kernel = answer(joint, fit.x, period)
            lost[run] = decode(
                command, residual, lost[run], kernel, fits.LEFT * joint.noise, odd
            )
        now = with_commands(joint, commands, lost)
        fit = fits.improve(now, fits.start(now, [(owner, fit.x)]), 4)[0]
    period = float(np.median(np.diff(joint.time[0, : len(commands[0])])))
    return Losses(lost, now, fit, length(lost) * period / fits.CORRELATED)


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
