"""Generative adversarial reinforced action transformation.

Desai, Durugkar, Karnan, Warnell, Hanna & Stone 2020, "An Imitation from Observation
Approach to Transfer Learning with Dynamics Mismatch" (NeurIPS): a discriminator learns
to tell the robot's transitions (s, a, s') from the simulator's, and the correction of
the command is trained to deceive it. No f, no f_sim^-1.

Their reward, -log(1 - D), taught nothing here: a discriminator that sees encoders
without noise is soon right about every transition (98 % at once, all after ten rounds),
and then it is 0 everywhere. So what it sees is blurred (Arjovsky & Bottou 2017,
"Towards Principled Methods for Training GANs"), and the reward is log D - log(1 - D)
(Fu, Luo & Levine 2018, AIRL), lifted above 0 so that a fall does not pay.
"""

from __future__ import annotations

import itertools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax

from gatjax.grounding.grounder import Experience, Grounder
from gatjax.grounding.reinforced import (
    FAR,
    LEAST,
    Correction,
    correction_effect,
    reinforced,
    samples,
    template,
)
from gatjax.grounding.transitions import transitions

Array = Any
ROUNDS = 80
HIDDEN = (128, 128)
STEPS, BATCH, RATE = 15, 512, 5e-4  # of the discriminator in a round
BLUR = 1.0  # deviation of noise on what it learns from, in deviations of the robot's
SURE = 8.0  # largest logit that counts
DECAY = 1e-3  # of its weights: it shall not learn samples by heart


class Discriminator:
    """Tells the robot's transitions from the simulator's; it learns as it goes."""

    def __init__(self, robot: Array, seed: int) -> None:
        """Know the robot.

        Args:
            robot: [S, I + K] inputs and changes of its transitions.
            seed: of weights and batches.
        """
        self._mean = robot.mean(0)
        self._deviation = np.maximum(robot.std(0), LEAST)
        self._robot, self._draw = self._standard(robot), np.random.default_rng(seed)
        sizes = (robot.shape[1], *HIDDEN, 1)
        self._layers = [
            (jnp.asarray(self._draw.normal(size=pair) / np.sqrt(pair[0]), float),
             jnp.zeros(pair[1]))
            for pair in itertools.pairwise(sizes)
        ]  # fmt: skip
        self._descent = optax.adamw(RATE, weight_decay=DECAY)
        self._state = self._descent.init(self._layers)
        self._learn = jax.jit(self._descended)
        self._logits = jax.jit(_logits)

    def rewards(self, simulator: Array) -> Array:
        """Learn from the simulator's transitions [S, I + K], then reward them [S]."""
        simulator = self._standard(simulator)
        for _ in range(STEPS):
            some = (self._picked(self._robot), self._picked(simulator))
            self._layers, self._state = self._learn(self._layers, self._state, *some)
        logits = self._logits(self._layers, simulator)
        self.accuracy = float(np.mean(np.asarray(logits) < 0.0))
        return SURE + np.clip(np.asarray(logits), -SURE, SURE)

    def _standard(self, rows: Array) -> Array:
        scaled = (rows - self._mean) / self._deviation
        return np.clip(scaled, -FAR, FAR)

    def _picked(self, rows: Array) -> Array:
        some = rows[self._draw.integers(len(rows), size=BATCH)]
        return some + BLUR * self._draw.normal(size=some.shape)

    def _descended(
        self, layers: Any, state: Any, robot: Array, simulator: Array
    ) -> Any:
        def loss(layers: Any) -> Array:
            real, made = _logits(layers, robot), _logits(layers, simulator)
            return jnp.mean(jax.nn.softplus(-real)) + jnp.mean(jax.nn.softplus(made))

        change, state = self._descent.update(jax.grad(loss)(layers), state, layers)
        return optax.apply_updates(layers, change), state


def _logits(layers: Any, rows: Array) -> Array:
    """Logits [S] of being the robot's, of rows [S, I + K]."""
    for weight, bias in layers[:-1]:
        rows = jnp.tanh(rows @ weight + bias[None])
    weight, bias = layers[-1]
    return (rows @ weight + bias[None])[:, 0]


def learn(experience: Experience) -> tuple[Correction, dict[str, Any]]:
    """Learn to move the simulator so that it passes for the robot."""
    robot = np.concatenate(samples(transitions(experience.robot)), axis=-1)
    discriminator = Discriminator(robot, experience.seed)
    unmasked = []

    def rewards(inputs: Array, later: Array) -> Array:
        change = later - inputs[:, : later.shape[-1]]
        paid = discriminator.rewards(np.concatenate([inputs, change], axis=-1))
        unmasked.append(discriminator.accuracy)
        return paid

    params, _ = reinforced(experience, rewards, ROUNDS)[-1]
    return params, {"unmasked": [unmasked[0], max(unmasked), unmasked[-1]]}


GARAT = Grounder(effect=correction_effect, learn=learn, template=template, needs="brax")
