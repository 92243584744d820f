"""How well a network predicts that learned the motion from the logs fitted to."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis.ahead import Windows, warming
from gatjax.grounding.gat import learn_forward, next_angle
from gatjax.grounding.network import Network
from gatjax.grounding.transitions import HISTORY

PIECE = 2.0  # s of a piece of the fit data, for the learned model's early stopping


def windows(forward: Network, cut: Windows, period: float) -> np.ndarray:
    """Angles that the network predicts for the windows."""
    warm = warming(period)
    return _rolled(forward, cut.angle[:, :warm], cut.command, warm)


def _rolled(
    forward: Network, past: np.ndarray, command: np.ndarray, warm: int
) -> np.ndarray:
    """Roll the learned model over commands [B, T, J] from past angles [B, W, J]."""
    order = np.arange(warm - 1, warm - 2 - HISTORY, -1)

    def one(angles: jnp.ndarray, actions: jnp.ndarray) -> jnp.ndarray:
        def step(history: jnp.ndarray, now: jnp.ndarray) -> tuple:
            following = next_angle(forward, history, now)
            return jnp.concatenate([following[None], history[:-1]]), following

        steps = jnp.arange(warm - 1, actions.shape[0] - 1)
        stack = actions[steps[:, None] - jnp.arange(HISTORY + 1)[None]]
        return jax.lax.scan(step, angles, stack)[1]

    first = jnp.asarray(past[:, order], jnp.float32)
    rolled = jax.jit(jax.vmap(one))(first, jnp.asarray(command, jnp.float32))
    return np.asarray(rolled, np.float64)


def learn(runs: list[JointRun], seed: int) -> Network:
    """The forward model of GAT, trained on pieces of the fit data."""
    return learn_forward(pieces(runs), seed)[0]


def pieces(runs: list[JointRun]) -> list[JointRun]:
    """Runs cut into pieces of about 2 s, of which some can be left out of training."""
    out = []
    for run in runs:
        count = max(2, round((run.time[-1] - run.time[0]) / PIECE))
        parts = np.array_split(np.arange(len(run.time)), count)
        out += [run.part(rows) for rows in parts]
    return out


def whole_log(forward: Network, runs: list[JointRun]) -> list[np.ndarray]:
    """Open-loop predictions [N, J] of whole runs by the learned model."""
    out = []
    for run in runs:
        warm = HISTORY + 1
        rolled = _rolled(forward, run.angle[None, :warm], run.command[None], warm)
        ends = run.angle.min(0) - 10.0, run.angle.max(0) + 10.0
        out.append(np.concatenate([run.angle[:warm], np.clip(rolled[0], *ends)]))
    return out
