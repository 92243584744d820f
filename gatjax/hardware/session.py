"""A robot under guard: it gets up, walks or plays a motion, and comes to rest."""

from __future__ import annotations

import gc
import signal
import sys
import time
from contextlib import contextmanager
from typing import Any, Callable, Iterator, NamedTuple, Optional

import numpy as np

from gatjax import task as tasks
from gatjax.hardware.frames import BadFrame, Command, Frame, Link, Lost
from gatjax.hardware.guard import FELL, LIMITS, Guard, Limits, Mode, Stage
from gatjax.hardware.log import BETWEEN, Log
from gatjax.hardware.mind import Mind
from gatjax.records import Base, Outcome, Reading
from gatjax.robot import nao
from gatjax.task import Task

Array = Any
Mover = Callable[[Reading], Optional[Array]]
"""Reading -> targets [J] rad, or None if there are none in time."""

OPENING = 3.0  # s that the first frame may take
WAITS = 20.0  # s that a robot which waits for answers may take for a frame
FRAME, LATE = 1.0, 1.5  # periods to the frame after a missing one, to any other
SWITCH = 5e-4  # s that another thread may keep Python from the loop; else 5 ms
RISE = 1.0  # rad/s on the way to the first pose
STEADY = 0.5  # s in which a motion's first pose is held
HALT = 1.0  # s in which a walk comes to a stand
PRESSES = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT]
"""Ctrl-C, a kill, a terminal or ssh connection that is gone, Ctrl-\\: all the same."""
SLEEPS = [signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU]
"""What would stop this process, and leave the robot alone."""


class Stopped(RuntimeError):
    """A run was ended early: the line says why; the robot has crouched or lies."""


class Row(NamedTuple):
    """One frame of a run and its answer."""

    time: float  # s, the robot's clock
    command: Array  # [J] rad
    reading: Reading
    base: Base | None


class Walk(NamedTuple):
    """One walk: its rows, and the verdict as far as anybody saw it."""

    rows: list[Row]
    fell_at: float  # s after the walk request, inf if it stood
    outcome: Outcome | None  # None where nothing measures where the robot is


