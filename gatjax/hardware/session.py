"""A robot under guard: it gets up, goes by itself and comes to rest."""

from __future__ import annotations

import time
from typing import Any, Callable, NamedTuple, Optional

import numpy as np

from gatjax.hardware.frames import BadFrame, Command, Frame, Link, Lost
from gatjax.hardware.guard import FELL, Guard, Mode, Stage
from gatjax.hardware.log import BETWEEN, Log
from gatjax.records import Base, Reading
from gatjax.robot import nao

Array = Any
Mover = Callable[[Reading], Optional[Array]]
"""Reading -> targets [J] rad, or None if there are none in time."""

OPENING = 3.0  # s that the first frame may take
WAITS = 20.0  # s that a robot which waits for answers may take for a frame
FRAME, LATE = 1.0, 1.5  # periods to the frame after a missing one, to any other
RISE = 1.0  # rad/s on the way to the first pose
INTERRUPTED = "Ctrl-C was pressed"
LOOK = "look whether it has crouched"
GONE = 1.0  # s without a frame after which nobody knows how the robot is


class Stopped(RuntimeError):
    """A run was ended early: the line says why; the robot has crouched or lies."""


class Row(NamedTuple):
    """One frame of a run and its answer."""

    time: float  # s, the robot's clock
    command: Array  # [J] rad
    reading: Reading
    base: Base | None


def first_frame(link: Link) -> Frame:
    """Wait for a frame that can be read.

    Raises:
        Lost: one line: there is none.
    """
    patience = OPENING if link.realtime else WAITS
    deadline = time.monotonic() + patience
    while time.monotonic() < deadline:
        try:
            frame = link.receive(deadline - time.monotonic())
        except BadFrame:
            frame = None
        if frame is not None and np.isfinite(frame.reading.angle).all():
            return frame
        if not link.realtime:  # it waits for an answer
            link.send(Command(0.5 * (nao.LOW + nao.HIGH), np.zeros(len(nao.LOW))))
    raise Lost(
        f"{link.name}: connected, but no frame that can be read in {patience:g} s; "
        f"{link.hint}"
    )


