"""Proximal policy optimisation: Brax's losses, networks and wrappers, our loop.

Schulman et al. 2017 (arXiv:1707.06347). Brax 0.14.2's own loop needs a function that
JAX 0.10 no longer has (`jax.device_put_replicated`), and keeps its rewards to itself;
here a learner may replace them by ones that it learns meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from brax.envs.base import Env
from brax.envs.wrappers.training import wrap
from brax.training import acting, networks
from brax.training.agents.ppo import losses
from brax.training.agents.ppo import networks as ppo_networks
from brax.training.distribution import NormalDistribution
from brax.training.types import Transition

Array = Any
HIDDEN = (200, 180)  # of the policy; tanh
CRITIC = (128, 128)
# Flax's dataclasses have no types that pyright could know.
Params: Any = losses.PPONetworkParams
PPONetworks: Any = ppo_networks.PPONetworks
CLIP, SPREAD, CLIPPED_NORM = 0.2, 0.95, 1.0  # PPO's epsilon, lambda; gradient norm
PACE, RATES = 1.5, (1e-5, 5e-3)  # how fast Adam's rate changes, and its bounds
FARTHEST = 4.0  # times the wanted change of a policy in a round
FAR = 8.0  # standard deviations at which observations are cut off


class Plan(NamedTuple):
    """How long and how to learn."""

    rounds: int = 60
    robots: int = 64  # episodes of a round
    ticks: int = 200  # of an episode; a multiple of `unroll`
    unroll: int = 10  # ticks after which the critic takes over
    minibatches: int = 16  # of a round; divides robots x ticks / unroll
    epochs: int = 4
    rate: float = 1e-3  # of Adam, at first
    step: float = 0.15  # nats that the policy shall change by in a round
    discount: float = 0.5
    deviation: float = 0.3  # first standard deviation of an action
    entropy: float = 0.0


class Scale(NamedTuple):
    """What observations are like."""

    mean: Array  # [O]
    deviation: Array  # [O] > 0


class Learned(NamedTuple):
    """Weights of a policy: standardised observation [O] -> action [A], by tanh."""

    weights: tuple[Array, ...]
    biases: tuple[Array, ...]
    log_deviation: Array  # [A]


class Round(NamedTuple):
    """What one round was like."""

    policy: Learned  # that walked
    walks: Transition  # [N, unroll, ...] what was tried
    reward: float  # mean of a tick, as it was learned from
    fell: float  # share of ticks that ended in a fall


Rewards = Callable[[Transition], Array]
"""Walks [N, T, ...] -> rewards [N, T]; may learn from them first."""


def act(policy: Learned, seen: Array) -> Array:
    """Actions [..., A] for standardised observations [..., O]."""
    for weight, bias in zip(policy.weights[:-1], policy.biases[:-1], strict=True):
        seen = jnp.tanh(seen @ weight + bias)
    return seen @ policy.weights[-1] + policy.biases[-1]


def trained(
    env: Env, scale: Scale, plan: Plan, seed: int, rewards: Rewards | None = None
) -> Iterator[Round]:
    """Learn a policy round by round; at first it does nothing but its noise.

    Args:
        env: one robot.
        scale: of its observations.
        plan: how.
        seed: of weights, starts and noise.
        rewards: what to learn from instead of the environment's rewards.
    """
    nets = _networks(env, plan)
    key, first, second = jax.random.split(jax.random.key(seed), 3)
    params = Params(
        policy=nets.policy_network.init(first), value=nets.value_network.init(second)
    )
    descent = optax.inject_hyperparams(_descent)(rate=plan.rate)
    state = descent.init(params)
    scale = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), scale)
    collect = jax.jit(_collector(wrap(env, plan.ticks), nets, plan))
    improve = jax.jit(_improver(nets, descent, plan))
    for number in range(plan.rounds):
        walking, learning = jax.random.split(jax.random.fold_in(key, number))
        walks = collect(params, scale, walking)
        if rewards is not None:  # a fall ends what can be earned
            walks = walks._replace(reward=rewards(walks) * walks.discount)
        tried, ended = params.policy, 1.0 - np.asarray(walks.discount)
        later, moved, far = improve(params, scale, state, walks, learning)
        if far < FARTHEST * plan.step:  # else the round is taken back
            params, state = later, moved
        state = _paced(state, float(far), plan.step)
        fell = float(np.mean(ended - walks.extras["state_extras"]["truncation"]))
        yield Round(tried, walks, float(np.mean(walks.reward)), fell)


def _descent(rate: float) -> optax.GradientTransformation:
    return optax.chain(optax.clip_by_global_norm(CLIPPED_NORM), optax.adam(rate))


def _paced(state: Any, far: float, wanted: float) -> Any:
    """Change Adam's rate where a round went more than twice as far as wanted, or less.

    Adaptive penalties of Schulman et al. (section 4), here of the rate; in nats.
    """
    change = 1.0 / PACE if far > 2.0 * wanted else PACE if far < wanted / 2.0 else 1.0
    rate = jnp.clip(state.hyperparams["rate"] * change, *RATES)
    return state._replace(hyperparams={**state.hyperparams, "rate": rate})


def _networks(env: Env, plan: Plan) -> Any:
    """Policy and critic; the policy's last layer is zero."""
    seen: Any = env.observation_size
    sizes = (seen, *HIDDEN, env.action_size)

    def init(key: Array) -> Learned:
        keys = jax.random.split(key, len(sizes) - 1)
        weights = [
            jax.random.normal(one, (wide, narrow)) / np.sqrt(wide)
            for one, wide, narrow in zip(keys, sizes, sizes[1:], strict=False)
        ]
        weights[-1] = jnp.zeros_like(weights[-1])
        biases = tuple(jnp.zeros(size) for size in sizes[1:])
        deviation = jnp.full(sizes[-1], np.log(plan.deviation), float)
        return Learned(tuple(weights), biases, deviation)

    def apply(scale: Scale, policy: Learned, seen: Array) -> tuple[Array, Array]:
        mean = act(policy, _standard(seen, scale))
        deviation = jnp.broadcast_to(jnp.exp(policy.log_deviation), mean.shape)
        return mean, deviation

    critic = networks.make_value_network(
        sizes[0], _standard, CRITIC, activation=jnp.tanh
    )
    return PPONetworks(
        networks.FeedForwardNetwork(init, apply), critic, NormalDistribution(sizes[-1])
    )


