"""Where the robot is, from motion capture: datagrams on the local network.

A datagram is JSON: {"position": [x, y, z], "quaternion": [w, x, y, z]}, metres, torso
to world, x towards the target. `gatjax nao` sends them; a bridge from a motion-capture
system is ten lines of Python.
"""

from __future__ import annotations

import json
import socket

import numpy as np

from gatjax.records import Base


class Tracker:
    """Listens for the robot's place on a UDP port of this computer."""

    def __init__(self, port: int) -> None:
        """Listen."""
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.bind(("127.0.0.1", port))
        self.socket.setblocking(False)
        self._latest: Base | None = None

    def latest(self) -> Base | None:
        """Return the last place that was told, None before the first."""
        message = b""
        while True:
            try:
                message = self.socket.recv(4096)
            except BlockingIOError:
                break
        if message:
            told = json.loads(message.decode())
            self._latest = Base(
                np.array(told["position"], float), np.array(told["quaternion"], float)
            )
        return self._latest

    def close(self) -> None:
        """Listen no more."""
        self.socket.close()
