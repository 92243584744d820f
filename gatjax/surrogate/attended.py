"""A simulated NAO behind LoLA: a stand-in robot that any NAO software can connect to.

It begins in somebody's hands, which press the button on its chest now and then. Who
connects gives its joints power and a pose; when the pose of the legs is steady, the
hands put the robot down and press the button again. When its power is off, they pick it
up. The delay is the stand-in robot's own: three frames from a request to what the
sensors say of it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gatjax.hardware.lola import CHEST, FROM_LOLA, GRAVITY, PERIOD, TO_LOLA
from gatjax.hardware.poses import tilt_of
from gatjax.records import JOINTS, Base, Reading
from gatjax.robot import nao
from gatjax.surrogate import course, engine_of
from gatjax.surrogate.e1 import E1
from gatjax.surrogate.start import NOISES, draw_run, series
from gatjax.task import task_at

HANDS = 3.0  # rad/s, joints of a robot that is held
STEADY = 0.5  # s that a pose is held before the robot is put down
NEAR = 0.03  # rad from the pose
PRESS = 0.5, 0.8  # s after it was put down: the button is down meanwhile
PRESSES = 2.0  # s between two while it is held without power
POWER = 0.3  # stiffness from which a leg holds a robot
LIFT = 0.5  # s without power after which it is picked up
VERSION, HEAD = "6.0.0", "P0000000000000000000"


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
        engine = engine_of(robot)
        self.flock, self.seed = engine.hung if hung else engine.flock, seed
        self.identity = f"{robot.upper()}{body_seed:0{len(HEAD) - len(robot)}d}"
        self.body, self.floor = series(body_seed)
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
        touch[CHEST] = self._pressed()
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
            "RobotConfig": [self.identity, VERSION, HEAD, VERSION],
        }

    def _pressed(self) -> bool:
        """Return whether the hands press the button on the chest."""
        if self.machine is not None:
            return PRESS[0] <= self.since < PRESS[1]
        again = self.powerless % PRESSES
        return not self.told.stiffness.any() and PRESS[0] <= again < PRESS[1]

    def advance(self, told: Told) -> str | None:
        """Live through one frame; return what the hands did, if anything."""
        steady = bool((np.abs(told.target - self.told.target)[nao.LEGS] < 1e-6).all())
        self.told, self.since = told, self.since + PERIOD
        self.powerless = 0.0 if told.stiffness.any() else self.powerless + PERIOD
        if self.machine is None:
            self._held(steady)
            return None
        seen = self.machine.sense().angle[0]
        target = seen + told.stiffness * (told.target - seen)
        self.machine.advance(target[None], np.ones(1, bool))
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
        near = np.abs(told.target - self.angle)[nao.LEGS].max() < NEAR
        if not (steady and near and told.stiffness[nao.LEGS].min() > POWER):
            self.since = 0.0
        if self.since >= STEADY:
            self._put_down()

    def _put_down(self) -> None:
        """Put the robot on its feet, as it is."""
        run = draw_run(self.body, self.seed + self.run, self.task, E1)
        poses = self.angle[None]
        self.machine = self.flock(self.body, self.floor, [run], poses, self.task)
        self.since = 0.0


def told_by(said: Any, before: Told) -> Told:
    """Take an answer: what it leaves out stays as it was.

    Raises:
        ValueError: one line: it is no answer.
    """
    if not isinstance(said, dict):
        raise ValueError("an answer is no map")
    fields = []
    for key, old in zip(("Position", "Stiffness"), before, strict=True):
        if key not in said:
            fields.append(old)
            continue
        try:
            values = np.asarray(said[key], float)
        except (TypeError, ValueError):
            values = np.zeros(0)
        if values.shape != (len(JOINTS),) or not np.isfinite(values).all():
            raise ValueError(f"{key} of an answer should hold {len(JOINTS)} numbers")
        fields.append(values[FROM_LOLA])
    return Told(*fields)
