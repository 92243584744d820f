"""Searches that do not fit into the device's memory go on in smaller pieces."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax

from gatjax.search import Generation

FULL = ("RESOURCE_EXHAUSTED", "out of memory", "Failed to allocate")
"""How XLA, CUDA and Warp say that there is no memory left."""


def frugal(
    build: Callable[[int], Generation], robots: int, say: Callable[[str], None]
) -> Generation:
    """Return a generation that takes twice as many turns each time memory runs out.

    Args:
        build: turns -> the generation whose robots run in so many turns.
        robots: of a generation; no more turns than these.
        say: shows a line to the user.
    """
    turns, step = 1, build(1)

    def run(state: Any, values: Any, number: Any) -> tuple:
        nonlocal turns, step
        while True:
            try:
                return jax.block_until_ready(step(state, values, number))
            except RuntimeError as error:  # XLA's and Warp's own
                if not any(sign in str(error) for sign in FULL) or turns >= robots:
                    raise
            turns = min(2 * turns, robots)
            say(
                f"out of device memory: {-(-robots // turns)} robots at a time from "
                f"now on, in {turns} turns"
            )
            step = build(turns)

    return run
