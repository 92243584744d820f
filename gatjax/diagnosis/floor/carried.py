"""What a standing robot carries: payloads, told by its feet and by all of its joints.

A joint of a robot that stands bears what is above it as seen from the floor, not from
its root, and the soles feel the weight of everything: only the whole robot can tell.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from gatjax.diagnosis.bank import ARM
from gatjax.robot.model import joint_names
from gatjax.sim.world import World, add_cause

SHARE = 0.1  # of the robot's mass: the payload that slopes are simulated with
FARTHEST = 0.3  # m from the link's centre of mass along each axis


class Load(NamedTuple):
    """A payload on the link of one joint, as coordinates.

    They are its mass, kg, and its moments about the link's centre of mass along the
    link's axes, kg m: what a robot that stands feels is nearly linear in these.
    """

    where: str
    centre: np.ndarray  # [3] m, of the link's mass
    mass: float  # kg, of the simulations that slopes are made of

    cause = "payload"
    axes = ("mass", "x", "y", "z")
    low, high = 0.0, 1000.0

    @property
    def nodes(self) -> np.ndarray:
        """Coordinates [4, 4] that are simulated."""
        return self.mass * np.array(
            [[1.0, 0.0, 0.0, 0.0], *np.insert(ARM * np.eye(3), 0, 1.0, axis=1)]
        )

    def slopes(self, seen: np.ndarray, nominal: np.ndarray) -> np.ndarray:
        """Channels [4, C, B] per unit of each coordinate, from those at the nodes."""
        aside = (seen[1:] - seen[:1]) / (self.mass * ARM)
        return np.concatenate([(seen[:1] - nominal) / self.mass, aside])

    def values(self, x: np.ndarray) -> dict[str, float]:
        """Parameters of the catalogue; the payload stays near its link."""
        mass = max(float(x[0]), 0.0)
        away = np.clip(x[1:] / max(mass, 1e-6), -FARTHEST, FARTHEST)
        place = self.centre + away
        return {"mass": mass} | dict(zip("xyz", map(float, place), strict=True))

    def world(self, world: World, x: np.ndarray) -> World:
        """A world with the payload added at coordinates x [4]."""
        return add_cause(world, self.cause, [self.where], self.values(x))


def loads(model: mujoco.MjModel) -> list[Load]:
    """A payload on each link."""
    mass = SHARE * float(model.body_mass.sum())
    bodies = model.jnt_bodyid[model.actuator_trnid[:, 0]]
    return [
        Load(name, np.array(model.body_ipos[body]), mass)
        for name, body in zip(joint_names(model), bodies, strict=True)
    ]
