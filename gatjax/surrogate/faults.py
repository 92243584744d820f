"""A simulated NAO in this process, and what can go wrong between it and a program.

It says and hears the same bytes as `lola.Server`, but without a socket or a clock: a
fault comes at the frame that it was asked for, on any machine.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from gatjax.hardware import messagepack
from gatjax.hardware.attendant import WALKS, put_up
from gatjax.hardware.frames import Command, Frame
from gatjax.hardware.lola import CHEST, ORDER, PERIOD, answer, as_frame, read_frame
from gatjax.hardware.mind import Mind
from gatjax.hardware.session import Session
from gatjax.hardware.terminal import Terminal
from gatjax.surrogate.attended import SimulatedNao, told_by
from gatjax.task import Task, pose
from gatjax.walk.parameters import THETA0

Message = bytes | None
Fault = Callable[["Direct", int, bytes], Message]
"""(link, frames since the fault began, message of the robot) -> what arrives of it."""


class Direct:
    """A link to a simulated NAO; from frame `begin` of a run on, a fault."""

    name = identity = "direct"
    hint = "nobody is there"
    period = PERIOD
    realtime = True
    clocked = False
    thinking = 1.0

    def __init__(
        self, nao: SimulatedNao, fault: Fault | None = None, begin: int = 0
    ) -> None:
        """Take a robot in its hands; the fault begins `begin` frames on its feet."""
        self.nao, self.fault, self.begin = nao, fault, begin
        self.commands: list[Command] = []
        self.late = 0.0  # s that the next frame is late by
        self.history: list[bytes] = []
        self.feet = -1  # frames since the robot was put down
        self._frames = 0

    @property
    def since(self) -> int:
        """Frames since the fault began; negative before."""
        return self.feet - self.begin

    def place(self) -> bool:
        """Leave it to the hands."""
        return False

    def receive(self, timeout: float) -> Frame | None:
        """Return the next frame, as far as the fault lets it through."""
        del timeout
        self._frames += 1
        self.feet = self.feet + 1 if self.nao.machine is not None else -1
        message: Message = messagepack.pack(self.nao.frame())
        self.history.append(message)
        if self.fault is not None and self.since >= 0:
            message = self.fault(self, self.since, message)
        received = self._frames * PERIOD + self.late
        self.late = 0.0
        if message is None:
            return None
        return as_frame(read_frame(message), self._frames * PERIOD, received)

    def send(self, command: Command) -> None:
        """Answer the last frame."""
        self.commands.append(command)
        told = messagepack.unpack(answer(command))
        self.nao.advance(told_by(told, self.nao.told))

    def close(self) -> None:
        """Do nothing: there is no socket."""


def standing(robot: str, fault: Fault | None, begin: int) -> tuple[Session, Direct]:
    """Return a robot on its feet that is ready to walk theta0 into a fault."""
    link = Direct(SimulatedNao(robot, 0, 0), fault, begin)
    session = Session(link)
    put_up(session, pose(THETA0), Terminal(), WALKS)
    return session, link


def started(task: Task, policy: np.ndarray) -> Mind:
    """Return a walk engine that is ready to answer."""
    mind = Mind(task, policy)
    while not mind.ready():
        time.sleep(0.01)
    return mind


def _edited(message: bytes, edit: Callable[[dict[str, Any]], None]) -> bytes:
    """Change what a message says."""
    entries = read_frame(message)
    edit(entries)
    entries["Status"] = [int(level) for level in entries["Status"]]
    return messagepack.pack(entries)


def dropped(count: int) -> Fault:
    """Lose so many frames."""
    return lambda link, since, message: None if since < count else message


def corrupted(count: int) -> Fault:
    """Turn bits over in so many frames."""

    def fault(link: Direct, since: int, message: bytes) -> Message:
        del link
        if since >= count:
            return message
        broken = bytearray(message)
        broken[1] ^= 0xFF
        return bytes(broken[: len(broken) // 2])

    return fault


def late(seconds: float) -> Fault:
    """Let one frame come late."""

    def fault(link: Direct, since: int, message: bytes) -> Message:
        link.late = seconds if since == 0 else 0.0
        return message

    return fault


def earlier(back: int, count: int) -> Fault:
    """Send an old frame again, so many times."""
    return lambda link, since, message: (
        link.history[-1 - back - since] if since < count else message
    )


def swapped(link: Direct, since: int, message: bytes) -> Message:
    """Let a frame come after the one that followed it."""
    return (None, message, link.history[-3])[since] if since < 3 else message


def reads(count: int, edit: Callable[[dict[str, Any]], None]) -> Fault:
    """Let so many frames say something else."""
    return lambda link, since, message: (
        _edited(message, edit) if since < count else message
    )


def frozen(key: str, part: int | slice = slice(None)) -> Fault:
    """Let a sensor say for ever what it said when the fault began."""

    def fault(link: Direct, since: int, message: bytes) -> Message:
        held = read_frame(link.history[-1 - since])[key][part]

        def edit(entries: dict[str, Any]) -> None:
            entries[key][part] = held

        return _edited(message, edit)

    return fault


def _set(key: str, part: int | slice, value: float) -> Callable[[dict[str, Any]], None]:
    def edit(entries: dict[str, Any]) -> None:
        entries[key][part] = value

    return edit


KNEE = ORDER.index("LKneePitch")
FOREVER = 1 << 30

FAULTS: dict[str, tuple[Fault, str]] = {
    "1 frame dropped": (dropped(1), ""),
    "2 frames dropped": (dropped(2), "no frame"),
    "10 frames dropped": (dropped(10), "no frame"),
    "1 frame corrupted": (corrupted(1), ""),
    "2 frames corrupted": (corrupted(2), "no frame"),
    "1 frame 10 ms late": (late(0.010), ""),
    "1 frame 40 ms late": (late(0.040), "52 ms after"),
    "1 frame twice": (earlier(1, 1), ""),
    "2 frames in the wrong order": (swapped, ""),
    "one frame again and again": (earlier(1, FOREVER), "came twice"),
    "NaN knee, 1 frame": (reads(1, _set("Position", KNEE, np.nan)), ""),
    "NaN knee": (reads(FOREVER, _set("Position", KNEE, np.nan)), "not a number"),
    "NaN gyroscope": (reads(FOREVER, _set("Gyroscope", 1, np.nan)), "not a number"),
    "knee reads 1 rad off": (
        reads(FOREVER, _set("Position", KNEE, -1.0)), "LKneePitch cannot be",
    ),
    "knee reading frozen": (frozen("Position", KNEE), "LKneePitch stands still"),
    "gyroscope frozen": (frozen("Gyroscope"), "gyroscope stands still"),
    "battery empty": (reads(FOREVER, _set("Battery", 0, 0.02)), "battery"),
    "knee hot": (reads(FOREVER, _set("Temperature", KNEE, 95.0)), "LKneePitch is hot"),
    "knee very hot, says LoLA": (
        reads(FOREVER, _set("Status", KNEE, 2)), "LKneePitch is hot",
    ),
    "chest button": (reads(20, _set("Touch", CHEST, 1.0)), "chest button"),
}  # fmt: skip
"""What goes wrong, and what the guard should say; nothing: the walk goes on."""
