"""Processors that this process may use: a job of a cluster has a share of them only."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path


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


def memory(
    told: Path = Path("/proc/self/cgroup"), root: Path = Path("/sys/fs/cgroup")
) -> float:
    """Bytes that this process may use; infinite where the system does not tell.

    They are those of the machine, or of the container or the job of a cluster.

    Args:
        told: lists the control groups of the process (Linux: cgroups(7)).
        root: where control groups are.
    """
    known, whole = getattr(os, "sysconf_names", {}), math.inf
    if {"SC_PHYS_PAGES", "SC_PAGE_SIZE"} <= set(known):
        whole = float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    lines = told.read_text().splitlines() if told.exists() else []
    return min([whole, *(limit for line in lines for limit in _limits(line, root))])


def _limits(line: str, root: Path) -> Iterator[float]:
    """Limits of memory of a control group and of those around it, bytes."""
    _, kinds, path = line.split(":", 2)
    file = "memory.limit_in_bytes" if kinds else "memory.max"
    if kinds and "memory" not in kinds.split(","):
        return
    root = root / "memory" if kinds else root
    folder = root / path.lstrip("/")
    for place in (folder, *folder.parents):
        if not place.is_relative_to(root):
            return
        text = (place / file).read_text() if (place / file).exists() else ""
        if text.strip().isdigit():
            yield float(text)
