"""From target to torque in one physics step, for one robot, shared by the backends."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gatjax.effects.effect import Effect, chain
from gatjax.effects.gear import encoder, motor, present
from gatjax.effects.joint import pull
from gatjax.records import Drive, Signal
from gatjax.robot.model import command_range
from gatjax.sim.causes import GEAR
from gatjax.sim.world import Values, World
from gatjax.xp import namespace_of

Array = Any


class State(NamedTuple):
    """Memory of motor and joint effects."""

    motor: Any
    joint: Any
    torque: Array  # [..., J] N m, of the servos; () in a world without joint effects


class Push(NamedTuple):
    """What the physics gets; None is what a world without such effects leaves."""

    control: Array  # [..., J] for the actuators, rad where they are position servos
    load: Array  # [..., J] N m, on the joints
    friction: Array  # [..., J] N m, dry friction of the joints
    armature: Array  # [..., J] kg m^2, of joints with gears


class Actuation(NamedTuple):
    """A world's motor and joint effects, closed over."""

    motor: Effect
    joint: Effect
    low: np.ndarray  # [J] rad, range of the targets
    high: np.ndarray
    plain: bool  # neither motor nor joint effects
    torques: bool  # has joint effects
    geared: bool  # of which one is a gear

    def init(self, values: Values, signal: Signal) -> State:
        """Return the first state of a run that begins with `signal`."""
        signal = signal if self.plain else self._within(signal)
        motor = self.motor.init(values.motor, signal)
        if not self.torques:
            return State(motor, (), ())
        _, signal = self.motor.apply(values.motor, motor, signal)
        drive = self._drive(values, signal, 0.0 * signal.target)
        drive = drive._replace(torque=pull(drive))
        return State(motor, self.joint.init(values.joint, drive), drive.torque)

    def apply(
        self, values: Values, state: State, signal: Signal, stiffness: Array = 1.0
    ) -> tuple[State, Push]:
        """Play one physics step.

        Args:
            values: of the world.
            state: memory.
            signal: holds the true angle and velocity.
            stiffness: [..., J] share of the servos' gain; needs a `stiffened` world.
        """
        if self.plain:
            return state, Push(signal.target, None, None, None)
        true = signal.angle
        state, signal = self.asked(values, state, signal)
        return self.driven(values, state, signal, true, stiffness)

    def asked(
        self, values: Values, state: State, signal: Signal
    ) -> tuple[State, Signal]:
        """Play the motor effects of a physics step; `signal` holds the true angle.

        Returns:
            State, with these effects' new memory, and what the servos are asked for and
            see.
        """
        signal = signal._replace(angle=self.seen(values, state, signal.angle))
        motor, signal = self.motor.apply(
            values.motor, state.motor, self._within(signal)
        )
        return state._replace(motor=motor), signal

    def driven(
        self, values: Values, state: State, signal: Signal, true: Array,
        stiffness: Array = 1.0,
    ) -> tuple[State, Push]:  # fmt: skip
        """Play the joint effects of a physics step, after `asked`.

        Args:
            values: of the world.
            state: memory.
            signal: what the servos are asked for and see.
            true: [..., J] rad, angle of the joints.
            stiffness: [..., J] share of the servos' gain.
        """
        if not self.torques:
            return state, Push(signal.target, None, None, None)
        seen, signal = signal.angle, signal._replace(angle=true)
        begin = self._drive(values, signal, state.torque, stiffness)
        if self.geared:
            begin = self._parted(values, state, begin._replace(seen=seen))
        joint, drive = self.joint.apply(values.joint, state.joint, begin)
        plain, torque = pull(begin), pull(drive)
        control, servo = _control(begin, plain, torque), drive.servo
        push = Push(control, drive.load + drive.lean, servo.friction, None)
        if self.geared:
            torque, push = joint[GEAR].pull, push._replace(armature=servo.rotor)
        return State(state.motor, joint, torque), push

    def seen(self, values: Values, state: State, angle: Array) -> Array:
        """Return what the encoders see of joints at `angle` [..., J], rad."""
        if not self.geared:
            return angle
        return encoder(values.joint[GEAR], state.joint[GEAR], angle)

    def _parted(self, values: Values, state: State, drive: Drive) -> Drive:
        """Motors are where their gears let them be; the encoder's angle is known."""
        motion = state.joint[GEAR]
        turned, turning = motor(motion, drive.angle, drive.velocity)
        return drive._replace(
            turned=turned, turning=turning, handed=motion.handed,
            geared=present(values.joint[GEAR]) + drive.geared,
        )  # fmt: skip

    def _within(self, signal: Signal) -> Signal:
        xp = namespace_of(signal.target)
        return signal._replace(target=xp.clip(signal.target, self.low, self.high))

    def _drive(
        self, values: Values, signal: Signal, torque: Array, stiffness: Array = 1.0
    ) -> Drive:
        return Drive(
            target=signal.target,
            angle=signal.angle,
            velocity=signal.velocity,
            seen=signal.angle,
            turned=signal.angle,
            turning=signal.velocity,
            servo=values.servo,
            rated=values.servo.high,
            load=0.0 * signal.velocity,
            lean=0.0 * signal.velocity,
            lean_apart=0.0 * signal.velocity,
            torque=torque,
            stiffness=stiffness + 0.0 * signal.velocity,
            geared=0.0 * signal.velocity,
            handed=0.0 * signal.velocity,
            apart=0.0 * signal.velocity,
        )


def actuation(world: World) -> Actuation:
    """Return the motor and joint effects of a world."""
    low, high = command_range(world.model)
    return Actuation(
        motor=chain(**world.motor),
        joint=chain(**world.joint),
        low=low,
        high=high,
        plain=not (world.motor or world.joint),
        torques=bool(world.joint),
        geared=GEAR in world.joint,
    )


def _control(drive: Drive, plain: Array, torque: Array) -> Array:
    """Command with which MuJoCo's actuator gives `torque` instead of `plain`."""
    xp, servo = namespace_of(drive.angle, drive.target), drive.servo
    wanted = torque + servo.damping * drive.velocity
    wanted = servo.hold * drive.angle + wanted / xp.maximum(servo.gain, 1e-9)
    return xp.where(torque == plain, drive.target, wanted)
