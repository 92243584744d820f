"""The guard: it stands between whoever moves the robot and its motors.

Whatever it is asked, it only ever commands finite targets within the joint limits, no
further apart than the joints' top speeds allow. When something is wrong with the robot,
with its frames or with who moves it, it lets the robot crouch and takes the power off;
when the robot falls, on its way or in the crouch, the power goes at once.
"""

from __future__ import annotations

from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from gatjax.hardware.frames import Command, Frame, Link
from gatjax.records import JOINTS, Reading
from gatjax.robot import nao

Array = Any

_CROUCH = {
    "ShoulderPitch": 1.5, "HipPitch": -0.75, "KneePitch": 2.0, "AnklePitch": -1.17,
}  # fmt: skip
CROUCH = np.clip([_CROUCH.get(joint[1:], 0.0) for joint in JOINTS], nao.LOW, nao.HIGH)
"""Joint angles [J] rad of a NAO that sits on its heels and needs no power to stay."""


class Limits(NamedTuple):
    """What the guard allows; two in a row are never a slip."""

    patience: int = 2  # frames that may be bad, missing, or without an answer: one less
    battery: float = 0.05  # charge at which the robot stops
    temperature: float = 85.0  # degC of a motor
    heat: int = 2  # very hot: the firmware has cut the power by a third
    tilt: float = float(np.deg2rad(45.0))  # rad, from there on it is a fall
    moved: float = 0.15  # rad that a target goes while a sensor says the same
    still: int = 10  # frames after which it must have said something else
    crouch: float = 2.0  # rad/s on the way down
    rise: float = 1.0  # s from no power to full power, and back after a crouch
    drop: float = 0.1  # s from full power to none after a fall
    gap: float = 0.2  # s without a frame after which nobody knows where it is
    astray: float = 0.3  # rad, further from its target no robot is that follows
    powerless: int = 10  # frames that say so of a robot that should have power


LIMITS = Limits()
FELL = "the robot fell"
SENSORS = (*JOINTS, "the gyroscope", "the accelerometer")
VITAL = np.isin(np.arange(len(SENSORS)), nao.LEGS)
VITAL[len(JOINTS) :] = True
"""Sensors without which no robot walks: legs, gyroscope, accelerometer."""


class Stage(Enum):
    """Who has the robot: it says what a button means, and what is a fall."""

    WAITS = "waits"  # somebody holds it; the button says that they are ready
    RISES = "rises"  # somebody holds it; the button stops it
    WALKS = "walks"  # it is on its own: falls and frozen sensors count, too


class Mode(Enum):
    """What the guard does with what it is asked."""

    FOLLOW = "follow"  # passes it on
    CROUCH = "crouch"  # goes down, then takes the power off
    LIMP = "limp"  # takes the power off at once
    RELEASED = "released"  # has taken it off


