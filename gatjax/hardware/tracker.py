"""Where the robot is, from motion capture: datagrams on the local network.

A datagram is JSON: {"position": [x, y, z], "quaternion": [w, x, y, z]}: the torso's
origin (`nao.xml`: 85 mm above the hips) in metres, x towards the target, z above the
floor; torso to world. `gatjax nao` sends them; a bridge from a motion-capture system is
ten lines of Python. Nothing here ever raises while a robot has power: what is no place
is not one.
"""

from __future__ import annotations

import json
import socket
import time

import numpy as np

from gatjax.records import Base

STALE = 0.2  # s after which a place says nothing any more
HERE = "127.0.0.1"


class Tracker:
    """Listens for the robot's place on a UDP port of this computer."""

    def __init__(self, address: str) -> None:
        """Listen at `PORT` of this computer, or `HOST:PORT`; 0.0.0.0 hears everybody.

        Raises:
            ValueError: one line: that is no address.
            OSError: one line: somebody listens there already.
        """
        host, _, port = address.rpartition(":")
        if not port.isdigit():
            raise ValueError(f"tracker {address!r}: use a port, or HOST:PORT")
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.socket.bind((host or HERE, int(port)))
        except (OSError, OverflowError) as error:
            self.socket.close()
            raise OSError(
                f"tracker {address}: cannot listen ({error}); does another program "
                f"walk this robot?"
            ) from error
        self.socket.setblocking(False)
        self._latest: Base | None = None
        self._told = 0.0  # s, this computer's clock

    def latest(self) -> Base | None:
        """Return the last place that was told, None if that is too long ago."""
        now = time.monotonic()
        for message in self._messages():
            base = place(message)
            if base is not None:
                self._latest, self._told = base, now
        return self._latest if now - self._told < STALE else None

    def _messages(self) -> list[bytes]:
        """Take what has come, at most what one frame may cost."""
        messages = []
        for _ in range(100):
            try:
                messages.append(self.socket.recv(4096))
            except OSError:
                break
        return messages[-5:]

    def close(self) -> None:
        """Listen no more."""
        self.socket.close()


def place(message: bytes) -> Base | None:
    """Read a datagram; None if it is no place."""
    try:
        told = json.loads(message.decode())
        position = np.array(told["position"], float)
        quaternion = np.array(told["quaternion"], float)
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
        return None
    if position.shape != (3,) or quaternion.shape != (4,):
        return None
    length = np.linalg.norm(quaternion)
    if not (np.isfinite(position).all() and abs(length - 1.0) < 0.1):
        return None
    return Base(position, quaternion / length)
