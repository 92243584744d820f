"""A SimSpark server that plays a recorded transcript to whoever connects."""

from __future__ import annotations

import gzip
import socket
import threading


def lines(path):
    """Messages of a transcript: (">" or "<", text)."""
    with gzip.open(path, "rt") as file:
        return [(line[0], line[2:].rstrip("\n")) for line in file]


class Recorded:
    """Plays the server's messages, one for each of the client's."""

    def __init__(self, messages, monitor=None):
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
            with client, client.makefile("rb") as stream:
                for _, text in (m for m in self.messages if m[0] == "<"):
                    head = stream.read(4)
                    if len(head) < 4:
                        break
                    told = stream.read(int.from_bytes(head, "big"))
                    self.heard.append(told.decode())
                    message = text.encode()
                    try:
                        client.sendall(len(message).to_bytes(4, "big") + message)
                    except OSError:
                        break

    def close(self):
        self.socket.close()
