"""Causes that only a robot with an inertial unit, or feet on the ground, can show.

What separates them: `imu_misalignment` turns what the inertial unit says (gyro,
accelerometer, roll and pitch alike, a constant rotation) and leaves joints and forces
as they are. `gravity_tilt` leans the robot: roll and pitch change about as much, but
the load moves between the feet and between toe and heel, and joints sag otherwise.
`sole_geometry` leans it too, by a corner that does not touch, so single force sensors
go silent. `ground_friction` shows where feet slip (heading, hips against ankles),
`ground_compliance` in the accelerations and forces of steps.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from gatjax.effects.ground import ball, contacts, touching
from gatjax.sim.world import Values, World, add_cause

FIELDS = (
    "geom_friction", "geom_solref", "geom_pos", "geom_quat", "opt.gravity",
    "body_mass", "body_inertia", "body_ipos", "body_iquat",
)  # fmt: skip
"""What the causes change in a model."""
SIDES = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))  # of a sole, x and y
PAIRS = ("pair_friction", "pair_solref")  # and in one that names its contacts


class Suspect(NamedTuple):
    """A cause at a place, with one severity along a line, or as a vector."""

    cause: str
    where: str
    axes: tuple[str, ...]  # parameters that are searched
    nodes: np.ndarray  # [K, P] of them that are simulated
    fixed: dict[str, float]  # parameters that are given
    low: float  # least and largest value that may be reported
    high: float

    def values(self, x: np.ndarray) -> dict[str, float]:
        """Parameters of the catalogue; a vector has its length first."""
        own = {name: float(v) for name, v in zip(self.axes, x, strict=True)}
        first = {"angle": float(np.linalg.norm(x))} if len(x) > 1 else {}
        return first | own | self.fixed

    def world(self, world: World, x: np.ndarray) -> World:
        """A world with the cause added at parameters x [P]."""
        return add_cause(world, self.cause, [self.where], self.values(x))


def feet(model: mujoco.MjModel) -> list[str]:
    """Bodies with contact geoms that are not fixed to the world."""
    bodies = np.unique(model.geom_bodyid[touching(model)])
    return [model.body(int(b)).name for b in bodies if model.body_weldid[b] != 0]


def _pointed(model: mujoco.MjModel, foot: str) -> bool:
    """Whether a foot stands on one ball, which has no sides."""
    geoms = touching(model)
    own = geoms[model.geom_bodyid[geoms] == model.body(foot).id]
    return len(own) == 1 and ball(model, int(own[0]))


def of_contacts(model: mujoco.MjModel, field: str) -> np.ndarray:
    """First number of `friction` or `solref` of contacts: of named pairs, if any."""
    rows = contacts(model)
    kind = "pair" if "pair" in rows else "geom"
    return getattr(model, f"{kind}_{field}")[rows[kind], 0]


def suspects(model: mujoco.MjModel) -> list[Suspect]:
    """Everything that is simulated for a model; `imu_misalignment` needs no physics."""
    size = np.deg2rad(1.5)
    lean = size * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    found = [Suspect("gravity_tilt", "all", ("roll", "pitch"), lean, {}, 0.0, 0.5)]
    mu = float(of_contacts(model, "friction").max())
    slips = mu * np.array([[0.7], [0.45], [0.3], [0.2], [0.12], [0.07]])
    found.append(Suspect("ground_friction", "ground", ("mu",), slips, {}, 0.01, 3.0))
    times = of_contacts(model, "solref")
    if (times > 0.0).all():  # else no times but springs
        soft = max(float(times.max()), 0.004)
        waits = soft * np.array([[0.6], [1.7], [3.0], [5.0], [8.0], [13.0]])
        axes = ("time_constant",)
        found.append(
            Suspect("ground_compliance", "ground", axes, waits, {}, 0.002, 0.3)
        )
    worn = np.array([[0.0008], [0.002], [0.005]])
    for foot in feet(model):
        for x, y in SIDES[:1] if _pointed(model, foot) else SIDES:
            side = {"x": x, "y": y}
            found.append(
                Suspect("sole_geometry", foot, ("wear",), worn, side, 0.0, 0.03)
            )
    return found


def batch(world: World, others: list[World]) -> list[Values]:
    """Values of worlds that differ in FIELDS only, ready for one batch."""
    out = []
    for other in others:
        fields = dict(other.values.body)
        for name in (*FIELDS, *(PAIRS if world.model.npair else ())):
            owner = world.model.opt if name.startswith("opt.") else world.model
            now = np.array(getattr(owner, name.removeprefix("opt.")))
            fields.setdefault(name, now)
        out.append(world.values._replace(body=fields))
    return out
