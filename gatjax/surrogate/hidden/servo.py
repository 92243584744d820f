"""The servo of all plants: a sampled position loop that heats up and saturates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gatjax.surrogate.hidden.numbers import Numbers, Specimen
from gatjax.surrogate.hidden.terms import Now, bind, gather

SUPPLY_LAG = 0.01  # s, of the supply behind the torques
MOST_LOST = 0.9
SETTLED = 0.0  # s, heat counts from here


class Servo:
    """L * J servos."""

    def __init__(
        self, specimens: Sequence[Specimen], numbers: Numbers, step: float
    ) -> None:
        """Prepares the servos; `numbers` are the stacked ones of the specimens."""
        self.shape = numbers["kp"].shape
        self.terms = bind(specimens, self.shape[1])
        self.gain, self.damping, self.limit, self.offset = (
            numbers[name].ravel() for name in ("kp", "kv", "limit", "offset_loop")
        )
        ticks = np.maximum(np.rint(numbers["period"] / step), 1.0).astype(int)
        self.ticks = np.repeat(ticks, self.shape[1])
        self.common = 1 if self.terms["push"] else int(np.gcd.reduce(self.ticks))
        self.count = 0
        self.held = np.zeros(self.gain.size)
        self.hot, heat = gather(specimens, self.shape[1], "heat")
        self.heat_rate = heat.get("rate", np.zeros(0))
        self.cooling = heat.get("cooling", np.ones(0))
        self.heat = np.zeros(self.hot.size)
        self.sag = numbers["sag"]
        self.sags = bool(self.sag.any())
        self.drop = np.zeros(self.shape[0])

    def lost(self) -> np.ndarray:
        """The share [L * J] of gain and torque limit that is lost now."""
        lost = np.repeat(self.drop, self.shape[1])
        lost[self.hot] = 1.0 - (1.0 - lost[self.hot]) * (
            1.0 - np.minimum(self.heat_rate * self.heat, MOST_LOST)
        )
        return lost

    def act(self, now: Now, target: np.ndarray, seen: np.ndarray) -> np.ndarray:
        """Motor torques [L * J], N m.

        Args:
            now: what is true; `error`, `limit` and `torque` are written here.
            target: [L * J] rad.
            seen: [L * J] rad, angle at the encoder without its offset.
        """
        if self.count % self.common == 0:  # integrals add up in every step
            push = self._push(now, target, seen)
            self.held = np.where(self.count % self.ticks == 0, push, self.held)
        self.count += 1
        now.torque = torque = self.held.copy()
        for term in self.terms["power"]:
            torque[term.at] *= term(now)
        self._wear(now)
        return torque

    def _push(self, now: Now, target: np.ndarray, seen: np.ndarray) -> np.ndarray:
        """Torques [L * J] that a new sample asks for, N m."""
        left = 1.0 - self.lost() if self.hot.size or self.sags else 1.0
        now.limit = self.limit * left
        now.error = target - seen - self.offset
        for term in self.terms["error"]:
            now.error[term.at] = term(now)
        push = self.gain * left * now.error - self.damping * now.motor_speed
        for term in self.terms["push"]:
            push[term.at] += term(now)
        push = np.minimum(np.maximum(push, -now.limit), now.limit)
        for term in self.terms["room"]:
            low, high = term(now)
            push[term.at] = np.minimum(np.maximum(push[term.at], low), high)
        return push

    def _wear(self, now: Now) -> None:
        """Heat and supply follow the torques."""
        if self.hot.size and now.time >= SETTLED:
            load = (now.torque[self.hot] / self.limit[self.hot]) ** 2
            self.heat += now.step * (load - self.heat / self.cooling)
        if self.sags:
            pull = np.abs(now.torque).reshape(self.shape).sum(1)
            goal = np.minimum(self.sag * pull, MOST_LOST)
            self.drop += now.step / SUPPLY_LAG * (goal - self.drop)
