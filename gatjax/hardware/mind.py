"""Who thinks: the walk engine in a process of its own.

If it hangs, dies or is killed, the process that holds the robot goes on and lets it
crouch.
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from typing import Any

import numpy as np

from gatjax import task as tasks
from gatjax.records import FORCE_SENSORS, JOINTS, Reading
from gatjax.task import Task

Array = Any

SIZES = (len(JOINTS), 3, 3, len(FORCE_SENSORS))
ASK = 2 + sum(SIZES)  # number, walking, reading
TELL = 1 + len(JOINTS)  # number, targets
READY = 60.0  # s that a start may take
NEVER = 1 << 30  # a control tick that does not come
TRY = -1.0  # instead of walking: an answer that is forgotten
TRIES = 100


class Mind:
    """The walk engine of one run, in another process."""

    def __init__(self, task: Task, policy: Array) -> None:
        """Start it: policy [15]; it is not `ready` at once."""
        ours, theirs = socket.socketpair()
        path = os.pathsep.join(place for place in sys.path if place)
        self.process = subprocess.Popen(
            [sys.executable, "-m", "gatjax.hardware.mind", str(theirs.fileno())],
            pass_fds=(theirs.fileno(),),
            env={**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"},
            start_new_session=True,  # Ctrl-C is for who holds the robot
        )
        theirs.close()
        self.socket, self._buffer, self._number = ours, b"", 0
        job = pickle.dumps((tuple(task), np.asarray(policy, float)))
        ours.sendall(len(job).to_bytes(4, "big") + job)
        self._since, self._ready = time.monotonic(), False

    def ready(self) -> bool:
        """Return whether it has started; it never waits.

        Raises:
            OSError: one line: it will not start.
        """
        if self._ready:
            return True
        if time.monotonic() - self._since > READY:
            raise OSError(f"the walk engine did not start in {READY:g} s")
        if select.select([self.socket], [], [], 0.0)[0]:
            if self.socket.recv(1) != b"+":
                raise OSError("the walk engine did not start; see the lines above")
            self._ready = True
        return self._ready

    def ask(self, reading: Reading, walking: bool, timeout: float) -> Array | None:
        """Return targets [J] rad for a reading; None if they do not come in time."""
        return self._ask(reading, float(walking), timeout)

    def pace(self) -> Array:
        """Try how long answers take, [TRIES] s, inf where none came."""
        rest = Reading(*map(np.zeros, SIZES))
        seconds = np.full(TRIES, np.inf)
        for index in range(TRIES):
            began = time.perf_counter()
            if self._ask(rest, TRY, 1.0) is None:
                break
            seconds[index] = time.perf_counter() - began
        return seconds

    def _ask(self, reading: Reading, walking: float, timeout: float) -> Array | None:
        self._number += 1
        message = np.concatenate([[self._number, walking], *reading])
        deadline = time.monotonic() + timeout
        try:
            self.socket.settimeout(timeout)
            self.socket.sendall(message.tobytes())
            while True:
                told = self._told(deadline)
                if told is None or told[0] == self._number:
                    return None if told is None else told[1:]
        except OSError:  # it died
            return None

    def _told(self, deadline: float) -> Array | None:
        """Return the next answer, None if it does not come in time."""
        while len(self._buffer) < 8 * TELL:
            left = deadline - time.monotonic()
            if left <= 0.0:
                return None
            self.socket.settimeout(left)
            part = self.socket.recv(8 * TELL - len(self._buffer))
            if not part:
                return None
            self._buffer += part
        message, self._buffer = self._buffer, b""
        return np.frombuffer(message)

    def close(self) -> None:
        """End the process."""
        self.socket.close()
        self.process.kill()
        self.process.wait()


def think(channel: socket.socket) -> None:
    """Answer readings with targets until nobody asks any more."""
    size = int.from_bytes(_exactly(channel, 4), "big")
    fields, policy = pickle.loads(_exactly(channel, size))
    task, state = Task(*fields), tasks.begin(policy)
    ends = np.cumsum(SIZES)[:-1]
    rest = Reading(*np.split(np.zeros(sum(SIZES)), ends))
    tasks.pilot(task, policy, np.asarray(NEVER), state, rest)  # the first is slow
    channel.sendall(b"+")
    while True:
        asked = np.frombuffer(_exactly(channel, 8 * ASK))
        reading = Reading(*np.split(asked[2:], ends))
        go = np.asarray(0 if asked[1] > 0.0 else NEVER)
        after, target = tasks.pilot(task, policy, go, state, reading)
        state = state if asked[1] == TRY else after
        channel.sendall(np.concatenate([asked[:1], target]).tobytes())


def _exactly(channel: socket.socket, size: int) -> bytes:
    """Receive so many bytes; the process ends where there are no more."""
    message = b""
    while len(message) < size:
        part = channel.recv(size - len(message))
        if not part:
            sys.exit(0)
        message += part
    return message


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Who asks may go at any time, also with an answer that nobody has read.
    with socket.socket(fileno=int(sys.argv[1])) as given, suppress(OSError):
        think(given)
