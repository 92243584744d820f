"""Who looks after the robot: a person at a terminal, or the button on its chest."""

from __future__ import annotations

import math
import os
import select
import sys

import numpy as np

from gatjax.hardware.frames import Frame
from gatjax.hardware.guard import LIMITS

MOST = 20  # lines that are read in one frame
AT_ONCE = 512  # bytes that any terminal takes whose queue is not full
HELD = 0.1  # s that a button is down when somebody presses it


class Terminal:
    """Asks for what only a person can do; an `attendant.Attendant`.

    It never waits: the robot is looked after meanwhile.
    """

    def __init__(self) -> None:
        """Ask nothing yet."""
        self._asked = ""
        self._up = False  # the button was, since it was asked for
        self._pressed = 0.0  # s, the robot's clock: it is down since
        self._typed, self._unsaid = b"", b""

    def ready(self, what: str, frame: Frame) -> bool:
        """Return whether the button was pressed, or Enter, since `what` was asked."""
        self._ask(what)
        done = "" in self._lines() or self._button(frame)
        if done:
            self._asked = ""
        return done

    def _button(self, frame: Frame) -> bool:
        """Return whether somebody holds the button of an upright robot down."""
        lies = np.abs(frame.tilt).max() > LIMITS.tilt  # its button on the floor, maybe
        if not frame.chest or lies:
            self._up, self._pressed = not frame.chest, frame.time
            return False
        return self._up and frame.time - self._pressed >= HELD

    def distance(self, run: int) -> float | None:
        """Return how far the robot walked, m; None until somebody says it."""
        what = f"walk {run + 1}: how far towards the target, in cm?"
        self._ask(what)
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
        self._unsaid += f"{text}\n".encode()
        self._say_on()

    def _say_on(self) -> None:
        """Write what the terminal takes now: Ctrl-S, or a slow line, holds nobody."""
        if sys.stderr is None:  # nobody listens
            self._unsaid = b""
            return
        try:
            place = sys.stderr.fileno()
        except (OSError, ValueError):  # no file: a notebook, say
            print(self._unsaid.decode(), end="", file=sys.stderr)
            self._unsaid = b""
            return
        try:
            while self._unsaid and select.select([], [place], [], 0.0)[1]:
                self._unsaid = self._unsaid[os.write(place, self._unsaid[:AT_ONCE]) :]
        except OSError:  # the terminal is gone; the robot is not
            self._unsaid = b""

    def _ask(self, what: str) -> None:
        """Ask once, and forget what was typed or pressed before."""
        if what != self._asked:
            self.say(what)
            self._lines()
            self._asked, self._typed, self._up = what, b"", False
        self._say_on()

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
