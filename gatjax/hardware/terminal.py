"""Who looks after the robot: a person at a terminal, or the button on its chest."""

from __future__ import annotations

import math
import os
import select
import sys

from gatjax.hardware.frames import Frame

MOST = 20  # lines that are read in one frame


class Terminal:
    """Asks for what only a person can do; a `robot.Attendant`.

    It never waits: the robot is looked after meanwhile.
    """

    def __init__(self) -> None:
        """Ask nothing yet."""
        self._asked = ""
        self._down = False
        self._typed = b""

    def ready(self, what: str, frame: Frame) -> bool:
        """Return whether the button was pressed, or Enter, since `what` was asked."""
        if what != self._asked:
            self._ask(what)
            self._asked, self._down = what, True
        pressed, self._down = frame.chest and not self._down, frame.chest
        done = pressed or "" in self._lines()
        self._asked = "" if done else what
        return done

    def distance(self, run: int) -> float | None:
        """Return how far the robot walked, m; None until somebody says it."""
        what = f"walk {run + 1}: how far towards the target, in cm?"
        if what != self._asked:
            self._ask(what)
            self._asked = what
        for line in self._lines():
            try:
                centimetres = float(line)
            except ValueError:
                centimetres = math.nan
            if math.isfinite(centimetres):
                self._asked = ""
                return centimetres / 100.0
            self.say(f"{line!r} is no number of centimetres")
        return None

    def here(self) -> bool:
        """Return whether there is somebody to ask."""
        return sys.stdin is not None and sys.stdin.isatty()

    def say(self, text: str) -> None:
        """Tell something."""
        try:
            print(text, file=sys.stderr, flush=True)
        except OSError:  # the terminal is gone; the robot is not
            pass

    def _ask(self, what: str) -> None:
        """Ask, and forget what was typed before."""
        self.say(what)
        self._lines()
        self._typed = b""

    def _lines(self) -> list[str]:
        """Take the whole lines that were typed."""
        try:
            for _ in range(MOST):
                if not self.here() or not select.select([sys.stdin], [], [], 0.0)[0]:
                    break
                self._typed += os.read(sys.stdin.fileno(), 4096)  # a line at a time
        except (OSError, ValueError):  # it is gone
            return []
        *lines, self._typed = self._typed.split(b"\n")
        return [line.decode(errors="replace").strip() for line in lines]
