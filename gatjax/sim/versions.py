"""Installed packages that do not go together: told in words instead of a crash."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from importlib import metadata
from pathlib import Path

import jax
from packaging.requirements import Requirement

CUDA = ("cuda12", "cuda13")
PLUGINS = tuple(f"jax-{cuda}-plugin" for cuda in CUDA)
ASKED = ("mujoco-mjx", "jax", *PLUGINS)
"""Packages whose requirements are looked at."""
ENGINES = ("mujoco", "jax", "jaxlib", *PLUGINS, *(f"jax-{cuda}-pjrt" for cuda in CUDA))
"""Packages that they must agree with; what is not installed is not needed."""


def mismatch(
    requires: Callable[[str], Iterable[str] | None] = metadata.requires,
    version: Callable[[str], str] = metadata.version,
) -> str | None:
    """Say in one line which two packages do not go together; None if all do.

    Args:
        requires: package -> its requirements; raises PackageNotFoundError.
        version: package -> its version; raises PackageNotFoundError.
    """
    for package in ASKED:
        try:
            lines, own = requires(package) or (), version(package)
        except metadata.PackageNotFoundError:
            continue
        for requirement in map(Requirement, lines):
            if requirement.name not in ENGINES:
                continue
            marker = requirement.marker
            if marker and not any(marker.evaluate({"extra": cuda}) for cuda in CUDA):
                continue
            try:
                found = version(requirement.name)
            except metadata.PackageNotFoundError:
                continue
            if not requirement.specifier.contains(found, prereleases=True):
                return (
                    f"{package} {own} needs {requirement.name} "
                    f"{requirement.specifier}, {found} is installed; install both "
                    f"again: pip install -c constraints.txt -e ."
                )
    return None


def unused_gpu(
    version: Callable[[str], str] = metadata.version, devices: Path = Path("/dev")
) -> str | None:
    """Say in one line that JAX leaves a GPU out for which a plugin is here; or None.

    A plugin that does not find its libraries, or a driver new enough for them, prints
    why and JAX goes on with CPUs. Who asks for them (`JAX_PLATFORMS=cpu`) is not told.
    """
    if os.environ.get("JAX_PLATFORMS") or jax.default_backend() != "cpu":
        return None
    if not any(devices.glob("nvidia[0-9]*")):
        return None
    for plugin in PLUGINS:
        try:
            own = version(plugin)
        except metadata.PackageNotFoundError:
            continue
        return (
            f"JAX does not use this machine's NVIDIA GPU though {plugin} {own} is "
            f"installed: the driver may be too old for it (nvidia-smi shows the CUDA "
            f"version it is for), or the plugin's libraries are missing"
        )
    return None
