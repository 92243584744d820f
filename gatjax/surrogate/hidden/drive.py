"""Servo, bristle friction and gear for rigid-body plants, all written out.

Friction is a bristle model (Canudas de Wit and others 1995: "LuGre") whose level falls
from standstill (Stribeck). A gear is a rotor of its own behind a spring with a gap.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gatjax.surrogate.hidden.numbers import Numbers, Specimen, stack
from gatjax.surrogate.hidden.servo import Servo
from gatjax.surrogate.hidden.terms import Now, gather

STIFFEST = 0.35  # rad, of a spring's oscillation per step
ROTOR = 0.85  # of the armature, on the motor's side of a gear
LEAST_LEVEL = 1e-6  # N m
GEAR_DAMPING = 0.25  # of critical


class Drive:
    """The joints of L robots; one call of `act` a physics step."""

    def __init__(
        self, specimens: Sequence[Specimen], joint_armature: np.ndarray, step: float
    ) -> None:
        """Prepares the joints.

        Args:
            specimens: L robots.
            joint_armature: [L, J] kg m^2 of the driven joints.
            step: s, physics step.
        """
        self.numbers: Numbers = stack(list(specimens))
        self.servo = Servo(specimens, self.numbers, step)
        self.terms, self.now = self.servo.terms, Now()
        self.now.step = step
        self.shape = self.numbers["kp"].shape
        self.damping, self.coulomb, self.stribeck, self.fades = (
            self.numbers[name].ravel()
            for name in ("damping", "coulomb", "stribeck", "stribeck_velocity")
        )
        self.now.torque = np.zeros(self.damping.size)
        self.bristle = np.zeros(self.damping.size)
        self.stretch = np.repeat(self.numbers["bristle"], self.shape[1])
        inertia = joint_armature.ravel()
        self.stiffest = (STIFFEST / step) ** 2 * inertia
        self.rub = 0.4 * np.sqrt(inertia)
        self._gears(specimens, inertia, step)

    def _gears(
        self, specimens: Sequence[Specimen], inertia: np.ndarray, step: float
    ) -> None:
        """Splits the armature where there is a gear."""
        self.geared, gear = gather(specimens, self.shape[1], "gear")
        self.rotor = ROTOR * inertia[self.geared]
        self.light = (1.0 - ROTOR) * inertia  # kg m^2, left on the link
        stiffest = 0.5 * (STIFFEST / step) ** 2 * self.rotor
        self.spring = np.minimum(gear.get("stiffness", np.zeros(0)), stiffest)
        self.gap = 0.5 * gear.get("play", np.zeros(0))
        self.blind = gear.get("encoder_on_motor", np.zeros(0)) > 0.5
        self.give = 2.0 * GEAR_DAMPING * np.sqrt(self.spring * self.light[self.geared])
        self.rotor_angle = np.zeros(self.geared.size)
        self.rotor_speed = np.zeros(self.geared.size)

    def link_armature(self, joint_armature: np.ndarray) -> np.ndarray:
        """The armature [L, J] that is left for the rigid-body engine."""
        left = joint_armature.ravel().copy()
        left[self.geared] = self.light[self.geared]
        return left.reshape(self.shape)

    def start(self, angle: np.ndarray) -> None:
        """Puts the rotors where the links are, [L, J] rad."""
        self.rotor_angle = angle.ravel()[self.geared].copy()

    def seen(self) -> np.ndarray:
        """The angle at the encoder [L, J] rad, without offset."""
        angle = self.now.angle.copy()
        angle[self.geared[self.blind]] = self.rotor_angle[self.blind]
        return angle.reshape(self.shape)

    def act(
        self, time: float, target: np.ndarray, angle: np.ndarray, speed: np.ndarray
    ) -> np.ndarray:
        """Torques [L, J] on the links, N m; moves the rotors by one step.

        Args:
            time: s.
            target: [L, J] rad.
            angle: [L, J] rad, links.
            speed: [L, J] rad/s, links.
        """
        now = self.now
        now.time, now.angle, now.speed = time, angle.ravel(), speed.ravel()
        now.motor_angle, now.motor_speed = now.angle.copy(), now.speed.copy()
        now.motor_angle[self.geared] = self.rotor_angle
        now.motor_speed[self.geared] = self.rotor_speed
        torque = self.servo.act(now, target.ravel(), self.seen().ravel()).copy()
        for term in self.terms["motor"]:
            torque[term.at] += term(now)
        torque -= self._friction()
        if self.geared.size:
            torque[self.geared] = self._gear(torque[self.geared])
            plain = now.motor_speed.copy()
            plain[self.geared] = 0.0
            torque -= self.damping * plain
        else:
            torque -= self.damping * now.motor_speed
        for term in self.terms["link"]:
            np.add.at(torque, term.at, term(now))
        return torque.reshape(self.shape)

    def _friction(self) -> np.ndarray:
        """Bristle friction [L * J], N m; implicit in the bristles."""
        now = self.now
        speed = now.motor_speed
        level = self.coulomb + self.stribeck * np.exp(-((speed / self.fades) ** 2))
        for term in self.terms["friction"]:
            level[term.at] += term(now)
        level = np.maximum(level, LEAST_LEVEL)
        stiffness = np.minimum(level / self.stretch, self.stiffest)
        before = self.bristle
        change = before + now.step * speed
        self.bristle = change / (1.0 + now.step * np.abs(speed) * stiffness / level)
        slide = (self.bristle - before) / now.step
        # The level may drop while the bristles are bent: they cannot hold more.
        force = np.clip(stiffness * self.bristle, -level, level)
        self.bristle = np.where(stiffness > 0.0, force / stiffness, 0.0)
        return force + self.rub * np.sqrt(stiffness) * slide

    def _gear(self, torque: np.ndarray) -> np.ndarray:
        """Turns the rotors under `torque` [n]; what reaches the links [n], N m."""
        now, at = self.now, self.geared
        twist = self.rotor_angle - now.angle[at]
        bent = twist - np.clip(twist, -self.gap, self.gap)
        pull = self.spring * bent
        pull += self.give * (self.rotor_speed - now.speed[at]) * (bent != 0.0)
        pushes_back = (pull * bent <= 0.0) & (self.gap > 0.0)
        pull = np.where(pushes_back, 0.0, pull)
        loss = 1.0 + now.step * self.damping[at] / self.rotor
        change = now.step * (torque - pull) / self.rotor
        self.rotor_speed = (self.rotor_speed + change) / loss
        self.rotor_angle = self.rotor_angle + now.step * self.rotor_speed
        return pull