class Guard:
    """Watches one robot; see the module."""

    def __init__(self, first: Frame, link: Link, limits: Limits = LIMITS) -> None:
        """Take over a robot as its first frame shows it, without power."""
        self.limits, self.period = limits, link.period
        self.realtime, self.clocked = link.realtime, link.clocked
        self.mode, self.why, self.stage = Mode.FOLLOW, "", Stage.WAITS
        self.sent = np.clip(first.reading.angle, nao.LOW, nao.HIGH)
        self.share = 0.0  # of the power
        self.odd: set[str] = set()  # sensors that stood still, and may
        self.wanted = ""  # why it should not go on after it is done, if it should not
        self._frame, self._reading = first, first.reading
        self._chest = first.chest
        self._came: float | None = first.received  # s, None if frames do not come
        self._bad = self._silent = self._tipped = self._limp = 0  # frames in a row
        # Of joints, gyroscope and accelerometer, since they last said something new:
        self._span = np.tile(self.sent, (2, 1))  # [2, J] rad, least and largest target
        self._way = np.zeros(2)  # rad that a joint's target went, for the other two
        self._still = np.zeros(len(SENSORS), int)  # frames after that was much
        self._from, self._shares = self.sent, 0.0  # the way into the crouch

    def enter(self, stage: Stage) -> None:
        """Let the robot change hands."""
        self.stage = stage
        self._span = np.tile(self.sent, (2, 1))
        self._way, self._still = np.zeros(2), np.zeros(len(SENSORS), int)

    def stop(self, why: str, mode: Mode = Mode.CROUCH) -> None:
        """End what the robot does; the first reason stays."""
        if why != FELL:
            self.wanted = self.wanted or why
        worse = mode is Mode.LIMP and self.mode is Mode.CROUCH
        if self.mode is Mode.FOLLOW or worse:
            more = worse and self.why not in ("", why)
            self.why = f"{self.why}; then {why}" if more else why
            self.mode, self._from, self._shares = mode, self.sent, 0.0

    def _lose(self, why: str) -> None:
        """Give up a robot that has no power any more: it must not get it back."""
        self.stop(why)
        self.mode, self.share = Mode.RELEASED, 0.0

    def see(self, frame: Frame | None) -> Reading | None:
        """Look at a frame, None if it did not come in time or cannot be read.

        Returns:
            What the robot reports; None if that should not be acted upon.
        """
        if frame is not None:
            self._alarm(frame)
            self._time(frame)
            self._came = frame.received
        elif self._came is not None:  # it looked for one meanwhile
            few = self._bad < self.limits.patience
            self._came = self._came + self.period if few else None
        wrong = self._wrong(frame)
        if wrong is None and frame is not None:
            if self._bad * self.period > self.limits.gap:
                self._rejoin(frame.reading.angle)
            self._bad = 0
            self._watch(frame.reading)
            self._frame, self._reading = frame, frame.reading
            return frame.reading
        self._bad += 1
        if self._bad >= self.limits.patience:
            self.stop(f"{wrong}, {self._bad} times in a row")
        return None

    def _rejoin(self, angle: Array) -> None:
        """Go on from where a robot is that did not follow while nobody saw it."""
        if np.abs(angle - self.sent).max() > self.limits.astray:
            self.sent = np.clip(angle, nao.LOW, nao.HIGH)
            self._from, self._shares = self.sent, 0.0

    def _wrong(self, frame: Frame | None) -> str | None:
        """Say why a frame should not be acted upon."""
        old, period = self._frame, self.period
        if frame is None:
            return "no frame came that can be read"
        if frame.time <= old.time:
            return "a frame came out of order"
        reading = frame.reading
        parts = (*reading, frame.tilt, frame.temperature, frame.heat, frame.battery)
        numbers = np.concatenate([np.ravel(part) for part in parts])
        if not np.isfinite(numbers).all():
            return "a reading is not a number"
        same = all((new == was).all() for new, was in zip(reading, old.reading))
        if same and not self.clocked:
            return "a frame came twice"
        steps = max(1.0, (frame.time - old.time) / period) * period
        far = np.abs(reading.angle - old.reading.angle) > 1.5 * nao.SPEEDS * steps + 0.1
        outside = (reading.angle < nao.LOW - 0.3) | (reading.angle > nao.HIGH + 0.3)
        bad = np.flatnonzero(far | outside)
        if bad.size:
            return f"{JOINTS[bad[0]]} cannot be at {reading.angle[bad[0]]:.2f} rad"
        return None

    def _time(self, frame: Frame) -> None:
        """Look whether this process slept, and how long."""
        if self._came is None or not self.realtime:
            return
        late = frame.received - self._came
        why = f"a frame came {1e3 * late:.0f} ms after the one before"
        if late > self.limits.gap:
            self._lose(why)
        if late > (self.limits.patience + 0.5) * self.period:
            self.stop(why)

    def _alarm(self, frame: Frame) -> None:
        """Look for a fall, a button, heat and a low battery, however bad the rest."""
        limits, down = self.limits, self.mode is Mode.CROUCH
        pressed, self._chest = frame.chest and not self._chest, frame.chest
        if pressed and self.stage is not Stage.WAITS:
            self.stop("the chest button was pressed")
        tipped = np.abs(frame.tilt).max() > limits.tilt
        self._tipped = self._tipped + 1 if tipped else 0
        own = self.stage is Stage.WALKS or down
        if own and self._tipped >= limits.patience:
            self.stop(FELL, Mode.LIMP)
        limp = self.share > 0.5 and not (frame.stiffness > 0.0).any()
        self._limp = self._limp + 1 if limp else 0
        if self._limp >= limits.powerless:
            self._lose("somebody else took its power")
        if frame.battery < limits.battery:
            self.stop(f"the battery is at {100.0 * frame.battery:.0f} %")
        hot = (frame.temperature > limits.temperature) | (frame.heat >= limits.heat)
        if hot.any():
            joint = int(np.argmax(np.where(hot, frame.temperature, -np.inf)))
            degrees, level = frame.temperature[joint], frame.heat[joint]
            told = f"{degrees:.0f} degC, level {level:.0f} of 3"
            self.stop(f"{JOINTS[joint]} is hot: {told}")

    def _watch(self, reading: Reading) -> None:
        """Look for sensors that stand still."""
        self._count_still(reading)
        if self.stage is not Stage.WALKS:
            return
        still = self._still >= self.limits.still
        for index in np.flatnonzero(still & VITAL)[:1]:
            said = "stands still, though the robot was told to move"
            self.stop(f"{SENSORS[index]} {said}")
        self.odd |= {SENSORS[index] for index in np.flatnonzero(still & ~VITAL)}

    def _count_still(self, reading: Reading) -> None:
        """Count how long each sensor says the same after targets moved."""
        old = self._reading
        same = np.append(
            reading.angle == old.angle,
            [(reading.gyro == old.gyro).all(),
             (reading.accelerometer == old.accelerometer).all()],
        )  # fmt: skip
        joints, others = same[: len(JOINTS)], same[len(JOINTS) :]
        self._span = np.where(joints, self._span, self.sent)
        self._way = np.where(others, self._way, 0.0)
        moved = np.append(self._span[1] - self._span[0], self._way)
        self._still = np.where(moved > self.limits.moved, self._still + 1, 0)

    def command(self, wanted: Array | None, power: float = 1.0) -> Command:
        """Return what the robot is told now.

        Args:
            wanted: [J] rad; None if nobody said: the robot stays where it was told.
            power: share of full power to go to while all is well.
        """
        goal = self._asked(wanted) if self.mode is Mode.FOLLOW else self.sent
        if self.mode is Mode.CROUCH:
            goal, power = self._down()
        elif self.mode is not Mode.FOLLOW or max(power, self.share) <= 0.0:
            goal, power = self._reading.angle, 0.0  # wherever somebody bends it to
        limits = self.limits
        slow = limits.drop if self.mode is Mode.LIMP else limits.rise
        step = self.period / slow
        self.share += float(np.clip(power - self.share, -step, step))
        if self.mode in (Mode.CROUCH, Mode.LIMP) and self.share <= 0.0:
            self.mode = Mode.RELEASED
        reach = nao.SPEEDS * self.period
        target = np.clip(goal, self.sent - reach, self.sent + reach)
        target = np.clip(target, nao.LOW, nao.HIGH)
        self._way = self._way + np.abs(target - self.sent).max()
        self._span = np.stack(
            [np.minimum(self._span[0], target), np.maximum(self._span[1], target)]
        )
        self.sent = target
        return Command(target, np.full(len(JOINTS), self.share))

    def _asked(self, wanted: Array | None) -> Array:
        """Take what was asked if it is there and finite, else stay."""
        if wanted is not None and np.isfinite(wanted).all():
            self._silent = 0
            return wanted
        if self._bad:  # after a bad frame nobody was asked
            return self.sent
        self._silent += 1
        if self._silent >= self.limits.patience:
            what = "no target" if wanted is None else "a target that is not a number"
            self.stop(f"{what}, {self._silent} times in a row")
        return self.sent

    def _down(self) -> tuple[Array, float]:
        """Next target and power on the way into the crouch."""
        way = np.abs(CROUCH - self._from).max() / self.limits.crouch
        self._shares = min(1.0, self._shares + self.period / max(way, self.period))
        wanted = self._from + (CROUCH - self._from) * self._shares
        # Full power on the way down, where there was some; none after it.
        return wanted, self.share if self._shares < 1.0 else 0.0
