"""One control tick of a simulated run, for one robot, shared by the backends."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from gatjax import task as tasks
from gatjax.records import JOINTS, Base, Outcome, Reading, Sensed, Signal, Trajectory
from gatjax.robot import nao
from gatjax.robot.model import Slots, joint_names
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


class Start(NamedTuple):
    """How a run begins."""

    qpos: Array  # [nq]
    qvel: Array  # [nv]
    go: Array  # [] int, control tick of the walk request


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


def start(world: World, slots: Slots, policy: Array, key: Array) -> Start:
    """Draw the start of a run: ready pose on the floor, slightly disturbed."""
    model, task = world.model, world.task
    angle_key, velocity_key, spin_key, go_key = jax.random.split(key, 4)
    kept, angle = joints_of(model), tasks.pose(policy)
    height = unpack(policy).walk_hip_height + nao.HIP_DROP
    qpos = jnp.zeros(model.nq, policy.dtype).at[2].set(height).at[3].set(1.0)
    disturbance = START_ANGLE * jax.random.normal(angle_key, angle.shape, policy.dtype)
    low, high = jnp.asarray(nao.LOW, policy.dtype), jnp.asarray(nao.HIGH, policy.dtype)
    angle = jnp.clip(angle + disturbance, low, high)
    qpos = qpos.at[slots.position].set(angle[kept])
    follower, follows = coupled(model, qpos)
    qpos = qpos.at[follower].set(follows)
    qvel = jnp.zeros(model.nv, policy.dtype)
    push = START_VELOCITY * jax.random.normal(velocity_key, (2,), policy.dtype)
    spin = START_SPIN * jax.random.normal(spin_key, (3,), policy.dtype)
    qvel = qvel.at[:2].set(push).at[3:6].set(spin)
    latest = round(task.longest_delay / task.control_period)
    settle = round(task.settle / task.control_period)
    return Start(qpos, qvel, settle + jax.random.randint(go_key, (), 0, latest + 1))


def ties(model: Any) -> tuple[Any, Any, Any]:
    """Joints that follow another: ids of followers and leaders, polynomials [E, 5].

    follower - its qpos0 = polynomial(leader - its qpos0), MuJoCo's joint equality.
    """
    tied = (model.eq_type == 2) & (model.eq_obj2id >= 0) & model.eq_active0.astype(bool)
    return model.eq_obj1id[tied], model.eq_obj2id[tied], model.eq_data[tied, :5]


def coupled(model: Any, qpos: Array) -> tuple[Any, Array]:
    """Places in qpos of joints that follow another, and their positions.

    Args:
        model: of the robot.
        qpos: [..., nq], the leaders in place.

    Returns:
        Indices [E] and positions [..., E] of the followers, rad.
    """
    followers, leaders, polynomials = ties(model)
    addresses = model.jnt_qposadr[followers], model.jnt_qposadr[leaders]
    turned = qpos[..., addresses[1]] - model.qpos0[addresses[1]]
    position = model.qpos0[addresses[0]] + 0.0 * turned
    for power in range(5):
        if polynomials[:, power].any():
            position = position + polynomials[:, power] * turned**power
    return addresses[0], position


def coupled_speed(model: Any, qpos: Array, qvel: Array) -> tuple[Any, Array]:
    """Places in qvel of joints that follow another, and their speeds [..., E] rad/s."""
    followers, leaders, polynomials = ties(model)
    addresses = model.jnt_qposadr[leaders]
    turned = qpos[..., addresses] - model.qpos0[addresses]
    powers = turned[..., None] ** np.arange(4) * np.arange(1, 5)
    slope = (polynomials[:, 1:] * powers).sum(-1)
    return model.jnt_dofadr[followers], slope * qvel[..., model.jnt_dofadr[leaders]]


def open_loop(world: World, values: Values, policy: Array, plant: Plant) -> Loop:
    """Return the control loop of a run that begins."""
    command, _, sensor = world.chains()
    angle = tasks.pose(policy)[joints_of(world.model)]
    silent = jax.tree.map(jnp.zeros_like, plant.reading)
    signal = Signal(angle, plant.reading.angle, plant.velocity, 0.0 * angle)
    return Loop(
        pilot=tasks.begin(policy),
        command=command.init(values.command, signal),
        sensor=sensor.init(values.sensor, Sensed(plant.reading, silent)),
        score=tasks.open_score(plant.base),
    )


def draws(
    key: Array, tick: Array, like: Reading, kept: np.ndarray
) -> tuple[Reading, Array]:
    """Unit normal draws of one tick: for the sensors, and for the command [K].

    A joint's draws are the same whatever other joints the model has.
    """
    joints = len(JOINTS)
    sizes = [joints, *(leaf.shape[-1] for leaf in like[1:])]
    total = sum(sizes) + joints
    flat = jax.random.normal(jax.random.fold_in(key, tick), (total,), like.angle.dtype)
    ends = [sum(sizes[: index + 1]) for index in range(len(sizes))]
    parts = [flat[e - n : e] for e, n in zip(ends, sizes, strict=True)]
    reading = Reading(*parts)
    return reading._replace(angle=reading.angle[kept]), flat[total - joints :][kept]


def control(
    world: World, values: Values, policy: Array, key: Array, go: Array
) -> Callable[[Loop, Array, Plant], tuple[Loop, Signal, Row]]:
    """Return one control tick: (loop, tick, plant) -> (loop, signal, row).

    What the servos are told is the signal's target.

    `key` belongs to the run; noise is folded from it by tick, so that all policies of a
    generation meet the same disturbances.
    """
    command, _, sensor = world.chains()
    task, kept, rest = world.task, joints_of(world.model), tasks.pose(policy)

    def step(loop: Loop, tick: Array, plant: Plant) -> tuple[Loop, Signal, Row]:
        sensor_noise, command_noise = draws(key, tick, plant.reading, kept)
        score = tasks.keep_score(task, go, tick, loop.score, plant.base)
        sensor_state, sensed = sensor.apply(
            values.sensor, loop.sensor, Sensed(plant.reading, sensor_noise)
        )
        angle = sensed.reading.angle
        whole = sensed.reading._replace(angle=rest.at[kept].set(angle))
        pilot, target = tasks.pilot(task, policy, go, loop.pilot, whole)
        row = Row(target, whole, plant.base, score.alive)
        signal = Signal(target[kept], angle, plant.velocity, command_noise)
        command_state, signal = command.apply(values.command, loop.command, signal)
        loop = Loop(pilot, command_state, sensor_state, score)
        return loop, signal, row

    return step


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
