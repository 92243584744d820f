"""Robots in shares: while some are stepped, another share is thought about.

MuJoCo's steps use all processors, the control loop between them few. With many
processors most of them would wait for it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import numpy as np

from gatjax import processors

CREW = 4  # processors that one share's steps keep busy beside another's control loop
MOST = 4  # Python runs one share at a time, so more of them would wait for each other
FEWEST = 64  # robots of a share


def count(robots: int) -> int:
    """How many shares a number of robots is worth on this machine."""
    return max(1, min(MOST, processors.usable() // CREW, robots // FEWEST))


def joined(run: Callable[[Any, threading.Event], Any], robots: int, shares: int) -> Any:
    """Run robots in shares at the same time.

    Args:
        run: (rows [K] of the robots, an event) -> leaves [K, ...]; once the event is
            set nobody waits for the result.
        robots: how many there are.
        shares: how many threads.

    Returns:
        Leaves [robots, ...] in the order of the rows.
    """
    parts = [np.arange(first, robots, shares) for first in range(shares)]
    stop = threading.Event()
    if shares == 1:
        return run(parts[0], stop)
    with ThreadPoolExecutor(shares) as pool:
        try:
            results = list(pool.map(run, parts, [stop] * shares))
        except BaseException:  # of a share, or Ctrl-C: the others need not go on
            stop.set()
            raise
    order = np.argsort(np.concatenate(parts))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[order], *results)
