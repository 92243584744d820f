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
