"""The worlds whose speed is measured, and a walk in one of them to be played bare.

Every world walks alike, or the work would differ: the grounding's share is 0 and the
effects are too small to be felt, but all of their arithmetic is done.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from gatjax.grounding.gat import GAT, Gat, gat_effect
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
    draw = np.random.default_rng(0).normal

    def drawn(leaf: Any) -> Any:
        shape = np.shape(leaf)
        if len(shape) < 2:
            return np.ones(shape, np.float32)
        return np.asarray(draw(0.0, shape[0] ** -0.5, shape), np.float32)

    params = jax.tree.map(drawn, GAT.template(len(WALKING)))
    return params._replace(alpha=np.float32(0.0))


class Walk(NamedTuple):
    """What a bare loop plays: the same physics as the closed loop, nothing else."""

    world: World
    policies: Any  # [B, 15]
    keys: Any  # [B]
    qpos: np.ndarray  # [B, nq] at the start
    qvel: np.ndarray  # [B, nv]
    command: np.ndarray  # [T, B, K] rad, of the model's joints


def stepped_as(walk: Walk, world: World) -> Walk:
    """Return a walk with physics steps as long as those of a world."""
    model = mujoco.MjModel.__copy__(walk.world.model)
    model.opt.timestep = world.model.opt.timestep
    return walk._replace(world=dataclasses.replace(walk.world, model=model))


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
