"""Robots spread over the devices of one host, and over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

Array = Any
ROBOTS = "robots"  # the axis of the mesh


def over_devices(outcome: Callable[..., Any], devices: Sequence[Any]) -> Callable:
    """Return the same runs with the robots shared out among devices.

    A number of robots that the devices do not divide is filled up with copies of the
    last one, which are thrown away.

    Args:
        outcome: (values, policies [B, 15], keys [B]) -> leaves [B, ...], traceable.
        devices: of this host.
    """
    mesh = _mesh(devices)
    each, all_same = PartitionSpec(ROBOTS), PartitionSpec()
    split = jax.shard_map(
        outcome, mesh=mesh, in_specs=(all_same, each, each), out_specs=each,
        check_vma=False,
    )  # fmt: skip

    def run(values: Any, policies: Array, keys: Array) -> Any:
        count = policies.shape[0]
        filled = -(-count // len(devices)) * len(devices)
        rows = np.minimum(np.arange(filled), count - 1)
        result = split(values, policies[rows], keys[rows])
        return jax.tree.map(lambda leaf: leaf[:count], result)

    return run


def everywhere(tree: Any, devices: Sequence[Any]) -> Any:
    """Return a tree whose leaves lie on all devices, as what such runs return does.

    A program that is called with its own results is then compiled only once.
    """
    if len(devices) == 1:
        return tree
    return jax.device_put(tree, NamedSharding(_mesh(devices), PartitionSpec()))


def _mesh(devices: Sequence[Any]) -> Mesh:
    return Mesh(np.array(devices), (ROBOTS,))


def in_turns(outcome: Callable[..., Any], turns: int) -> Callable:
    """Return the same runs in so many turns, one after the other: less memory.

    Args:
        outcome: (values, policies [B, 15], keys [B]) -> leaves [B, ...], traceable.
        turns: how many; 1 is all at once.
    """
    if turns == 1:
        return outcome

    def run(values: Any, policies: Array, keys: Array) -> Any:
        count = policies.shape[0]
        size = -(-count // turns)
        rows = np.minimum(np.arange(size * turns), count - 1).reshape(turns, size)
        result = jax.lax.map(
            lambda row: outcome(values, policies[row], keys[row]), rows
        )
        return jax.tree.map(
            lambda leaf: leaf.reshape(-1, *leaf.shape[2:])[:count], result
        )

    return run
