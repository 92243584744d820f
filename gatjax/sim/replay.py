"""Open-loop replay of whole logs on the CPU, each robot with values of its own.

Effects run in numpy over the batch, those of long replays compiled; MuJoCo steps on
all cores. Where no effect looks at the joints, it plays many rows in one call.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import mujoco
import numpy as np
from mujoco import batch

from gatjax.effects.effect import Effect, chain
from gatjax.effects.sensor import drifted
from gatjax.records import Base, Played, Reading, Sensed, Signal
from gatjax.robot.model import slots as find_slots
from gatjax.sim import derived
from gatjax.sim.actuation import actuation
from gatjax.sim.compiled import Compiled, precisely
from gatjax.sim.control import KEPT
from gatjax.sim.world import Values, World, fields_applied

Array = Any
CHUNK = 2_000_000  # numbers that one call of MuJoCo may record of a field
LONG = 4000  # physics steps from which on compiling takes less time than it saves


class Plan(NamedTuple):
    """What of a world a replay uses, closed over."""

    world: World
    where: Any  # Slots
    servos: Any  # Actuation, or one that is Compiled
    command: Effect
    lead: int


class Told(NamedTuple):
    """What the servos are told in each row, [N, T, J]."""

    command: Array  # rad
    draw: Array  # unit normal
    stiffness: Array


def replay_many(
    world: World,
    values: Values,
    commands: Array,
    qpos: Array,
    qvel: Array,
    noise: Array | None = None,
    stiffness: Array | None = None,
    lead: int = 0,
) -> Played:
    """Play recorded commands from the first row on.

    Args:
        world: the structure; its own values are not used.
        values: stacked values of worlds of this structure, `world.stacked`; [N, ...].
        commands: [N, T, J] or [T, J] rad, one row a control period.
        qpos: [N, nq] or [nq], state of the physics at the first row.
        qvel: [N, nv] or [nv]
        noise: [N, T, J] unit draws of the command effects (`drive.loss`); zeros if
            left out. Sensors have no noise here.
        stiffness: [N, T, J] share of the servos' gains; in a `stiffened` world.
        lead: rows before the log, whose clock starts with the row after them.

    Returns:
        Rows [N, T] as in a recording: row t is measured when command t comes into
        force, so row 0 is the start. A run that diverges holds what is not finite, or
        repeats its last rows.
    """
    count = len(jax.tree.leaves(values)[0])
    commands, qpos, qvel = (
        np.broadcast_to(each, (count, *np.shape(each)[-rank:]))
        for each, rank in ((commands, 2), (qpos, 1), (qvel, 1))
    )
    draws = np.zeros_like(commands) if noise is None else np.asarray(noise)
    stiff = np.ones_like(commands) if stiffness is None else np.asarray(stiffness)
    told = Told(commands, draws, stiff)
    servos = actuation(world)
    command = _whole(world.command, bool(world.learned))
    plan = Plan(world, find_slots(world.model), servos, command, lead)
    physics = _physics(world, values, count)
    physics.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
    physics.qpos[:], physics.qvel[:] = qpos, qvel
    for name in RECORDED:
        physics.bind(name)
    play = _foreseen if world.foresees else _stepped
    with np.errstate(all="ignore"), precisely():  # a run that diverges is NaN
        rows, torque, seen = play(plan, values, physics, told)
        return _measured(plan, values, rows, torque, seen)


RECORDED = ("qpos", "qvel", "sensordata", "actuator_force")


def _whole(parts: Mapping[str, Effect], learned: bool) -> Effect:
    """Return effects as one; with such as were learned it is vectorised by jax."""
    return _vectorised(tuple(parts.items())) if learned else chain(**parts)


@functools.lru_cache(KEPT)
def _vectorised(parts: tuple[tuple[str, Effect], ...]) -> Effect:
    """Effects that were made for one robot as one effect of many, compiled once."""
    whole = chain(**dict(parts))
    return Effect(jax.jit(jax.vmap(whole.init)), jax.jit(jax.vmap(whole.apply)))


def _physics(world: World, values: Values, count: int) -> batch.Batch:
    """Return a batch whose model fields are the values' [N, ...]."""
    first = jax.tree.map(lambda leaf: leaf[0], values)
    model = fields_applied(dataclasses.replace(world, values=first))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    physics = batch.Batch(model, nsim=count)
    own = {key: row for key, row in values.body.items() if (row != row[:1]).any()}
    for name, field in own.items():
        physics.expand(name)[:] = field
    if derived.moves_frames(own):
        physics.set_const()
    return physics


