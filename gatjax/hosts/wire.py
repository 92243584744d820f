"""What hosts say to each other: numpy arrays by name, never code.

Connections are those of `multiprocessing.connection`: messages with a length, and both
sides prove that they know the same secret, GATJAX_SECRET.
"""

from __future__ import annotations

import io
import json
import os
import socket
import struct
import zipfile
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import numpy as np

Array = Any
LARGEST = 1 << 30  # bytes of a message
SILENCE = 120  # s without a sign of the other end's system, after which it is gone
LOST = (EOFError, OSError)
"""What a connection raises whose other end is gone."""


class Task(NamedTuple):
    """What is searched: all that a host has to know before the first order."""

    facts: dict[str, Any]  # settings and versions, as JSON
    files: dict[str, bytes]  # of the world, by the name in its folder


class Order(NamedTuple):
    """Policies to be run, each with the same random numbers."""

    number: int  # which the answer repeats
    policies: Array  # [N, 15]
    keys: Array  # [R, 2] words


def secret() -> bytes:
    """What both ends of a connection have to know."""
    return os.environ.get("GATJAX_SECRET", "gatjax").encode()


def send(link: Connection, **arrays: Any) -> None:
    """Send arrays by name."""
    file = io.BytesIO()
    np.savez(file, **arrays)
    link.send_bytes(file.getvalue())


def receive(link: Connection) -> dict[str, np.ndarray]:
    """Wait for the arrays that the other end sends.

    Raises:
        EOFError, OSError: the other end is gone, or sends what gatjax does not.
    """
    data = link.recv_bytes(LARGEST)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as found:
            return {name: found[name] for name in found.files}
    except (ValueError, zipfile.BadZipFile) as error:
        raise OSError(f"not a message of gatjax: {error}") from error


def send_task(link: Connection, task: Task) -> None:
    """Send a task."""
    files = {f"file:{n}": np.frombuffer(b, np.uint8) for n, b in task.files.items()}
    send(link, facts=np.array(json.dumps(task.facts)), **files)


def task_of(message: dict[str, np.ndarray]) -> Task:
    """Read a task."""
    files = {
        name.removeprefix("file:"): data.tobytes()
        for name, data in message.items()
        if name.startswith("file:")
    }
    return Task(json.loads(str(message["facts"])), files)


def heed(link: Connection) -> None:
    """Let the system notice within two minutes that the other end lost its power.

    That is so while nothing is on its way there; for what is, see `hurry`.
    """
    with _socket_of(link) as line:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in (
            ("TCP_KEEPIDLE", SILENCE // 2),
            ("TCP_KEEPINTVL", SILENCE // 8),
            ("TCP_KEEPCNT", 4),
        ):
            if hasattr(socket, option):
                line.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)


def hurry(link: Connection) -> None:
    """Let the system give up what does not get on for two minutes, sent or received.

    For the leader's end, whose orders are read at once and whose answers come in one
    piece. Not for a host's: the leader reads its answer after its own share, and what
    does not fit into the buffers until then (some 100 kB) counts as not received.
    """
    with _socket_of(link) as line:
        wait = struct.pack("ll", SILENCE, 0)
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, wait)
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            option = socket.TCP_USER_TIMEOUT
            line.setsockopt(socket.IPPROTO_TCP, option, 1000 * SILENCE)


def _socket_of(link: Connection) -> socket.socket:
    """Return a connection's socket, to set what it does; to be closed."""
    return socket.socket(fileno=os.dup(link.fileno()))


def address_of(text: str) -> tuple[str, int]:
    """Read HOST:PORT.

    Raises:
        ValueError: it is none.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ValueError(f"{text!r} is no HOST:PORT, for example node7:5123")
    return host, int(port)
