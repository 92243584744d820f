"""Robots by name: what `--robot` means beside the stand-in robots."""

from __future__ import annotations

from pathlib import Path

from gatjax.hardware import lola
from gatjax.hardware.frames import Link

FORMS = "lola[:SOCKET]"


def is_hardware(name: str) -> bool:
    """Return whether a name means a robot behind a link."""
    return name.partition(":")[0] == "lola"


def open_link(name: str) -> Link:
    """Connect to a robot: `lola` (or `lola:/tmp/other.socket`).

    Raises:
        ValueError: the name means no robot.
        Lost: one line: it is not there.
    """
    kind, _, where = name.partition(":")
    if kind == "lola":
        return lola.Lola(Path(where) if where else lola.SOCKET)
    raise ValueError(f"robot {name!r} is unknown; use {FORMS}")
