"""The process that holds a robot: what may end it, and what may hold it up."""

from __future__ import annotations

import gc
import os
import select
import signal
import sys
import time
from contextlib import contextmanager, suppress
from typing import Any, Callable, Iterator

ENDS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT]
"""Ctrl-C, a kill, a terminal or ssh connection that is gone, Ctrl-backslash."""
SLEEPS = [signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU]
"""What would stop this process, and leave the robot alone."""
STDERR = 2  # its file
AGAIN = 0.3  # s after which a Ctrl-C is another one
SWITCH = 5e-4  # s that another thread may keep Python from the loop; else 5 ms


@contextmanager
def interruptible(stop: Callable[[bool], str]) -> Iterator[None]:
    """Let whatever would end this process be told to `stop` instead.

    Args:
        stop: told whether the power should go at once, says what it does. Only a second
            Ctrl-C of a person means that: a terminal that closes may send its signal
            twice.
    """
    first: list[float] = []

    def handle(number: int, place: Any) -> None:
        del place
        now = time.monotonic()
        again = number == signal.SIGINT and bool(first) and now - first[0] > AGAIN
        if number == signal.SIGINT and not first:
            first.append(now)
        told = stop(again)
        # Nobody may read it, and a terminal that stands still must not hold the robot
        # up; print is not for here.
        with suppress(OSError, ValueError):
            if select.select([], [STDERR], [], 0.0)[1]:
                os.write(STDERR, f"\n{told}\n".encode())

    before = {number: signal.signal(number, handle) for number in ENDS}
    before.update({number: signal.signal(number, signal.SIG_IGN) for number in SLEEPS})
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def unhindered() -> Iterator[None]:
    """Let neither the log's thread nor the garbage collector hold the loop up.

    A collection takes 80 to 180 ms with all that gatjax loads; it leaves that alone.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH)
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(before)
