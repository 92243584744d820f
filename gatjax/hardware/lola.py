"""LoLA, the low-level interface of the NAO v6: a frame each 12 ms on a Unix socket.

The robot sends a MessagePack map of 896 bytes and is answered with one that holds what
it should do. Facts: RoboCup SPL teams' descriptions of LoLA; what gatjax measured of
them is in `docs/hardware.md`.
"""

from __future__ import annotations

import socket
import time
from pathlib import Path
from typing import Any

import numpy as np

from gatjax.files import read_json
from gatjax.hardware import messagepack
from gatjax.hardware.frames import BadFrame, Command, Frame, Lost
from gatjax.hardware.stream import received
from gatjax.hardware.tracker import Tracker
from gatjax.records import JOINTS, Reading

Array = Any

SOCKET = Path("/tmp/robocup")
FRAME = 896  # bytes
PERIOD = 0.012  # s
GRAVITY = 9.81  # m/s^2, kg of the foot sensors to N
ORDER = (
    "HeadYaw", "HeadPitch",
    "LShoulderPitch", "LShoulderRoll", "LElbowYaw", "LElbowRoll", "LWristYaw",
    "LHipYawPitch", "LHipRoll", "LHipPitch", "LKneePitch", "LAnklePitch", "LAnkleRoll",
    "RHipRoll", "RHipPitch", "RKneePitch", "RAnklePitch", "RAnkleRoll",
    "RShoulderPitch", "RShoulderRoll", "RElbowYaw", "RElbowRoll", "RWristYaw",
    "LHand", "RHand",
)  # fmt: skip
"""Joints in LoLA's order."""
FROM_LOLA = np.array([ORDER.index(joint) for joint in JOINTS])
TO_LOLA = np.array([JOINTS.index(joint) for joint in ORDER])
SIZES = {
    "Position": 25, "Stiffness": 25, "Temperature": 25, "Current": 25, "Status": 25,
    "FSR": 8, "Accelerometer": 3, "Gyroscope": 3, "Angles": 2, "Battery": 4,
    "Sonar": 2, "Touch": 14, "RobotConfig": 4,
}  # fmt: skip
"""What a frame holds, and how many of each."""
CHEST = 0  # in Touch


def read_frame(message: bytes) -> dict[str, Any]:
    """Read a frame of the robot: arrays in LoLA's order and units.

    Raises:
        BadFrame: one line with what is wrong with it.
    """
    try:
        entries = messagepack.unpack(message)
    except ValueError as error:
        raise BadFrame(f"a frame cannot be read: {error}") from error
    if not isinstance(entries, dict):
        raise BadFrame("a frame is no map")
    for key, size in SIZES.items():
        if key not in entries:
            raise BadFrame(f"a frame has no {key}")
        value = entries[key]
        if not isinstance(value, (list, np.ndarray)) or len(value) != size:
            raise BadFrame(f"{key} of a frame should hold {size} values")
        if key == "RobotConfig":
            continue
        try:
            entries[key] = np.asarray(value, float)
        except (TypeError, ValueError, OverflowError):
            raise BadFrame(f"{key} of a frame holds what is no number") from None
    return entries


def as_frame(entries: dict[str, Any], at: float, received: float) -> Frame:
    """Translate a frame: `JOINTS` order, SI units."""
    joints = {key: entries[key][FROM_LOLA] for key in SIZES if SIZES[key] == 25}
    return Frame(
        time=at,
        received=received,
        reading=Reading(
            angle=joints["Position"],
            gyro=entries["Gyroscope"],
            accelerometer=entries["Accelerometer"],
            force=entries["FSR"] * GRAVITY,
        ),
        tilt=entries["Angles"],
        stiffness=joints["Stiffness"],
        temperature=joints["Temperature"],
        current=joints["Current"],
        heat=joints["Status"],
        battery=float(entries["Battery"][0]),
        chest=bool(entries["Touch"][CHEST] > 0.5),
    )


def answer(command: Command) -> bytes:
    """Write what the robot is told."""
    return messagepack.pack(
        {
            "Position": np.asarray(command.target, float)[TO_LOLA],
            "Stiffness": np.asarray(command.stiffness, float)[TO_LOLA],
        }
    )


