"""A simulated NAO behind LoLA: a stand-in robot that any NAO software can connect to.

It begins in somebody's hands. Who connects gives its joints power and a pose; when the
pose is steady, the hands put the robot down and press the button on its chest. When its
power is off again, the hands pick it up. The delay is the stand-in robot's own: three
frames from a request to what the sensors say of it.
"""

from __future__ import annotations

import contextlib
import json
import select
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gatjax.hardware import messagepack
from gatjax.hardware.lola import CHEST, FROM_LOLA, GRAVITY, PERIOD, TO_LOLA
from gatjax.hardware.poses import tilt_of
from gatjax.records import JOINTS, Base, Reading
from gatjax.robot import nao
from gatjax.surrogate import course
from gatjax.surrogate.e1 import E1, Body, draw_body
from gatjax.surrogate.start import NOISES, Floor, Run, draw_floor, draw_run
from gatjax.task import Task, task_at

HANDS = 3.0  # rad/s, joints of a robot that is held
STEADY = 0.5  # s that a pose is held before the robot is put down
NEAR = 0.03  # rad from the pose
PRESS = 0.5, 0.8  # s after it was put down: the button is down meanwhile
LIFT = 0.5  # s without power after which it is picked up
RELEASE = 0.5  # s without an answer after which LoLA takes the power off
IDENTITY = ("P0000000000000000000", "6.0.0", "P0000000000000000001", "6.0.0")

Build = Callable[[Body, Floor, Run, np.ndarray, Task], course.Machine]


def build_of(robot: str, hung: bool) -> Build:
    """Return what puts a stand-in robot down, or hangs it up."""
    if robot == "dart":
        from gatjax.surrogate.dart import HungNao, Nao

        return HungNao if hung else Nao
    from gatjax.surrogate.stiff import Flock, HungFlock

    kind = HungFlock if hung else Flock
    return lambda body, floor, run, pose, task: kind(
        body, floor, [run], pose[None], task
    )


class Told(NamedTuple):
    """What the robot was told last."""

    target: np.ndarray  # [J] rad
    stiffness: np.ndarray  # [J]


class SimulatedNao:
    """A robot and the hands that look after it, one frame after the other."""

    def __init__(
        self, robot: str, body_seed: int, seed: int, hung: bool = False
    ) -> None:
        """Take a robot of the series.

        Args:
            robot: dart or stiff.
            body_seed: which of the series.
            seed: draws its starts and its noise.
            hung: the hands hang it up by its torso instead of putting it down.
        """
        self.build, self.seed = build_of(robot, hung), seed
        self.body = draw_body(body_seed)
        self.floor = draw_floor(self.body, E1)
        self.task = task_at(83.3)
        self.run = 0
        self.angle = np.clip(np.zeros(len(JOINTS)), nao.LOW, nao.HIGH)
        self.told = Told(self.angle, np.zeros(len(JOINTS)))
        self._put_down()  # the first one takes longer than a frame
        self._hold()

    def _hold(self) -> None:
        """Take the robot into the hands."""
        self.machine: course.Machine | None = None
        self.since = 0.0  # s: held and steady, or on its feet
        self.powerless = 0.0  # s
        self.noise = np.random.default_rng([self.seed, self.run])

    def pick_up(self) -> None:
        """End a run: take the robot, without power, into the hands."""
        self.told = Told(self.told.target, np.zeros(len(JOINTS)))
        self.run += 1
        self._hold()

    def base(self) -> Base:
        """Return where the torso is, seen from where the run began."""
        if self.machine is None:
            return Base(np.array([0.0, 0.0, 0.5]), np.array([1.0, 0.0, 0.0, 0.0]))
        base = self.machine.base()
        return Base(base.position[0], base.quaternion[0])

    def reading(self) -> Reading:
        """Return what the sensors say."""
        if self.machine is None:
            zero = np.zeros(3)
            true = Reading(self.angle, zero, np.array([0.0, 0.0, 9.81]), np.zeros(8))
        else:
            true = Reading(*(part[0] for part in self.machine.sense()))
        return course.report(E1, self.body, true, self.noise.normal(size=NOISES))

    def frame(self) -> dict[str, Any]:
        """Return a frame in LoLA's order and units."""
        reading, base = self.reading(), self.base()
        touch = np.zeros(14)
        down = self.machine is not None and PRESS[0] <= self.since < PRESS[1]
        touch[CHEST] = down
        return {
            "Position": reading.angle[TO_LOLA],
            "Stiffness": self.told.stiffness[TO_LOLA],
            "Temperature": np.full(len(JOINTS), 38.0),
            "Current": np.zeros(len(JOINTS)),
            "Status": [0] * len(JOINTS),
            "FSR": np.maximum(reading.force, 0.0) / GRAVITY,
            "Accelerometer": reading.accelerometer,
            "Gyroscope": reading.gyro,
            "Angles": tilt_of(base.quaternion),
            "Battery": np.array([0.9, -1.0, 0.0, 30.0]),
            "Sonar": np.ones(2),
            "Touch": touch,
            "RobotConfig": list(IDENTITY),
        }

    def advance(self, told: Told) -> str | None:
        """Live through one frame; return what the hands did, if anything."""
        steady = bool((np.abs(told.target - self.told.target) < 1e-6).all())
        self.told, self.since = told, self.since + PERIOD
        if self.machine is None:
            self._held(steady)
            return None
        seen = self.machine.sense().angle[0]
        target = seen + told.stiffness * (told.target - seen)
        self.machine.advance(target[None], np.ones(1, bool))
        self.powerless = 0.0 if told.stiffness.any() else self.powerless + PERIOD
        if self.powerless < LIFT:
            return None
        self.angle = np.clip(seen, nao.LOW, nao.HIGH)
        walked = self.base().position[0]
        self.pick_up()
        return f"run {self.run}: {walked:.2f} m forward; picked up"

    def _held(self, steady: bool) -> None:
        """Move joints in the hands; put the robot down when its pose is steady."""
        told = self.told
        way = np.clip(told.target - self.angle, -HANDS * PERIOD, HANDS * PERIOD)
        self.angle = self.angle + np.where(told.stiffness > 0.0, way, 0.0)
        near = np.abs(told.target - self.angle).max() < NEAR
        if not (steady and near and told.stiffness.min() >= 0.9):
            self.since = 0.0
        if self.since >= STEADY:
            self._put_down()

    def _put_down(self) -> None:
        """Put the robot on its feet, as it is."""
        run = draw_run(self.body, self.seed + self.run, self.task, E1)
        self.machine = self.build(self.body, self.floor, run, self.angle, self.task)
        self.since = 0.0


