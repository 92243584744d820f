"""The mjx backend: whole runs inside one compiled function.

`rollout`, `outcome` and `replay` return functions for one robot; the outermost caller
vmaps, jits and shards them. `impl` is "jax", or "warp" on NVIDIA GPUs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from gatjax.effects.sensor import drifted
from gatjax.records import Outcome, Signal, Trajectory
from gatjax.robot.model import slots as find_slots
from gatjax.sim import episode
from gatjax.sim.actuation import State, actuation
from gatjax.sim.course import Engine, Place, course
from gatjax.sim.mjxmodel import TRACE, bare_data, mjx
from gatjax.sim.world import Values, World

Array = Any
Step = Callable[[Any, Any], Any]


def _float(tree: Any) -> Any:
    """Cast every float to JAX's default float."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.result_type(float)), tree)


def _with_fields(model: Any, body: dict[str, Array]) -> Any:
    """Return MJX's model with a world's field changes.

    Which joints have friction is structure for MJX: it ignores what is added to the
    others, and takes a friction of 0 for a brake. So friction is never quite 0.
    """
    if not body:
        return model
    if "dof_frictionloss" in body:
        friction = jnp.maximum(body["dof_frictionloss"], TRACE)
        body = body | {"dof_frictionloss": friction}
    return model.tree_replace(body)


def _substeps(
    world: World, values: Values, model: Any, physics: Step = mjx.step
) -> Callable:
    """Return (data, actuation state, target) -> the same after one control tick."""
    servos = actuation(world)
    where = find_slots(world.model)

    def advance(data: Any, state: State, target: Array) -> tuple[Any, State]:
        def step(carry: tuple, model: Any) -> tuple:
            data, state = carry
            angle, velocity = data.qpos[where.position], data.qvel[where.velocity]
            signal = Signal(target, angle, velocity, jnp.zeros_like(target))
            state, push = servos.apply(values, state, signal)
            now, data = model, data.replace(ctrl=push.control)
            if push.load is not None:
                data = data.replace(
                    qfrc_applied=data.qfrc_applied.at[where.velocity].set(push.load)
                )
                rub = jnp.maximum(push.friction, TRACE)
                rub = model.dof_frictionloss.at[where.velocity].set(rub)
                now = model.tree_replace({"dof_frictionloss": rub})
            if push.armature is not None:
                heavy = model.dof_armature.at[where.velocity].set(push.armature)
                now = now.tree_replace({"dof_armature": heavy})
            with jax.numpy_rank_promotion("allow"):  # MJX promotes ranks itself
                data = physics(now, data)
            return data, state

        if model.impl is not mjx.Impl.WARP:
            return jax.lax.fori_loop(
                0, world.substeps, lambda _, carry: step(carry, model), (data, state)
            )
        # A step of Warp is one call to XLA: no loop, and sensors are read once a tick.
        carry = data, state
        for _ in range(world.substeps - 1):
            carry = step(carry, _unsensed(model))
        return step(carry, model)

    return advance


def _given(model: Any) -> Any:
    """Return MJX's model as a compiled program should have it (call it in one).

    Each call of Warp is given the whole model. XLA would make constants anew for each
    of them, one kernel an array: half as many kernels as Warp's own.
    """
    if model.impl is mjx.Impl.WARP:
        return jax.lax.optimization_barrier(model)
    return model


def _unsensed(model: Any) -> Any:
    """Return MJX's model with its sensors off: a sixth of Warp's kernels."""
    off = model.opt.disableflags | mjx.DisableBit.SENSOR
    return model.replace(opt=model.opt.replace(disableflags=off))


def engine(world: World) -> Engine:
    """Return MJX-JAX's physics of a world."""
    return _engine(world, bare_data(world, "jax"), mjx.step)


def _engine(world: World, bare: tuple[Any, Any], physics: Step) -> Engine:
    """Return the physics of a world whose model and data MJX has."""
    (base_model, base_data), where = bare, find_slots(world.model)

    def begin(qpos: Array, qvel: Array) -> Any:
        return base_data.replace(
            qpos=qpos.astype(base_data.qpos.dtype),
            qvel=qvel.astype(base_data.qvel.dtype),
        )

    def see(data: Any) -> episode.Plant:
        return episode.observe(where, data.qpos, data.qvel, data.sensordata)

    def advance(values: Values, data: Any, state: State, target: Array) -> tuple:
        model = _with_fields(base_model, values.body)
        return _substeps(world, values, model, physics)(data, state, target)

    return Engine(begin, see, advance)


