"""Regression models: linear part plus a 200-180 network, GAT's on the circle.

Paper (GAT Implementation): three layers with 200 and 180 hidden units that regress to
the sine and cosine of the target, passed through arctan. Ours adds a linear path beside
the layers, solved in closed form: it carries the model where the data end.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

Array = Any

HIDDEN = (200, 180)
RIDGE = 1e-3  # of standardised inputs, per sample
BATCH, EPOCHS, PATIENCE = 256, 80, 8
LEAST_STEPS = 8  # of an epoch: few samples are gone over several times
LEARNING_RATE = 2e-3
SILENT = 1e30  # scale of an input that never moved: of it nothing is heard
LEAST = 1e-4  # rad (unit of an input), deviation of one that tells something


class Network(NamedTuple):
    """Parameters of one model, all arrays."""

    input_mean: Array  # [I]
    input_scale: Array  # [I]
    output_mean: Array  # [O]; of angles: of K sines, then K cosines
    output_scale: Array  # [O]
    linear: Array  # [I, O]
    weights: tuple[Array, ...]
    biases: tuple[Array, ...]


class Fit(NamedTuple):
    """How a training went."""

    validation_rmse: float  # rad (unit of the output), on runs that decided to stop
    linear_rmse: float  # of the linear part alone
    epochs: int


def _standard(network: Network, inputs: Array) -> Array:
    z = (inputs - network.input_mean) / network.input_scale
    hidden = z
    for weight, bias in zip(network.weights[:-1], network.biases[:-1], strict=True):
        hidden = jnp.tanh(hidden @ weight + bias)
    return z @ network.linear + hidden @ network.weights[-1] + network.biases[-1]


def raw(network: Network, inputs: Array) -> Array:
    """Outputs [O] for inputs [I]."""
    return _standard(network, inputs) * network.output_scale + network.output_mean


def raw_many(network: Network, inputs: Array) -> np.ndarray:
    """Outputs [S, O] for inputs [S, I]."""
    return np.asarray(_raw_many(network, inputs))


_raw_many = jax.jit(jax.vmap(raw, in_axes=(None, 0)))


def predict(network: Network, inputs: Array) -> Array:
    """Angles [K] rad for inputs [I]."""
    return _angle(raw(network, inputs))


def _angle(out: Array) -> Array:
    """Angles [..., K] rad of sines and cosines [..., 2 K]."""
    xp = np if isinstance(out, np.ndarray) else jnp
    sine, cosine = xp.split(out, 2, axis=-1)
    return xp.arctan2(sine, cosine)


def blank(inputs: int, outputs: int) -> Network:
    """A network that is all zero, in its shapes."""
    sizes = (inputs, *HIDDEN, outputs)
    return Network(
        np.zeros(inputs), np.zeros(inputs), np.zeros(outputs), np.zeros(outputs),
        np.zeros((inputs, outputs)),
        tuple(np.zeros(pair) for pair in itertools.pairwise(sizes)),
        tuple(np.zeros(size) for size in sizes[1:]),
    )  # fmt: skip


def _circle(angle: Array) -> Array:
    return np.concatenate([np.sin(angle), np.cos(angle)], axis=-1)


def _start(inputs: Array, target: Array, seed: int) -> Network:
    """Standardise, solve the linear part, draw the layers; the last one starts at 0."""
    mean, scale = inputs.mean(0), inputs.std(0)
    scale = np.where(scale < LEAST, SILENT, scale)  # else a joint at rest shouts later
    out_mean, out_scale = target.mean(0), np.maximum(target.std(0), 1e-6)
    z, y = (inputs - mean) / scale, (target - out_mean) / out_scale
    gram = z.T @ z + RIDGE * len(z) * np.eye(z.shape[1])
    linear = np.linalg.solve(gram, z.T @ y)
    sizes = (z.shape[1], *HIDDEN, y.shape[1])
    generator = np.random.default_rng(seed)
    weights = [
        generator.normal(0.0, 1.0 / np.sqrt(size), (size, following))
        for size, following in itertools.pairwise(sizes)
    ]
    weights[-1] = np.zeros_like(weights[-1])
    return Network(
        mean, scale, out_mean, out_scale, linear, tuple(weights),
        tuple(np.zeros(size) for size in sizes[1:]),
    )  # fmt: skip


def _batches(samples: int) -> tuple[int, int, int]:
    """Number of batches, their size, and how often an epoch goes over them."""
    size = min(BATCH, samples)
    count = samples // size
    return count, size, -(-LEAST_STEPS // count)


def _optimiser(samples: int) -> optax.GradientTransformation:
    """Return what trains on so many samples; its steps shrink to 0 at the last one."""
    count, _, passes = _batches(samples)
    steps = count * passes * EPOCHS
    return optax.adam(optax.cosine_decay_schedule(LEARNING_RATE, steps))


@jax.jit
def _loss(layers: tuple, fixed: Network, inputs: Array, target: Array) -> Array:
    network = fixed._replace(weights=layers[0], biases=layers[1])
    found = jax.vmap(_standard, in_axes=(None, 0))(network, inputs)
    return jnp.mean((found - target) ** 2)


@jax.jit
def _epoch(
    layers: tuple, state: Any, fixed: Network, inputs: Array, target: Array, key: Array
) -> tuple[tuple, Any]:
    """One pass over shuffled minibatches, training the layers only."""
    order = jax.random.permutation(key, len(inputs))
    count, size, passes = _batches(len(inputs))
    batches = jnp.tile(order[: count * size].reshape(count, size), (passes, 1))
    optimiser = _optimiser(len(inputs))

    def step(carry: tuple, chosen: Array) -> tuple:
        layers, state = carry
        gradient = jax.grad(_loss)(layers, fixed, inputs[chosen], target[chosen])
        updates, state = optimiser.update(gradient, state)
        return (optax.apply_updates(layers, updates), state), None

    return jax.lax.scan(step, (layers, state), batches)[0]


def train(
    inputs: Array, angle: Array, held_out: Array, seed: int
) -> tuple[Network, Fit]:
    """Fit a model of angles; the layers stop early on held-out runs.

    Args:
        inputs: [S, I].
        angle: [S, K] rad, targets.
        held_out: [S] bool, samples of runs that only decide when to stop.
        seed: of the initial layers and the shuffling.
    """
    return regress(inputs, _circle(angle), held_out, seed, _angle)


def regress(
    inputs: Array,
    output: Array,
    held_out: Array,
    seed: int,
    meant: Callable[[Array], Array] = lambda out: out,
) -> tuple[Network, Fit]:
    """Fit a model of any numbers.

    Args:
        inputs: [S, I].
        output: [S, O], targets.
        held_out: [S] bool, samples of runs that only decide when to stop.
        seed: of the initial layers and the shuffling.
        meant: outputs [S, O] -> the numbers whose errors `Fit` tells.
    """
    fit, test = ~held_out, held_out
    network = _start(inputs[fit], output[fit], seed)
    network = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), network)
    target = (output - np.asarray(network.output_mean)) / np.asarray(
        network.output_scale
    )
    data = [jnp.asarray(array, jnp.float32) for array in (inputs, target)]
    (train_x, test_x), (train_y, test_y) = ((d[fit], d[test]) for d in data)
    layers, linear = (network.weights, network.biases), network
    state = _optimiser(len(train_x)).init(layers)
    best, waited, epoch = layers, 0, 0
    best_loss = float(_loss(layers, linear, test_x, test_y))
    for epoch in range(EPOCHS):
        key = jax.random.fold_in(jax.random.key(seed), epoch)
        layers, state = _epoch(layers, state, linear, train_x, train_y, key)
        now = float(_loss(layers, linear, test_x, test_y))
        waited = 0 if now < best_loss else waited + 1
        if now < best_loss:
            best, best_loss = layers, now
        if waited >= PATIENCE:
            break
    network = network._replace(weights=best[0], biases=best[1])

    def rmse(model: Network) -> float:
        error = meant(raw_many(model, test_x)) - meant(output[test])
        return float(np.sqrt(np.mean(error**2)))

    return network, Fit(rmse(network), rmse(linear), epoch + 1)
