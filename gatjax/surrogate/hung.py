"""A stand-in robot that hangs: its torso is held in the air, its joints are free."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from gatjax.motions import Limbs, standing_nao
from gatjax.records import Trajectory
from gatjax.surrogate.start import Floor, Run, first_state

HEIGHT = 1.0  # m, over where it would stand


class Hung(NamedTuple):
    """A robot that hangs: it plays motions and does not walk."""

    name: str
    follow: Callable[[np.ndarray, float, Sequence[int] | np.ndarray], Trajectory]

    def limbs(self) -> Limbs:
        """Return what a motion must know of it: it cannot fall."""
        return standing_nao()._replace(floating=False)

    def play(
        self, targets: np.ndarray, rate_hz: float, seeds: Sequence[int] | np.ndarray
    ) -> Trajectory:
        """Let N robots follow targets [N, T, J] rad; a Trajectory [N, T, ...]."""
        return self.follow(targets, rate_hz, seeds)


def hung_state(angle: np.ndarray, run: Run, floor: Floor) -> tuple:
    """State of a robot that is held over the floor, at rest: see `first_state`."""
    qpos, qvel = first_state(angle, run, floor)
    qpos[2] += HEIGHT
    return qpos, np.zeros_like(qvel)
