"""What this process may use of a machine: a job of a cluster has a share of it only."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path

TOLD = Path("/proc/self/cgroup")  # lists control groups of the process: cgroups(7)
GROUPS = Path("/sys/fs/cgroup")


def usable() -> int:
    """Number of processors that this process may keep busy.

    All of the machine where the system does not tell; a container's or a job's limit of
    processor time counts as so many.
    """
    return math.ceil(min(len(_given()), _time()))


def shares(count: int) -> list[set[int]]:
    """Share processors out to processes, where the system can tell one what to use.

    Threads of one process cost a fifth more where another one wants the processor too.
    Nothing is shared out where time on them is limited: others may be bound to them.
    """
    every = _given()
    if not hasattr(os, "sched_setaffinity") or usable() < len(every):
        return []
    return [set(every[first::count]) for first in range(count)]


def _given() -> list[int]:
    """Numbers of the processors that the process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def memory() -> float:
    """Bytes that this process may use; infinite where the system does not tell.

    They are those of the machine, or of the container or the job of a cluster.
    """
    known, whole = getattr(os, "sysconf_names", {}), math.inf
    if {"SC_PHYS_PAGES", "SC_PAGE_SIZE"} <= set(known):
        whole = float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    texts = _texts("memory", ("memory.limit_in_bytes",), ("memory.max",))
    return min([whole, *(float(text) for (text,) in texts if text.isdigit())])


def _time() -> float:
    """Processors whose time the process may use; infinite where nothing limits it."""
    old = "cpu.cfs_quota_us", "cpu.cfs_period_us"
    words = [" ".join(t).split() for t in _texts("cpu", old, ("cpu.max",))]
    limits = [
        float(w[0]) / float(w[1]) for w in words if len(w) == 2 and w[0].isdigit()
    ]
    return min(limits, default=math.inf)


def _texts(
    kind: str, old: tuple[str, ...], new: tuple[str, ...]
) -> Iterator[list[str]]:
    """What files say of a kind of limit, of the process' groups and those around them.

    Args:
        kind: of limit.
        old: files of cgroups 1, which have a tree for each kind.
        new: files of cgroups 2.
    """
    for line in TOLD.read_text().splitlines() if TOLD.exists() else []:
        _, kinds, path = line.split(":", 2)
        if kinds and kind not in kinds.split(","):
            continue
        top = GROUPS / kind if kinds else GROUPS
        folder = top / path.lstrip("/")
        for place in (folder, *folder.parents):
            if not place.is_relative_to(top):
                break
            files = [place / name for name in (old if kinds else new)]
            if all(file.exists() for file in files):
                yield [file.read_text().strip() for file in files]
