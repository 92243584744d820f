"""Draws of what chance decides: which commands get lost on a motion nobody has seen.

The mean over draws is predicted, which has the least expected squared error.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gatjax.sim.world import World

LOSS = "dropped_commands"
DRAWS, SEED = 8, 0


def draws(world: World, shape: Sequence[int]) -> list[np.ndarray | None]:
    """Unit draws [B, T, J] of the command effects, for commands of that shape.

    One None if the world loses no commands. A lost message is one to all joints.
    """
    if all(row["cause"] != LOSS for row in world.causes):
        return [None]
    drawn = np.random.default_rng(SEED).normal(size=(DRAWS, *shape[:2], 1))
    return list(np.broadcast_to(drawn, (DRAWS, *shape)))
