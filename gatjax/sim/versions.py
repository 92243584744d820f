"""Installed packages that do not go together: told in words instead of a crash."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import metadata

from packaging.requirements import Requirement

ASKED = ("mujoco-mjx", "jax", "jax-cuda12-plugin")
"""Packages whose requirements are looked at."""
ENGINES = ("mujoco", "jax", "jaxlib", "jax-cuda12-plugin", "jax-cuda12-pjrt")
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
            if requirement.marker and not requirement.marker.evaluate(
                {"extra": "cuda12"}
            ):
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
