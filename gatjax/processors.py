"""Processors that this process may use: a job of a cluster has a share of them only."""

from __future__ import annotations

import math
import os


def usable() -> list[int]:
    """Their numbers; all of the machine where the system does not tell."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def shares(count: int) -> list[set[int]]:
    """Share them out to processes, where the system can tell one what to use.

    Threads of one process cost a fifth more where another one wants the processor too.
    """
    if not hasattr(os, "sched_setaffinity"):
        return []
    every = usable()
    return [set(every[first::count]) for first in range(count)]


def memory() -> float:
    """Bytes of the whole machine; infinite where the system does not tell."""
    known = getattr(os, "sysconf_names", {})
    if not {"SC_PHYS_PAGES", "SC_PAGE_SIZE"} <= set(known):
        return math.inf
    return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
