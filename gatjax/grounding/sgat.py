"""Stochastic GAT: the forward model says how sure it is, and is sampled from.

Desai, Karnan, Hanna, Warnell & Stone 2020, "Stochastic Grounded Action Transformation
for Robot Learning in Simulation" (IROS): f(s, a) is a Gaussian over the robot's next
state, from which g samples before f_sim^-1. They train mean and deviation together;
here the mean is GAT's, and the deviation is the regression of the logarithm of its
errors (Davidian & Carroll 1987), scaled to errors on runs that were not fitted.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from gatjax.effects.effect import Effect
from gatjax.grounding.gat import (
    Memory,
    command_effect,
    expected,
    forward_inputs,
    inverse_action,
    learn_forward,
    learn_inverse,
    next_angle_of,
    split,
)
from gatjax.grounding.grounder import Experience, Grounder
from gatjax.grounding.network import Network, blank, raw, raw_many, regress
from gatjax.grounding.transitions import HISTORY, transitions

Array = Any
FLOOR = 1e-5  # rad, added to errors whose logarithm is taken
LEAST = 1e-3  # of what f_sigma says: a joint at rest has no deviation at all
GAUSSIAN = 0.6351814  # -E[log |z|] of a standard normal z


class Sgat(NamedTuple):
    """Parameters of the SGAT effect."""

    alpha: Array  # [] 0..1
    forward: Network  # mean of f of the robot
    spread: Network  # logarithm of its standard deviation in rad
    inverse: Network  # f_sim^-1 of the simulator


def sgat_effect(joints: Array) -> Effect:
    """SGAT on the joints with these indices; params: `Sgat`."""

    def transform(
        params: Sgat, memory: Memory, angle: Array, target: Array, noise: Array
    ) -> Array:
        angles, actions, following = expected(params.forward, memory, angle, target)
        deviation = jnp.exp(raw(params.spread, forward_inputs(angles, actions)))
        following = following + deviation * noise
        return inverse_action(params.inverse, angles, memory.sent, following)

    return command_effect(joints, transform)


def learn_spread(forward: Network, experience: Experience) -> tuple[Network, dict]:
    """Learn the standard deviation [K] rad of the robot around f, and how it fits."""
    data = transitions(experience.robot)
    error = np.abs(next_angle_of(forward, data) - data.following)
    inputs = forward_inputs(data.angle, data.action)
    unseen = split(data, 0.15, experience.seed)
    logs = np.log(error + FLOOR) + GAUSSIAN
    spread, fit = regress(inputs, logs, unseen, experience.seed)
    told = np.exp(raw_many(spread, inputs[unseen]))
    scale = np.sqrt(np.mean((error[unseen] / told) ** 2, axis=0))
    mean = spread.output_mean + np.log(np.maximum(scale, LEAST))
    facts = {"deviation_rad": float(np.sqrt(np.mean((told * scale) ** 2)))}
    return spread._replace(output_mean=jnp.asarray(mean, jnp.float32)), {
        **facts, "epochs": fit.epochs,
    }  # fmt: skip


def learn(experience: Experience) -> tuple[Sgat, dict[str, Any]]:
    """Learn f with its deviation from the robot, f_sim^-1 from the simulator."""
    forward, forward_fit = learn_forward(experience.robot, experience.seed)
    spread, spread_fit = learn_spread(forward, experience)
    inverse, inverse_fit = learn_inverse(experience.simulator, experience.seed + 1)
    facts = {
        "forward": forward_fit._asdict(),
        "spread": spread_fit,
        "inverse": inverse_fit._asdict(),
    }
    return Sgat(np.float32(1.0), forward, spread, inverse), facts


def template(joints: int) -> Sgat:
    """Parameters for so many joints that are all zero."""
    inputs = (2 + 2 * HISTORY) * joints
    network = blank(inputs, 2 * joints)
    return Sgat(np.float32(0.0), network, blank(inputs, joints), network)


SGAT = Grounder(effect=sgat_effect, learn=learn, template=template)
