"""What groundings that learn by reinforcement have in common.

One network gives the command its correction: g(s, a) = a + correction(s, a). It is the
policy that Brax's PPO trains in the simulator, rewarded for how like the robot the
simulator then moves.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from gatjax.effects.effect import Effect
from gatjax.grounding.gat import (
    Memory,
    command_effect,
    forward_inputs,
    joined,
    pushed,
    remembered,
)
from gatjax.grounding.grounder import Experience
from gatjax.grounding.network import HIDDEN
from gatjax.grounding.transitions import HISTORY, Transitions, transitions
from gatjax.records import Signal

Array = Any
CORRECTION = 0.05  # rad that an action of 1 adds to a command
EPISODE = 4.0  # s of a walk that teaches
TOLD = 10  # rounds after which a line is shown
LEAST = 1e-4  # rad, least deviation of an input
FAR = 8.0  # standard deviations at which inputs are cut off


class Correction(NamedTuple):
    """Parameters of the effect."""

    alpha: Array  # [] 0..1
    mean: Array  # [I] of the inputs, as of f
    deviation: Array  # [I]
    weights: tuple[Array, ...]
    biases: tuple[Array, ...]


def inputs_of(joints: int) -> int:
    """How many inputs the network of K joints has."""
    return (2 + 2 * HISTORY) * joints


def correction_effect(joints: Array) -> Effect:
    """The correction of the joints with these indices; params: `Correction`."""

    def transform(
        params: Correction, memory: Memory, angle: Array, target: Array, noise: Array
    ) -> Array:
        seen = forward_inputs(*joined(memory, angle, target))
        seen = jnp.clip((seen - params.mean) / params.deviation, -FAR, FAR)
        for weight, bias in zip(params.weights[:-1], params.biases[:-1], strict=True):
            seen = jnp.tanh(seen @ weight + bias)
        return target + CORRECTION * (seen @ params.weights[-1] + params.biases[-1])

    return command_effect(joints, transform)


def template(joints: int) -> Correction:
    """Parameters for so many joints that are all zero, but for the deviations."""
    inputs = inputs_of(joints)
    sizes = (inputs, *HIDDEN, joints)
    return Correction(
        np.float32(0.0), np.zeros(inputs), np.ones(inputs),
        tuple(np.zeros(pair) for pair in itertools.pairwise(sizes)),
        tuple(np.zeros(size) for size in sizes[1:]),
    )  # fmt: skip


def reinforced(
    experience: Experience, rewards: Callable[[Array, Array], Array], rounds: int
) -> list[tuple[Correction, float]]:
    """Train the correction.

    Args:
        experience: what is learned from.
        rewards: (inputs [S, I], next angles [S, K] rad) -> rewards [S], 0 or more,
            since a fall ends them; called once a round.
        rounds: of PPO, each with 64 walks of EPISODE.

    Returns:
        What walked in every round, and its mean reward.

    Raises:
        ImportError: there is no Brax.
    """
    from gatjax.rl import env, ppo

    data = transitions(experience.simulator)
    count = data.following.shape[-1]
    inputs = forward_inputs(data.angle, data.action)
    scale = ppo.Scale(inputs.mean(0), np.maximum(inputs.std(0), LEAST))
    view = env.View(
        size=inputs_of(count),
        begin=lambda signal: remembered(signal.angle, signal.target),
        look=_look,
        push=lambda memory, signal, sent: pushed(
            memory, signal.angle, signal.target, sent
        ),
    )
    walk, plan = experience.practice(view, CORRECTION), plan_of(experience, rounds)

    def judged(walks: Any) -> Array:
        flat = np.asarray(walks.observation).reshape(-1, view.size)
        later = np.asarray(walks.next_observation)[..., :count].reshape(-1, count)
        # what follows a fall is another walk's start: others stand in for those rows
        going = np.flatnonzero(np.reshape(walks.discount, -1))
        rows = np.arange(len(flat))
        rows = np.where(np.isin(rows, going), rows, np.resize(going, len(flat)))
        return np.reshape(rewards(flat[rows], later[rows]), np.shape(walks.reward))

    found = []
    for one in ppo.trained(walk, scale, plan, experience.seed, judged):
        layers = jax.tree.map(np.asarray, (one.policy.weights, one.policy.biases))
        mean, deviation = map(np.float32, scale)
        params = Correction(np.float32(1.0), mean, deviation, *layers)
        found.append((params, one.reward))
        if len(found) % TOLD == 0:
            experience.tell(f"PPO in the simulator, round {len(found)} of {rounds}")
    return found


def plan_of(experience: Experience, rounds: int) -> Any:
    """A `ppo.Plan` whose episodes take EPISODE at the control rate of the logs."""
    from gatjax.rl import ppo

    plan = ppo.Plan(rounds=rounds)
    period = float(np.median(np.diff(experience.simulator[0].time)))
    unrolls = max(1, round(EPISODE / period / plan.unroll))
    return plan._replace(ticks=unrolls * plan.unroll)


def _look(memory: Memory, signal: Signal, reading: Any) -> Array:
    return forward_inputs(*joined(memory, signal.angle, signal.target))


def samples(data: Transitions) -> tuple[Array, Array]:
    """Inputs [S, I] and changes [S, K] rad of recorded transitions."""
    return forward_inputs(data.angle, data.action), data.following - data.angle[:, 0]
