"""What every plant gives back, and how long robots settle before the log begins."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from gatjax.surrogate.hidden.robots import Robot
from gatjax.surrogate.hidden.targets import Lane

SETTLE = 1.0  # s, at the first command
AFTER = 0.05  # s, beyond the last row
EVERY = 0.001  # s, of the history
PIECE = 0.25  # s, of targets made at once


class History(NamedTuple):
    """What one robot did, every millisecond from time 0."""

    angle: np.ndarray  # [T, J] rad, at the encoder, without offset
    speed: np.ndarray  # [T, J] rad/s, links
    torque: np.ndarray  # [T, J] N m, of the servos
    lost: np.ndarray  # [T, J] share of gain and torque limit
    body: np.ndarray  # [T, S] gyro, accelerometer, orientation, forces; S = 0 if fixed


Plant = Callable[[Robot, Sequence[Lane]], list[History]]


class Tape:
    """Collects the histories of L robots."""

    def __init__(self, lanes: Sequence[Lane], channels: int, step: float) -> None:
        """Makes room; `channels` are the body's."""
        self.every = round(EVERY / step)
        self.first = round(SETTLE / step)
        longest = max(lane.seconds for lane in lanes) + AFTER
        self.steps = self.first + round(longest / step)
        count = -(-(self.steps - self.first) // self.every)
        shape = (len(lanes), count, len(lanes[0].specimen.numbers["kp"]))
        self.fields = [np.zeros(shape, np.float32) for _ in range(4)]
        self.body = np.zeros((*shape[:2], channels), np.float32)

    def due(self, index: int) -> bool:
        """Whether step `index`, counted from the start of settling, is kept."""
        return index >= self.first and (index - self.first) % self.every == 0

    def keep(self, index: int, fields: Sequence[np.ndarray], body: np.ndarray) -> None:
        """Keeps angle, speed, torque, lost [L, J] and body [L, S]."""
        row = (index - self.first) // self.every
        for store, field in zip(self.fields, fields, strict=True):
            store[:, row] = field
        self.body[:, row] = body

    def histories(self) -> list[History]:
        """One for each robot."""
        rows = zip(*self.fields, self.body, strict=True)
        return [History(*row) for row in rows]
