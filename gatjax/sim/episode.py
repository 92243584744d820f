"""One control tick of a simulated run, for one robot, shared by the backends."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from gatjax import task as tasks
from gatjax.records import (
    FORCE_SENSORS,
    JOINTS,
    Base,
    Outcome,
    Reading,
    Sensed,
    Signal,
    Trajectory,
)
from gatjax.robot import nao
from gatjax.robot.model import Slots, joint_names
from gatjax.sim.tied import coupled
from gatjax.sim.world import Values, World
from gatjax.walk.parameters import unpack

Array = Any

START_ANGLE, START_VELOCITY, START_SPIN = 0.01, 0.03, 0.1
"""Standard deviations of the start: rad per joint, m/s sideways and forward, rad/s."""


class Plant(NamedTuple):
    """What the physics is like now, before any sensor effect."""

    reading: Reading
    velocity: Array  # [J] rad/s
    base: Base


class Loop(NamedTuple):
    """What the control loop carries from tick to tick, beside the physics."""

    pilot: tasks.PilotState
    command: Any
    sensor: Any
    score: tasks.Score


class Row(NamedTuple):
    """What a recording holds of one tick."""

    command: Array  # [J] rad
    reading: Reading
    base: Base
    alive: Array  # [] bool


class Draw(NamedTuple):
    """How a run begins, whatever the robot's model leaves out."""

    pose: Array  # [J] rad, the ready pose
    angle: Array  # [J] rad, disturbed
    height: Array  # [] m, of the torso
    push: Array  # [2] m/s, forward and sideways
    spin: Array  # [3] rad/s
    go: Array  # [] int, control tick of the walk request
    noise: Array  # [2] words of the run's noise key


def joints_of(model: Any) -> np.ndarray:
    """Indices [K] into `JOINTS` of the joints that a NAO's model drives."""
    return np.array([JOINTS.index(name) for name in joint_names(model)])


def observe(slots: Slots, qpos: Array, qvel: Array, sensors: Array) -> Plant:
    """Read the plant off MuJoCo's state vectors [nq], [nv], [ns]."""
    return Plant(
        reading=Reading(
            angle=qpos[slots.position],
            gyro=sensors[slots.gyro],
            accelerometer=sensors[slots.accelerometer],
            force=sensors[slots.force],
        ),
        velocity=qvel[slots.velocity],
        base=Base(qpos[:3], qpos[3:7]),
    )


def draw(task: tasks.Task, policy: Array, key: Array) -> Draw:
    """Draw the start of a run: ready pose on the floor, slightly disturbed."""
    key, noise = jax.random.split(key)
    angle_key, velocity_key, spin_key, go_key = jax.random.split(key, 4)
    pose = tasks.pose(policy)
    disturbance = START_ANGLE * jax.random.normal(angle_key, pose.shape, policy.dtype)
    low, high = jnp.asarray(nao.LOW, policy.dtype), jnp.asarray(nao.HIGH, policy.dtype)
    push = START_VELOCITY * jax.random.normal(velocity_key, (2,), policy.dtype)
    spin = START_SPIN * jax.random.normal(spin_key, (3,), policy.dtype)
    latest = round(task.longest_delay / task.control_period)
    settle = round(task.settle / task.control_period)
    return Draw(
        pose=pose,
        angle=jnp.clip(pose + disturbance, low, high),
        height=unpack(policy).walk_hip_height + nao.HIP_DROP,
        push=push,
        spin=spin,
        go=settle + jax.random.randint(go_key, (), 0, latest + 1),
        noise=jax.random.key_data(noise),
    )


def placed(model: Any, slots: Slots, drawn: Draw) -> tuple[Array, Array]:
    """State of a run that begins: qpos [nq] and qvel [nv]."""
    dtype = drawn.angle.dtype
    qpos = jnp.zeros(model.nq, dtype).at[2].set(drawn.height).at[3].set(1.0)
    qpos = qpos.at[slots.position].set(drawn.angle[joints_of(model)])
    follower, follows = coupled(model, qpos)
    qvel = jnp.zeros(model.nv, dtype).at[:2].set(drawn.push).at[3:6].set(drawn.spin)
    return qpos.at[follower].set(follows), qvel


