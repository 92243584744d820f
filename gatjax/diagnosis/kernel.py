"""The simulation of one joint, compiled by numba and kept on disk."""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import numpy as np

from gatjax.diagnosis import plant
from gatjax.diagnosis.laws import Drive, Grid
from gatjax.diagnosis.loop import SERIES, WEIGHED, source
from gatjax.files import write_whole

Array = Any
BUILDING = threading.Lock()


def compiled(geared: bool, drawn: bool, h: float) -> Callable[..., None]:
    """The loop, compiled when it is called first.

    It is kept beside the programs that JAX keeps, if it does (`use_compile_cache`).
    """
    with BUILDING:
        return _module(geared, drawn, h).simulate


@functools.cache
def _module(geared: bool, drawn: bool, h: float) -> Any:
    text = source(geared, drawn, h)
    folder = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    if folder is None:
        return _executed(text)
    kept = text.replace("<cached>", "True")
    name = f"joint_{hashlib.sha256(kept.encode()).hexdigest()[:16]}"
    path = Path(folder) / "numba" / f"{name}.py"
    try:
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole({path: kept.encode()})
    except OSError:
        return _executed(text)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)  # for the cache
    spec.loader.exec_module(module)
    return module


def _executed(text: str) -> Any:
    names: dict[str, Any] = {}
    exec(text.replace("<cached>", "False"), names)
    return SimpleNamespace(**names)


def simulate(
    p: Drive, grid: Grid, time: Array, lead: int, h: float, geared: bool, drawn: bool,
    moving: bool = False,
) -> plant.Outcome:  # fmt: skip
    """Simulate a joint with S sets of numbers.

    Args:
        p: numbers [S] each, terms [S, B].
        grid: of R runs.
        time: stamps of the readings [R, N] s.
        lead: steps before a run's first stamp.
        h: step, s.
        geared: whether motor and link are two inertias.
        drawn: whether it is drawn to its measured motion.
        moving: whether the angle of the link is wanted; it is empty else.
    """
    numbers = np.stack([np.asarray(number, np.float32) for number in p[:-1]])
    steps, runs = grid.target.shape
    count = numbers.shape[1]
    readings = np.empty((*time.shape, count), np.float32)
    angle = np.empty((steps, runs, count) if moving else (0, runs, count), np.float32)
    heat = np.empty((runs, count), np.float32)
    series = [getattr(grid, name) for name in ("target", "reading", *SERIES, *WEIGHED)]
    terms = grid.rest_terms, grid.slope_terms, grid.inertia_terms
    compiled(geared, drawn, h)(
        *(_plain(each) for each in (numbers, p.terms, *series, *terms, time)),
        np.float32(lead), np.float32(h), readings, angle, heat,
    )  # fmt: skip
    readings[..., np.isnan(numbers).any(0)] = np.nan  # limits would hide that
    return plant.Outcome(readings, angle, heat)


def _plain(values: Array) -> Array:
    """An array of one kind, so that there is one compilation."""
    plain = np.ascontiguousarray(values, np.float32).view()
    plain.flags.writeable = False
    return plain
