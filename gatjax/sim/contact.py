"""MuJoCo's law of contacts: the shape of the friction cone, and its stiffness."""

from __future__ import annotations

from typing import NamedTuple

import mujoco

CONES = ("pyramidal", "elliptic")  # in the order of mujoco.mjtCone


class Law(NamedTuple):
    """`option/cone` and `option/impratio` of a model."""

    cone: str
    impratio: float


def law_of(model: mujoco.MjModel) -> Law:
    """The law of a model."""
    return Law(CONES[int(model.opt.cone)], float(model.opt.impratio))


def with_law(model: mujoco.MjModel, law: Law) -> mujoco.MjModel:
    """A copy of a model with another law.

    Raises:
        ValueError: there is no such cone.
    """
    if law.cone not in CONES:
        raise ValueError(f"cone is {law.cone!r}; it is one of {', '.join(CONES)}")
    other = mujoco.MjModel.__copy__(model)
    other.opt.cone, other.opt.impratio = CONES.index(law.cone), law.impratio
    return other
