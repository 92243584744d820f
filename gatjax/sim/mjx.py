"""The mjx backend: whole runs inside one compiled function.

`rollout`, `outcome` and `replay` return functions for one robot; the outermost caller
vmaps, jits and shards them. `impl` is "jax", or "warp" on NVIDIA GPUs.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from gatjax.effects.sensor import drifted
from gatjax.records import Outcome, Signal, Trajectory
from gatjax.robot.model import slots as find_slots
from gatjax.sim import episode
from gatjax.sim.actuation import State, actuation
from gatjax.sim.course import Engine, Place, course
from gatjax.sim.versions import mismatch
from gatjax.sim.world import Values, World, fields_applied

try:
    with contextlib.redirect_stdout(io.StringIO()) as _printed:
        from mujoco import mjx  # prints why it has no Warp
except Exception as error:  # any: packages of other ages lack this or that
    raise ImportError(
        mismatch()
        or f"mujoco-mjx does not go with mujoco or jax here ({error}); install them "
        f"again: pip install -c constraints.txt -e ."
    ) from error

Array = Any
Step = Callable[[Any, Any], Any]
TRACE = 1e-9  # N m, least dry friction of a world with friction; see `_with_fields`
POINTS = 8  # at which two geoms touch at most, two boxes do; a sphere touches at one
CONTACTS = 64  # of a robot in MJX-Warp's buffer at most; a NAO's soles touch at eight
EQUALITY_ROWS = {0: 3, 1: 6}  # of MuJoCo's connect and weld; others have one


def check(world: World, impl: str) -> None:
    """Raise if this machine or MJX can't run the world as it is described."""
    lost = dropped_by_mjx(world.model)
    if lost:
        raise ValueError(f"MJX can't represent {', '.join(lost)}; use --backend native")
    check_machine(impl)


def dropped_by_mjx(model: mujoco.MjModel) -> list[str]:
    """Name what MJX would silently ignore or refuse in a model."""
    found = []
    if np.any(np.asarray(model.actuator_delay) > 0):
        found.append("actuator delay (use the cause command_delay instead)")
    if np.any(np.asarray(model.sensor_delay) > 0):
        found.append("sensor delay (use the cause measurement_delay instead)")
    held = model.sensor_history[:, 0] > 0  # without one the interval does nothing
    if np.any(held & (model.sensor_interval[:, 0] > 0)):
        found.append("sensor interval (take the sensor's nsample out)")
    if np.any(model.actuator_biastype == mujoco.mjtBias.mjBIAS_DCMOTOR):
        found.append("dcmotor actuators (use position actuators and effects)")
    return found


def check_machine(impl: str) -> None:
    """Raise if this machine can't run an implementation of MJX."""
    if impl not in ("jax", "warp"):
        raise ValueError(f"impl {impl!r} is unknown; choose from ['jax', 'warp']")
    lacking = mismatch() or (lacking_for_warp() if impl == "warp" else None)
    if lacking is not None:
        raise ValueError(lacking)


def lacking_for_warp() -> str | None:
    """What this machine lacks to run MJX-Warp, in a line; None if nothing."""
    if importlib.util.find_spec("warp") is None:
        return "impl 'warp' needs warp-lang; pip install 'gatjax[warp]'"
    if _printed.getvalue():
        return f"impl 'warp' is broken: {_printed.getvalue().splitlines()[0]}"
    if "NVIDIA" not in jax.devices()[0].device_kind:
        return "impl 'warp' needs an NVIDIA GPU; use --impl jax"
    return None


def bare_data(world: World, impl: str, robots: int = 1) -> tuple[Any, Any]:
    """Return MJX's model and data of a world with its field changes.

    Args:
        world: what to simulate.
        impl: "jax" or "warp".
        robots: in one call; MJX-Warp's contacts lie in one buffer for all of them, and
            each step takes the time of its size.
    """
    check(world, impl)
    model = fields_applied(world)
    if _rubs(world):  # a row for each joint, at any value
        dofs = find_slots(model).velocity
        model.dof_frictionloss[dofs] = np.maximum(model.dof_frictionloss[dofs], TRACE)
    put = mjx.put_model(model, impl=impl)
    if impl == "warp":
        room = {"naconmax": most_contacts(model) * robots, "njmax": most_rows(model)}
        return _calm(put), mjx.make_data(model, impl=impl, **room)
    return put, mjx.make_data(model, impl=impl)


def most_contacts(model: mujoco.MjModel) -> int:
    """Most contacts of a robot at once, `CONTACTS` where its geoms allow for more."""
    kinds, masks = model.geom_contype, model.geom_conaffinity
    met = (kinds[:, None] & masks[None]) | (masks[:, None] & kinds[None])
    met[model.geom_bodyid[:, None] == model.geom_bodyid[None]] = 0
    ball = model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE
    points = np.where(ball[:, None] | ball[None], 1, POINTS)
    found = int(np.triu(np.where(met, points, 0)).sum()) + POINTS * model.npair
    return min(max(found, 1), CONTACTS)


def most_rows(model: mujoco.MjModel) -> int:
    """Most constraints of a robot: equalities, friction, limits and contacts."""
    held = sum(EQUALITY_ROWS.get(int(kind), 1) for kind in model.eq_type)
    rubbing = int((model.dof_frictionloss > 0).sum())
    sliding = int(model.geom_condim.max(initial=1)) - 1
    touching = most_contacts(model) * max(1, 2 * sliding)
    return held + rubbing + int(model.jnt_limited.sum()) + touching


def _calm(model: Any) -> Any:
    """Return MJX-Warp's model, which prints no line for each robot and step whose
    solver used up its iterations: they are few on purpose.
    """
    from mujoco.mjx.third_party.mujoco_warp import OverflowType

    own = model.opt._impl
    silent = OverflowType.ITERATIONS | OverflowType.LS_ITERATIONS
    own = own.replace(warn_overflow=int(own.warn_overflow) & ~int(silent))
    return model.replace(opt=model.opt.replace(_impl=own))


def _rubs(world: World) -> bool:
    """Whether a world changes dry friction, before the run or in it."""
    return "dof_frictionloss" in world.values.body or bool(world.joint)


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
            return track.move(values, place, signal.target), keep(row)

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
