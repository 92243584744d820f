"""ROS 2 messages to signals by topic, field and joint.

A message is stamped by its header, by its log time where it has none.
"""

from __future__ import annotations

import math
from array import array
from pathlib import Path
from typing import Any

import numpy as np

from gatjax.data.readers.source import Run, Stream

JOINT_STATE, TRAJECTORY = "JointState", "JointTrajectory"
ARRAY, IMU = "Float64MultiArray", "Imu"
KNOWN = (JOINT_STATE, TRAJECTORY, ARRAY, IMU)
APART = 1.0  # s between two clocks: more is no delay of messages


class Collector:
    """Samples of each signal, in the order in which they came, 8 bytes each."""

    def __init__(self) -> None:
        """Nothing is kept yet."""
        self.times: dict[str, array[float]] = {}  # of each group of signals
        self.values: dict[str, dict[str, array[float]]] = {}
        self.unknown: dict[str, int] = {}
        self.behind = math.inf  # s, least time from a header's stamp to the log's
        self.bare: set[str] = set()  # groups whose messages have no header

    def add(self, group: str, time: float, sample: dict[str, float]) -> None:
        """Keep a sample of signals that share their stamps.

        Raises:
            ValueError: one line: the signals of the group are others than before.
        """
        times = self.times.setdefault(group, array("d"))
        values = self.values.setdefault(group, {name: array("d") for name in sample})
        if values.keys() != sample.keys():
            raise ValueError(
                f"message {len(times) + 1} of {group} is about {', '.join(sample)}, "
                f"those before about {', '.join(values)}"
            )
        times.append(time)
        for name, value in sample.items():
            values[name].append(value)

    def take(self, topic: str, kind: str, logged: float, body: Any) -> None:
        """Keep what a message says."""
        stamp = _stamp(body)
        time = stamp or logged
        if stamp:
            self.behind = min(self.behind, logged - stamp)
        if kind == JOINT_STATE:
            for field in ("position", "velocity", "effort"):
                said = dict(zip(body.name, getattr(body, field), strict=False))
                if said:
                    who = ",".join(said)  # several drivers may share a topic
                    self.add(f"{topic}/{field}.{who}", time, _named(topic, field, said))
        elif kind == TRAJECTORY:
            for point in body.points:
                ahead = point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec
                said = dict(zip(body.joint_names, point.positions, strict=False))
                who = ",".join(said)
                named = _named(topic, "position", said)
                self.add(f"{topic}/position.{who}", time + ahead, named)
        elif kind == ARRAY:
            said = {str(k): value for k, value in enumerate(body.data)}
            self.bare.add(f"{topic}/data")
            self.add(f"{topic}/data", logged, _named(topic, "data", said))
        elif kind == IMU:
            rate, size = body.angular_velocity, body.linear_acceleration
            said = _named(topic, "gyro", {a: getattr(rate, a) for a in "xyz"})
            said |= _named(topic, "accelerometer", {a: getattr(size, a) for a in "xyz"})
            self.add(topic, time, said)
        else:
            unknown = f"{topic} ({kind})"
            self.unknown[unknown] = self.unknown.get(unknown, 0) + 1

    def run(self, path: Path) -> tuple[Run, list[str]]:
        """All signals from the first stamp on, s, and what was done to their clocks."""
        notes, late = [], 0.0
        if self.bare and abs(self.behind) > APART and math.isfinite(self.behind):
            late = self.behind
            notes.append(
                f"{path}: headers are stamped {late:.6g} s before they were logged; "
                f"they were moved, for {', '.join(sorted(self.bare))} has no header"
            )
        first = min(
            (t[0] - (late if g in self.bare else 0.0) for g, t in self.times.items()),
            default=0.0,
        )
        out: Run = {}
        for group, times in self.times.items():
            moved = first + late if group in self.bare else first
            clock = np.frombuffer(times) - moved
            for name, values in self.values[group].items():
                stream = Stream(clock, np.frombuffer(values))
                out[name] = _merged(out[name], stream) if name in out else stream
        return out, notes


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
