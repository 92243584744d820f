"""Bytes off a socket, until a deadline."""

from __future__ import annotations

import select
import socket

from gatjax.hardware.frames import Lost

MOST = 1 << 16  # bytes that are taken at once


def received(channel: socket.socket, timeout: float, who: str) -> bytes:
    """Return bytes that come within `timeout` s, none if there are none.

    Raises:
        Lost: `who` is gone, or closed the connection.
    """
    if timeout < 0.0 or not select.select([channel], [], [], timeout)[0]:
        return b""
    try:
        part = channel.recv(MOST)
    except OSError as error:
        raise Lost(f"{who} is gone ({error.strerror})") from error
    if not part:
        raise Lost(f"{who} closed the connection")
    return part
