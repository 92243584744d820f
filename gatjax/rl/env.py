"""The walk world as a `brax.envs.Env`: the action is added to what the walk commands.

One step is one control tick. The walk engine walks in it as it does everywhere; an
environment only adds to its targets, so a policy that does nothing is the plain walk.
A world that delays or loses commands does so with the sum, as it would on the robot.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import Env, State

from gatjax.records import Reading, Signal
from gatjax.robot.model import joint_names
from gatjax.robot.nao import WALKING_JOINTS
from gatjax.sim import called, mjx
from gatjax.sim.course import Place, course
from gatjax.sim.world import World
from gatjax.task import Score

Array = Any
NewState: Any = State  # Flax's dataclasses have no types that pyright could know
ENGINES = {"native": called.engine, "mjx": mjx.engine}


class View(NamedTuple):
    """What a learner sees of the K joints that it acts on; signals are theirs alone."""

    size: int  # of an observation
    begin: Callable[[Signal], Any]  # (first signal) -> memory
    look: Callable[[Any, Signal, Reading], Array]
    # (memory, signal, reading of all joints) -> observation [size]
    push: Callable[[Any, Signal, Array], Any]
    # (memory, signal, targets [K] rad that were sent) -> memory


class Step(NamedTuple):
    """A state of the environment: before the action of a tick."""

    place: Place
    signal: Signal  # [J] what the walk commands
    memory: Any  # of the view


class Walk(Env):
    """A walk in a world; observations are [size], actions [K] in `scale`."""

    def __init__(
        self,
        world: World,
        policy: Array,
        view: View,
        scale: float,
        engine: str = "native",
        joints: tuple[str, ...] = WALKING_JOINTS,
    ) -> None:
        """Prepare the world.

        Args:
            world: what it walks in.
            policy: [15] parameters of the walk engine.
            view: what is observed.
            scale: rad that an action of 1 adds to a joint's target.
            engine: "native" (MuJoCo C, called back) or "mjx".
            joints: K names that are acted on.
        """
        names = joint_names(world.model)
        self._world, self._view, self._scale = world, view, scale
        self._policy = jnp.asarray(policy, float)
        self._joints = np.array([names.index(joint) for joint in joints])
        self._course = course(world, ENGINES[engine](world))

    def reset(self, rng: Array) -> State:
        """Begin a walk: ready pose, slightly disturbed.

        Args:
            rng: words [2] of a random key (`jax.random.key_data`), as Brax has them.
        """
        key = jax.random.wrap_key_data(rng)
        place = self._course.begin(self._world.values, self._policy, key)
        place, signal, row = self._look(place)
        memory = self._view.begin(self._of(signal))
        zero = jnp.zeros(())
        metrics = {"forward_m": zero, "fell": zero}
        step = Step(place, signal, memory)
        return NewState(step, self._seen(step, row.reading), zero, zero, metrics)

    def step(self, state: Any, action: Array) -> State:
        """Command the walk's target and the action; walk one control tick.

        Rewards of an episode add up to what the search maximises: mean velocity in m/s
        over the task's duration, less 15 for a fall, which ends the episode.
        """
        before: Any = state.pipeline_state
        sent = before.signal.target[self._joints] + self._scale * action
        target = before.signal.target.at[self._joints].set(sent)
        told = before.signal._replace(target=target)
        memory = self._view.push(before.memory, self._of(before.signal), sent)
        place = self._course.move(self._world.values, before.place, told)
        place, signal, row = self._look(place)
        step, task = Step(place, signal, memory), self._world.task
        forward = _way(place.loop.score) - _way(before.place.loop.score)
        fell = jnp.asarray(jnp.isfinite(place.loop.score.fell_at), float)
        return state.replace(
            pipeline_state=step, obs=self._seen(step, row.reading), done=fell,
            reward=forward / task.duration - task.fall_penalty * fell,
            metrics=state.metrics | {"forward_m": forward, "fell": fell},
        )  # fmt: skip

    @property
    def observation_size(self) -> int:
        """Numbers in an observation."""
        return self._view.size

    @property
    def action_size(self) -> int:
        """Joints that are acted on."""
        return len(self._joints)

    @property
    def backend(self) -> str:
        """The physics, in Brax's words."""
        return "mjx"

    def _look(self, place: Place) -> tuple:
        return self._course.look(self._world.values, self._policy, place)

    def _of(self, signal: Signal) -> Signal:
        return jax.tree.map(lambda leaf: leaf[self._joints], signal)

    def _seen(self, step: Step, reading: Reading) -> Array:
        seen = self._view.look(step.memory, self._of(step.signal), reading)
        return jnp.asarray(seen, float)


def _way(score: Score) -> Array:
    """How far a robot has walked since the request, m."""
    return score.reached - score.origin
