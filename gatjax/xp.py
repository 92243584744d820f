"""One source for numpy and jax: code asks its arguments for their array module."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import numpy


def namespace_of(*arrays: Any) -> ModuleType:
    """Return `jax.numpy` if any argument is a jax array or tracer, else `numpy`.

    jax is never imported here: if an argument is a jax array, jax is loaded already.
    """
    for array in arrays:
        if type(array).__module__.partition(".")[0] in ("jax", "jaxlib"):
            return sys.modules["jax.numpy"]
    return numpy


def settled(tree: Any) -> Any:
    """Return a tuple of arrays as it is; XLA computes it once, and no use of it anew.

    XLA for GPUs fuses what is stacked into one kernel in which each entry computes all
    that it needs: the legs' joint angles, stacked, took it five minutes to compile.
    """
    if namespace_of(*tree) is numpy:
        return tree
    return sys.modules["jax"].lax.optimization_barrier(tree)
