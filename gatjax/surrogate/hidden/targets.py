"""What becomes of the commands on their way to the servo: loss, delay, steps, lag."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from gatjax.surrogate.hidden.numbers import Numbers, Specimen

BURST = 3.0  # rows, mean length of a burst of lost targets


class Log(NamedTuple):
    """The commands of one trajectory."""

    times: np.ndarray  # [K] s, when a command is sent, from 0
    commands: np.ndarray  # [K, J] rad
    noise_seed: tuple[int, ...]  # decides which targets are lost, and the noise


class Lane(NamedTuple):
    """One robot with one trajectory."""

    specimen: Specimen
    log: Log

    @property
    def seconds(self) -> float:
        """How long the trajectory takes."""
        return float(self.log.times[-1])


def lose(log: Log, share: np.ndarray) -> np.ndarray:
    """The commands [K, J] after losses in bursts; the last one is held.

    Args:
        log: what is sent.
        share: [J] of the rows that are lost.
    """
    commands = log.commands.copy()
    for joint in np.flatnonzero(share):
        rng = np.random.default_rng([*log.noise_seed, 7, int(joint)])
        draws, end = rng.uniform(size=len(commands)), 1.0 / BURST
        begin = min(end * share[joint] / (1.0 - share[joint]), 1.0)
        lost = False
        for row in range(1, len(commands)):
            lost = bool(draws[row] < (1.0 - end if lost else begin))
            if lost:
                commands[row, joint] = commands[row - 1, joint]
    return commands


class Targets:
    """The targets of L robots, made in pieces."""

    def __init__(self, lanes: Sequence[Lane], numbers: Numbers, step: float) -> None:
        """Prepares the paths; `numbers` are stacked [L, ...]."""
        self.step, self.numbers = step, numbers
        self.times = [lane.log.times for lane in lanes]
        self.rows = [
            lose(lane.log, share)
            for lane, share in zip(lanes, numbers["lost"], strict=True)
        ]
        for rows, quantum in zip(self.rows, numbers["quantum"], strict=True):
            for joint in np.flatnonzero(quantum):
                grid = quantum[joint]
                rows[:, joint] = np.rint(rows[:, joint] / grid) * grid
        self.last = np.stack([rows[0] for rows in self.rows])  # [L, J], after the lag
        self.slow = np.argwhere(numbers["lag"] > 0.0)
        self.limited = np.isfinite(numbers["target_speed"])
        self.held = self.last.copy()

    def piece(self, first: int, count: int) -> np.ndarray:
        """The targets [count, L, J] from step `first` on, rad."""
        moments = self.step * (first + np.arange(count))
        delays = self.numbers["delay"]
        out = np.empty((count, *self.last.shape))
        for lane, (times, rows) in enumerate(zip(self.times, self.rows, strict=True)):
            for delay in np.unique(delays[lane]):
                row = np.searchsorted(times, moments - delay + 1e-9, side="right") - 1
                joints = np.flatnonzero(delays[lane] == delay)
                out[:, lane, joints] = rows[np.maximum(row, 0)][:, joints]
        for lane, joint in self.slow:
            keep = np.exp(-self.step / self.numbers["lag"][lane, joint])
            path, state = out[:, lane, joint], self.last[lane, joint]
            filtered, _ = lfilter([1.0 - keep], [1.0, -keep], path, zi=[keep * state])
            out[:, lane, joint] = filtered
            self.last[lane, joint] = filtered[-1]
        if self.limited.any():
            self._limit(out)
        return out

    def _limit(self, out: np.ndarray) -> None:
        """The speed limit on targets, in place."""
        most = self.step * self.numbers["target_speed"][self.limited]
        held = self.held[self.limited]
        for moment in out:
            held = held + np.clip(moment[self.limited] - held, -most, most)
            moment[self.limited] = held
        self.held[self.limited] = held
