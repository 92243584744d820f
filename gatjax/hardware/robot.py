"""Hardware as a robot of the loop: it walks policies and plays motions one by one."""

from __future__ import annotations

from contextlib import closing, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, Callable, Iterator, Protocol, Sequence

import numpy as np

from gatjax import task as tasks
from gatjax.files import make_folder
from gatjax.hardware.batches import judged, padded, stacked
from gatjax.hardware.frames import Frame, Lost
from gatjax.hardware.kept import Order, keep, kept
from gatjax.hardware.links import open_link
from gatjax.hardware.log import BETWEEN, Log
from gatjax.hardware.mind import Mind
from gatjax.hardware.session import (
    Session,
    Stopped,
    Walk,
    first_frame,
    unhindered,
)
from gatjax.motions import Limbs, standing_nao
from gatjax.records import JOINTS, Base, Outcome, Trajectory
from gatjax.task import Task

Array = Any

GET_UP = "hold the robot by its torso, press its chest button (or Enter): it gets up"
WALKS = "put it on its feet, press its chest button (or Enter): it walks"
MOVES = "put it where it plays, press its chest button (or Enter): it moves"
SLOW = 0.5  # of the time for an answer, that the walk engine may need in the middle


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
        Stopped, KeyboardInterrupt, Lost: see `Session.walk`.
    """
    placed = session.link.place()
    session.take(1.0 if placed else 0.0)  # what a simulator puts down stands already
    session.wait(lambda frame: placed or attendant.ready(GET_UP, frame), 0.0)
    session.prepare(pose)
    session.wait(lambda frame: placed or attendant.ready(what, frame))


class Hardware:
    """A robot behind a link; see `gatjax.surrogate.Robot` for what it offers."""

    def __init__(self, address: str, folder: Path, attendant: Attendant) -> None:
        """Look whether a robot is there; `folder` gets its frames and finished walks.

        Raises:
            ValueError, Lost: see `links.open_link`; or the robot is silent.
        """
        self.address, self.folder, self.attendant = address, folder, attendant
        with closing(open_link(address)) as link:
            self.state = said_of(first_frame(link))
            self.name, self.period = link.name, link.period
            self.identity = link.identity

    def constants(self) -> dict[str, Any]:
        """Return what `robot.json` says about this robot."""
        return {
            "address": self.address, "identity": self.identity, "period_s": self.period,
        }  # fmt: skip

    def limbs(self) -> Limbs:
        """Return what a motion must know of it: it stands."""
        return standing_nao()

    def walk(
        self, policies: Array, seeds: Sequence[int], task: Task = Task()
    ) -> tuple[Trajectory, Outcome]:
        """Walk policies [N, 15], one after the other.

        A walk that is there already, of the same policy and seed, is not walked again:
        so what was interrupted goes on.

        Returns:
            Trajectory [N, T, ...] and Outcome [N].

        Raises:
            ValueError: the task has another control rate than the robot.
            Stopped: a run was stopped; the robot is safe, what was walked is kept.
            KeyboardInterrupt: Ctrl-C; the robot is safe.
            Lost: the robot is gone.
        """
        self._check_rate(1.0 / task.control_period)
        orders = [
            Order(self.identity, policy, int(seed), task)
            for policy, seed in zip(np.asarray(policies, float), seeds)
        ]
        walks = [kept(self.folder, order) for order in orders]
        there = sum(walk is not None for walk in walks)
        if there:
            self.attendant.say(
                f"{there} of {len(walks)} walks are in {self.folder} already"
            )
        if not all(walk is not None and _measured(walk) for walk in walks):
            with self._session() as session:
                walks = []
                for number, order in enumerate(orders):
                    told = f"walk {number + 1} of {len(orders)}"
                    walks.append(self._one(session, number, order, told))
        return stacked(walks)

    def _one(
        self, session: Session, number: int, order: Order, told: str
    ) -> tuple[Trajectory, Outcome]:
        """Return a walk: kept, or walked now; measured, or asked for now."""
        walk = kept(self.folder, order)
        if walk is None:
            self.attendant.say(told)
            walk = self._walked(session, number, order)
            keep(self.folder, order, walk)
        if not _measured(walk):
            metres = self._distance(session, number)
            walk = walk[0], judged(order.task, metres, walk[1].fell_at)
            keep(self.folder, order, walk)
        return walk

    def _distance(self, session: Session, number: int) -> float:
        """Ask how far it walked; the robot lies without power meanwhile."""
        self._check_person(None)
        told: list[float] = []

        def answered(frame: Frame) -> bool:
            del frame
            metres = self.attendant.distance(number)
            told.extend([] if metres is None else [metres])
            return bool(told)

        session.take()
        session.wait(answered, 0.0)
        return told[0]

    def play(self, targets: Array, rate_hz: float, seeds: Array) -> Trajectory:
        """Follow targets [N, T, J] rad, one run after the other.

        Raises:
            ValueError, Stopped, KeyboardInterrupt, Lost: see `walk`.
        """
        self._check_rate(rate_hz)
        runs = []
        with self._session() as session:
            for number, target in enumerate(targets):
                self.attendant.say(f"run {number + 1} of {len(targets)}")
                play = partial(session.play, target)
                walk = self._run(session, number, target[0], MOVES, play)
                runs.append(padded(walk.rows, len(target), self.period))
        return stacked(runs)

    def _check_rate(self, rate_hz: float) -> None:
        ours = 1.0 / self.period
        if abs(rate_hz - ours) > 0.1:
            raise ValueError(
                f"{self.name} runs at {ours:.1f} Hz; use --rate-hz {ours:.1f}"
            )

    @contextmanager
    def _session(self) -> Iterator[Session]:
        """Hold the robot while the block runs, with a log of its frames."""
        make_folder(self.folder)
        with closing(open_link(self.address)) as link:
            session = Session(link)
            session.log = Log(self.folder, self.name, self.period)
            with closing(session.log), session.interruptible(), unhindered():
                try:
                    yield session
                finally:  # whatever went wrong, the robot must not be left with power
                    with suppress(Lost):
                        session.rest()

    def _walked(
        self, session: Session, number: int, order: Order
    ) -> tuple[Trajectory, Outcome]:
        """Walk once; the velocity is NaN where nothing measures it."""
        task = order.task
        mind = Mind(task, order.policy)  # before it has power: it takes a moment
        try:
            if session.link.realtime:  # before anybody holds it
                self._check_pace(mind, session.link.thinking)
                self._check_person(session.frame.base)
            once = partial(session.walk, mind, task)
            walk = self._run(session, number, tasks.pose(order.policy), WALKS, once)
        finally:
            mind.close()
        outcome = walk.outcome or judged(task, np.nan, walk.fell_at)
        return padded(walk.rows, task.ticks, self.period), outcome

    def _check_pace(self, mind: Mind, limit: float) -> None:
        """Refuse a computer that is too slow to answer within `limit` s."""
        middle, tail = 1e3 * np.quantile(mind.pace(), [0.5, 0.99])
        if middle > SLOW * 1e3 * limit:
            raise ValueError(
                f"the walk engine needs {middle:.1f} ms a frame on this computer and "
                f"has {1e3 * limit:.1f} ms: end what else this computer does"
            )
        if tail > 1e3 * limit:
            self.attendant.say(
                f"one answer of a hundred takes {tail:.0f} ms, {1e3 * limit:.0f} are "
                f"there: a walk may be stopped; end what else this computer does"
            )

    def _check_person(self, base: Base | None) -> None:
        """Refuse a walk of which nobody can say how far it went."""
        if base is None and not self.attendant.here():
            raise ValueError(
                "nobody can say how far it walks: there is no motion capture, and no "
                "terminal to ask at (ssh -t)"
            )

    def _run(
        self, session: Session, number: int, pose: Array, what: str,
        run: Callable[[], Walk],
    ) -> Walk:  # fmt: skip
        """Bring the robot to its start, and let it run."""
        put_up(session, pose, self.attendant, what)
        session.run = number
        try:
            walk = run()
        finally:
            session.run = BETWEEN
        for told in (session.guard.why, *map(_frozen, sorted(session.guard.odd))):
            if told:
                self.attendant.say(told)
        if not walk.rows:
            raise Stopped("the robot fell before the run began")
        return walk


class HungHardware(Hardware):
    """The same robot, hung up by its torso: it plays motions and cannot fall."""

    def limbs(self) -> Limbs:
        """Return what a motion must know of it."""
        return standing_nao()._replace(floating=False)


def said_of(frame: Frame) -> str:
    """Say in a line how a robot is."""
    hottest = int(np.argmax(frame.temperature))
    return (
        f"battery {100.0 * frame.battery:.0f} %, hottest motor {JOINTS[hottest]} "
        f"{frame.temperature[hottest]:.0f} degC"
    )


def _measured(walk: tuple[Trajectory, Outcome]) -> bool:
    """Return whether somebody said how far a walk went."""
    return bool(np.isfinite(walk[1].velocity))


def _frozen(sensor: str) -> str:
    return f"{sensor} stood still, though it was told to move: is it broken?"
