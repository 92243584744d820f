"""The log: every frame and its answer, into a recording that gatjax reads.

A thread of its own writes whole lines of CSV every quarter second, so that the loop
never waits for a disk and a kill loses at most the last moment.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from pathlib import Path
from typing import Any, Sequence

import numpy as np

from gatjax.files import write_json
from gatjax.hardware.frames import Command, Frame
from gatjax.records import FORCE_SENSORS, JOINTS

EVERY = 0.25  # s between writes
SYNC = 4  # writes between two that wait for the disk
BETWEEN = -1  # number of the run outside of runs


def columns() -> list[str]:
    """Names of the columns of a log; `docs/files.md` says what they are."""
    families = ("command", "position", "stiffness", "temperature", "current")
    names = [f"{family}.{joint}" for family in families for joint in JOINTS]
    names += [
        f"{family}.{axis}" for family in ("gyro", "accelerometer") for axis in "xyz"
    ]
    names += [f"force.{sensor}" for sensor in FORCE_SENSORS]
    names += ["orientation.roll", "orientation.pitch", "received", "sent"]
    return ["time", "trajectory", *names]


PLACE = ["time", "trajectory", "x", "y", "z", "qw", "qx", "qy", "qz"]
FRAMES, OTHERS, PLACES = range(3)  # files


class Log:
    """Writes `frames_<number>.csv` and, of all that is between runs, `between_...`.

    What they are is in a .json beside each. `place_<number>.csv` has where the robot
    was, in the frames in which somebody knew.
    """

    def __init__(self, folder: Path, robot: str, base: str, period: float) -> None:
        """Begin a log in a folder, of a robot whose base is floating or fixed.

        Raises:
            OSError: one line: it cannot be written.
        """
        number = 1 + max(map(_number, folder.glob("*_*.csv")), default=-1)
        self.path = folder / f"frames_{number:03}.csv"
        notes = {"robot": robot, "base": base, "rate_hz": round(1.0 / period, 4)}
        self._files = []
        heads = {"frames": columns(), "between": columns(), "place": PLACE}
        for name, head in heads.items():
            path = folder / f"{name}_{number:03}.csv"
            if name != "place":
                write_json(path.with_suffix(".json"), notes)
            file = open(path, "xb", buffering=0)
            file.write((",".join(head) + "\n").encode())
            self._files.append(file)
        self._rows: deque[Any] = deque()
        self.failed: OSError | None = None  # one line: rows were lost
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._write_on, daemon=True)
        self._thread.start()

    def add(self, run: int, frame: Frame, command: Command, sent: float) -> None:
        """Note a frame and its answer.

        Args:
            run: number of the run, BETWEEN outside of runs.
            frame: what came.
            command: what it was answered with.
            sent: s, this computer's clock, when that had been sent.
        """
        self._rows.append((run, frame, command, sent))

    def _write_on(self) -> None:
        count = 0
        while not self._end.wait(EVERY):
            count += 1
            self._write(count % SYNC == 0)

    def _write(self, sync: bool) -> None:
        """Write what has come together: whole lines, in one call a file."""
        lines: list[list[str]] = [[], [], []]
        while self._rows:
            run, frame, command, sent = self._rows.popleft()
            kind = OTHERS if run == BETWEEN else FRAMES
            lines[kind].append(_line(run, frame, command, sent))
            if frame.base is not None:
                words = [f"{frame.time:.6f}", str(run), *_words(frame.base)]
                lines[PLACES].append(",".join(words) + "\n")
        if self.failed:
            return
        try:
            for file, told in zip(self._files, lines):
                _append(file, "".join(told).encode())
                if sync:
                    os.fsync(file.fileno())
        except OSError as error:
            why = f"{self.path}: rows were lost ({error.strerror})"
            self.failed = OSError(why)

    def close(self) -> None:
        """Write the rest; see `failed`."""
        self._end.set()
        self._thread.join()
        self._write(True)
        for file in self._files:
            file.close()


def _append(file: Any, lines: bytes) -> None:
    """Write lines to the end of a file without a buffer, all of them or none.

    Raises:
        OSError: none; half a line would make those before it unreadable.
    """
    begun, left = file.tell(), memoryview(lines)
    try:
        while left:  # such a file may take a part only
            left = left[file.write(left) :]
    except OSError:
        file.truncate(begun)
        raise


def _number(path: Path) -> int:
    """Number of a log's file, -1 if it has none."""
    word = path.stem.partition("_")[2]
    return int(word) if word.isdigit() else -1


def _line(run: int, frame: Frame, command: Command, sent: float) -> str:
    """Write a frame and its answer as a row of `columns`."""
    reading = frame.reading
    parts = [
        command.target, reading.angle, frame.stiffness, frame.temperature,
        frame.current, reading.gyro, reading.accelerometer, reading.force,
        frame.tilt,
    ]  # fmt: skip
    text = [f"{frame.time:.6f}", str(run), *_words(parts)]
    return ",".join([*text, f"{frame.received:.6f}", f"{sent:.6f}"]) + "\n"


def _words(parts: Sequence[Any]) -> list[str]:
    """Write arrays as words, single precision whole."""
    return [f"{number:.9g}" for number in np.concatenate(parts).tolist()]
