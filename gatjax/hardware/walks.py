"""What a robot does by itself: a walk with a mind, or a motion."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gatjax import task as tasks
from gatjax.hardware.guard import FELL, Mode
from gatjax.hardware.mind import Mind
from gatjax.hardware.session import Row, Session
from gatjax.records import Base, Outcome, Reading
from gatjax.task import Task

Array = Any

STEADY = 0.5  # s in which a motion's first pose is held
HALT = 1.0  # s in which a walk comes to a stand


class Walk(NamedTuple):
    """One walk: its rows, and the verdict as far as anybody saw it."""

    rows: list[Row]
    fell_at: float  # s after the walk request, inf if it stood
    outcome: Outcome | None  # None where nothing measures where the robot is
    late: Exception | None = None  # what went wrong after it was done


class Verdict:
    """Follows the score of a walk where something measures where the robot is."""

    def __init__(self, task: Task) -> None:
        """Begin; the walk is requested when the robot has settled."""
        self.task = task
        self.go = round(task.settle / task.control_period)
        self.score: tasks.Score | None = None
        self._doubt: Base | None = None  # a fall that was seen once

    def tick(self, rows: list[Row]) -> int:
        """Number of the last row, counted with frames that were lost."""
        return round((rows[-1].time - rows[0].time) / self.task.control_period)

    def follow(self, rows: list[Row]) -> bool:
        """Look at the last row; return whether the robot has fallen.

        A fall that a single word of motion capture says is none.
        """
        base = rows[-1].base
        if base is None:
            return False
        if tasks.fallen(base):
            once = self._doubt is None or base is self._doubt
            self._doubt = base
            if once:
                return False
        else:
            self._doubt = None
        score = tasks.open_score(base) if self.score is None else self.score
        go, tick = np.asarray(self.go), np.asarray(self.tick(rows))
        self.score = tasks.keep_score(self.task, go, tick, score, base)
        return bool(np.isfinite(self.score.fell_at))

    def walk(self, rows: list[Row], fell: bool, late: Exception | None) -> Walk:
        """Judge a walk that is done."""
        ended = (self.tick(rows) - self.go) * self.task.control_period if rows else 0.0
        fell_at = ended if fell else np.inf
        score = self.score
        if score is None or not _seen(rows, self.go * self.task.control_period):
            return Walk(rows, fell_at, None, late)
        # The guard may see a fall first.
        score = score._replace(fell_at=np.minimum(score.fell_at, fell_at))
        return Walk(rows, fell_at, tasks.outcome(self.task, score), late)


def walk(session: Session, mind: Mind, task: Task) -> Walk:
    """Walk once with a mind; the robot stands ready, and rests at the end.

    Raises:
        Stopped, KeyboardInterrupt, Lost: see `Session.run_out`.
    """
    walking = False
    rows: list[Row] = []
    verdict = Verdict(task)

    def mover(reading: Reading) -> Array | None:
        return mind.ask(reading, walking, session.link.thinking)

    def go() -> None:
        nonlocal walking
        for tick in range(verdict.go + round(task.duration / task.control_period) + 1):
            walking = tick >= verdict.go
            row = session.step(mover)
            if session.guard.mode is not Mode.FOLLOW:
                break
            if row is None:
                continue
            rows.append(row)
            if verdict.follow(rows):
                session.guard.stop(FELL)  # a crouch: a tilt alone takes the power
        walking = False

    fell, late = session.run_out(go, lambda: session.last(HALT, mover))
    return verdict.walk(rows, fell, late)


def play(session: Session, targets: Array) -> Walk:
    """Follow targets [T, J] rad from the first one, where the robot is.

    Raises:
        Stopped, KeyboardInterrupt, Lost: see `Session.run_out`.
    """
    rows: list[Row] = []

    def go() -> None:
        session.last(STEADY, lambda reading: targets[0])
        for target in targets:
            row = session.step(lambda reading, target=target: target)
            if session.guard.mode is not Mode.FOLLOW:
                return
            if row is not None:
                rows.append(row)

    fell, late = session.run_out(go, lambda: None)
    fell_at = session.link.period * len(rows) if fell else np.inf
    return Walk(rows, fell_at, None, late)


def _seen(rows: list[Row], settle: float) -> bool:
    """Return whether somebody saw where the robot set off and where it ended."""
    began = [row.base for row in rows if row.time - rows[0].time <= settle]
    return bool(began) and began[-1] is not None and rows[-1].base is not None
