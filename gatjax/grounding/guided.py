"""Guided GSL: the simulator is told where the robot's forward model sees it go.

Farchy et al. 2013, as the paper puts it: GAT with f_sim^-1(s, x') = x', which supposes
that the simulator reaches what it is told within a tick.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gatjax.effects.effect import Effect
from gatjax.grounding.gat import Memory, command_effect, expected, learn_forward
from gatjax.grounding.grounder import Experience, Grounder
from gatjax.grounding.network import Network, blank
from gatjax.grounding.transitions import HISTORY

Array = Any


class Guided(NamedTuple):
    """Parameters of the Guided GSL effect."""

    alpha: Array  # [] 0..1
    forward: Network


def guided_effect(joints: Array) -> Effect:
    """Guided GSL on the joints with these indices; params: `Guided`."""

    def transform(
        params: Guided, memory: Memory, angle: Array, target: Array, noise: Array
    ) -> Array:
        return expected(params.forward, memory, angle, target)[2]

    return command_effect(joints, transform)


def learn(experience: Experience) -> tuple[Guided, dict[str, Any]]:
    """Learn the robot's forward model."""
    forward, fit = learn_forward(experience.robot, experience.seed)
    return Guided(np.float32(1.0), forward), {"forward": fit._asdict()}


def template(joints: int) -> Guided:
    """Parameters for so many joints that are all zero."""
    return Guided(np.float32(0.0), blank((2 + 2 * HISTORY) * joints, 2 * joints))


GUIDED = Grounder(effect=guided_effect, learn=learn, template=template)
