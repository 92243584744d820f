"""The control loop between physics steps, vectorised over robots, on the CPU.

Encoders, sensors, pilot, effects and servos are compiled functions; those that do not
depend on the world are compiled once for all worlds, the others once for all worlds
of the same model, causes and groundings, whatever `World.values` are.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from gatjax import task as tasks
from gatjax.records import Reading, Signal
from gatjax.robot.model import slots as find_slots
from gatjax.sim import episode
from gatjax.sim.actuation import Push, State, actuation
from gatjax.sim.compiled import host
from gatjax.sim.world import Values, World

Array = Any
KEPT = 32  # worlds whose compiled functions are kept


def _cpu(function: Callable, axes: tuple) -> Callable:
    """Vectorise and compile for the CPU, wherever else JAX computes."""
    compiled = jax.jit(jax.vmap(function, in_axes=axes))
    device = host()

    def call(*arguments: Any) -> Any:
        with jax.default_device(device):
            return compiled(*arguments)

    return call


class Start(NamedTuple):
    """State of a run that begins."""

    qpos: Array  # [nq]
    qvel: Array  # [nv]


class Shared(NamedTuple):
    """What runs of a task have in common, whatever the world is."""

    draw: Callable[[Array, Array], tuple[episode.Draw, tasks.PilotState]]
    noise: Callable[[Array, Array], episode.Noise]
    pilot: Callable[..., tuple[tasks.PilotState, Array]]  # as `tasks.pilot`


@functools.cache
def shared(task: tasks.Task) -> Shared:
    """The larger part of the control loop, compiled once for all worlds."""

    def draw(policy: Array, key: Array) -> tuple[episode.Draw, tasks.PilotState]:
        return episode.draw(task, policy, key), tasks.begin(policy)

    pilot = functools.partial(tasks.pilot, task)
    return Shared(
        _cpu(draw, (0, 0)), _cpu(episode.noise, (0, None)), _cpu(pilot, (0, 0, 0, 0))
    )


class Control:
    """The part of the control loop that depends on a world.

    Every function takes the world's values, and a row a robot of all else but ticks.
    """

    def __init__(self, world: World) -> None:
        """Compile nothing yet."""
        self._world = world
        self._joints = find_slots(world.model)
        self.servos = actuation(world)
        self.open = _cpu(self._open, (None, 0, 0))
        self.sense = _cpu(self._sense, (None, 0, 0, 0, None, 0, 0, 0, 0))
        self.tell = _cpu(self._tell, (None, 0, 0, 0, 0))
        self._asked = _cpu(self._ask, (None, 0, 0, 0, 0))
        driven = self.servos.driven  # without torques there is nothing to compile
        self._driven = _cpu(driven, (None, *[0] * 4)) if self.servos.torques else driven
        self.command = _cpu(self._command, (None, 0, 0, 0, 0, 0))
        self.init = _cpu(self._init, (None, 0, 0))
        self.report = _cpu(self._report, (None, 0, 0, 0))

    def motor(
        self, values: Values, state: State, target: Array, angle: Array,
        velocity: Array, stiffness: Array,
    ) -> tuple[State, Push]:  # fmt: skip
        """One physics step of the motor and joint effects of all robots.

        They are two compiled functions: in one XLA computes what the motors are asked
        for, a look into the memory of a delay, anew for each of its twenty uses. The
        second is not given that memory, which it would copy.
        """
        state, signal = self._asked(values, state, target, angle, velocity)
        kept, state = state.motor, state._replace(motor=())
        state, push = self._driven(values, state, signal, angle, stiffness)
        return state._replace(motor=kept), push

    # one robot

    def _open(
        self, values: Values, drawn: episode.Draw, pilot: tasks.PilotState
    ) -> tuple[Start, episode.Loop, State]:
        qpos, qvel = episode.placed(self._world.model, self._joints, drawn)
        sensors = jnp.zeros(self._world.model.nsensordata, qpos.dtype)
        plant = episode.observe(self._joints, qpos, qvel, sensors)
        loop, first = episode.open_loop(self._world, values, drawn, pilot, plant)
        return Start(qpos, qvel), loop, self.servos.init(values, first)

    def _sense(
        self, values: Values, drawn: episode.Draw, noise: episode.Noise,
        loop: episode.Loop, tick: Array, qpos: Array, qvel: Array, sensors: Array,
        motor: State,
    ) -> tuple[episode.Loop, episode.Plant, Reading]:  # fmt: skip
        plant = episode.observe(self._joints, qpos, qvel, sensors)
        angle = self.servos.seen(values, motor, plant.reading.angle)
        plant = plant._replace(reading=plant.reading._replace(angle=angle))
        loop, reading = episode.sense(
            self._world, values, drawn, noise, loop, tick, plant
        )
        return loop, plant, reading

    def _tell(
        self, values: Values, state: Any, plant: episode.Plant, row: episode.Row,
        noise: episode.Noise,
    ) -> tuple[Any, Array]:  # fmt: skip
        state, signal = episode.tell(self._world, values, state, plant, row, noise)
        return state, signal.target

    def _ask(
        self, values: Values, state: State, target: Array, angle: Array,
        velocity: Array,
    ) -> tuple[State, Signal]:  # fmt: skip
        signal = Signal(target, angle, velocity, jnp.zeros_like(target))
        return self.servos.asked(values, state, signal)

    def _command(
        self, values: Values, state: Any, target: Array, angle: Array, velocity: Array,
        noise: Array,
    ) -> tuple[Any, Array]:  # fmt: skip
        signal = Signal(target, angle, velocity, noise)
        state, signal = self._world.chains()[0].apply(values.command, state, signal)
        return state, signal.target

    def _init(self, values: Values, target: Array, angle: Array) -> tuple[Any, State]:
        command = self._world.chains()[0]
        signal = Signal(target, angle, jnp.zeros_like(angle), jnp.zeros_like(angle))
        motor = self.servos.init(values, signal)
        _, reported = self._report(values, None, motor, angle)
        told = signal._replace(angle=reported)
        return command.init(values.command, told), motor

    def _report(
        self, values: Values, state: Any, motor: State, angle: Array
    ) -> tuple[Any, Array]:
        """Return what is measured of joints at an angle; state None is the first."""
        seen = self.servos.seen(values, motor, angle)
        return episode.report(self._world, values, state, seen)


class _Structure:
    """A world; equal to others whose control loops would be compiled alike."""

    def __init__(self, world: World) -> None:
        """Take a world whose model changes no more."""
        self.world = world
        slots = world.command, world.motor, world.sensor, world.joint
        self._key = (
            world.task, _content(world.model), repr(world.causes),
            tuple(tuple(slot) for slot in slots),
            tuple(world.command[name] for name in world.learned),
            tuple(world.sensor[name] for name in world.learned_sensors),
        )  # fmt: skip

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Structure) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


def _content(model: mujoco.MjModel) -> bytes:
    """All that a model says, in a few bytes."""
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return hashlib.sha256(buffer.tobytes()).digest()


def control(world: World) -> Control:
    """The part of the control loop that depends on a world, compiled once if need be.

    Args:
        world: its model, its causes with their numbers, and the effects that were
            learned are what decides; other `World.values` share what is compiled.
    """
    return _control(_Structure(world))


@functools.lru_cache(KEPT)
def _control(structure: _Structure) -> Control:
    return Control(structure.world)
