"""Who looks after the robot: a person at a terminal, or the button on its chest."""

from __future__ import annotations

import select
import sys

from gatjax.hardware.frames import Frame


class Terminal:
    """Asks for what only a person can do; a `robot.Attendant`."""

    def __init__(self) -> None:
        """Ask nothing yet."""
        self._asked = -1
        self._down = False

    def ready(self, run: int, frame: Frame) -> bool:
        """Return whether the button was pressed, or Enter, since it was asked for."""
        if run != self._asked:
            self._asked, self._down = run, True
            self.say("robot is up: put it on its feet, then press its chest button")
            _typed()
        pressed, self._down = frame.chest and not self._down, frame.chest
        return pressed or _typed()

    def distance(self, run: int) -> float:
        """Ask how far the robot walked, m."""
        while True:
            told = input(f"walk {run + 1}: how far towards the target, in cm? ")
            try:
                return float(told) / 100.0
            except ValueError:
                self.say(f"{told!r} is no number")

    def say(self, text: str) -> None:
        """Tell something."""
        print(text, file=sys.stderr, flush=True)


def _typed() -> bool:
    """Return whether Enter was pressed, and take it away."""
    if not sys.stdin or not sys.stdin.isatty():
        return False
    if not select.select([sys.stdin], [], [], 0.0)[0]:
        return False
    sys.stdin.readline()
    return True
