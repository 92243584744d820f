"""ROS 2 messages to signals by topic, field and joint.

A message is stamped by its header, by its log time where it has none.
"""

from __future__ import annotations

import math
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from gatjax.data.readers.goals import Goal, followed, goal_of
from gatjax.data.readers.source import Run, Stream
from gatjax.data.spill import Column, mapped

JOINT_STATE, TRAJECTORY = "JointState", "JointTrajectory"
ARRAY, IMU = "Float64MultiArray", "Imu"
KNOWN = {
    "sensor_msgs/JointState": JOINT_STATE,
    "trajectory_msgs/JointTrajectory": TRAJECTORY,
    "std_msgs/Float64MultiArray": ARRAY,
    "sensor_msgs/Imu": IMU,
}
TIME = "time"  # of a group: no signal is called so, they have topics
APART = 1.0  # s between two clocks: more is no delay of messages
AHEAD = 60.0  # s that a trajectory may be stamped ahead


@cache
def kind_of(schema: str) -> str:
    """The short name of a type that is read; package and name of another one."""
    name = f"{schema.partition('/')[0]}/{schema.rpartition('/')[2]}"
    return KNOWN.get(name, name if "/" in schema else schema)


class Collector:
    """Samples of each signal, in the order in which they came, 8 bytes each."""

    def __init__(self) -> None:
        """Nothing is kept yet."""
        self.series: dict[str, dict[str, Column]] = {}  # of each group, TIME first
        self.goals: dict[str, list[Goal]] = {}  # of each topic
        self.kinds: dict[str, str] = {}  # of each group: the type of its messages
        self.unknown: dict[str, int] = {}
        self.behind: dict[str, float] = {}  # s, least from header's stamp to log's
        self.bare: set[str] = set()  # groups whose messages have no stamp
        self.early: dict[str, int] = {}  # of those, before a group's first stamp
        self.uneven: set[str] = set()  # groups of arrays that differ in length
        self.joined: set[str] = set()  # groups of paths with points far apart

    def add(self, group: str, kind: str, time: float, said: dict[str, float]) -> None:
        """Keep a sample of signals that share their stamps."""
        self.kinds[group] = kind
        said = {TIME: time, **said}
        series = self.series.setdefault(group, {name: Column() for name in said})
        if series.keys() != said.keys():
            self.uneven.add(group)
            return
        for name, value in said.items():
            series[name].append(value)

    def take(self, topic: str, kind: str, logged: float, body: Any) -> None:
        """Keep what a message says."""
        stamp = _stamp(body)
        if kind == JOINT_STATE:
            for field in ("position", "velocity", "effort"):
                said = dict(zip(body.name, getattr(body, field), strict=False))
                if said:
                    group = f"{topic}/{field}.{','.join(said)}"  # drivers share topics
                    self._stamped(group, stamp, logged)
                    named = _named(topic, field, said)
                    self.add(group, kind, stamp or logged, named)
        elif kind == TRAJECTORY:
            self._take_path(topic, stamp, logged, body)
        elif kind == ARRAY:
            said = {str(k): value for k, value in enumerate(body.data)}
            self.bare.add(f"{topic}/data")
            self.add(f"{topic}/data", kind, logged, _named(topic, "data", said))
        elif kind == IMU:
            rate, size = body.angular_velocity, body.linear_acceleration
            said = _named(topic, "gyro", {a: getattr(rate, a) for a in "xyz"})
            said |= _named(topic, "accelerometer", {a: getattr(size, a) for a in "xyz"})
            self._stamped(topic, stamp, logged)
            self.add(topic, kind, stamp or logged, said)
        else:
            unknown = f"{topic} ({kind})"
            self.unknown[unknown] = self.unknown.get(unknown, 0) + 1

    def _take_path(self, topic: str, stamp: float, logged: float, body: Any) -> None:
        """Keep what a path asks for."""
        if not body.points:
            return
        self.goals.setdefault(topic, []).append(goal_of(body, stamp or logged))
        for name in _named(topic, "position", dict.fromkeys(body.joint_names, 0.0)):
            self._stamped(name, stamp, logged)
            self.kinds[name] = TRAJECTORY
            self.series.setdefault(name, {TIME: Column(), name: Column()})

    def _follow(self, topic: str, moves: dict[str, float]) -> None:
        """Put paths of a topic one after the other, clocks moved by `moves`, s."""
        every = dict.fromkeys(
            name for goal in self.goals[topic] for name in goal.joints
        )
        there = {name: self._measured(name, moves) for name in every}

        def seen(joint: str, time: float) -> float:
            stamps, angles = there[joint]
            moved = time + moves.get(f"{topic}/position.{joint}", 0.0)
            near = len(stamps) and stamps[0] - APART <= moved <= stamps[-1] + APART
            return float(np.interp(moved, stamps, angles)) if near else math.nan

        path = followed(self.goals[topic], list(every), seen)
        if path.filled:
            self.joined.add(topic)
        for joint, values in zip(every, path.position.T, strict=True):
            known = np.isfinite(values)
            stamps, column = self.series[f"{topic}/position.{joint}"].values()
            stamps.add(path.time[known])
            column.add(values[known])

    def _measured(self, joint: str, moves: dict[str, float]) -> Stream:
        """The angle of a joint on the clock of all, rad; empty if there is none."""
        for group, series in self.series.items():
            for name, column in series.items():
                own = name.endswith(f"/position.{joint}")
                if own and self.kinds[group] == JOINT_STATE:
                    time = series[TIME].whole() + moves.get(group, 0.0)
                    return Stream(time, column.whole())
        return Stream(np.empty(0), np.empty(0))

    def _stamped(self, group: str, stamp: float, logged: float) -> None:
        """Notice how far a clock is behind that of the log."""
        if stamp:
            late = min(self.behind.get(group, math.inf), logged - stamp)
            self.behind[group] = late
        else:
            self.bare.add(group)
            if group not in self.behind:
                self.early[group] = self.early.get(group, 0) + 1

    def clocks(self, path: Path) -> tuple[dict[str, float], list[str]]:
        """What to add to the stamps of each group, s, so that all are of one clock."""
        states = [late for group, late in self.behind.items()
                  if self.kinds[group] == JOINT_STATE]  # fmt: skip
        usual = min(states or self.behind.values(), default=0.0)
        moves, notes = {}, []
        for group in self.series:
            late = 0.0 if group in self.bare else self.behind.get(group, usual)
            goals = self.kinds[group] == TRAJECTORY
            ahead = goals and group not in self.bare and -AHEAD <= late - usual < 0.0
            if abs(late - usual) > APART and not ahead:
                moves[group] = late - usual
                whose = group.rpartition("/position.")[0] if goals else group
                notes.append(
                    f"{path}: {whose} moved by {late - usual:.6g} s: joint states are "
                    f"stamped {usual:.6g} s before they were logged, it {late:.6g} s"
                )
        return moves, list(dict.fromkeys(notes))

    def _begun(self, path: Path) -> tuple[dict[str, int], list[str]]:
        """Samples of groups from before their clock ran, which are left out."""
        begun = {
            group: count for group, count in self.early.items()
            if group in self.behind and self.kinds[group] != TRAJECTORY
        }  # fmt: skip
        self.bare -= begun.keys()
        return begun, [
            f"{path}: {group}: {count} messages before the first with a stamp left out"
            for group, count in begun.items()
        ]

    def run(self, path: Path) -> tuple[Run, dict[str, str], list[str]]:
        """All signals from the first stamp on, s; their types; what was done."""
        begun, early = self._begun(path)
        moves, notes = self.clocks(path)
        notes += early
        for topic in self.goals:
            self._follow(topic, moves)
        notes += [
            f"{path}: {group} left out, its messages differ in length"
            for group in sorted(self.uneven)
        ]
        notes += [
            f"{path}: points of {group} are joined as a ros2_control controller does: "
            f"straight, or by cubics where speeds are given"
            for group in sorted(self.joined)
        ]
        out: Run = {}
        kinds: dict[str, str] = {}
        used = {
            group: {name: each.whole()[begun.get(group, 0) :]
                    for name, each in series.items()}
            for group, series in self.series.items() if group not in self.uneven
        }  # fmt: skip
        for group in [g for g, series in used.items() if not len(series[TIME])]:
            notes.append(f"{path}: {group} left out, none of it is a number")
            del used[group]
        begins = [series[TIME][0] + moves.get(group, 0.0)
                  for group, series in used.items()]  # fmt: skip
        for group, series in used.items():
            late = min(begins) - moves.get(group, 0.0)
            clock = mapped(partial(np.add, -late), series.pop(TIME))
            for name, values in series.items():
                stream = _finite(Stream(clock, values))
                lost = len(values) - len(stream.values)
                if lost == len(values):
                    notes.append(f"{path}: {name} left out, none of it is a number")
                    continue
                if lost:
                    notes.append(f"{path}: {name}: {lost} samples left out, no numbers")
                kinds[name] = self.kinds[group]
                out[name] = _merged(out[name], stream) if name in out else stream
        return out, kinds, notes


def _finite(stream: Stream) -> Stream:
    """The samples of a signal that are numbers."""
    known = np.isfinite(stream.values)
    return stream if known.all() else Stream(stream.time[known], stream.values[known])


def _merged(one: Stream, other: Stream) -> Stream:
    """The samples of a signal from messages about different sets of joints."""
    time = np.append(one.time, other.time)
    order = np.argsort(time, kind="stable")
    return Stream(time[order], np.append(one.values, other.values)[order])


def _named(topic: str, field: str, said: dict[str, float]) -> dict[str, float]:
    """Values by the names of their signals."""
    return {f"{topic}/{field}.{name}": value for name, value in said.items()}


def _stamp(body: Any) -> float:
    """Seconds of a header's stamp; 0 where nobody filled it in."""
    stamp = getattr(getattr(body, "header", None), "stamp", None)
    return 0.0 if stamp is None else stamp.sec + 1e-9 * stamp.nanosec
