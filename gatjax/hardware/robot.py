"""Hardware as a robot of the loop: it walks policies and plays motions one by one."""

from __future__ import annotations

from contextlib import closing, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, Callable, Iterator, Sequence

import numpy as np

from gatjax import task as tasks
from gatjax.files import make_folder
from gatjax.hardware.attendant import MOVES, WALKS, Attendant, put_up
from gatjax.hardware.batches import judged, padded, stacked
from gatjax.hardware.frames import Frame, Lost
from gatjax.hardware.kept import Entry, Order, keep, kept
from gatjax.hardware.links import open_link
from gatjax.hardware.log import BETWEEN, Log
from gatjax.hardware.mind import Mind
from gatjax.hardware.process import interruptible, unhindered
from gatjax.hardware.session import Session, Stopped, first_frame
from gatjax.hardware.walks import Walk, play, walk
from gatjax.motions import Limbs, standing_nao
from gatjax.records import JOINTS, Base, Outcome, Trajectory
from gatjax.task import Task

Array = Any

FASTEST = 0.5  # m/s, more than any NAO walks
SLOW = 0.5  # of the time for an answer, that the walk engine may need in the middle


class Hardware:
    """A robot behind a link; see `gatjax.surrogate.Robot` for what it offers."""

    base = "floating"  # or fixed: what its logs say

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
        self, policies: Array, seeds: Sequence[int], task: Task = Task(),
        done: Callable[[int], Any] = lambda number: None,
    ) -> tuple[Trajectory, Outcome]:  # fmt: skip
        """Walk policies [N, 15], one after the other.

        A walk that is there already, of the same policy and seed, is not walked again:
        so what was interrupted goes on. `done` hears the number of each that is there.

        Returns:
            Trajectory [N, T, ...] and Outcome [N].

        Raises:
            ValueError: the task has another control rate than the robot.
            Stopped: a run was stopped; the robot is safe, what was walked is kept.
            KeyboardInterrupt: Ctrl-C; the robot is safe.
            Lost: the robot is gone.
        """
        self.check_rate(1.0 / task.control_period)
        orders = self._orders(policies, seeds, task)
        walks = [kept(self.folder, order) for order in orders]
        there = sum(walk is not None for walk in walks)
        if there:
            self.attendant.say(
                f"{there} of {len(walks)} walks are in {self.folder} already"
            )
        if not all(walk is not None and _measured(walk) for walk in walks):
            with self._session() as session:
                for number, order in enumerate(orders):
                    told = f"walk {number + 1} of {len(orders)}"
                    entry = walks[number] or kept(self.folder, order)  # asked twice
                    walks[number] = self._one(session, number, order, entry, told)
                    done(number)
        return stacked(walks)

    def walked(
        self, policies: Array, seeds: Sequence[int], task: Task
    ) -> list[Entry | None]:
        """Return the walks that are there, None where there is none; as for `walk`."""
        orders = self._orders(policies, seeds, task)
        return [kept(self.folder, order) for order in orders]

    def _orders(self, policies: Array, seeds: Sequence[int], task: Task) -> list[Order]:
        return [
            Order(self.identity, policy, int(seed), task)
            for policy, seed in zip(np.asarray(policies, float), seeds)
        ]

    def _one(
        self, session: Session, number: int, order: Order, entry: Entry | None,
        told: str,
    ) -> Entry:  # fmt: skip
        """Return a walk: kept, or walked now; measured, or asked for now."""
        if entry is None:
            self._announce(session, told)
            done = self._walked(session, number, order)
            outcome = done.outcome or judged(order.task, np.nan, done.fell_at)
            entry = padded(done.rows, order.task.ticks, self.period), outcome
            keep(self.folder, order, entry)
            if done.late is not None:
                raise done.late
        if not _measured(entry):
            metres = self._distance(session, number, order.task.duration)
            entry = entry[0], judged(order.task, metres, entry[1].fell_at)
            keep(self.folder, order, entry)
        return entry

    def _distance(self, session: Session, number: int, seconds: float) -> float:
        """Ask how far it walked; the robot lies without power meanwhile."""
        self._check_person(None)
        told: list[float] = []

        def answered(frame: Frame) -> bool:
            del frame
            metres = self.attendant.distance(number)
            if metres is None:
                return False
            if abs(metres) > FASTEST * seconds:
                self.attendant.say(f"{100.0 * metres:g} cm are too far: no NAO does it")
                return False
            told.append(metres)
            self.attendant.say(f"walk {number + 1}: {100.0 * metres:g} cm")
            return True

        session.take()
        session.wait(answered, 0.0)
        return told[0]

    def play(self, targets: Array, rate_hz: float, seeds: Array) -> Trajectory:
        """Follow targets [N, T, J] rad, one run after the other.

        Raises:
            ValueError, Stopped, KeyboardInterrupt, Lost: see `walk`.
        """
        self.check_rate(rate_hz)
        runs = []
        with self._session() as session:
            for number, target in enumerate(targets):
                self._announce(session, f"run {number + 1} of {len(targets)}")
                once = partial(play, session, target)
                done = self._run(session, number, target[0], MOVES, once)
                whole = not np.isfinite(done.fell_at)
                runs.append(padded(done.rows, len(target), self.period, whole))
                if done.late is not None:
                    raise done.late
        return stacked(runs)

    def _announce(self, session: Session, what: str) -> None:
        """Say what comes next, unless somebody wants the end."""
        if session.interrupted:
            raise KeyboardInterrupt
        self.attendant.say(what)

    def check_rate(self, rate_hz: float) -> None:
        """Refuse a control rate that is not the robot's.

        Raises:
            ValueError: one line: the rate to use.
        """
        ours = 1.0 / self.period
        if abs(rate_hz - ours) > 0.1:
            raise ValueError(
                f"{self.name} runs at {ours:.1f} Hz; use --rate-hz {ours:.1f}"
            )

    @contextmanager
    def _session(self) -> Iterator[Session]:
        """Hold the robot while the block runs, with a log of its frames.

        Raises:
            KeyboardInterrupt: whatever was done, somebody wants it to end.
            OSError: one line: rows of the log were lost; the block was done.
        """
        make_folder(self.folder)
        with closing(open_link(self.address)) as link:
            session = Session(link)
            session.log = Log(self.folder, self.name, self.base, self.period)
            try:
                with interruptible(session.stop), unhindered():
                    yield from self._held(session)
            finally:
                session.log.close()
                if session.log.failed is not None:
                    self.attendant.say(str(session.log.failed))
        if session.interrupted:
            raise KeyboardInterrupt
        if session.log.failed is not None:
            raise session.log.failed

    def _held(self, session: Session) -> Iterator[Session]:
        """Let a block have a session; whatever it does, the robot has no power then."""
        try:
            yield session
        except KeyboardInterrupt as pressed:
            if pressed.args:
                self.attendant.say(f"stopped, since {pressed}")
            raise
        finally:
            with suppress(Lost):
                session.rest()

    def _walked(self, session: Session, number: int, order: Order) -> Walk:
        """Walk once."""
        mind = Mind(order.task, order.policy)  # before it has power: it takes a moment
        try:
            session.take()
            session.wait(lambda frame: mind.ready(), 0.0)
            if session.link.realtime:  # before anybody holds it
                self._check_pace(mind, session.link.thinking)
                self._check_person(session.frame.base)
            once = partial(walk, session, mind, order.task)
            return self._run(session, number, tasks.pose(order.policy), WALKS, once)
        finally:
            mind.close()

    def _check_pace(self, mind: Mind, limit: float) -> None:
        """Refuse a computer that is too slow to answer within `limit` s."""
        seconds = np.sort(mind.pace())
        middle, tail = 1e3 * seconds[len(seconds) // 2], 1e3 * seconds[-2]
        if not middle <= SLOW * 1e3 * limit:
            raise ValueError(
                f"the walk engine needs {middle:.1f} ms a frame on this computer and "
                f"has {1e3 * limit:.1f} ms: end what else this computer does"
            )
        if tail > 1e3 * limit:
            self.attendant.say(
                f"one answer of a hundred takes {tail:.0f} ms, {1e3 * limit:.1f} are "
                f"allowed: a walk may be stopped; end what else this computer does"
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
            done = run()
        finally:
            session.run = BETWEEN
        for told in (session.guard.why, *map(_frozen, sorted(session.guard.odd))):
            if told:
                self.attendant.say(told)
        if not done.rows:
            raise Stopped("the robot fell before the run began")
        return done


class HungHardware(Hardware):
    """The same robot, hung up by its torso: it plays motions and cannot fall."""

    base = "fixed"

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


def _measured(walk: Entry) -> bool:
    """Return whether somebody said how far a walk went."""
    return bool(np.isfinite(walk[1].velocity))


def _frozen(sensor: str) -> str:
    return f"{sensor} stood still, though it was told to move: is it broken?"
