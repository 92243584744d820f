"""Robots by name: what `--robot` means beside the stand-in robots."""

from __future__ import annotations

import os
from pathlib import Path

from gatjax.hardware.frames import Link
from gatjax.hardware.lola import SOCKET, Lola
from gatjax.hardware.simspark import TYPES, SimSpark

FORMS = "lola[:SOCKET], simspark[:HOST:PORT:MONITORPORT], simspark-v4[...]"
SIMSPARK = "localhost:3100:3200"


def is_hardware(name: str) -> bool:
    """Return whether a name means a robot behind a link."""
    kind = name.partition(":")[0]
    return kind == "lola" or kind in TYPES


def open_link(name: str) -> Link:
    """Connect to a robot: `lola`, `lola:/tmp/other.socket`, `simspark:host:3100:3200`.

    Without an address SimSpark is where GATJAX_SIMSPARK says, or on this computer.

    Raises:
        ValueError: the name means no robot.
        Lost: one line: it is not there.
    """
    kind, colon, where = name.partition(":")
    if colon and not where:
        raise ValueError(f"robot {name!r} has no address after its colon; use {FORMS}")
    if kind == "lola":
        return Lola(Path(where) if where else SOCKET)
    if kind in TYPES:
        where = where or os.environ.get("GATJAX_SIMSPARK", SIMSPARK)
        host, *ports = where.split(":")
        if len(ports) in (1, 2) and all(port.isdigit() for port in ports):
            agents, *monitors = map(int, ports)
            return SimSpark(kind, host, agents, *monitors[:1])
        raise ValueError(
            f"{where!r}: SimSpark is at HOST:PORT or HOST:PORT:MONITORPORT"
        )
    raise ValueError(f"robot {name!r} is unknown; use {FORMS}")
