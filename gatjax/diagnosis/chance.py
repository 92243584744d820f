"""Draws of what chance decides: which commands get lost on a motion nobody has seen.

The mean over draws is predicted, which has the least expected squared error.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gatjax.sim.world import World

LOSS = "dropped_commands"
DRAWS, SEED = 8, 0


def draws(world: World, shape: Sequence[int]) -> np.ndarray:
    """Unit draws [D, B, T, J] of the command effects, for commands of that shape.

    One of zeros if the world loses no commands. Where all joints lose alike, the first
    one's draws count for all of them (`gatjax.effects.drive.loss`).
    """
    if all(row["cause"] != LOSS for row in world.causes):
        return np.zeros((1, *shape))
    return np.random.default_rng(SEED).normal(size=(DRAWS, *shape))
