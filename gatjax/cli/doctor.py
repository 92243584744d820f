"""Look at an installation: versions, devices, engines, and a short walk."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from collections.abc import Iterator

import jax
import numpy as np

from gatjax import loop, processors
from gatjax.sim.backend import default_backend
from gatjax.sim.versions import mismatch, unused_gpu
from gatjax.sim.world import nominal
from gatjax.surrogate import ROBOTS, make_robot
from gatjax.task import Task
from gatjax.walk.parameters import THETA0

PACKAGES = ("jax", "mujoco", "mujoco-mjx", "evosax", "orbax-checkpoint", "dartpy")
BROKEN = ("broken", "missing", "refused")  # how findings begin that are none


def examine() -> Iterator[tuple[str, str]]:
    """Yield (what, finding) pairs; a broken engine is a finding, not an exception."""
    yield "python", f"{platform.python_version()} on {platform.platform()}"
    yield "cores", f"{processors.usable()} of {os.cpu_count()}"
    for package in PACKAGES:
        try:
            yield package, importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            yield package, "missing; pip install gatjax again"
    lacking = mismatch()
    yield "versions", lacking or "go together"
    try:
        devices = ", ".join(str(device) for device in jax.devices())
    except RuntimeError as error:  # a plugin of JAX that cannot start
        yield "devices", f"broken: {' '.join(str(error).split())}"
        return
    unused = unused_gpu()
    yield "devices", f"broken: {unused}" if unused else devices
    yield "MJX-Warp", _warp()
    refused = "versions" if lacking else "devices" if unused else None
    meant = f"refused, see {refused}" if refused else default_backend()
    yield "backend", f"{meant} (what --backend auto means here)"
    task = Task(duration=1.0)
    for name in ("simulator", *ROBOTS):
        yield name, _walk(name, task)


def _warp() -> str:
    try:
        from gatjax.sim.mjxmodel import lacking_for_warp
    except ImportError as error:
        return f"broken: {' '.join(str(error).split())}"
    lacking = lacking_for_warp()
    return lacking or "can run (what --impl auto means here)"


def _walk(name: str, task: Task) -> str:
    try:
        robot = (
            loop.Simulator(nominal(task)) if name == "simulator" else make_robot(name)
        )
        _, outcome = robot.walk(THETA0[None], [0], task)
    except (ImportError, RuntimeError, ValueError, OSError) as error:
        return f"broken: {' '.join(str(error).split())}"
    fell = np.isfinite(outcome.fell_at[0])
    speed = 100.0 * float(outcome.velocity[0])
    return f"fell in {task.duration} s" if fell else f"walks, {speed:.1f} cm/s"