def _standard(observation: Any, preprocessor_params: Any) -> Array:
    """Observations [..., O], standardised; the names are those that Brax asks for."""
    shape = observation.shape
    mean, deviation = (jnp.broadcast_to(value, shape) for value in preprocessor_params)
    return jnp.clip((observation - mean) / deviation, -FAR, FAR)


def _collector(env: Any, nets: Any, plan: Plan) -> Callable:
    """(params, scale, key) -> walks [robots x ticks / unroll, unroll, ...]."""

    def collect(params: Any, scale: Scale, key: Array) -> Transition:
        begin, noise = jax.random.split(key)
        starts = jax.random.split(begin, plan.robots)
        state = env.reset(jax.random.key_data(starts))
        policy = ppo_networks.make_inference_fn(nets)((scale, params.policy))

        def some(carry: tuple, _: None) -> tuple:
            state, noise = carry
            noise, now = jax.random.split(noise)
            state, walks = acting.generate_unroll(
                env, state, policy, now, plan.unroll, ("truncation",)
            )
            return (state, noise), walks

        with jax.numpy_rank_promotion("allow"):  # Brax promotes ranks itself
            count = plan.ticks // plan.unroll
            _, walks = jax.lax.scan(some, (state, noise), None, length=count)
        return jax.tree.map(_by_piece, walks)

    return collect


def _by_piece(leaf: Array) -> Array:
    """[pieces, unroll, robots, ...] as [pieces x robots, unroll, ...]."""
    leaf = jnp.swapaxes(leaf, 1, 2)
    return leaf.reshape(-1, *leaf.shape[2:])


def _improver(nets: Any, descent: Any, plan: Plan) -> Callable:
    """(params, scale, state of Adam, walks, key) -> params, state of Adam, nats."""

    def loss(params: Any, scale: Scale, walks: Transition, key: Array) -> Array:
        return losses.compute_ppo_loss(
            params, scale, walks, key, nets, plan.entropy, plan.discount,
            gae_lambda=SPREAD, clipping_epsilon=CLIP,
        )[0]  # fmt: skip

    def improve(
        params: Any, scale: Scale, state: Any, walks: Transition, key: Array
    ) -> tuple:
        count = len(walks.reward)

        def descend(carry: tuple, rows: Array) -> tuple:
            params, state, key = carry
            key, now = jax.random.split(key)
            some = jax.tree.map(lambda leaf: leaf[rows], walks)
            slope = jax.grad(loss)(params, scale, some, now)
            change, state = descent.update(slope, state, params)
            return (optax.apply_updates(params, change), state, key), None

        orders = jax.vmap(lambda one: jax.random.permutation(one, count))(
            jax.random.split(key, plan.epochs)
        )
        rows = orders.reshape(plan.epochs * plan.minibatches, -1)
        with jax.numpy_rank_promotion("allow"):
            (params, state, _), _ = jax.lax.scan(descend, (params, state, key), rows)
            new = nets.policy_network.apply(scale, params.policy, walks.observation)
            old = walks.extras["policy_extras"]["distribution_params"]
            return params, state, _divergence(old, new)

    return improve


def _divergence(old: Any, new: Any) -> Array:
    """Mean Kullback-Leibler divergence of normal (mean, deviation) [..., A], nats."""
    (mean, deviation), (later, wide) = old, new
    square = (deviation**2 + (later - mean) ** 2) / (2.0 * wide**2)
    return jnp.mean(jnp.sum(jnp.log(wide / deviation) + square - 0.5, axis=-1))
