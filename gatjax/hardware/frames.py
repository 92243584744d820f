"""What goes to and fro between a robot and the program that moves it."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

from gatjax.records import Base, Reading

Array = Any


class Frame(NamedTuple):
    """What a robot reports at one control tick; J as in `records.JOINTS`."""

    time: float  # s, the robot's clock
    received: float  # s, this computer's clock when it arrived
    reading: Reading
    tilt: Array  # [2] rad, roll and pitch of the torso
    stiffness: Array  # [J] share of full power
    temperature: Array  # [J] degC
    current: Array  # [J] A
    heat: Array  # [J] int, 0 normal, 1 hot, 2 very hot, 3 critical
    battery: float  # charge, 0 to 1
    chest: bool  # the button on the chest is down
    base: Base | None = None  # where it is, if something measures that


class Command(NamedTuple):
    """What a robot is told in answer to a frame."""

    target: Array  # [J] rad
    stiffness: Array  # [J] share of full power


class BadFrame(ValueError):
    """A frame came that cannot be read; the next one may be good."""


class Lost(OSError):
    """The robot is gone: one line that says what to do."""


class Link(Protocol):
    """A robot that takes a command for every frame."""

    name: str
    identity: str  # of the robot itself, once a frame was read
    hint: str  # what to do if it is silent
    period: float  # s between frames
    realtime: bool  # False: the robot waits for every answer
    clocked: bool  # frames carry the robot's own clock
    thinking: float  # s that an answer may take

    def place(self) -> bool:
        """Put the robot where a run begins; False: a person has to.

        Raises:
            Lost: the robot is gone.
        """
        ...

    def receive(self, timeout: float) -> Frame | None:
        """Return the next frame, None if `timeout` s pass without one.

        Raises:
            BadFrame: it came, and cannot be read.
            Lost: there will be none.
        """
        ...

    def send(self, command: Command) -> None:
        """Answer the last frame.

        Raises:
            Lost: the robot is gone.
        """
        ...

    def close(self) -> None:
        """Let go of the robot."""
        ...
