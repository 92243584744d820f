"""ROS 2 logs: MCAP files (mcap-ros2-support) and rosbag2 folders (rosbags).

Joint states, joint trajectories, arrays of commands and inertial units become signals
by topic; a message is stamped by its header, by its log time where it has none.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from gatjax.data.readers.source import Run, Source, Stream

JOINT_STATE, TRAJECTORY = "JointState", "JointTrajectory"
ARRAY, IMU = "Float64MultiArray", "Imu"
KNOWN = (JOINT_STATE, TRAJECTORY, ARRAY, IMU)
COMMANDING = ("command", "cmd", "target", "goal", "desired", "reference")
Message = tuple[str, str, float, Any]  # topic, type without package, log time s, body


class Collector:
    """Samples of each signal, in the order in which they came."""

    def __init__(self) -> None:
        self.times: dict[str, list[float]] = {}
        self.values: dict[str, list[float]] = {}
        self.unknown: dict[str, int] = {}

    def add(self, name: str, time: float, value: float) -> None:
        """Keep a sample."""
        self.times.setdefault(name, []).append(time)
        self.values.setdefault(name, []).append(float(value))

    def take(self, topic: str, kind: str, logged: float, body: Any) -> None:
        """Keep what a message says."""
        time = _stamp(body) or logged
        if kind == JOINT_STATE:
            for field in ("position", "velocity", "effort"):
                for joint, value in zip(body.name, getattr(body, field), strict=False):
                    self.add(f"{topic}/{field}.{joint}", time, value)
        elif kind == TRAJECTORY:
            for point in body.points:
                ahead = point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec
                for joint, value in zip(body.joint_names, point.positions, strict=False):
                    self.add(f"{topic}/position.{joint}", time + ahead, value)
        elif kind == ARRAY:
            for number, value in enumerate(body.data):
                self.add(f"{topic}/data.{number}", logged, value)
        elif kind == IMU:
            for axis in "xyz":
                self.add(f"{topic}/gyro.{axis}", time, getattr(body.angular_velocity, axis))
                size = getattr(body.linear_acceleration, axis)
                self.add(f"{topic}/accelerometer.{axis}", time, size)
        else:
            self.unknown[f"{topic} ({kind})"] = self.unknown.get(f"{topic} ({kind})", 0) + 1

    def run(self) -> Run:
        """All signals from the first stamp on, s."""
        first = min((times[0] for times in self.times.values()), default=0.0)
        return {
            name: Stream(np.array(times) - first, np.array(self.values[name]))
            for name, times in self.times.items()
        }


def read_mcap(path: Path) -> Source:
    """Read an MCAP file, message by message.

    Raises:
        ValueError: one line: truncated, or no message of a known type.
    """
    return _source(path, "MCAP", _mcap(path))


def read_bag(path: Path) -> Source:
    """Read a rosbag2 folder, message by message.

    Raises:
        ValueError: one line: broken, or no message of a known type.
    """
    return _source(path, "rosbag2", _bag(path))


def _source(path: Path, kind: str, messages: Iterator[Message]) -> Source:
    """Collect all messages of a log."""
    found = Collector()
    for topic, name, logged, body in messages:
        found.take(topic, name, logged, body)
    notes = [
        f"{path}: {count} messages of {topic} left out, their type is not read"
        for topic, count in found.unknown.items()
    ]
    run = found.run()
    if not run:
        seen = ", ".join(found.unknown) or "no message at all"
        raise ValueError(f"{path}: no messages of {', '.join(KNOWN)}; it has {seen}")
    metadata = {"robot": path.stem}
    return Source(str(path), kind, [run], draft(list(run)), metadata, notes)


def draft(names: list[str]) -> dict[str, dict[str, Any]]:
    """Columns that the names of topics and fields suggest.

    Numbered commands take the joints' names in the order of the joint states.
    """
    out: dict[str, dict[str, Any]] = {}
    plain = {"velocity": "velocity", "effort": "torque"}
    joints: list[str] = []
    for name in names:
        topic, _, last = name.rpartition("/")
        field, _, joint = last.partition(".")
        commanding = any(word in topic.lower() for word in COMMANDING)
        if field == "position":
            family = "command" if commanding else "position"
            out.setdefault(f"{family}.{joint}", {"from": name})
            joints += [] if commanding or joint in joints else [joint]
        elif field in plain and not commanding:
            out.setdefault(f"{plain[field]}.{joint}", {"from": name})
        elif field in ("gyro", "accelerometer"):
            out.setdefault(f"{field}.{joint}", {"from": name})
    for name in names:
        last = name.rpartition("/")[2]
        if last.startswith("data.") and int(last[5:]) < len(joints):
            out.setdefault(f"command.{joints[int(last[5:])]}", {"from": name})
    return out


def _mcap(path: Path) -> Iterator[Message]:
    """Messages of an MCAP file."""
    from mcap.exceptions import McapError
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with path.open("rb") as file:
        try:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            for schema, channel, message in reader.iter_messages(log_time_order=True):
                kind = "" if schema is None else schema.name.rpartition("/")[2]
                body = None
                if kind in KNOWN and schema is not None:
                    decode = _decoder(reader, channel, schema)
                    body = decode(message.data)
                yield channel.topic, kind, 1e-9 * message.log_time, body
        except (McapError, EOFError, OSError) as error:
            line = " ".join(str(error).split()) or type(error).__name__
            raise ValueError(
                f"{path}: broken after {file.tell()} of {path.stat().st_size} bytes "
                f"({line}); mcap recover mends what is there"
            ) from error


def _decoder(reader: Any, channel: Any, schema: Any) -> Any:
    """What turns the bytes of a channel into a message."""
    for factory in reader._decoder_factories:
        found = factory.decoder_for(channel.message_encoding, schema)
        if found is not None:
            return found
    raise ValueError(f"{channel.topic}: {channel.message_encoding} is not read")


def _bag(path: Path) -> Iterator[Message]:
    """Messages of a rosbag2 folder."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    try:
        store = get_typestore(Stores.LATEST)
        with warnings.catch_warnings(), AnyReader([path], default_typestore=store) as bag:
            for connection, logged, raw in bag.messages():
                kind = connection.msgtype.rpartition("/")[2]
                body = bag.deserialize(raw, connection.msgtype) if kind in KNOWN else None
                yield connection.topic, kind, 1e-9 * logged, body
    except (OSError, RuntimeError, ValueError, KeyError, AssertionError) as error:
        line = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path}: not a readable rosbag2 folder: {line}") from error


def _stamp(body: Any) -> float:
    """Seconds of a header's stamp; 0 where nobody filled it in."""
    stamp = getattr(getattr(body, "header", None), "stamp", None)
    return 0.0 if stamp is None else stamp.sec + 1e-9 * stamp.nanosec
