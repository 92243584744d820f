"""The worlds whose speed is measured, and a walk in one of them to be played bare.

Every world walks alike, or the work would differ: the grounding's share is 0 and the
effects are too small to be felt, but all of their arithmetic is done.
"""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from gatjax.grounding.gat import Gat, gat_effect
from gatjax.grounding.network import HIDDEN, Network
from gatjax.grounding.transitions import HISTORY
from gatjax.robot.nao import WALKING
from gatjax.sim.episode import joints_of
from gatjax.sim.native import Native
from gatjax.sim.world import World, add_causes, add_command, nominal
from gatjax.task import Task
from gatjax.walk.parameters import THETA0

UNFELT = (
    ("command_delay", ["all"], {"delay": 1e-4}),
    ("encoder_scale", ["all"], {"scale": 1.0 + 1e-6}),
    ("backlash", ["LKneePitch", "RKneePitch"], {"width": 1e-6}),
    ("load_friction", ["all"], {"coefficient": 1e-6}),
)
"""Causes of which one acts every control tick, the others every physics step."""


def world_of(kind: str, task: Task) -> World:
    """A world to measure.

    Args:
        kind: "plain": sensor noise only; "grounded": GAT's two networks a control tick
            besides; "explained": effects of diagnosed causes besides those.
        task: how long a run is.
    """
    world = nominal(task)
    if kind == "explained":
        world = add_causes(world, UNFELT)
    if kind in ("grounded", "explained"):
        world = add_command(world, "grounding", gat_effect(WALKING), _networks())
    return world


def _networks() -> Gat:
    """GAT of the paper's size with drawn weights, of which nothing is used."""
    joints = len(WALKING)
    inputs, outputs = (2 + 2 * HISTORY) * joints, 2 * joints
    sizes = (inputs, *HIDDEN, outputs)
    draw = np.random.default_rng(0).normal

    def layer(one: int, other: int) -> Any:
        return np.asarray(draw(0.0, one**-0.5, (one, other)), np.float32)

    def like(size: int, value: float) -> Any:
        return np.full(size, value, np.float32)

    network = Network(
        like(inputs, 0.0), like(inputs, 1.0), like(outputs, 0.0), like(outputs, 1.0),
        layer(inputs, outputs),
        tuple(layer(*pair) for pair in itertools.pairwise(sizes)),
        tuple(like(size, 0.0) for size in sizes[1:]),
    )  # fmt: skip
    return Gat(np.float32(0.0), network, network)


class Walk(NamedTuple):
    """What a bare loop plays: the same physics as the closed loop, nothing else."""

    world: World
    policies: Any  # [B, 15]
    keys: Any  # [B]
    qpos: np.ndarray  # [B, nq] at the start
    qvel: np.ndarray  # [B, nv]
    command: np.ndarray  # [T, B, K] rad, of the model's joints


def recorded(world: World, worlds: int) -> Walk:
    """Walk theta0 once and keep the starts and commands."""
    policies = jnp.tile(jnp.asarray(THETA0, float), (worlds, 1))
    keys = jax.random.split(jax.random.key(0), worlds)
    native = Native(world)
    start = native.begin(world.values, policies, keys)[0]
    walk, _ = native.rollout(world.values, policies, keys)
    command = np.swapaxes(walk.command, 0, 1)[..., joints_of(world.model)]
    return Walk(
        world, policies, keys, np.asarray(start.qpos), np.asarray(start.qvel), command
    )
