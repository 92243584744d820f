"""Pushes at the feet that the nominal simulation misses, seen by the other joints.

Two feet on the ground close a chain, and hardly anything resists a twist of it: a sole
that chatters or creeps moves all joints of both legs. What each joint feels of it is
taken from what the others did, so that nothing of a joint's own misfit is explained
away by its own reading.
"""

from __future__ import annotations

import numpy as np

from gatjax.diagnosis.floor.reaction import Answer

FORCE, MOMENT = 2.0, 0.1  # N and N m, of pushes that nobody is surprised of


ROUNDS = 2  # of weighing down joints that tell something else
ODD = 6.0  # times their variance: only then


def felt(answers: list[Answer], left: np.ndarray, scatter: np.ndarray) -> np.ndarray:
    """Load that each joint feels of the pushes that all other joints tell of.

    Args:
        answers: of the body at m moments.
        left: [m, J] rad, measured minus simulated angles.
        scatter: [J, J] rad^2, covariance of `left` within the tolerances, about its
            mean over time.

    Returns:
        [m, J] N m, to be added to `rest`.
    """
    left = left - left.mean(0)
    size = np.tile([FORCE] * 3 + [MOMENT] * 3, answers[0].pushes.shape[1] // 6)
    loads = np.stack([one.share @ (one.pushes * size) for one in answers])
    moved = loads * np.stack([one.gives for one in answers])[..., None]
    found = _told(moved, left, scatter)
    for _ in range(ROUNDS):
        odd = np.square(left - np.einsum("mjw,mjw->mj", moved, found)).mean(0)
        more = np.diag(np.maximum(0.0, odd - ODD * np.diag(scatter)))
        found = _told(moved, left, scatter + more)
    return -np.einsum("mjw,mjw->mj", loads, found)


def _told(moved: np.ndarray, left: np.ndarray, scatter: np.ndarray) -> np.ndarray:
    """Pushes [m, J, W] in units of their size that all joints but j tell of.

    Args:
        moved: [m, J, W] rad, by a unit of each push.
        left: [m, J] rad.
        scatter: [J, J] rad^2
    """
    count, unit = left.shape[1], np.eye(moved.shape[2])
    out = np.empty_like(moved)
    for joint in range(count):
        others = np.arange(count) != joint
        precise = np.linalg.inv(scatter[np.ix_(others, others)])
        weight = np.swapaxes(moved[:, others], 1, 2) @ precise
        normal = weight @ moved[:, others] + unit
        right = weight @ left[:, others, None]
        out[:, joint] = np.linalg.solve(normal, right)[..., 0]
    return out
