"""LoLA's side of the socket: whoever connects gets a simulated NAO."""

from __future__ import annotations

import contextlib
import json
import select
import socket
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gatjax.hardware import messagepack
from gatjax.hardware.lola import PERIOD
from gatjax.hardware.process import unhindered
from gatjax.records import JOINTS, Base
from gatjax.surrogate.attended import SimulatedNao, Told, told_by

RELEASE = 0.5  # s without an answer after which LoLA takes the power off
FAIR = 0.8 * PERIOD  # s that a client must have had to be counted as silent
KEPT = 1_000_000  # answers of a client that are timed


class Answer(NamedTuple):
    """What a client said to a frame."""

    said: Any
    at: float  # s, this computer's clock


def _served(path: Path) -> bool:
    """Whether somebody listens at a socket."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as tried:
        tried.setblocking(False)
        try:
            tried.connect(str(path))
        except BlockingIOError:  # too many wait there already
            return True
        except OSError:
            return False
    return True


class Server:
    """LoLA's side of the socket."""

    def __init__(self, path: Path, lockstep: bool) -> None:
        """Listen; `lockstep`: wait for every answer, as fast as both can.

        Raises:
            OSError: one line: the socket cannot be made.
        """
        if path.exists() and not path.is_socket():
            raise OSError(f"{path}: is a file; choose another place for the socket")
        if _served(path):
            raise OSError(f"{path}: a NAO is there already; end it, or use another one")
        path.unlink(missing_ok=True)
        self.path, self.lockstep = path, lockstep
        self.answers: deque[float] = deque(maxlen=KEPT)
        """How long a client took to answer frames of a robot with power, s."""
        self.notes = path.with_name(path.name + ".json")
        self.tracker = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.tracker.bind(("127.0.0.1", 0))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self.socket.bind(str(path))
        except OSError as error:
            raise OSError(
                f"{path}: no socket can be made ({error.strerror or error})"
            ) from error
        self.socket.listen(1)
        told = {"lockstep": lockstep, "tracker": self.port}
        self.notes.write_text(json.dumps(told) + "\n")

    def serve(self, robot: SimulatedNao, say: Callable[[str], None]) -> None:
        """Serve one client after the other, until interrupted or closed."""
        while True:
            try:
                client, _ = self.socket.accept()
            except OSError:
                return
            with client, unhindered():
                stayed = self._serve(client, robot, say)
            robot.pick_up()
            if stayed:
                say(f"disconnected: {paces(self.answers)}")

    def _serve(
        self, client: socket.socket, robot: SimulatedNao, say: Callable[[str], None]
    ) -> bool:
        """Serve one client until it leaves; return whether it was more than a look."""
        stream, silent, stayed = b"", 0.0, False
        self.answers.clear()
        due = time.monotonic()
        while True:
            try:  # closed meanwhile, too
                self._track(robot.base())
                client.sendall(messagepack.pack(robot.frame()))
                sent = time.monotonic()
                due = max(due + PERIOD, sent - 10.0 * PERIOD)
                answer, stream = self._answer(client, stream, due)
                silent = 0.0 if answer else silent + PERIOD
                told = told_by(answer.said, robot.told) if answer else robot.told
            except (OSError, EOFError):
                if stayed:
                    say("client left")
                return stayed
            except ValueError as error:
                say(f"client: {error}")
                return stayed
            if not stayed and (answer or silent > RELEASE):
                stayed = True
                say("connected")
            if told.stiffness.any() and (answer or due - sent > FAIR):
                self.answers.append(answer.at - sent if answer else np.inf)
            if silent > RELEASE:
                told = Told(told.target, np.zeros(len(JOINTS)))
            happened = robot.advance(told)
            if happened:
                say(happened)

    def _answer(
        self, client: socket.socket, stream: bytes, due: float
    ) -> tuple[Answer | None, bytes]:
        """Collect answers until the next frame is due; return the last one."""
        last: Answer | None = None
        at = time.monotonic()
        while True:
            found = messagepack.first(stream)
            if found is not None:
                last, stream = Answer(found[0], at), found[1]
                if self.lockstep:
                    return last, stream
                continue
            left = None if self.lockstep else max(0.0, due - time.monotonic())
            if not select.select([client], [], [], left)[0]:
                return last, stream
            at = time.monotonic()
            part = client.recv(4096)
            if not part:
                raise EOFError
            stream += part

    def _track(self, base: Base) -> None:
        """Say where the robot is, as motion capture would."""
        told = {
            "position": base.position.tolist(), "quaternion": base.quaternion.tolist(),
        }  # fmt: skip
        self.tracker.sendto(json.dumps(told).encode(), ("127.0.0.1", self.port))

    def close(self) -> None:
        """Listen no more."""
        with contextlib.suppress(OSError):  # wakes a server that waits for a client
            self.socket.shutdown(socket.SHUT_RDWR)
        self.socket.close()
        self.tracker.close()
        self.path.unlink(missing_ok=True)
        self.notes.unlink(missing_ok=True)


def paces(seconds: Sequence[float]) -> str:
    """Say how long a client took for its answers, s; inf: it gave none in time."""
    given = np.array([each for each in seconds if np.isfinite(each)])
    if not given.size:
        return "no answers while it had power"
    middle, tail, longest = 1e3 * np.quantile(given, [0.5, 0.999, 1.0])
    return (
        f"{len(given)} answers, {middle:.1f} ms in the middle, {tail:.1f} ms for "
        f"99.9 %, {longest:.1f} ms at most; {len(seconds) - len(given)} frames without"
    )
