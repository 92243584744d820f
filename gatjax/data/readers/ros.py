"""ROS 2 logs: MCAP files (mcap-ros2-support) and rosbag2 folders (rosbags).

Joint states, joint trajectories, arrays of commands and inertial units become signals
by topic; a message is stamped by its header, by its log time where it has none.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from gatjax.data.readers.messages import KNOWN, Collector
from gatjax.data.readers.source import Source, Tell

COMMANDING = ("command", "cmd", "target", "goal", "desired", "reference")
Message = tuple[str, str, float, Any]  # topic, type without package, log time s, body


def read_mcap(path: Path, tell: Tell) -> Source:
    """Read an MCAP file, message by message.

    Raises:
        ValueError: one line: truncated, or no message of a known type.
    """
    return _source(path, "MCAP", _mcap(path, tell))


def read_bag(path: Path, tell: Tell) -> Source:
    """Read a rosbag2 folder, message by message.

    Raises:
        ValueError: one line: broken, or no message of a known type.
    """
    return _source(path, "rosbag2", _bag(path, tell))


def _source(path: Path, kind: str, messages: Iterator[Message]) -> Source:
    """Collect all messages of a log."""
    found = Collector()
    for topic, name, logged, body in messages:
        try:
            found.take(topic, name, logged, body)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path}: {error}") from error
    notes = [
        f"{path}: {count} messages of {topic} left out, their type is not read"
        for topic, count in found.unknown.items()
    ]
    run, moved = found.run(path)
    if not run:
        seen = ", ".join(found.unknown) or "no message at all"
        raise ValueError(f"{path}: no messages of {', '.join(KNOWN)}; it has {seen}")
    metadata = {"robot": path.stem}
    return Source(str(path), kind, [run], draft(list(run)), metadata, moved + notes)


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


def _mcap(path: Path, tell: Tell) -> Iterator[Message]:
    """Messages of an MCAP file."""
    from mcap.exceptions import McapError
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    size, factory = path.stat().st_size, DecoderFactory()
    with path.open("rb") as file:
        try:
            for schema, channel, message in make_reader(file).iter_messages():
                kind = "" if schema is None else schema.name.rpartition("/")[2]
                body = None
                if kind in KNOWN:
                    decode = factory.decoder_for(channel.message_encoding, schema)
                    if decode is None:
                        kind += f", {channel.message_encoding or 'not'} encoded"
                    else:
                        body = decode(message.data)
                yield channel.topic, kind, 1e-9 * message.log_time, body
                tell(file.tell() / size)
        except (McapError, EOFError, OSError, struct.error) as error:
            line = " ".join(str(error).split()) or type(error).__name__
            raise ValueError(
                f"{path}: broken after {file.tell()} of {size} bytes ({line}); "
                f"`mcap recover` keeps what can be read"
            ) from error


def _bag(path: Path, tell: Tell) -> Iterator[Message]:
    """Messages of a rosbag2 folder."""
    from rosbags.highlevel import AnyReader, AnyReaderError
    from rosbags.typesys import Stores, get_typestore

    store, done = get_typestore(Stores.LATEST), 0
    try:
        with AnyReader([path], default_typestore=store) as bag:
            for connection, logged, raw in bag.messages():
                kind = connection.msgtype.rpartition("/")[2]
                body = (
                    bag.deserialize(raw, connection.msgtype) if kind in KNOWN else None
                )
                yield connection.topic, kind, 1e-9 * logged, body
                done += 1
                tell(done / bag.message_count)
    except (AnyReaderError, OSError, KeyError, struct.error) as error:
        line = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(
            f"{path}: broken after {done} messages ({line}); try `ros2 bag reindex`"
        ) from error