@contextmanager
def unhindered() -> Iterator[None]:
    """Let neither the log's thread nor the garbage collector hold the loop up.

    A collection takes 80 ms with all that gatjax loads; so it leaves that alone.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH)
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(before)


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

    def __init__(self, link: Link, limits: Limits = LIMITS) -> None:
        """Take over a robot that has no power.

        Raises:
            Lost: it sends no frame that can be read.
        """
        self.link, self.limits = link, limits
        self.log: Log | None = None
        self.run = BETWEEN
        self.interrupted = False
        self.take()

    def take(self, share: float = 0.0) -> None:
        """Take over the robot as it is now, with a share of its power.

        Raises:
            Lost: it sends no frame that can be read.
            KeyboardInterrupt: Ctrl-C was pressed before.
        """
        self.frame = first_frame(self.link)
        self._due = self._after(LATE)
        self.guard = Guard(self.frame, self.link, self.limits)
        self.guard.share = share
        self.link.send(self.guard.command(self.guard.sent, share))
        self._check()

    def _after(self, periods: float) -> float:
        """Return this computer's time some periods from now, s."""
        return time.monotonic() + periods * self.link.period

    def step(self, mover: Mover | None, power: float = 1.0) -> Row | None:
        """Take a frame and answer it; None if none came that can be acted upon.

        A robot that goes on by itself is told something each period, frame or none.
        """
        frame = self._frame()
        reading = self.guard.see(frame)
        wanted = self.guard.sent if mover is None else None
        if mover and reading is not None and self.guard.mode is Mode.FOLLOW:
            wanted = mover(reading)
        command = self.guard.command(wanted, power)
        self.link.send(command)
        if reading is None or frame is None:
            return None
        self.frame = frame
        if self.log is not None:
            self.log.add(self.run, frame, command, time.monotonic())
        return Row(frame.time, command.target, reading, frame.base)

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
            Stopped, KeyboardInterrupt: see `walk`.
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
            Stopped, KeyboardInterrupt: see `walk`.
        """
        self.guard.enter(Stage.WAITS)
        while self.guard.mode is Mode.FOLLOW and not ready(self.frame):
            self.step(None, power)
        self._check()

    def walk(self, mind: Mind, task: Task) -> Walk:
        """Walk once with a mind; the robot stands ready, and rests at the end.

        Raises:
            Stopped: something was wrong; the line says what. The robot is safe.
            KeyboardInterrupt: Ctrl-C was pressed. The robot is safe.
            Lost: the robot is gone.
        """
        walking = False

        def mover(reading: Reading) -> Array | None:
            return mind.ask(reading, walking, self.link.thinking)

        go = round(task.settle / task.control_period)
        last = go + round(task.duration / task.control_period)
        rows: list[Row] = []
        score, why = None, ""
        self.guard.enter(Stage.WALKS)
        try:
            for tick in range(last + 1):
                walking = tick >= go
                row = self.step(mover)
                if self.guard.mode is not Mode.FOLLOW:
                    break
                if row is not None:
                    rows.append(row)
                    score = self._score(task, go, rows, score)
            why, walking = self.guard.why, False
            self._for(HALT, mover)
        finally:
            self.rest()
        fell = why == FELL
        if why and not fell:
            self._check()
        last_tick = self._tick(rows) if rows else 0
        fell_at = (last_tick - go) * task.control_period if fell else np.inf
        if fell and score is not None:  # the guard may see it first
            score = score._replace(fell_at=np.minimum(score.fell_at, fell_at))
        if score is None or not _seen(rows, go * task.control_period):
            return Walk(rows, fell_at, None)
        return Walk(rows, fell_at, tasks.outcome(task, score))

    def _tick(self, rows: list[Row]) -> int:
        """Number of the last row, counted with frames that were lost."""
        return round((rows[-1].time - rows[0].time) / self.link.period)

    def _score(self, task: Task, go: int, rows: list[Row], score: Any) -> Any:
        """Follow the verdict where something measures where the robot is."""
        base = rows[-1].base
        if base is None:
            return score
        score = tasks.open_score(base) if score is None else score
        tick = np.asarray(self._tick(rows))
        score = tasks.keep_score(task, np.asarray(go), tick, score, base)
        if np.isfinite(score.fell_at):
            self.guard.stop(FELL)  # a crouch: a tilt alone takes the power at once
        return score

    def play(self, targets: Array) -> Walk:
        """Follow targets [T, J] rad from the first one, where the robot is.

        Raises:
            Stopped: something was wrong; the line says what.
            Lost: the robot is gone.
        """
        rows: list[Row] = []
        why = ""
        self.guard.enter(Stage.WALKS)
        try:
            self._for(STEADY, lambda reading: targets[0])
            for target in targets:
                row = self.step(lambda reading, target=target: target)
                if self.guard.mode is not Mode.FOLLOW:
                    break
                if row is not None:
                    rows.append(row)
            why = self.guard.why
        finally:
            self.rest()
        if why and why != FELL:
            self._check()
        fell_at = self.link.period * len(rows) if why == FELL else np.inf
        return Walk(rows, fell_at, None)

    def _for(self, seconds: float, mover: Mover) -> None:
        """Let a mover go on for a time, while all is well."""
        for _ in range(round(seconds / self.link.period)):
            if self.guard.mode is not Mode.FOLLOW:
                return
            self.step(mover)

    def rest(self) -> None:
        """Let the robot crouch, and take its power off, whatever goes wrong meanwhile.

        Raises:
            Lost: the robot is gone.
        """
        self.guard.stop("")
        trouble: Exception | None = None
        while self.guard.mode is not Mode.RELEASED:
            try:
                self.step(None, 0.0)
            except Lost:
                raise
            except Exception as error:  # of ours: it must not drop the robot
                trouble = trouble or error
                self.link.send(self.guard.command(None, 0.0))
        if trouble is not None:
            raise trouble

    def _check(self) -> None:
        """Bring a robot to rest that must not go on, and say why."""
        if self.interrupted:
            self.rest()
            raise KeyboardInterrupt
        if self.guard.why:
            self.rest()
            raise Stopped(f"stopped, since {self.guard.why}")

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """Let Ctrl-C bring the robot to rest first; a second one takes its power."""

        def stop(number: int, place: Any) -> None:
            del number, place
            again, self.interrupted = self.interrupted, True
            self.guard.stop("Ctrl-C was pressed", Mode.LIMP if again else Mode.CROUCH)

        before = {number: signal.signal(number, stop) for number in PRESSES}
        before.update({n: signal.signal(n, signal.SIG_IGN) for n in SLEEPS})
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def _seen(rows: list[Row], settle: float) -> bool:
    """Return whether somebody saw where the robot set off and where it ended."""
    began = [row.base for row in rows if row.time - rows[0].time <= settle]
    return bool(began) and began[-1] is not None and rows[-1].base is not None
