"""Somebody who looks after the robot between runs, and gets it up with them."""

from __future__ import annotations

from typing import Any, Protocol

from gatjax.hardware.frames import Frame
from gatjax.hardware.session import Session

Array = Any

GET_UP = "hold the robot by its torso, press its chest button (or Enter): it gets up"
WALKS = "put it on its feet, press its chest button (or Enter): it walks"
MOVES = "put it where it plays, press its chest button (or Enter): it moves"


class Attendant(Protocol):
    """Who looks after the robot between runs; asked once a frame, it never waits."""

    def ready(self, what: str, frame: Frame) -> bool:
        """Return whether somebody has done `what`."""
        ...

    def distance(self, run: int) -> float | None:
        """Return how far the robot walked, m; asked where nothing measures it."""
        ...

    def here(self) -> bool:
        """Return whether there is somebody to ask for a distance."""
        ...

    def say(self, text: str) -> None:
        """Tell what happens."""
        ...


def put_up(session: Session, pose: Array, attendant: Attendant, what: str) -> None:
    """Let a robot get up into a pose [J] rad, and somebody do `what` with it.

    Raises:
        Stopped, KeyboardInterrupt, Lost: see `Session.run_out`.
    """
    placed = session.link.place()
    session.take(1.0 if placed else 0.0)  # what a simulator puts down stands already
    session.wait(lambda frame: placed or attendant.ready(GET_UP, frame), 0.0)
    session.prepare(pose)
    session.wait(lambda frame: placed or attendant.ready(what, frame))
