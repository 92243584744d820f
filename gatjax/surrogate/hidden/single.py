"""The plant for one joint: exact sticking and exact tooth contact, at 0.1 ms.

Dry friction is solved as an impulse that can stop the joint within the step and hold
it (Moreau's time stepping in one dimension). A gear with play is two inertias that
are free, or touch on one tooth flank; flanks meet with restitution and part when the
force between them would pull.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from gatjax.surrogate.hidden.numbers import Numbers, stack
from gatjax.surrogate.hidden.plant import PIECE, SETTLE, History, Tape
from gatjax.surrogate.hidden.rigid import gravity
from gatjax.surrogate.hidden.robots import Robot
from gatjax.surrogate.hidden.servo import Servo
from gatjax.surrogate.hidden.targets import Lane, Targets
from gatjax.surrogate.hidden.terms import Now, gather

STEP = 0.0001  # s
RESTITUTION = 0.15
SLOWEST_BOUNCE = 0.02  # rad/s, slower flanks stay together
SPLIT = 0.85  # of the armature, on the motor's side of a gear


class Link:
    """Gravity and inertia of L one-joint robots."""

    def __init__(self, robot: Robot, numbers: Numbers) -> None:
        """Takes masses from the numbers, axis and frame from the robot."""
        model, body = robot.model, int(robot.body[0])
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.body_iquat[body])
        axes = turn.reshape(3, 3)
        self.axis = model.jnt_axis[0]
        mass, centre = numbers["mass"][:, body], numbers["centre"][:, body]
        moments = numbers["inertia"][:, body]
        around = (moments * (axes.T @ self.axis) ** 2).sum(-1)
        arm = np.cross(np.broadcast_to(self.axis, centre.shape), centre)
        self.inertia = around + mass * (arm**2).sum(-1)
        pull = mass[:, None] * gravity(numbers["tilt"])
        along = (centre @ self.axis)[:, None] * self.axis
        flat = centre - along
        self.cosine = (np.cross(flat, pull) @ self.axis).ravel()
        side = np.cross(np.broadcast_to(self.axis, flat.shape), flat)
        self.sine = (np.cross(side, pull) @ self.axis).ravel()

    def weight(self, angle: np.ndarray) -> np.ndarray:
        """Torque of gravity [L] at link angles [L], N m."""
        return self.cosine * np.cos(angle) + self.sine * np.sin(angle)


class Joint:
    """Motor, gear and link of L robots."""

    def __init__(self, robot: Robot, lanes: Sequence[Lane]) -> None:
        """Puts the robots at their first commands."""
        specimens = [lane.specimen for lane in lanes]
        self.numbers = stack(specimens)
        self.servo = Servo(specimens, self.numbers, STEP)
        self.link = Link(robot, self.numbers)
        self.now = Now()
        self.now.step, self.now.torque = STEP, np.zeros(len(lanes))
        armature = self.numbers["armature"][:, 0]
        self.geared, gear = gather(specimens, 1, "gear")
        is_geared = np.zeros(len(lanes), bool)
        is_geared[self.geared] = True
        self.rotor = np.where(is_geared, SPLIT * armature, armature)
        self.load = self.link.inertia + armature - self.rotor
        self.gap = 0.5 * self._spread(gear, "play", 0.0)
        stiffness = self._spread(gear, "stiffness", np.inf)
        self.springy = np.isfinite(stiffness)
        self.spring = np.where(self.springy, stiffness, 0.0)
        light = self.rotor * self.load / (self.rotor + self.load)
        self.give = 0.1 * np.sqrt(self.spring * light)
        self.blind = self._spread(gear, "encoder_on_motor", 0.0) > 0.5
        self.open = is_geared & ~self.springy  # may be without contact
        self.springs, self.opens = self.springy.any(), self.open.any()
        self.damping, self.coulomb, self.stribeck, self.fades = (
            self.numbers[name][:, 0]
            for name in ("damping", "coulomb", "stribeck", "stribeck_velocity")
        )
        self._touch(np.where(is_geared, 0, 1))
        self.angle = np.array([lane.log.commands[0, 0] for lane in lanes])
        self.speed = np.zeros(len(lanes))
        self.motor, self.motor_speed = self.angle.copy(), self.speed.copy()

    def _spread(self, gear: dict, name: str, neutral: float) -> np.ndarray:
        """A parameter of the gears for all L robots."""
        values = np.full(len(self.servo.gain), neutral)
        values[self.geared] = gear.get(name, neutral)
        return values

    def _touch(self, flank: np.ndarray) -> None:
        """Takes on which flanks [L] touch: -1, 0 (free), 1."""
        self.flank = flank
        self.together = (flank != 0) & ~self.springy
        self.inertia = np.where(self.together, self.rotor + self.load, self.rotor)
        self.slowed = 1.0 + STEP * self.damping / self.inertia

    def seen(self) -> np.ndarray:
        """Angle at the encoder [L], rad."""
        return np.where(self.blind, self.motor, self.angle)

    def level(self) -> np.ndarray:
        """Dry friction [L], N m."""
        ratio = self.now.motor_speed / self.fades
        level = self.coulomb + self.stribeck * np.exp(-(ratio**2))
        for term in self.servo.terms["friction"]:
            level[term.at] += term(self.now)
        return level

    def act(self, time: float, target: np.ndarray) -> None:
        """One step with targets [L], rad."""
        now = self.now
        now.time, now.angle, now.speed = time, self.angle, self.speed
        now.motor_angle, now.motor_speed = self.motor, self.motor_speed
        drive = self.servo.act(now, target, self.seen()).copy()
        load = self.link.weight(self.angle)
        for term in self.servo.terms["motor"]:
            drive[term.at] += term(now)
        for term in self.servo.terms["link"]:
            load[term.at] += term(now)
        if self.springs:
            twist, slip = self.motor - self.angle, self.motor_speed - self.speed
            pull = self.spring * twist + self.give * slip
            drive, load = drive - pull, load + pull
        self._move(drive, load, self.level())
        if self.opens:
            self._meet()

    def _move(self, drive: np.ndarray, load: np.ndarray, level: np.ndarray) -> None:
        """Moves motors and links by one step; friction and damping on the motors."""
        total = np.where(self.together, drive + load, drive)
        free = (self.motor_speed + STEP * total / self.inertia) / self.slowed
        stop = STEP * level / self.inertia
        speed = np.copysign(np.maximum(np.abs(free) - stop, 0.0), free)
        if self.opens:
            # force of the motor on the link, from the link's side
            push = self.load * (speed - self.speed) / STEP - load
            parts = self.together & self.open & (push * self.flank < 0.0)
            if parts.any():
                self._touch(np.where(parts, 0, self.flank))
        self.motor_speed = speed
        alone = self.speed + STEP * load / self.load
        self.speed = np.where(self.together, speed, alone)
        self.motor = self.motor + STEP * self.motor_speed
        self.angle = self.angle + STEP * self.speed

    def _meet(self) -> None:
        """Flanks that have met bounce, or stay together."""
        twist, slip = self.motor - self.angle, self.motor_speed - self.speed
        side = np.where(twist >= 0.0, 1, -1)
        meets = self.open & (self.flank == 0) & (np.abs(twist) >= self.gap)
        meets &= slip * side >= 0.0
        if not meets.any():
            return
        total = self.rotor + self.load
        common = (self.rotor * self.motor_speed + self.load * self.speed) / total
        bounce = np.where(np.abs(slip) > SLOWEST_BOUNCE, RESTITUTION, 0.0)
        rest = bounce * slip / total
        motor = common - rest * self.load
        link = common + rest * self.rotor
        self.motor_speed = np.where(meets, motor, self.motor_speed)
        self.speed = np.where(meets, link, self.speed)
        self.motor = np.where(meets, self.angle + side * self.gap, self.motor)
        self._touch(np.where(meets & (bounce == 0.0), side, self.flank))


def simulate(robot: Robot, lanes: Sequence[Lane]) -> list[History]:
    """Lets L one-joint robots run; see `rigid.simulate`.

    Raises:
        ValueError: the robot has more than one joint.
    """
    if len(robot.joints) != 1:
        raise ValueError(f"{robot.name} has {len(robot.joints)} joints; this takes one")
    joint = Joint(robot, lanes)
    targets = Targets(lanes, joint.numbers, STEP)
    tape = Tape(lanes, 0, STEP)
    start, size = round(SETTLE / STEP), round(PIECE / STEP)
    none = np.zeros((len(lanes), 0))
    for index in range(tape.steps):
        if index % size == 0:
            piece = targets.piece(index - start, size)[..., 0]
        joint.act((index - start) * STEP, piece[index % size])
        if tape.due(index):
            fields = (joint.seen(), joint.speed, joint.now.torque, joint.servo.lost())
            tape.keep(index, [field[:, None] for field in fields], none)
    return tape.histories()
