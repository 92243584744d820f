"""Grounded Action Transformation.

Hanna & Stone 2017, Algorithm 1: g(s, a) = alpha f_sim^-1(s, f(s, a)) + (1 - alpha) a,
with f the robot's forward model and f_sim^-1 the simulator's inverse model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.effects.effect import Effect
from gatjax.grounding.grounder import Experience, Grounder
from gatjax.grounding.network import Fit, Network, blank, predict, train
from gatjax.grounding.transitions import HISTORY, Transitions, transitions
from gatjax.records import Signal

Array = Any


class Gat(NamedTuple):
    """Parameters of the GAT effect."""

    alpha: Array  # [] 0..1
    forward: Network  # f of the robot
    inverse: Network  # f_sim^-1 of the simulator


class Memory(NamedTuple):
    """The past of the grounded joints, newest first."""

    angle: Array  # [HISTORY, K] rad: x_t-1 .. x_t-4
    asked: Array  # [HISTORY, K] rad, what the policy commanded
    sent: Array  # [HISTORY, K] rad, what the simulator was told instead


def forward_inputs(angle: Array, action: Array) -> Array:
    """Inputs of f from x_t..x_t-4 and a_t..a_t-4, both [..., 1 + HISTORY, K].

    Past positions enter as changes, actions as desired changes of x_t (paper).
    """
    xp = jnp if not isinstance(angle, np.ndarray) else np
    now = angle[..., :1, :]
    parts = [now, now - angle[..., 1:, :], action - now]
    joined = xp.concatenate(parts, axis=-2)
    return joined.reshape(*joined.shape[:-2], -1)


def inverse_inputs(angle: Array, past: Array, following: Array) -> Array:
    """Inputs of f_sim^-1 from x_t..x_t-4, a_t-1..a_t-4 [..., HISTORY, K], x_t+1."""
    xp = jnp if not isinstance(angle, np.ndarray) else np
    now = angle[..., :1, :]
    parts = [now, now - angle[..., 1:, :], past - now, following[..., None, :] - now]
    joined = xp.concatenate(parts, axis=-2)
    return joined.reshape(*joined.shape[:-2], -1)


def next_angle(forward: Network, angle: Array, action: Array) -> Array:
    """Robot's x_t+1 [K] rad: the predicted acceleration, integrated over one tick."""
    acceleration = predict(forward, forward_inputs(angle, action))
    return 2.0 * angle[0] - angle[1] + acceleration


def next_angle_of(forward: Network, data: Transitions) -> Array:
    """Predict x_t+1 [S, K] rad of recorded transitions."""
    return np.asarray(_next_angles(forward, data.angle, data.action))


_next_angles = jax.jit(jax.vmap(next_angle, in_axes=(None, 0, 0)))


def split(data: Transitions, share: float, seed: int) -> Array:
    """Mark the samples of a share of the runs, at least one and not all."""
    runs = np.unique(data.run)
    if len(runs) < 2:
        raise ValueError("grounding needs at least 2 trajectories; collect more")
    order = np.random.default_rng(seed).permutation(runs)
    count = min(max(1, round(share * len(runs))), len(runs) - 1)
    return np.isin(data.run, order[:count])


def learn_forward(runs: Sequence[JointRun], seed: int) -> tuple[Network, Fit]:
    """Learn the robot's f from its recordings."""
    data = transitions(runs)
    acceleration = data.following - 2.0 * data.angle[:, 0] + data.angle[:, 1]
    inputs = forward_inputs(data.angle, data.action)
    return train(inputs, acceleration, split(data, 0.15, seed), seed)


def learn_inverse(runs: Sequence[JointRun], seed: int) -> tuple[Network, Fit]:
    """Learn the simulator's f_sim^-1 from its recordings."""
    data = transitions(runs)
    inputs = inverse_inputs(data.angle, data.action[:, 1:], data.following)
    change = data.action[:, 0] - data.angle[:, 0]
    return train(inputs, change, split(data, 0.15, seed), seed)


