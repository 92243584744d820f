"""Hardware as a robot of the loop: it walks policies and plays motions one by one."""

from __future__ import annotations

from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any, Callable, Iterator, Protocol, Sequence

import numpy as np

from gatjax import task as tasks
from gatjax.files import make_folder
from gatjax.hardware.frames import Frame, Lost
from gatjax.hardware.kept import keep, kept
from gatjax.hardware.links import open_link
from gatjax.hardware.log import BETWEEN, Log
from gatjax.hardware.mind import Mind
from gatjax.hardware.session import Row, Session, Stopped, Walk
from gatjax.motions import Limbs, standing_nao
from gatjax.records import Base, Outcome, Reading, Trajectory
from gatjax.task import Task

Array = Any

TAKEN = 1.0  # s without power in which somebody takes the robot away


class Attendant(Protocol):
    """Who looks after the robot between runs."""

    def ready(self, run: int, frame: Frame) -> bool:
        """Return whether the robot stands where it should, before a run."""
        ...

    def distance(self, run: int) -> float:
        """Return how far the robot walked, m; asked where nothing measures it."""
        ...

    def say(self, text: str) -> None:
        """Tell what happens."""
        ...


class Hardware:
    """A robot behind a link; see `gatjax.surrogate.Robot` for what it offers."""

    def __init__(self, address: str, folder: Path, attendant: Attendant) -> None:
        """Look whether a robot is there; `folder` gets its frames and finished walks.

        Raises:
            ValueError, Lost: see `links.open_link`.
        """
        self.address, self.folder, self.attendant = address, folder, attendant
        link = open_link(address)
        self.name, self.period = link.name, link.period
        link.close()
        self._runs = 0

    def constants(self) -> dict[str, Any]:
        """Return what `robot.json` says about this robot."""
        return {"address": self.address, "period_s": self.period}

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
        asked = list(zip(np.asarray(policies, float), seeds))
        walks = [kept(self.folder, policy, seed, task) for policy, seed in asked]
        if all(walk is not None for walk in walks):
            return stacked(walks)
        with self._session() as session:
            for number, (policy, seed) in enumerate(asked):
                if walks[number] is not None:
                    continue
                walk = kept(self.folder, policy, seed, task)  # asked for twice
                if walk is None:
                    self.attendant.say(f"walk {number + 1} of {len(asked)}")
                    walk = self._walked(session, policy, task)
                    keep(self.folder, policy, seed, task, walk)
                walks[number] = walk
        return stacked(walks)

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
                walk = self._run(
                    session, target[0], lambda target=target: session.play(target)
                )
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
            base = session.frame.base is not None
            session.log = Log(self.folder, self.name, self.period, base)
            with closing(session.log), session.interruptible():
                try:
                    yield session
                finally:  # whatever went wrong, the robot must not be left with power
                    with suppress(Lost):
                        session.rest()

    def _walked(
        self, session: Session, policy: Array, task: Task
    ) -> tuple[Trajectory, Outcome]:
        """Walk once."""
        mind = Mind(task, policy)  # before the robot has power: it takes a moment
        try:
            pose = tasks.pose(policy)
            walk = self._run(session, pose, lambda: session.walk(mind, task))
        finally:
            mind.close()
        outcome = walk.outcome
        if outcome is None:
            velocity = self.attendant.distance(self._runs - 1) / task.duration
            fell = bool(np.isfinite(walk.fell_at))
            cost = -velocity + (task.fall_penalty if fell else 0.0)
            outcome = Outcome(cost, velocity, walk.fell_at, True)
        return padded(walk.rows, task.ticks, self.period), outcome

    def _run(self, session: Session, pose: Array, run: Callable[[], Walk]) -> Walk:
        """Bring the robot to its start, have it put down, and let it run."""
        number, self._runs = self._runs, self._runs + 1
        placed = session.link.place()
        if not placed:
            session.idle(TAKEN)
        session.prepare(pose)
        session.hold(lambda frame: placed or self.attendant.ready(number, frame))
        session.run = number
        try:
            walk = run()
        finally:
            session.run = BETWEEN
        if not walk.rows:
            raise Stopped("the robot fell before the run began")
        return walk


class HungHardware(Hardware):
    """The same robot, hung up by its torso: it plays motions and cannot fall."""

    def limbs(self) -> Limbs:
        """Return what a motion must know of it."""
        return standing_nao()._replace(floating=False)


def padded(rows: list[Row], ticks: int, period: float) -> Trajectory:
    """Turn the rows of a run into a Trajectory [ticks, ...].

    The last row is repeated, not alive, where there are no more.
    """
    rows = rows[:ticks]
    index = np.minimum(np.arange(ticks), len(rows) - 1)
    time = np.array([row.time for row in rows]) - rows[0].time
    after = np.maximum(np.arange(ticks) - len(rows) + 1, 0) * period
    readings = zip(*(row.reading for row in rows))
    return Trajectory(
        time=time[index] + after,
        command=np.stack([row.command for row in rows])[index],
        reading=Reading(*(np.stack(part)[index] for part in readings)),
        base=_bases([row.base for row in rows], index),
        alive=np.arange(ticks) < len(rows),
    )


def _bases(bases: list[Base | None], index: Array) -> Base:
    """Stack where the robot was; NaN where nobody knows."""
    unknown = Base(np.full(3, np.nan), np.full(4, np.nan))
    known = [unknown if base is None else base for base in bases]
    return Base(*(np.stack(part)[index] for part in zip(*known)))


def stacked(records: Sequence[Any]) -> Any:
    """Stack equal records along a new first axis."""
    first = records[0]
    if isinstance(first, tuple):
        parts = (stacked(part) for part in zip(*records))
        return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)
    return np.stack([np.asarray(record) for record in records])
