"""MessagePack, as much of it as LoLA speaks (github.com/msgpack/msgpack, spec.md)."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

FLOAT32 = np.dtype([("mark", "u1"), ("value", ">f4")])
NUMBERS = {
    0xCA: ">f", 0xCB: ">d", 0xCC: ">B", 0xCD: ">H", 0xCE: ">I", 0xCF: ">Q",
    0xD0: ">b", 0xD1: ">h", 0xD2: ">i", 0xD3: ">q",
}  # fmt: skip
LENGTHS = {
    0xD9: (">B", "text"), 0xDA: (">H", "text"), 0xDB: (">I", "text"),
    0xC4: (">B", "bytes"), 0xC5: (">H", "bytes"), 0xC6: (">I", "bytes"),
    0xDC: (">H", "array"), 0xDD: (">I", "array"),
    0xDE: (">H", "map"), 0xDF: (">I", "map"),
}  # fmt: skip
BROKEN = (struct.error, IndexError, UnicodeDecodeError, TypeError, RecursionError)
WORDS = {0xC0: None, 0xC2: False, 0xC3: True}


def pack(value: Any) -> bytes:
    """Write a value; floats and arrays of floats [N] as float32, as LoLA does.

    Raises:
        TypeError: it is nothing that LoLA is told.
    """
    if isinstance(value, dict):
        return _head(len(value), 0x80, 16, 0xDE) + b"".join(
            pack(key) + pack(entry) for key, entry in value.items()
        )
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        numbers = np.empty(len(value), FLOAT32)
        numbers["mark"], numbers["value"] = 0xCA, value
        return _head(len(value), 0x90, 16, 0xDC) + numbers.tobytes()
    if isinstance(value, (list, tuple, np.ndarray)):
        return _head(len(value), 0x90, 16, 0xDC) + b"".join(map(pack, value))
    if isinstance(value, str):
        text = value.encode()
        return _head(len(text), 0xA0, 32, 0xDA) + text
    if isinstance(value, (bool, np.bool_)):
        return b"\xc3" if value else b"\xc2"
    if isinstance(value, (int, np.integer)):
        short = -32 <= value < 128
        return struct.pack(">b", value) if short else struct.pack(">Bi", 0xD2, value)
    if isinstance(value, (float, np.floating)):
        return struct.pack(">Bf", 0xCA, value)
    raise TypeError(f"{type(value).__name__} has no place in a LoLA message")


def _head(count: int, short: int, below: int, long: int) -> bytes:
    """Head of a map, an array or a text: a byte, or three."""
    if count < below:
        return struct.pack(">B", short | count)
    return struct.pack(">BH", long, count)


def unpack(message: bytes) -> Any:
    """Read a message that holds exactly one value.

    Raises:
        ValueError: it is cut off, goes on after its end, or is no MessagePack.
    """
    try:
        value, end = _read(message, 0)
    except BROKEN as error:
        raise ValueError(f"no whole MessagePack message ({error})") from error
    if end != len(message):
        raise ValueError(f"{len(message) - end} bytes too many in the message")
    return value


def first(stream: bytes) -> tuple[Any, bytes] | None:
    """Take the first value off a stream, with what follows; None if it is not whole.

    Raises:
        ValueError: the stream is no MessagePack.
    """
    try:
        value, end = _read(stream, 0)
    except (struct.error, IndexError):
        return None
    except BROKEN as error:
        raise ValueError(f"no MessagePack ({error})") from error
    return value, stream[end:]


def _read(message: bytes, at: int) -> tuple[Any, int]:
    """Read the value at a place; return it and where the next one begins."""
    mark = message[at]
    at += 1
    if mark < 0x80:
        return mark, at
    if mark >= 0xE0:
        return mark - 256, at
    if mark in WORDS:
        return WORDS[mark], at
    if mark in NUMBERS:
        form = NUMBERS[mark]
        return struct.unpack_from(form, message, at)[0], at + struct.calcsize(form)
    if mark in LENGTHS:
        form, kind = LENGTHS[mark]
        count = struct.unpack_from(form, message, at)[0]
        at += struct.calcsize(form)
    elif mark < 0xC0:
        kind = "map" if mark < 0x90 else "array" if mark < 0xA0 else "text"
        count = mark & (0x1F if kind == "text" else 0x0F)
    else:
        raise ValueError(f"byte {mark:#x} at {at - 1} starts nothing that LoLA sends")
    return _collect(message, at, kind, count)


def _collect(message: bytes, at: int, kind: str, count: int) -> tuple[Any, int]:
    """Read what has a length."""
    if kind in ("text", "bytes"):
        part = message[at : at + count]
        if len(part) < count:
            raise IndexError("the message ends inside a text")
        return part.decode() if kind == "text" else part, at + count
    if kind == "array":
        end = at + count * FLOAT32.itemsize
        if count and end <= len(message):
            numbers = np.frombuffer(message, FLOAT32, count, at)
            if (numbers["mark"] == 0xCA).all():
                return numbers["value"].astype(float), end
        values = []
        for _ in range(count):
            value, at = _read(message, at)
            values.append(value)
        return values, at
    entries = {}
    for _ in range(count):
        key, at = _read(message, at)
        entries[key], at = _read(message, at)
    return entries, at
