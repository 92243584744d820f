"""Agents of the RoboCup 3D simulators: S-expressions over TCP, length first."""

from __future__ import annotations

import re
import socket
import time
from typing import Any

from gatjax.hardware.frames import BadFrame, Lost
from gatjax.hardware.stream import received

HEAD = 4  # bytes of a message's length, big-endian
LONGEST = 1 << 22  # bytes; a length beyond is noise
TOKENS = re.compile(r"[()]|[^\s()]+")


def parse(text: str) -> list[Any]:
    """Read a sequence of S-expressions into nested lists of words.

    Raises:
        BadFrame: brackets do not match.
    """
    stack: list[list[Any]] = [[]]
    for token in TOKENS.findall(text):
        if token == "(":
            stack.append([])
        elif token == ")":
            if len(stack) == 1:
                raise BadFrame("a message closes a bracket that it did not open")
            done = stack.pop()
            stack[-1].append(done)
        else:
            stack[-1].append(token)
    if len(stack) != 1:
        raise BadFrame("a message ends inside brackets")
    return stack[0]


def named(entries: list[Any]) -> dict[str, list[Any]]:
    """Take `(n torso) (rt 1 2 3)` by name: {"n": ["torso"], "rt": ["1", "2", "3"]}."""
    return {entry[0]: entry[1:] for entry in entries if isinstance(entry, list)}


class Agent:
    """One connection to a simulator."""

    def __init__(self, host: str, port: int, hint: str) -> None:
        """Connect; `hint` says what to do if nobody is there.

        Raises:
            Lost: nobody is there.
        """
        self.place = f"{host}:{port}"
        self.who = f"{self.place}: the simulator"
        try:
            self.socket = socket.create_connection((host, port), timeout=5.0)
        except OSError as error:
            raise Lost(f"{self.place}: nobody there ({error}); {hint}") from error
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._buffer = b""

    def send(self, text: str) -> None:
        """Send a message.

        Raises:
            Lost: the simulator is gone.
        """
        message = text.encode("ascii")
        try:
            self.socket.settimeout(5.0)
            self.socket.sendall(len(message).to_bytes(HEAD, "big") + message)
        except OSError as error:
            raise Lost(f"{self.who} is gone ({error})") from error

    def receive(self, timeout: float) -> str | None:
        """Return the next message, None if `timeout` s pass without one.

        Raises:
            BadFrame: its length is none.
            Lost: the simulator is gone.
        """
        deadline = time.monotonic() + timeout
        while True:
            size = int.from_bytes(self._buffer[:HEAD], "big")
            if len(self._buffer) >= HEAD and size > LONGEST:
                raise BadFrame(f"a message of {size} bytes")
            if len(self._buffer) >= HEAD + size and len(self._buffer) >= HEAD:
                message = self._buffer[HEAD : HEAD + size]
                self._buffer = self._buffer[HEAD + size :]
                return message.decode("ascii", "replace")
            part = received(self.socket, deadline - time.monotonic(), self.who)
            if not part:
                return None
            self._buffer += part

    def close(self) -> None:
        """Leave."""
        self.socket.close()
