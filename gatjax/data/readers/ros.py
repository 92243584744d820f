"""ROS 2 logs: MCAP files (mcap-ros2-support) and rosbag2 folders (rosbags).

Joint states, joint trajectories, arrays of commands and inertial units become signals
by topic; a message is stamped by its header, by its log time where it has none.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from gatjax.data.readers.messages import (
    ARRAY,
    KNOWN,
    TRAJECTORY,
    Collector,
    kind_of,
)
from gatjax.data.readers.source import Source, Tell

COMMANDING = ("command", "cmd", "target", "goal", "desired", "reference")
MEANT = {"effort": "N m", "torque": "N m", "volt": "V", "velocity": "", "speed": ""}
"""Units of commands by words in the names of their topics."""
MAGIC = b"\x89MCAP0\r\n"  # how every MCAP file begins
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
            raise ValueError(f"{path}: {topic}: {error}") from error
    notes = [
        f"{path}: {count} messages of {topic} left out, their type is not read"
        for topic, count in found.unknown.items()
    ]
    run, kinds, done = found.run(path)
    if not run:
        seen = ", ".join(found.unknown) or "no message at all"
        raise ValueError(
            f"{path}: no messages of {', '.join(KNOWN.values())}; it has {seen}"
        )
    columns, taken = draft(kinds)
    notes = [*done, *notes, *(f"{path}: {note}" for note in taken)]
    return Source(str(path), kind, [run], columns, {"robot": path.stem}, notes)


def draft(kinds: dict[str, str]) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """Columns that types, topics and fields suggest, and what was taken for granted.

    Args:
        kinds: type of message of each signal.
    """
    out: dict[str, dict[str, Any]] = {}
    twice: dict[tuple[str, str], list[str]] = {}
    plain = {"velocity": "velocity", "effort": "torque"}
    joints: list[str] = []

    def put(column: str, name: str) -> None:
        """The first one of a column counts."""
        first = out.setdefault(column, {"from": name})["from"]
        if first != name:
            topics = _parts(first)[0], _parts(name)[0]
            twice.setdefault(topics, []).append(column)

    for name, kind in kinds.items():
        topic, field, joint = _parts(name)
        commanding = kind == TRAJECTORY or _commanding(topic)
        if field == "position":
            family = "command" if commanding else "position"
            put(f"{family}.{joint}", name)
            joints += [] if commanding or joint in joints else [joint]
        elif field in plain and not commanding:
            put(f"{plain[field]}.{joint}", name)
        elif field in ("gyro", "accelerometer"):
            put(f"{field}.{joint}", name)
    notes = [
        f"{other} has {', '.join(columns)} as well; taken from {first}, which came "
        f"first: correct the map if that is the wrong one"
        for (first, other), columns in twice.items()
    ]
    numbers: dict[str, list[str]] = {}
    for name, kind in kinds.items():
        if kind == ARRAY:
            numbers.setdefault(_parts(name)[0], []).append(name)
    for topic, names in numbers.items():
        notes.append(f"{topic}: {_numbered(topic, names, joints, out)}")
    return out, notes


def _parts(name: str) -> tuple[str, str, str]:
    """Topic, field and joint of a signal; joints may have slashes, topics no dots."""
    head, _, joint = name.partition(".")
    topic, _, field = head.rpartition("/")
    return topic, field, joint


def _commanding(topic: str) -> bool:
    """Whether the name of a topic says that it commands."""
    return any(word in topic.lower() for word in COMMANDING)


def _numbered(
    topic: str, names: list[str], joints: list[str], out: dict[str, dict[str, Any]]
) -> str:
    """Numbers without names as commands, if they can be nothing else; in words."""
    mend = "name its numbers in the map if they are"
    if not _commanding(topic):
        return f"taken for no commands, its name does not say so; {mend}"
    unit = next((u for word, u in MEANT.items() if word in topic.lower()), "rad")
    if not unit:
        return f"no commands that gatjax reads, by its name; {mend}"
    if len(names) != len(joints):
        return f"as many as {len(names)} for {len(joints)} joints: not used; {mend}"
    if any(f"command.{joint}" in out for joint in joints):
        return f"left out, there are other commands; {mend}"
    for name, joint in zip(names, joints, strict=True):
        out[f"command.{joint}"] = {"from": name, "unit": unit}
    return (
        f"taken for commands in {unit} of {', '.join(joints)}, the order of the joint "
        f"states; correct the map if it is another one"
    )


def _mcap(path: Path, tell: Tell) -> Iterator[Message]:
    """Messages of an MCAP file."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    size, factory = path.stat().st_size, DecoderFactory()
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise ValueError(f"{path}: {'empty' if size == 0 else 'no MCAP file'}")
        file.seek(0)
        try:
            reader = make_reader(file, validate_crcs=True)
            for schema, channel, message in reader.iter_messages():
                kind = "" if schema is None else kind_of(schema.name)
                body = None
                if kind in KNOWN.values():
                    decode = factory.decoder_for(channel.message_encoding, schema)
                    if decode is None:
                        kind += f", {channel.message_encoding or 'not'} encoded"
                    else:
                        body = decode(message.data)
                yield channel.topic, kind, 1e-9 * message.log_time, body
                tell(file.tell() / size)
        except Exception as error:  # of foreign bytes, by several libraries
            line = " ".join(str(error).split()) or type(error).__name__
            raise ValueError(
                f"{path}: broken after {file.tell()} of {size} bytes ({line}); "
                f"`mcap recover` keeps what can be read"
            ) from error


def _bag(path: Path, tell: Tell) -> Iterator[Message]:
    """Messages of a rosbag2 folder."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    store, done = get_typestore(Stores.LATEST), 0
    try:
        with AnyReader([path], default_typestore=store) as bag:
            for connection, logged, raw in bag.messages():
                kind, body = kind_of(connection.msgtype), None
                if kind in KNOWN.values():
                    body = bag.deserialize(raw, connection.msgtype)
                yield connection.topic, kind, 1e-9 * logged, body
                done += 1
                tell(done / bag.message_count)
    except Exception as error:  # of foreign bytes, by several libraries
        line = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(
            f"{path}: broken after {done} messages ({line}); try `ros2 bag reindex`"
        ) from error
