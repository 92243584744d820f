"""What a way of grounding is: an effect, and how its parameters are learned."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from gatjax.data.trajectories import JointRun
from gatjax.effects.effect import Effect

Array = Any


class Experience(NamedTuple):
    """What a grounding is learned from; K joints are those that it corrects."""

    robot: Sequence[JointRun]  # runs of the robot, angles [T, K]
    simulator: Sequence[JointRun]  # runs of the simulator under the same policy
    gyros: Callable[[], tuple[Sequence[Array], Sequence[Array]]]
    # () -> rad/s, [T, 3] a run, of both; raises ValueError where a log has none
    step_error: Callable[[], Array]
    # () -> [K] rad, RMS one-step error of the simulator on the robot's runs
    play: Callable[[str, Any, int], Sequence[JointRun]]
    # (method, params, number) -> runs of the policy in the simulator grounded so; their
    # commands are what the simulator was told, not what the policy asked for
    practice: Callable[[Any, float], Any]
    # (view, scale) -> brax.envs.Env of the policy's walk in the simulator, seen like
    # that, whose actions times scale are added to its commands; raises ImportError
    # without the extra `rl`
    seed: int  # of initial weights and splits
    tell: Callable[[str], None]  # shows a line about what goes on, where it takes long


class Grounder(NamedTuple):
    """One way of grounding; its parameters have a field `alpha`, 0 (nothing) to 1."""

    effect: Callable[[Array], Effect]  # indices [K] of the joints -> command effect
    learn: Callable[[Experience], tuple[Any, dict[str, Any]]]  # -> params, facts of it
    template: Callable[[int], Any]  # K -> params that are all zero, in their shapes
    sensor: Callable[[Array], Effect] | None = None  # on what the pilot is told, if any
    needs: str | None = None  # package of an extra that learning needs
