"""The native backend: MuJoCo C on all CPU cores, the control loop vectorised between.

`mujoco.batch.Batch` steps the physics; pilot, effects and networks run as compiled CPU
functions over all robots (`gatjax.sim.control`). Robots that fell or finished are no
longer stepped.
"""

from __future__ import annotations

import dataclasses
import functools
import threading
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import batch

from gatjax.effects.sensor import drifted
from gatjax.records import Outcome, Trajectory
from gatjax.robot.model import slots as find_slots
from gatjax.sim import episode, shares
from gatjax.sim.actuation import State
from gatjax.sim.control import control, shared
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
        self._shared, self._control = shared(world.task), control(world)
        self._plain = self._control.servos.plain

    def begin(self, values: Values, policies: Array, keys: Array) -> tuple:
        """Return how runs begin: their state, what was drawn, loops and servos."""
        drawn, pilot = self._shared.draw(policies, keys)
        start, loop, motor = self._control.open(values, drawn, pilot)
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
        if self._plain:
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
        servos = functools.partial(self._control.motor, values)
        physics.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        physics.qpos[:], physics.qvel[:] = start
        sensors = physics.bind("sensordata")
        full = np.ones((len(rows), self.world.model.nu))
        for tick in range(self.world.task.ticks):
            noise = self._shared.noise(drawn.noise, np.int32(tick))
            loop, plant, reading = self._control.sense(
                values, drawn, noise, loop, np.int32(tick),
                physics.qpos, physics.qvel, sensors, motor,
            )  # fmt: skip
            mind, target = self._shared.pilot(policies, drawn.go, loop.pilot, reading)
            row = episode.Row(target, reading, plant.base, loop.score.alive)
            command, target = self._control.tell(
                values, loop.command, plant, row, noise
            )
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
        servos = functools.partial(self._control.motor, values)
        state, motor = self._control.init(values, commands[:, 0], angles[:, 0])
        warm, log, sense, reported = angles.shape[1], [], None, None
        given = np.ones(np.shape(commands)) if stiffness is None else stiffness
        drawn = np.zeros(np.shape(commands)) if noise is None else noise
        for index in range(commands.shape[1]):
            if index < warm:
                angle, velocity = angles[:, index], 0.0 * angles[:, index]
                _, reported = self._control.report(values, None, motor, angle)
            else:
                velocity = physics.qvel[:, self._where.velocity]
                if sense is None:
                    angle = physics.qpos[:, self._where.position]
                    sense, reported = self._control.report(values, None, motor, angle)
                    log.append(np.asarray(reported))
            state, target = self._control.command(
                values, state, commands[:, index], reported, velocity, drawn[:, index]
            )
            if index < warm:
                for _ in range(0 if self._plain else self.world.substeps):
                    motor, _ = servos(motor, target, angle, velocity, given[:, index])
                continue
            motor = self._advance(physics, servos, motor, target, None, given[:, index])
            angle = physics.qpos[:, self._where.position]
            sense, reported = self._control.report(values, sense, motor, angle)
            log.append(np.asarray(reported))
        return self._logged(values, np.stack(log, axis=1))[:, 1:]

    def behind(self, values: Values, readings: Array) -> np.ndarray:
        """Joint angles [B, J] rad that encoders at rest report as readings [B, J]."""
        readings = np.asarray(readings)
        angle = readings
        for _ in range(INVERTED):
            _, motor = self._control.init(values, angle, angle)
            _, measured = self._control.report(values, None, motor, angle)
            angle = angle + readings - np.asarray(measured)
        return angle

    def _logged(self, values: Values, log: np.ndarray) -> np.ndarray:
        """Apply the drift of the log's clock to logs [B, T, J]."""
        for drift in values.log.values() if values.log else ():
            log = np.stack([drifted(row, drift) for row in log])
        return log
