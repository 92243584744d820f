"""GAT with a sensor transformation: the pilot is told what the robot's gyro would say.

The paper's future work: a second layer turns what the simulator measures into what the
robot would measure in that state. What a gyro says while the joints move so is learned
of the robot and of the simulator, and their difference is added. What the simulated
robot does besides (a push, a stumble) stays.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.effects.effect import Effect
from gatjax.grounding import gat
from gatjax.grounding.gat import Gat, gat_effect
from gatjax.grounding.grounder import Experience, Grounder
from gatjax.grounding.network import Fit, Network, blank, raw, regress
from gatjax.grounding.transitions import HISTORY, transitions, windows
from gatjax.records import Sensed

Array = Any
AXES = 3  # of a gyro


class Sensing(NamedTuple):
    """Parameters of both effects."""

    alpha: Array  # [] 0..1, of both
    action: Gat  # its own alpha is not used
    robot: Network  # rad/s that the robot's gyro reads while its joints move so
    simulator: Network  # the same of the simulator


def gyro_inputs(angle: Array) -> Array:
    """Inputs of both gyro models from x_t..x_t-4 [..., 1 + HISTORY, K]."""
    xp = jnp if not isinstance(angle, np.ndarray) else np
    now = angle[..., :1, :]
    joined = xp.concatenate([now, now - angle[..., 1:, :]], axis=-2)
    return joined.reshape(*joined.shape[:-2], -1)


def action_effect(joints: Array) -> Effect:
    """Command effect: GAT on the joints with these indices; params: Sensing."""
    effect = gat_effect(joints)

    def own(params: Sensing) -> Gat:
        return params.action._replace(alpha=params.alpha)

    return Effect(
        init=lambda params, signal: effect.init(own(params), signal),
        apply=lambda params, state, signal: effect.apply(own(params), state, signal),
    )


def gyro_effect(joints: Array) -> Effect:
    """Sensor effect on the gyro, from the joints with these indices."""

    def init(params: Sensing, signal: Sensed) -> Array:
        return jnp.stack([signal.reading.angle[joints]] * HISTORY)

    def apply(params: Sensing, past: Array, signal: Sensed) -> tuple[Array, Sensed]:
        now = signal.reading.angle[joints][None]
        inputs = gyro_inputs(jnp.concatenate([now, past]))
        apart = raw(params.robot, inputs) - raw(params.simulator, inputs)
        gyro = signal.reading.gyro + params.alpha * apart
        reading = signal.reading._replace(gyro=gyro.astype(signal.reading.gyro.dtype))
        return jnp.concatenate([now, past[:-1]]), signal._replace(reading=reading)

    return Effect(init, apply)


def learn_gyro(
    runs: list[JointRun], gyros: list[Array], seed: int
) -> tuple[Network, Fit]:
    """Learn what a gyro [T, 3] rad/s reads while the joints move so."""
    data = transitions(runs)
    read = np.concatenate([windows(gyro)[:, 0] for gyro in gyros])
    return regress(gyro_inputs(data.angle), read, gat.split(data, 0.15, seed), seed)


def learn(experience: Experience) -> tuple[Sensing, dict[str, Any]]:
    """Learn GAT, and of robot and simulator what their gyros read."""
    params, facts = gat.learn(experience)
    models, seed = [], experience.seed
    sides = zip((experience.robot, experience.simulator), experience.gyros(),
                ("gyro_robot", "gyro_simulator"), strict=True)  # fmt: skip
    for runs, gyros, name in sides:
        model, fit = learn_gyro(list(runs), list(gyros), seed)
        models.append(model)
        facts[name] = fit._asdict()
    return Sensing(np.float32(1.0), params, *models), facts


def template(joints: int) -> Sensing:
    """Parameters for so many joints that are all zero."""
    model = blank((1 + HISTORY) * joints, AXES)
    return Sensing(np.float32(0.0), gat.template(joints), model, model)


SENSING = Grounder(action_effect, learn, template, gyro_effect)