def _run(
    world: World, impl: str, robots: int, keep: Callable, physics: Step = mjx.step
) -> Callable:
    model, data = bare_data(world, impl, robots)

    def run(values: Values, policy: Array, key: Array) -> tuple[Any, episode.Loop]:
        values, policy = _float(values), _float(policy)
        track = course(world, _engine(world, (_given(model), data), physics))

        def tick(place: Place, _: None) -> tuple:
            place, signal, row = track.look(values, policy, place)
            return track.move(values, place, signal), keep(row)

        place = track.begin(values, policy, key)
        place, rows = jax.lax.scan(tick, place, None, length=world.task.ticks)
        return rows, place.loop

    return run


def outcome(
    world: World, impl: str = "jax", robots: int = 1, physics: Step = mjx.step
) -> Callable[..., Outcome]:
    """Return (values, policy [15], key) -> Outcome of one closed-loop run.

    Args:
        world: what to simulate.
        impl: "jax" or "warp".
        robots: that the caller vmaps it over.
        physics: (model, data) -> data one step later.
    """
    run = _run(world, impl, robots, lambda row: None, physics)

    def one(values: Values, policy: Array, key: Array) -> Outcome:
        return episode.verdict(world, run(values, policy, key)[1])

    return one


def rollout(
    world: World, impl: str = "jax", robots: int = 1
) -> Callable[..., tuple[Trajectory, Outcome]]:
    """Return (values, policy [15], key) -> (Trajectory [T], Outcome), closed loop.

    Arguments are those of `outcome`.
    """
    run = _run(world, impl, robots, keep=lambda row: row)

    def one(values: Values, policy: Array, key: Array) -> tuple[Trajectory, Outcome]:
        rows, loop = run(values, policy, key)
        return episode.trajectory(world, rows), episode.verdict(world, loop)

    return one


def replay(world: World, impl: str = "jax", robots: int = 1) -> Callable[..., Array]:
    """Return the open-loop replay of recorded commands; arguments as of `outcome`.

    The function takes (values, command [T, J] rad, angle [W, J] rad, qpos [nq],
    qvel [nv]): the first W commands only warm up the effects, while the joints are at
    those angles; then the physics starts at qpos, qvel and plays the other T - W
    commands. It returns the joint angles [T - W, J] after each of those ticks, rad, as
    the encoders report them: after the sensor effects, without noise, drift counted
    from qpos, qvel: what was measured there has drifted already.
    """
    base_model, base_data = bare_data(world, impl, robots)
    where = find_slots(world.model)
    servos = actuation(world)
    command = world.chains()[0]

    def one(
        values: Values, commands: Array, angles: Array, qpos: Array, qvel: Array
    ) -> Array:
        values = _float(values)
        model = _with_fields(base_model, values.body)
        data = base_data.replace(qpos=_float(qpos), qvel=_float(qvel))
        commands, angles = _float(commands), _float(angles)
        still = jnp.zeros_like(angles[0])
        first = Signal(commands[0], angles[0], still, still)
        motor_state, warm = servos.init(values, first), angles.shape[0]

        def report(sensor_state: Any, motor_state: State, angle: Array) -> tuple:
            seen = servos.seen(values, motor_state, angle)
            return episode.report(world, values, sensor_state, seen)

        _, reported = report(None, motor_state, angles[0])
        state = command.init(values.command, first._replace(angle=reported))
        for index in range(warm):
            _, reported = report(None, motor_state, angles[index])
            signal = Signal(commands[index], reported, still, still)
            state, signal = command.apply(values.command, state, signal)
            for _ in range(world.substeps):
                held = Signal(signal.target, angles[index], still, still)
                motor_state, _ = servos.apply(values, motor_state, held)
        advance = _substeps(world, values, model)

        def tick(carry: tuple, asked: Array) -> tuple:
            state, data, motor_state, sensor_state, reported = carry
            velocity = data.qvel[where.velocity]
            signal = Signal(asked, reported, velocity, jnp.zeros_like(asked))
            state, signal = command.apply(values.command, state, signal)
            data, motor_state = advance(data, motor_state, signal.target)
            angle = data.qpos[where.position]
            sensor_state, reported = report(sensor_state, motor_state, angle)
            return (state, data, motor_state, sensor_state, reported), reported

        begin = report(None, motor_state, data.qpos[where.position])
        carry = (state, data, motor_state, *begin)
        played = jax.lax.scan(tick, carry, commands[warm:])[1]
        log = jnp.concatenate([begin[1][None], played])
        for drift in values.log.values() if values.log else ():
            log = drifted(log, drift)
        return log[1:]

    return one
