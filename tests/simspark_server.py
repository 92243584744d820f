"""A SimSpark server that plays a recorded transcript to whoever connects."""

from __future__ import annotations

import contextlib
import gzip
import math
import socket
import threading

from gatjax.hardware.agent import parse
from gatjax.hardware.simspark import EFFECTORS, PERIOD


def lines(path):
    """Messages of a transcript: (">" or "<", text)."""
    with gzip.open(path, "rt") as file:
        return [(line[0], line[2:].rstrip("\n")) for line in file]


class Recorded:
    """Plays the server's messages, one for each of the client's."""

    def __init__(self, messages):
        self.messages, self.heard = messages, []
        self.socket = socket.create_server(("127.0.0.1", 0))
        self.port = self.socket.getsockname()[1]
        self.thread = threading.Thread(target=self._play, daemon=True)
        self.thread.start()

    def _play(self):
        while True:
            try:
                client, _ = self.socket.accept()
            except OSError:
                return
            with client, client.makefile("rb") as stream, contextlib.suppress(OSError):
                self._serve(client, stream)

    def _serve(self, client, stream):
        for _, text in (m for m in self.messages if m[0] == "<"):
            head = stream.read(4)
            if len(head) < 4:
                return
            told = stream.read(int.from_bytes(head, "big"))
            self.heard.append(told.decode())
            message = text.encode()
            client.sendall(len(message).to_bytes(4, "big") + message)

    def close(self):
        self.socket.close()


class Kinematic(Recorded):
    """A robot that does with its joints what it is told and never falls."""

    def __init__(self):
        self.angle = dict.fromkeys(EFFECTORS, 0.0)  # degrees
        self.now = 100.0
        super().__init__([])

    def _serve(self, client, stream):
        told = b""
        while len(head := stream.read(4)) == 4:
            told = stream.read(int.from_bytes(head, "big")).decode()
            self.heard.append(told)
            for kind, *values in parse(told):
                if kind in self.angle:
                    self.angle[kind] += math.degrees(float(values[0])) * PERIOD
            self.now += PERIOD
            message = self._percept().encode()
            client.sendall(len(message).to_bytes(4, "big") + message)

    def _percept(self):
        pose = "1 0 0 -12 0 1 0 0 0 0 1 0.38 0 0 0 1"
        joints = "".join(
            f"(HJ (n {name.replace('e', 'j')}) (ax {angle:.3f}))"
            for name, angle in self.angle.items()
        )
        feet = "".join(f"(FRP (n {n}) (c 0 0 0) (f 0 0 22.5))" for n in ("lf", "rf"))
        return (
            f"(time (now {self.now:.3f}))(GPS (n torso) (tf {pose}))"
            f"(GYR (n torso) (rt 0 {math.sin(self.now):.3f} 0))"
            f"(ACC (n torso) (a 0 {math.cos(self.now):.3f} 9.81)){joints}{feet}"
        )