def remembered(angle: Array, target: Array) -> Memory:
    """Memory of joints [K] that have stood still so far."""
    repeat = jnp.stack([angle] * HISTORY), jnp.stack([target] * HISTORY)
    return Memory(repeat[0], repeat[1], repeat[1])


def pushed(memory: Memory, angle: Array, target: Array, sent: Array) -> Memory:
    """Memory one tick later: where the joints are, what was asked, what was sent."""
    return Memory(
        jnp.concatenate([angle[None], memory.angle[:-1]]),
        jnp.concatenate([target[None], memory.asked[:-1]]),
        jnp.concatenate([sent[None], memory.sent[:-1]]),
    )


def command_effect(joints: Array, transform: Callable) -> Effect:
    """Build the command effect of `transform(params, memory, angle, target, noise)`.

    Args:
        joints: [K] indices of the joints that it corrects.
        transform: what the simulator is told instead of `target`, all [K] rad; noise is
            unit normal.
    """

    def init(params: Any, signal: Signal) -> Memory:
        return remembered(signal.angle[joints], signal.target[joints])

    def apply(params: Any, memory: Memory, signal: Signal) -> tuple[Memory, Signal]:
        angle, target = signal.angle[joints], signal.target[joints]
        noise = draws(signal, joints)
        changed = transform(params, memory, angle, target, noise)
        sent = params.alpha * changed + (1.0 - params.alpha) * target
        memory = pushed(memory, angle, target, sent)
        return memory, signal._replace(target=signal.target.at[joints].set(sent))

    return Effect(init, apply)


def draws(signal: Signal, joints: Array) -> Array:
    """Unit normal draws [K], each another joint's.

    A joint's own one decides whether its command is lost.
    """
    return jnp.roll(signal.noise[joints], 1)


def joined(memory: Memory, angle: Array, target: Array) -> tuple[Array, Array]:
    """Angles and actions, both [1 + HISTORY, K], newest first."""
    angles = jnp.concatenate([angle[None], memory.angle])
    return angles, jnp.concatenate([target[None], memory.asked])


def expected(
    forward: Network, memory: Memory, angle: Array, target: Array
) -> tuple[Array, Array, Array]:
    """Angles and actions, both [1 + HISTORY, K], and the x_t+1 [K] that f expects."""
    angles, actions = joined(memory, angle, target)
    return angles, actions, next_angle(forward, angles, actions)


def inverse_action(
    inverse: Network, angles: Array, sent: Array, following: Array
) -> Array:
    """Action [K] rad that takes the simulator from x_t..x_t-4 to `following` [K]."""
    return angles[0] + predict(inverse, inverse_inputs(angles, sent, following))


def gat_effect(joints: Array) -> Effect:
    """GAT on the joints with these indices; params: `Gat`."""

    def transform(
        params: Gat, memory: Memory, angle: Array, target: Array, noise: Array
    ) -> Array:
        angles, _, following = expected(params.forward, memory, angle, target)
        return inverse_action(params.inverse, angles, memory.sent, following)

    return command_effect(joints, transform)


def learn(experience: Experience) -> tuple[Gat, dict[str, Any]]:
    """Learn f from the robot and f_sim^-1 from the simulator."""
    forward, forward_fit = learn_forward(experience.robot, experience.seed)
    inverse, inverse_fit = learn_inverse(experience.simulator, experience.seed + 1)
    facts = {"forward": forward_fit._asdict(), "inverse": inverse_fit._asdict()}
    return Gat(np.float32(1.0), forward, inverse), facts


def template(joints: int) -> Gat:
    """Parameters for so many joints that are all zero."""
    network = blank((2 + 2 * HISTORY) * joints, 2 * joints)
    return Gat(np.float32(0.0), network, network)


GAT = Grounder(effect=gat_effect, learn=learn, template=template)
