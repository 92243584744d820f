"""What MJX gets of a world, and what it can't do with it or with this machine."""

from __future__ import annotations

import contextlib
import importlib.util
import io
from typing import Any

import jax
import mujoco
import numpy as np

from gatjax.robot.model import slots as find_slots
from gatjax.sim.versions import mismatch
from gatjax.sim.world import World, fields_applied

try:
    with contextlib.redirect_stdout(io.StringIO()) as _printed:
        mjx = importlib.import_module("mujoco.mjx")  # prints why it has no Warp
except Exception as error:  # any: packages of other ages lack this or that
    raise ImportError(
        mismatch()
        or f"mujoco-mjx does not go with mujoco or jax here ({error}); install them "
        f"again: pip install -c constraints.txt -e ."
    ) from error

TRACE = 1e-9  # N m, least dry friction of a world with friction; see `bare_data`
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
        return (
            "impl 'warp' needs warp-lang; in gatjax's folder: .venv/bin/pip install "
            "-c constraints.txt -e '.[warp]'"
        )
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
    if _rubs(world):  # a row for each joint, at any value; MJX takes 0 for a brake
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