def notes_of(path: Path) -> dict[str, Any]:
    """Read what lies beside a socket, `<socket>.json`.

    `tracker`: where motion capture tells the robot's place, see `Tracker`. `lockstep`:
    it is simulated and waits for every answer; that of a simulated NAO which was killed
    means nothing for the robot that made the socket after it.

    Raises:
        ValueError: one line: it is not such a file.
    """
    file = path.with_name(path.name + ".json")
    if not file.is_file():
        return {}
    notes = read_json(file)
    if path.exists() and file.stat().st_mtime < path.stat().st_mtime:
        notes.pop("lockstep", None)
    unknown = sorted(set(notes) - {"lockstep", "tracker"})
    if unknown:
        raise ValueError(f"{file}: {unknown[0]!r} is unknown; use lockstep or tracker")
    return notes


class Lola:
    """A NAO v6, or a simulated one (`gatjax nao`); a `frames.Link`."""

    name = "lola"
    period = PERIOD
    clocked = False
    hint = "on a NAO, other software holds LoLA: stop it"

    def __init__(self, path: Path = SOCKET) -> None:
        """Connect to a robot's socket.

        What is known of it beside LoLA lies in `<socket>.json`, see `notes_of`.

        Raises:
            ValueError: one line: what is wrong with these notes.
            Lost: one line: nothing listens there.
        """
        self.path, self.identity = path, self.name
        notes = notes_of(path)
        self.realtime = not notes.get("lockstep", False)
        self.thinking = 0.6 * PERIOD if self.realtime else 20.0
        told = notes.get("tracker")
        self.tracker = None if told is None else Tracker(str(told))
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self.socket.connect(str(path))
        except OSError as error:
            self.close()
            raise Lost(
                f"{path}: no LoLA there ({error.strerror or error}); on a NAO, stop "
                f"what else holds it, or start a simulated one with: "
                f"gatjax nao --socket {path}"
            ) from error
        self._buffer = b""
        self._frames, self._due = 0, 0.0

    def place(self) -> bool:
        """Leave it to a person: they press the button on the chest then."""
        return False

    def receive(self, timeout: float) -> Frame | None:
        """Return the next frame; see `frames.Link`."""
        deadline, who = time.monotonic() + timeout, f"{self.path}: LoLA"
        while len(self._buffer) < FRAME:
            left = max(0.0, deadline - time.monotonic())
            part = received(self.socket, left, who)
            if not part:
                return None
            self._buffer += part
        arrived = time.monotonic()
        # Of several frames that wait, the last one counts: the others are history.
        while self.realtime and (part := received(self.socket, 0.0, who)):
            self._buffer += part
        whole = len(self._buffer) // FRAME
        end = whole * FRAME
        message, self._buffer = self._buffer[end - FRAME : end], self._buffer[end:]
        self._count(whole, arrived)
        entries = read_frame(message)
        self.identity = str(entries["RobotConfig"][0])
        frame = as_frame(entries, self._frames * PERIOD, arrived)
        if self.tracker is not None:
            frame = frame._replace(base=self.tracker.latest())
        return frame

    def _count(self, whole: int, received: float) -> None:
        """Count frames, those that never came too: the robot's clock."""
        late = 0.0
        if self.realtime and self._frames:
            late = (received - self._due) / PERIOD
        gone = max(whole, 1 + int(max(late, 0.0)))
        first = self._frames == 0
        self._frames += gone
        self._due = received if first else self._due + (gone - 1) * PERIOD
        # An early frame sets the clock; a late one only moves it a little.
        early = received < self._due
        self._due += (1.0 if early else 0.05) * (received - self._due) + PERIOD

    def send(self, command: Command) -> None:
        """Answer the last frame; see `frames.Link`."""
        try:
            self.socket.settimeout(1.0)
            self.socket.sendall(answer(command))
        except OSError as error:
            raise Lost(f"{self.path}: LoLA takes no commands ({error})") from error

    def close(self) -> None:
        """Let go of the robot; LoLA then takes the power off the joints by itself."""
        self.socket.close()
        if self.tracker is not None:
            self.tracker.close()