def open_loop(
    world: World, values: Values, drawn: Draw, pilot: tasks.PilotState, plant: Plant
) -> tuple[Loop, Signal]:
    """Return the control loop of a run that begins, and what its servos are told."""
    command, _, sensor = world.chains()
    still = jnp.zeros_like(plant.velocity)
    angle = drawn.pose[joints_of(world.model)]
    signal = Signal(angle, plant.reading.angle, plant.velocity, still)
    sensed = Sensed(plant.reading, jax.tree.map(jnp.zeros_like, plant.reading))
    first = sensor.init(values.sensor, sensed)
    _, sensed = sensor.apply(values.sensor, first, sensed)
    told = signal._replace(angle=sensed.reading.angle)
    loop = Loop(
        pilot=pilot,
        command=command.init(values.command, told),
        sensor=first,
        score=tasks.open_score(plant.base),
    )
    return loop, signal


class Noise(NamedTuple):
    """Unit normal draws of one tick, of all joints whatever the model leaves out."""

    reading: Reading  # [J], [3], [3], [F]
    command: Array  # [J]


def noise(words: Array, tick: Array) -> Noise:
    """Draw the noise of a tick.

    It is folded from the run's key [2] by tick, so that all policies of a generation
    meet the same disturbances.
    """
    key = jax.random.fold_in(jax.random.wrap_key_data(words), tick)
    sizes = [len(JOINTS), 3, 3, len(FORCE_SENSORS), len(JOINTS)]
    *reading, command = jnp.split(
        jax.random.normal(key, (sum(sizes),)), np.cumsum(sizes)[:-1]
    )
    return Noise(Reading(*reading), command)


def sense(
    world: World, values: Values, drawn: Draw, noise: Noise, loop: Loop, tick: Array,
    plant: Plant,
) -> tuple[Loop, Reading]:  # fmt: skip
    """The first part of a control tick: the loop, and the reading of all joints."""
    kept, sensor = joints_of(world.model), world.chains()[2]
    disturbance = noise.reading._replace(angle=noise.reading.angle[kept])
    score = tasks.keep_score(world.task, drawn.go, tick, loop.score, plant.base)
    state, sensed = sensor.apply(
        values.sensor, loop.sensor, Sensed(plant.reading, disturbance)
    )
    whole = drawn.pose.at[kept].set(sensed.reading.angle)
    loop = loop._replace(sensor=state, score=score)
    return loop, sensed.reading._replace(angle=whole)


def tell(
    world: World, values: Values, state: Any, plant: Plant, row: Row, noise: Noise
) -> tuple[Any, Array]:
    """The last part of a control tick: what the servos are told of the pilot's targets.

    Args:
        world: what is simulated.
        values: of its effects.
        state: of the command effects.
        plant: what the physics is like.
        row: of this tick.
        noise: of this tick.

    Returns:
        The new state, and a signal whose target is what the servos are told.
    """
    signal = asked(world, plant, row, noise)
    return world.chains()[0].apply(values.command, state, signal)


def asked(world: World, plant: Plant, row: Row, noise: Noise) -> Signal:
    """The pilot's targets at the joints that move, ahead of the command effects."""
    kept = joints_of(world.model)
    angle = row.reading.angle[kept]
    return Signal(row.command[kept], angle, plant.velocity, noise.command[kept])


def report(world: World, values: Values, state: Any, angle: Array) -> tuple[Any, Array]:
    """What is measured of joints, without noise: the state, and angles [J] rad.

    Args:
        world: what is simulated.
        values: of its effects.
        state: of the sensor effects; None is the first.
        angle: [J] rad, as encoders see it.
    """
    sensor = world.chains()[2]
    nothing = [jnp.zeros(3), jnp.zeros(3), jnp.zeros(len(FORCE_SENSORS))]
    reading = Reading(angle, *nothing)
    signal = Sensed(reading, jax.tree.map(jnp.zeros_like, reading))
    state = sensor.init(values.sensor, signal) if state is None else state
    state, signal = sensor.apply(values.sensor, state, signal)
    return state, signal.reading.angle


def trajectory(world: World, rows: Row) -> Trajectory:
    """Turn stacked rows [T, ...] into a Trajectory."""
    ticks = jnp.arange(rows.alive.shape[0])
    return Trajectory(
        time=ticks * world.task.control_period,
        command=rows.command,
        reading=rows.reading,
        base=rows.base,
        alive=rows.alive,
    )


def verdict(world: World, loop: Loop) -> Outcome:
    """Return the outcome of a finished run."""
    return tasks.outcome(world.task, loop.score)
