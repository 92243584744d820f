"""Reinforced GAT: one network, learned by reinforcement, in place of f_sim^-1.

Karnan, Desai, Hanna, Warnell & Stone 2020, "Reinforced Grounded Action Transformation
for Sim-to-Real Transfer" (IROS): the correction of the command is a policy whose reward
is how near the simulator comes to what f says that the robot would do. So the errors of
a supervised f_sim^-1 do not add up from tick to tick. Their reward is the negative
distance; here a fall ends an episode and must not pay, so it is 1 where the two agree
and falls to 0 (Gaussian, as wide as the simulator's own error).
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gatjax.grounding.gat import learn_forward, next_angle_of
from gatjax.grounding.grounder import Experience, Grounder
from gatjax.grounding.network import Network, predict
from gatjax.grounding.reinforced import (
    Correction,
    correction_effect,
    reinforced,
    template,
)
from gatjax.grounding.transitions import transitions

Array = Any
ROUNDS = 80
LEAST = 1e-4  # rad, least error that counts as the simulator's own


def learn(experience: Experience) -> tuple[Correction, dict[str, Any]]:
    """Learn f from the robot, and in the simulator a correction that follows it."""
    forward, fit = learn_forward(experience.robot, experience.seed)
    data = transitions(experience.simulator)
    error = next_angle_of(forward, data) - data.following
    width = np.maximum(np.sqrt(np.mean(error**2, axis=0)), LEAST)

    @jax.jit
    def agreement(inputs: Array, later: Array) -> Array:
        off = (later - _expected(forward, inputs, later.shape[-1])) / width[None]
        return jnp.exp(-0.5 * off**2).mean(-1)

    found = reinforced(experience, agreement, ROUNDS)
    params, best = max(found, key=lambda one: one[1])
    return params, {"forward": fit._asdict(), "reward": [found[0][1], best]}


def _expected(forward: Network, inputs: Array, joints: int) -> Array:
    """x_t+1 [S, K] rad that f expects, from its inputs [S, I]."""
    acceleration = jax.vmap(predict, in_axes=(None, 0))(forward, inputs)
    now, change = inputs[:, :joints], inputs[:, joints : 2 * joints]
    return now + change + acceleration


RGAT = Grounder(effect=correction_effect, learn=learn, template=template, needs="brax")
