"""The native backend: MuJoCo C on all CPU cores, the control loop vectorised between.

`mujoco.batch.Batch` steps the physics; pilot, effects and networks run as compiled CPU
functions over all robots: those that do not depend on the world are compiled once for
all worlds. Robots that fell or finished are no longer stepped.
"""

from __future__ import annotations

import dataclasses
import functools
import threading
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import batch

from gatjax import task as tasks
from gatjax.effects.sensor import drifted
from gatjax.records import Outcome, Reading, Signal, Trajectory
from gatjax.robot.model import slots as find_slots
from gatjax.sim import episode, shares
from gatjax.sim.actuation import Push, State, actuation
from gatjax.sim.compiled import host
from gatjax.sim.world import Values, World, fields_applied

Array = Any
SMALLEST = 64  # rows of a compiled batch
FEW = 100  # geoms of which all pairs are looked at sooner than trees of them are built
UNREAD = mujoco.mjtDisableBit.mjDSBL_SENSOR.value
INVERTED = 8  # iterations that undo what encoders do to an angle


def _padding(count: int) -> np.ndarray:
    """Rows that fill a batch up to one of a few sizes.

    The compiled control loop then serves many batch sizes; rows that are only padding
    are never stepped, and are an eighth of the batch or less than `SMALLEST`.
    """
    part = max(SMALLEST, (1 << (count - 1).bit_length()) // 8)
    return np.minimum(np.arange(-(-count // part) * part), count - 1)


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
def _shared(task: tasks.Task) -> Shared:
    """The larger part of the control loop, compiled once for all worlds."""

    def draw(policy: Array, key: Array) -> tuple[episode.Draw, tasks.PilotState]:
        return episode.draw(task, policy, key), tasks.begin(policy)

    pilot = functools.partial(tasks.pilot, task)
    return Shared(
        _cpu(draw, (0, 0)), _cpu(episode.noise, (0, None)), _cpu(pilot, (0, 0, 0, 0))
    )


class Native:
    """Runs of one world on the CPU; every method takes values and a batch."""

    def __init__(
        self,
        world: World,
        engine: Callable[..., Any] = batch.Batch,
        shares: Callable[[int], int] = shares.count,
    ) -> None:
        """Compile nothing yet; keep the world and find its joints and sensors.

        Args:
            world: what to simulate.
            engine: (model, nsim) -> what steps so many robots.
            shares: (robots) -> in how many shares they run at the same time.
        """
        self.world = world
        self._engine, self._shares = engine, shares
        self._where = find_slots(world.model)
        self._servos = actuation(world)
        self._shared = _shared(world.task)
        self._open = _cpu(self._open_one, (None, 0, 0))
        self._sense = _cpu(self._sense_one, (None, 0, 0, 0, None, 0, 0, 0, 0))
        self._tell = _cpu(self._tell_one, (None, 0, 0, 0, 0))
        self._motor = _cpu(self._motor_one, (None, 0, 0, 0, 0, 0))
        self._command = _cpu(self._command_one, (None, 0, 0, 0, 0, 0))
        self._init = _cpu(self._init_one, (None, 0, 0))
        self._report = _cpu(self._report_one, (None, 0, 0, 0))

    # one robot; vectorised by the constructor

    def _open_one(
        self, values: Values, drawn: episode.Draw, pilot: tasks.PilotState
    ) -> tuple[Start, episode.Loop, State]:
        qpos, qvel = episode.placed(self.world.model, self._where, drawn)
        sensors = jnp.zeros(self.world.model.nsensordata, qpos.dtype)
        plant = episode.observe(self._where, qpos, qvel, sensors)
        loop, first = episode.open_loop(self.world, values, drawn, pilot, plant)
        return Start(qpos, qvel), loop, self._servos.init(values, first)

    def _sense_one(
        self, values: Values, drawn: episode.Draw, noise: episode.Noise,
        loop: episode.Loop, tick: Array, qpos: Array, qvel: Array, sensors: Array,
        motor: State,
    ) -> tuple[episode.Loop, episode.Plant, Reading]:  # fmt: skip
        plant = episode.observe(self._where, qpos, qvel, sensors)
        angle = self._servos.seen(values, motor, plant.reading.angle)
        plant = plant._replace(reading=plant.reading._replace(angle=angle))
        loop, reading = episode.sense(
            self.world, values, drawn, noise, loop, tick, plant
        )
        return loop, plant, reading

    def _tell_one(
        self, values: Values, state: Any, plant: episode.Plant, row: episode.Row,
        noise: episode.Noise,
    ) -> tuple[Any, Array]:  # fmt: skip
        state, signal = episode.tell(self.world, values, state, plant, row, noise)
        return state, signal.target

    def _motor_one(
        self, values: Values, state: State, target: Array, angle: Array,
        velocity: Array, stiffness: Array,
    ) -> tuple[State, Push]:  # fmt: skip
        signal = Signal(target, angle, velocity, jnp.zeros_like(target))
        return self._servos.apply(values, state, signal, stiffness)

    def _command_one(
        self, values: Values, state: Any, target: Array, angle: Array, velocity: Array,
        noise: Array,
    ) -> tuple[Any, Array]:  # fmt: skip
        signal = Signal(target, angle, velocity, noise)
        state, signal = self.world.chains()[0].apply(values.command, state, signal)
        return state, signal.target

    def _init_one(
        self, values: Values, target: Array, angle: Array
    ) -> tuple[Any, State]:
        command = self.world.chains()[0]
        signal = Signal(target, angle, jnp.zeros_like(angle), jnp.zeros_like(angle))
        motor = self._servos.init(values, signal)
        _, reported = self._report_one(values, None, motor, angle)
        told = signal._replace(angle=reported)
        return command.init(values.command, told), motor

    def _report_one(
        self, values: Values, state: Any, motor: State, angle: Array
    ) -> tuple[Any, Array]:
        """Return what is measured of joints at an angle; state None is the first."""
        seen = self._servos.seen(values, motor, angle)
        return episode.report(self.world, values, state, seen)

    # batches

    def begin(self, values: Values, policies: Array, keys: Array) -> tuple:
        """Return how runs begin: their state, what was drawn, loops and servos."""
        drawn, pilot = self._shared.draw(policies, keys)
        start, loop, motor = self._open(values, drawn, pilot)
        return start, drawn, loop, motor

    def batch(self, values: Values, size: int) -> Any:
        """Return what steps so many robots, with the field changes of these values."""
        model = fields_applied(dataclasses.replace(self.world, values=values))
        # A run that diverges must stay so: MuJoCo would set it up again, standing.
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        if model.ntree == 1 and model.ngeom < FEW:  # islands are found among trees
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE
        return self._engine(model, nsim=size)

    def play(self, physics: Any, target: Array, ids: Any = None) -> None:
        """Play one control tick where no effect acts in motors or joints.

        Sensors are read after the last step, so they are left out of the others.
        """
        last, flags = self.world.substeps - 1, physics.expand("opt.disableflags")
        physics.ctrl[:] = np.asarray(target)
        flags |= UNREAD
        if last:
            physics.step(ids=ids, nstep=last)
        flags &= ~UNREAD
        physics.step(ids=ids)

    def _advance(
        self, physics: Any, motor: Callable, state: State, target: Array,
        ids: Any, stiffness: Array,
    ) -> State:  # fmt: skip
        """Play one control tick; `motor` is one step of the motor and joint effects."""
        if self._servos.plain:
            self.play(physics, target, ids)
            return state
        dofs, flags = self._where.velocity, physics.expand("opt.disableflags")
        flags |= UNREAD
        for step in range(self.world.substeps):
            angle, velocity = (
                physics.qpos[:, self._where.position],
                physics.qvel[:, dofs],
            )
            state, push = motor(state, target, angle, velocity, stiffness)
            physics.ctrl[:] = np.asarray(push.control)
            if push.load is not None:
                physics.qfrc_applied[:, dofs] = np.asarray(push.load)
                physics.expand("dof_frictionloss")[:, dofs] = np.asarray(push.friction)
            if push.armature is not None:
                physics.expand("dof_armature")[:, dofs] = np.asarray(push.armature)
            if step == self.world.substeps - 1:
                flags &= ~UNREAD
            physics.step(ids=ids)
        return state

    def _run(
        self, values: Values, policies: Array, keys: Array, keep: Callable,
        stopped: threading.Event,
    ) -> Any:  # fmt: skip
        count = len(policies)
        rows = _padding(count)
        policies = jnp.asarray(policies, jnp.result_type(float))[rows]
        start, drawn, loop, motor = self.begin(values, policies, keys[rows])
        real = jnp.arange(len(rows)) < count
        loop = loop._replace(score=loop.score._replace(alive=real))
        physics = self.batch(values, len(rows))
        servos = functools.partial(self._motor, values)
        physics.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        physics.qpos[:], physics.qvel[:] = start
        sensors = physics.bind("sensordata")
        full = np.ones((len(rows), self.world.model.nu))
        for tick in range(self.world.task.ticks):
            noise = self._shared.noise(drawn.noise, np.int32(tick))
            loop, plant, reading = self._sense(
                values, drawn, noise, loop, np.int32(tick),
                physics.qpos, physics.qvel, sensors, motor,
            )  # fmt: skip
            mind, target = self._shared.pilot(policies, drawn.go, loop.pilot, reading)
            row = episode.Row(target, reading, plant.base, loop.score.alive)
            command, target = self._tell(values, loop.command, plant, row, noise)
            loop = loop._replace(pilot=mind, command=command)
            keep(row, count)
            ids = np.flatnonzero(np.asarray(loop.score.alive))
            if len(ids) == 0 or stopped.is_set():
                break
            motor = self._advance(physics, servos, motor, target, ids, full)
        verdict = episode.verdict(self.world, loop)
        return jax.tree.map(lambda leaf: np.asarray(leaf)[:count], verdict)

    def outcome(self, values: Values, policies: Array, keys: Array) -> Outcome:
        """Closed-loop runs of policies [B, 15] with keys [B] -> Outcome [B]."""

        def some(rows: np.ndarray, stopped: threading.Event) -> Outcome:
            ours = policies[rows], keys[rows]
            return self._run(values, *ours, lambda row, count: None, stopped)

        return shares.joined(some, len(policies), self._shares(len(policies)))

    def rollout(
        self, values: Values, policies: Array, keys: Array
    ) -> tuple[Trajectory, Outcome]:
        """Closed-loop runs -> (Trajectory [B, T, ...], Outcome [B])."""

        def some(rows: np.ndarray, stopped: threading.Event) -> Any:
            return self._recorded(values, policies[rows], keys[rows], stopped)

        return shares.joined(some, len(policies), self._shares(len(policies)))

    def _recorded(
        self, values: Values, policies: Array, keys: Array, stopped: threading.Event
    ) -> tuple[Trajectory, Outcome]:
        """Closed-loop runs of one share."""
        rows: list[episode.Row] = []
        verdict = self._run(
            values, policies, keys,
            lambda row, count: rows.append(
                jax.tree.map(lambda leaf: np.asarray(leaf)[:count], row)
            ),
            stopped,
        )  # fmt: skip
        last = jax.tree.map(lambda leaf: np.array(leaf), rows[-1])
        last = last._replace(alive=np.zeros_like(last.alive))
        rows += [last] * (self.world.task.ticks - len(rows))
        stacked = jax.tree.map(lambda *leaves: np.stack(leaves, axis=1), *rows)
        time = np.arange(len(rows)) * self.world.task.control_period
        time = np.broadcast_to(time, stacked.alive.shape)
        return (
            Trajectory(
                time, stacked.command, stacked.reading, stacked.base, stacked.alive
            ),
            verdict,
        )

    def replay(
        self, values: Values, commands: Array, angles: Array, qpos: Array, qvel: Array,
        stiffness: Array | None = None, noise: Array | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Open-loop replay of windows; see `gatjax.sim.mjx.replay`.

        Args:
            values: the world's values.
            commands: [B, T, J] rad.
            angles: [B, W, J] rad, of the joints, for warming up the effects.
            qpos: [B, nq] physics state after the warm-up.
            qvel: [B, nv]
            stiffness: [B, T, J] share of the servos' gains; in a `stiffened` world.
            noise: [B, T, J] unit draws of the command effects; zeros if left out.

        Returns:
            Joint angles [B, T - W, J] after each tick as the encoders report them, rad.
        """
        physics = self.batch(values, len(commands))
        physics.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        physics.qpos[:], physics.qvel[:] = qpos, qvel
        servos = functools.partial(self._motor, values)
        state, motor = self._init(values, commands[:, 0], angles[:, 0])
        warm, log, sense, reported = angles.shape[1], [], None, None
        given = np.ones(np.shape(commands)) if stiffness is None else stiffness
        drawn = np.zeros(np.shape(commands)) if noise is None else noise
        for index in range(commands.shape[1]):
            if index < warm:
                angle, velocity = angles[:, index], 0.0 * angles[:, index]
                _, reported = self._report(values, None, motor, angle)
            else:
                velocity = physics.qvel[:, self._where.velocity]
                if sense is None:
                    angle = physics.qpos[:, self._where.position]
                    sense, reported = self._report(values, None, motor, angle)
                    log.append(np.asarray(reported))
            state, target = self._command(
                values, state, commands[:, index], reported, velocity, drawn[:, index]
            )
            if index < warm:
                for _ in range(0 if self._servos.plain else self.world.substeps):
                    motor, _ = servos(motor, target, angle, velocity, given[:, index])
                continue
            motor = self._advance(physics, servos, motor, target, None, given[:, index])
            angle = physics.qpos[:, self._where.position]
            sense, reported = self._report(values, sense, motor, angle)
            log.append(np.asarray(reported))
        return self._logged(values, np.stack(log, axis=1))[:, 1:]

    def behind(self, values: Values, readings: Array) -> np.ndarray:
        """Joint angles [B, J] rad that encoders at rest report as readings [B, J]."""
        readings = np.asarray(readings)
        angle = readings
        for _ in range(INVERTED):
            _, motor = self._init(values, angle, angle)
            _, measured = self._report(values, None, motor, angle)
            angle = angle + readings - np.asarray(measured)
        return angle

    def _logged(self, values: Values, log: np.ndarray) -> np.ndarray:
        """Apply the drift of the log's clock to logs [B, T, J]."""
        for drift in values.log.values() if values.log else ():
            log = np.stack([drifted(row, drift) for row in log])
        return log
