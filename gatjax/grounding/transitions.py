"""From recorded runs to the transitions that grounders learn from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gatjax.data.trajectories import JointRun

Array = Any

HISTORY = 4  # past positions and actions beside the present ones (paper, GAT section)


class Transitions(NamedTuple):
    """Windows of S transitions; newest entry first on the history axis."""

    angle: Array  # [S, 1 + HISTORY, K] rad: x_t .. x_t-4
    action: Array  # [S, 1 + HISTORY, K] rad: a_t .. a_t-4
    following: Array  # [S, K] rad: x_t+1
    run: Array  # [S] int, index of the run


def windows(samples: Array) -> Array:
    """Windows [S, 1 + HISTORY, ...] of a run's samples [T, ...], newest entry first.

    One for each transition: the last sample has no following one.
    """
    steps = np.arange(HISTORY, len(samples) - 1)
    return samples[steps[:, None] - np.arange(HISTORY + 1)]


def transitions(runs: Sequence[JointRun]) -> Transitions:
    """Cut runs into transitions; a run shorter than the history gives none."""
    angle, action, following, index = [], [], [], []
    for number, run in enumerate(runs):
        if len(run.angle) < HISTORY + 2:
            continue
        angle.append(windows(run.angle))
        action.append(windows(run.command))
        following.append(run.angle[HISTORY + 1 :])
        index.append(np.full(len(following[-1]), number))
    if not angle:
        raise ValueError(
            f"no run is longer than {HISTORY + 1} samples; collect longer trajectories"
        )
    return Transitions(*map(np.concatenate, (angle, action, following, index)))
