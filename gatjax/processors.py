"""Processors that this process may use: a job of a cluster has a share of them only."""

from __future__ import annotations

import os


def usable() -> list[int]:
    """Their numbers; all of the machine where the system does not tell."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))