class Server:
    """LoLA's side of the socket."""

    def __init__(self, path: Path, lockstep: bool) -> None:
        """Listen; `lockstep`: wait for every answer, as fast as both can.

        Raises:
            OSError: one line: the socket cannot be made.
        """
        if path.exists() and not path.is_socket():
            raise OSError(f"{path}: is a file; choose another place for the socket")
        path.unlink(missing_ok=True)
        self.path, self.lockstep = path, lockstep
        self.notes = path.with_name(path.name + ".json")
        self.tracker = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.tracker.bind(("127.0.0.1", 0))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self.socket.bind(str(path))
        except OSError as error:
            raise OSError(
                f"{path}: no socket can be made ({error.strerror})"
            ) from error
        self.socket.listen(1)
        told = {"lockstep": lockstep, "tracker": self.port}
        self.notes.write_text(json.dumps(told) + "\n")

    def serve(self, robot: SimulatedNao, say: Callable[[str], None]) -> None:
        """Serve one client after the other, until interrupted or closed."""
        while True:
            try:
                client, _ = self.socket.accept()
            except OSError:
                return
            say("connected")
            with client:
                self._serve(client, robot, say)
            robot.pick_up()
            say("disconnected")

    def _serve(
        self, client: socket.socket, robot: SimulatedNao, say: Callable[[str], None]
    ) -> None:
        """Serve one client until it leaves."""
        stream, silent = b"", 0.0
        due = time.monotonic()
        while True:
            self._track(robot.base())
            try:
                client.sendall(messagepack.pack(robot.frame()))
                due = max(due + PERIOD, time.monotonic() - 10.0 * PERIOD)
                told, stream = self._answer(client, stream, due)
            except (OSError, EOFError, ValueError) as error:
                say(f"client: {error}" if str(error) else "client left")
                return
            silent = 0.0 if told else silent + PERIOD
            before = robot.told
            if silent > RELEASE:
                before = Told(before.target, np.zeros(len(JOINTS)))
            happened = robot.advance(told_by(told, before) if told else before)
            if happened:
                say(happened)

    def _answer(
        self, client: socket.socket, stream: bytes, due: float
    ) -> tuple[dict[str, Any] | None, bytes]:
        """Collect answers until the next frame is due; return the last one."""
        last: dict[str, Any] | None = None
        while True:
            found = messagepack.first(stream)
            if found is not None:
                last, stream = found
                if self.lockstep:
                    return last, stream
                continue
            left = None if self.lockstep else max(0.0, due - time.monotonic())
            if not select.select([client], [], [], left)[0]:
                return last, stream
            part = client.recv(4096)
            if not part:
                raise EOFError
            stream += part

    def _track(self, base: Base) -> None:
        """Say where the robot is, as motion capture would."""
        told = {
            "position": base.position.tolist(), "quaternion": base.quaternion.tolist(),
        }  # fmt: skip
        self.tracker.sendto(json.dumps(told).encode(), ("127.0.0.1", self.port))

    def close(self) -> None:
        """Listen no more."""
        with contextlib.suppress(OSError):  # wakes a server that waits for a client
            self.socket.shutdown(socket.SHUT_RDWR)
        self.socket.close()
        self.tracker.close()
        self.path.unlink(missing_ok=True)
        self.notes.unlink(missing_ok=True)


def told_by(answer: dict[str, Any], before: Told) -> Told:
    """Take an answer: what it leaves out stays as it was."""
    fields = []
    for key, old in zip(("Position", "Stiffness"), before, strict=True):
        value = answer.get(key)
        fields.append(old if value is None else np.asarray(value, float)[FROM_LOLA])
    return Told(*fields)
