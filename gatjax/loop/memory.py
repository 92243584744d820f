"""Searches that do not fit into the device's memory go on in smaller pieces."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax

FULL = ("RESOURCE_EXHAUSTED", "out of memory", "Failed to allocate")
"""How XLA, CUDA and Warp say that there is no memory left."""


def frugal(
    build: Callable[[int], Callable[..., Any]],
    robots: Callable[..., int],
    say: Callable[[str], None],
) -> Callable[..., Any]:
    """Return what takes twice as many turns each time memory runs out.

    Args:
        build: turns -> the function, whose robots run in so many turns.
        robots: its arguments -> how many robots they are; no more turns than these.
        say: shows a line to the user.
    """
    turns, step = 1, build(1)

    def run(*given: Any) -> Any:
        nonlocal turns, step
        count = robots(*given)
        while True:
            try:
                return jax.block_until_ready(step(*given))
            except RuntimeError as error:  # XLA's and Warp's own
                if not any(sign in str(error) for sign in FULL) or turns >= count:
                    raise
            turns = min(2 * turns, count)
            say(
                f"out of device memory: {-(-count // turns)} robots at a time from "
                f"now on, in {turns} turns"
            )
            step = build(turns)

    return run
