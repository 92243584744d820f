"""The actuation of a long replay, compiled: one call a physics step.

A step of a few robots is hundreds of operations on a few numbers; numpy spends most of
its time between them. In and out go flat arrays of double precision, since a compiled
function looks at each array that it is given.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from gatjax.records import Signal
from gatjax.sim.actuation import Actuation, Push, State
from gatjax.sim.world import Values

Array = Any


class Memory(NamedTuple):
    """What a compiled actuation remembers."""

    flat: Array  # [N, S] of its effects
    torque: Array  # [N, J] N m, of the servos; () without joint effects


class Compiled:
    """An `Actuation` for robots [N] with values of their own; used `precisely`."""

    def __init__(self, servos: Actuation, values: Values, robots: int) -> None:
        """Compile nothing yet; values [N, ...] are those of all calls."""
        self._servos = servos
        self.torques, self.geared = servos.torques, servos.geared
        self._told = True, servos.torques, servos.torques, servos.geared  # of a Push
        used = Values({}, values.motor, {}, {}, values.joint, (), values.servo)
        self._values, self._open_values = _flat(used, robots)
        self._open: Callable[[Array], State]  # of the state that `init` gives
        self._step, self._see = (
            jax.jit(jax.vmap(one)) for one in (self._stepped, self._seen)
        )

    def init(self, values: Values, signal: Signal) -> Memory:
        """As `Actuation.init`."""
        state = self._servos.init(values, signal)
        flat, self._open = _flat(state, len(signal.target))
        return Memory(flat, state.torque)

    def apply(
        self, values: Values, state: Memory, signal: Signal, stiffness: Array = 1.0
    ) -> tuple[Memory, Push]:
        """As `Actuation.apply`."""
        robots, joints = signal.target.shape
        given = np.empty((robots, 4, joints))
        for row, part in enumerate((*signal[:3], stiffness)):
            given[:, row] = part
        flat, told = self._step(self._values, state.flat, given)
        rows = iter(np.asarray(told).swapaxes(0, 1))
        push = Push(*(next(rows) if there else None for there in self._told))
        return Memory(flat, next(rows) if self.torques else ()), push

    def seen(self, values: Values, state: Memory, angle: Array) -> Array:
        """As `Actuation.seen`."""
        if not self.geared:
            return angle
        return np.asarray(self._see(self._values, state.flat, angle))

    def _stepped(self, values: Array, flat: Array, given: Array) -> tuple[Array, Array]:
        target, angle, velocity, stiffness = given
        signal = Signal(target, angle, velocity, 0.0 * target)
        state, push = self._servos.apply(
            self._open_values(values), self._open(flat), signal, stiffness
        )
        torque = [state.torque] if self.torques else []
        told = [row for row in push if row is not None] + torque
        return ravel_pytree(state)[0], jnp.stack(jnp.broadcast_arrays(*told))

    def _seen(self, values: Array, flat: Array, angle: Array) -> Array:
        return self._servos.seen(self._open_values(values), self._open(flat), angle)


@contextlib.contextmanager
def precisely() -> Iterator[None]:
    """JAX computes in double precision here, on the CPU."""
    with jax.enable_x64(True), jax.default_device(host()):
        yield


@contextlib.contextmanager
def on_cpu() -> Iterator[None]:
    """JAX computes on the CPU here, in all threads."""
    before = jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]
    jax.config.update("jax_default_device", host())
    try:
        yield
    finally:
        jax.config.update("jax_default_device", before)


def host() -> Any:
    """The CPU.

    Raises:
        RuntimeError: JAX was told to leave it out.
    """
    try:
        return jax.local_devices(backend="cpu")[0]
    except RuntimeError as error:
        raise RuntimeError(
            "JAX leaves the CPU out, which gatjax needs beside a GPU: set "
            "JAX_PLATFORMS=cuda,cpu or nothing"
        ) from error


def _flat(tree: Any, robots: int) -> tuple[Array, Callable[[Array], Any]]:
    """A tree of robots as one array [N, S], and the way back of one robot."""
    _, back = ravel_pytree(jax.tree.map(lambda leaf: np.asarray(leaf[0], float), tree))
    rows = [np.reshape(leaf, (robots, -1)) for leaf in jax.tree.leaves(tree)]
    return jnp.concatenate([np.zeros((robots, 0)), *rows], axis=1), back