def _first(plan: Plan, values: Values, commands: Array, physics: Any) -> tuple:
    """Return first states of the command effects and of the actuation."""
    angle = np.array(physics.qpos[:, plan.where.position])
    velocity = np.array(physics.qvel[:, plan.where.velocity])
    reported = _reported(plan, values)(angle, np.array(physics.sensordata))
    signal = Signal(commands[:, 0], reported, velocity, 0.0 * angle)
    command = plan.command.init(values.command, signal)
    _, signal = plan.command.apply(values.command, command, signal)
    signal = signal._replace(target=np.asarray(signal.target), angle=angle)
    return command, plan.servos.init(values, signal)


def _reported(plan: Plan, values: Values) -> Callable[[Array, Array], Array]:
    """Return what is logged, row by row, of joints that encoders see: to be called with
    what they see [N, J] rad and the sensors' data [N, S].

    Only corrections that were learned look at it, before their command goes out.
    """
    if not plan.world.learned:
        return lambda seen, data: seen
    sensor, params = _sensor(plan, values)
    state = None

    def report(seen: Array, data: Array) -> Array:
        nonlocal state
        reading = _reading(plan, seen, data)
        sensed = Sensed(reading, Reading(*(np.zeros_like(leaf) for leaf in reading)))
        state = sensor.init(params, sensed) if state is None else state
        state, sensed = sensor.apply(params, state, sensed)
        return np.asarray(sensed.reading.angle)

    return report


def _now(physics: batch.Batch) -> dict[str, np.ndarray]:
    return {name: np.array(physics.bind(name)) for name in RECORDED}


def _stepped(
    plan: Plan, values: Values, physics: batch.Batch, told: Told
) -> tuple[dict, Array, Array]:
    """Play step by step, for effects that look at the joints."""
    commands = told.command
    if commands.shape[1] * plan.world.substeps > LONG and not plan.servos.plain:
        plan = plan._replace(servos=Compiled(plan.servos, values, len(commands)))
    command, state = _first(plan, values, commands, physics)
    where, servos = plan.where, plan.servos
    dofs, substeps = where.velocity, plan.world.substeps
    friction = physics.expand("dof_frictionloss") if servos.torques else None
    armature = physics.expand("dof_armature") if servos.geared else None
    qpos, qvel = physics.qpos, physics.qvel
    ctrl, applied = physics.ctrl, physics.qfrc_applied
    rows, torques, seen, report = [], [], [], _reported(plan, values)

    def keep(state: Any) -> None:
        rows.append(_now(physics))
        seen.append(servos.seen(values, state, rows[-1]["qpos"][:, where.position]))
        force = rows[-1]["actuator_force"]
        torques.append(state.torque if servos.torques else force)

    physics.ctrl[:] = commands[:, 0]
    physics.forward()
    for tick in range(commands.shape[1]):
        keep(state)
        draw, stiff = told.draw[:, tick], told.stiffness[:, tick]
        reported = report(seen[-1], rows[-1]["sensordata"])
        signal = Signal(commands[:, tick], reported, qvel[:, dofs], draw)
        command, signal = plan.command.apply(values.command, command, signal)
        target = np.asarray(signal.target)
        for _ in range(substeps if tick + 1 < commands.shape[1] else 0):
            angle, velocity = qpos[:, where.position], qvel[:, dofs]
            signal = Signal(target, angle, velocity, 0.0 * target)
            state, push = servos.apply(values, state, signal, stiff)
            ctrl[:] = push.control
            if friction is not None:
                applied[:, dofs], friction[:, dofs] = push.load, push.friction
            if armature is not None:
                armature[:, dofs] = push.armature
            physics.step()
    stacked = {name: np.stack([row[name] for row in rows], 1) for name in RECORDED}
    return stacked, np.stack(torques, 1), np.stack(seen, 1)