class Session:
    """Holds one robot; see the module."""

    def __init__(self, link: Link) -> None:
        """Take over a robot that has no power.

        Raises:
            Lost: it sends no frame that can be read.
        """
        self.link = link
        self.log: Log | None = None
        self.run = BETWEEN
        self.interrupted = False
        self._told = 0  # commands so far
        self._silent = 0  # periods in a row without a frame that can be read
        self.take()

    def take(self, share: float = 0.0) -> None:
        """Take over the robot as it is now, with a share of its power.

        Raises:
            Lost: it sends no frame that can be read.
            KeyboardInterrupt: Ctrl-C was pressed before.
        """
        self.frame = first_frame(self.link)
        self._due = self._after(LATE)
        self.guard = Guard(self.frame, self.link)
        self.guard.share = share
        self._tell(self.guard.sent, share)
        self._check()

    def _after(self, periods: float) -> float:
        """Return this computer's time some periods from now, s."""
        return time.monotonic() + periods * self.link.period

    def step(self, mover: Mover | None, power: float = 1.0) -> Row | None:
        """Take a frame and answer it; None if none came that can be acted upon.

        A robot that goes on by itself is told something each period, frame or none.
        """
        frame = self._frame()
        self._silent = self._silent + 1 if frame is None else 0
        reading = self.guard.see(frame)
        wanted = self.guard.sent if mover is None else None
        if mover and reading is not None and self.guard.mode is Mode.FOLLOW:
            wanted = mover(reading)
        command = self._tell(wanted, power)
        if reading is None or frame is None:
            return None
        self.frame = frame
        if self.log is not None:
            self.log.add(self.run, frame, command, time.monotonic())
        return Row(frame.time, command.target, reading, frame.base)

    def _tell(self, wanted: Array | None, power: float) -> Command:
        """Tell the robot what the guard makes of a wish."""
        command = self.guard.command(wanted, power)
        self.link.send(command)
        self._told += 1
        return command

    def _frame(self) -> Frame | None:
        """Return the next frame, None if it does not come in time or cannot be read."""
        realtime = self.link.realtime
        wait = max(0.0, self._due - time.monotonic()) if realtime else WAITS
        try:
            frame = self.link.receive(wait)
        except BadFrame:
            self._due = self._after(LATE)
            return None
        if frame is None and not realtime:
            raise Lost(f"{self.link.name}: silent for {wait:g} s; {self.link.hint}")
        self._due = self._after(FRAME if frame is None else LATE)
        return frame

    def prepare(self, pose: Array) -> None:
        """Bring the robot to a pose [J] rad, slowly, with its power rising.

        Raises:
            Stopped, KeyboardInterrupt: see `run_out`.
        """
        self.guard.enter(Stage.RISES)
        start, share = self.guard.sent, 0.0
        seconds = max(1.0, float(np.abs(pose - start).max()) / RISE)

        def rise(reading: Reading) -> Array:
            del reading
            return start + (pose - start) * min(share, 1.0)

        while share < 1.0 and self.guard.mode is Mode.FOLLOW:
            share += self.link.period / seconds
            self.step(rise)
        self._check()

    def wait(self, ready: Callable[[Frame], bool], power: float = 1.0) -> None:
        """Keep the pose, or lie without power, until somebody is ready.

        Raises:
            Stopped, KeyboardInterrupt: see `run_out`.
        """
        self.guard.enter(Stage.WAITS)
        while self.guard.mode is Mode.FOLLOW and not ready(self.frame):
            self.step(None, power)
        self._check()

    def last(self, seconds: float, mover: Mover) -> None:
        """Let a mover go on for a time, while all is well."""
        for _ in range(round(seconds / self.link.period)):
            if self.guard.mode is not Mode.FOLLOW:
                return
            self.step(mover)

    def run_out(
        self, go: Callable[[], None], end: Callable[[], None]
    ) -> tuple[bool, Exception | None]:
        """Let the robot go by itself, come to an end and to rest.

        Args:
            go: what is asked of it; when that is done, it counts.
            end: how it comes to an end.

        Returns:
            Whether it fell, and what went wrong after it was done: not to be lost, but
            to be raised as soon as what was done is safe.

        Raises:
            Stopped, KeyboardInterrupt: it was not done. The robot is safe.
            Lost: it was not done, and the robot is gone.
        """
        self.guard.enter(Stage.WALKS)
        why: str | None = None
        late: Exception | None = None
        try:
            try:
                go()
                why = self.guard.why
                end()
            finally:
                self.rest()
        except Exception as error:
            if why is None and isinstance(error, Lost):
                raise Lost(f"{error}: {LOOK}") from error
            if why is None:
                raise
            late = error
        if why and why != FELL:
            self._raise()
        if late is None and self.guard.wanted and not self.interrupted:
            late = Stopped(f"stopped, since {self.guard.wanted}")
        return why == FELL, late

    def rest(self) -> None:
        """Let the robot crouch, and take its power off, whatever goes wrong meanwhile.

        Raises:
            Lost: the robot is gone.
        """
        self.guard.stop("")
        self.run = BETWEEN  # its power goes: no recording of a run should hold that
        trouble: Exception | None = None
        while self.guard.mode is not Mode.RELEASED:
            told = self._told
            try:
                self.step(None, 0.0)
            except Lost:
                raise
            except Exception as error:  # of ours: it must not drop the robot
                trouble = trouble or error
                if self._told == told:
                    if self.link.realtime:
                        time.sleep(self.link.period)
                    self._tell(None, 0.0)
        if trouble is not None:
            raise trouble

    def stop(self, at_once: bool) -> str:
        """Let somebody who ends this process end what the robot does; say how."""
        self.interrupted = True
        if self.guard.share <= 0.0:
            told = "it has no power, and gets none"
        elif at_once:
            told = "its power is off"
        else:
            told = "it crouches; another Ctrl-C takes its power at once: hold it then"
        self.guard.stop(INTERRUPTED, Mode.LIMP if at_once else Mode.CROUCH)
        return told

    def _check(self) -> None:
        """Bring a robot to rest that must not go on, and say why."""
        if self.interrupted or self.guard.why:
            self.rest()
            self._raise()

    def _raise(self) -> None:
        """Say why the robot must not go on, and that it may not have heard so."""
        if self.interrupted and self.guard.why in ("", INTERRUPTED):
            raise KeyboardInterrupt
        why = self.guard.why
        if self._silent * self.link.period > GONE:
            why += f"; nothing has come since: {LOOK}"
        if self.interrupted:
            raise KeyboardInterrupt(why)
        raise Stopped(f"stopped, since {why}")