def _foreseen(
    plan: Plan, values: Values, physics: batch.Batch, told: Told
) -> tuple[dict, Array, Array]:
    """Play many rows a call, for effects that do not look at the joints."""
    commands = told.command
    command, state = _first(plan, values, commands, physics)
    substeps, still = plan.world.substeps, 0.0 * commands[:, 0]
    physics.ctrl[:] = commands[:, 0]
    physics.forward()
    rows = [{name: field[:, None] for name, field in _now(physics).items()}]
    widest = max(field.shape[-1] for field in rows[0].values())
    size = max(1, CHUNK // (len(commands) * substeps * max(widest, 1)))
    for first in range(0, commands.shape[1] - 1, size):
        controls = []
        for tick in range(first, min(first + size, commands.shape[1] - 1)):
            signal = Signal(commands[:, tick], still, still, told.draw[:, tick])
            command, signal = plan.command.apply(values.command, command, signal)
            for _ in range(substeps):
                state, push = plan.servos.apply(values, state, signal)
                controls.append(push.control)
        done = physics.rollout(
            len(controls), control=np.stack(controls, axis=1), record=RECORDED,
            control_spec=mujoco.mjtState.mjSTATE_CTRL.value,
        )  # fmt: skip
        rows.append(
            {name: done[name][:, substeps - 1 :: substeps] for name in RECORDED}
        )
    whole = {name: np.concatenate([row[name] for row in rows], 1) for name in RECORDED}
    angle = whole["qpos"][..., plan.where.position]
    return whole, whole["actuator_force"], angle


def _measured(
    plan: Plan, values: Values, rows: dict, torque: Array, seen: Array
) -> Played:
    """Send rows [N, T, ...] through the sensor effects and the log's clock."""
    where, reading = plan.where, _reading(plan, seen, rows["sensordata"])
    floating = plan.world.model.nq > 6 and plan.world.model.jnt_type[0] == 0
    pose = rows["qpos"][..., :7] if floating else np.zeros((*seen.shape[:2], 7))
    base = Base(pose[..., :3], pose[..., 3:])
    turned = reading._replace(gyro=_up(plan, values, base))
    up = _sensed(plan, values, turned, learned=False).gyro
    reading = _sensed(plan, values, reading)
    for drift in values.log.values() if values.log else ():
        before, log = np.split(reading.angle, [plan.lead], axis=1)
        log = np.stack([drifted(*each) for each in zip(log, drift, strict=True)])
        reading = reading._replace(angle=np.concatenate([before, log], axis=1))
    return Played(
        reading=reading,
        velocity=rows["qvel"][..., where.velocity],
        torque=torque,
        base=base,
        up=up,
    )


def _reading(plan: Plan, seen: Array, data: Array) -> Reading:
    """Return a reading [..., J] of what encoders see, and sensors' data [..., S]."""
    where = plan.where
    slots = where.gyro, where.accelerometer, where.force
    return Reading(seen, *(data[..., each] for each in slots))


def _up(plan: Plan, values: Values, base: Base) -> np.ndarray:
    """Direction against gravity in the torso's frame, [N, T, 3]."""
    level = plan.world.model.opt.gravity[None]
    gravity = np.asarray(values.body.get("opt.gravity", level))
    up = -gravity / np.maximum(np.linalg.norm(gravity, axis=-1, keepdims=True), 1e-9)
    w, v = base.quaternion[..., :1], -base.quaternion[..., 1:]
    up = np.broadcast_to(up[:, None], v.shape)
    side = np.cross(v, up)
    return up + 2.0 * (w * side + np.cross(v, side))


def _sensor(
    plan: Plan, values: Values, learned: bool = True
) -> tuple[Effect, dict[str, Any]]:
    """Return the sensor effects without the noise, and their params."""
    foreign = plan.world.learned_sensors
    names = [
        n for n in plan.world.sensor if n != "noise" and (learned or n not in foreign)
    ]
    parts = {name: plan.world.sensor[name] for name in names}
    sensor = _whole(parts, learned and bool(foreign))
    return sensor, {name: values.sensor[name] for name in names}


def _sensed(
    plan: Plan, values: Values, reading: Reading, learned: bool = True
) -> Reading:
    """Send readings [N, T, ...] through the sensor effects, row by row."""
    sensor, params = _sensor(plan, values, learned)
    if not params:
        return reading
    silent = Reading(*(np.zeros_like(leaf[:, 0]) for leaf in reading))
    first = Sensed(Reading(*(leaf[:, 0] for leaf in reading)), silent)
    state, out = sensor.init(params, first), []
    for tick in range(reading.angle.shape[1]):
        now = Sensed(Reading(*(leaf[:, tick] for leaf in reading)), silent)
        state, sensed = sensor.apply(params, state, now)
        out.append(sensed.reading)
    return Reading(*(np.stack(leaves, axis=1) for leaves in zip(*out, strict=True)))
