"""What a diagnosis starts from: a model file, and what is known of the robot besides.

Known changes of bodies, joints and servos become fields of the model; other known
causes become numbers of the simulated joints, in place of neutral ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from gatjax.diagnosis.hypotheses import Numbers
from gatjax.diagnosis.joint import Assumed
from gatjax.effects.catalogue import CATALOGUE
from gatjax.effects.joint import WARM
from gatjax.robot import model as robot_model
from gatjax.runs import read_json
from gatjax.sim import causes, derived
from gatjax.sim.contact import Law, with_law
from gatjax.sim.stored import read_world, world_file
from gatjax.sim.world import World, add_rows, nominal, with_contact
from gatjax.task import Task

ADDING = frozenset({
    "armature", "asymmetric_friction", "clock_drift", "com_shift", "command_delay",
    "coulomb_friction", "damping_error", "encoder_offset", "gain_error",
    "gravity_tilt", "payload", "torque_limit", "viscous_friction",
})  # fmt: skip
"""Causes that may be there twice: what is found besides adds up with what is known."""

CHAIN = (
    "command_delay", "command_quantization", "first_order_lag", "thermal_derating",
    "supply_sag", "speed_limit", "encoder_offset", "encoder_scale", "dead_band",
    "torque_saturation", "torque_ripple", "stiction", "asymmetric_friction",
    "load_friction",
)  # fmt: skip
"""Causes from the command to the joint, in the order in which `plant` has them."""

_GEAR = {
    "sensed": "encoder_on_motor", "link_share": "link_share",
    "behind": "armature_share", "ratio": "damping_ratio", "linked": "kv_on_link",
}  # fmt: skip
NUMBERS = {
    "command_delay": {"delay": "delay"},
    "measurement_delay": {"late": "delay"},
    "first_order_lag": {"lag": "time_constant"},
    "stiction": {"stiction": "excess", "creep": "velocity"},
    "load_friction": {"loaded": "coefficient", "of_link": "of_link"},
    "backlash": {"width": "width", **_GEAR},
    "joint_elasticity": {"stiffness": "stiffness", **_GEAR},
    "dead_band": {"dead": "half_width"},
    "command_quantization": {"quantum": "step"},
    "torque_ripple": {
        "ripple": "amplitude", "cycles": "cycles", "ripple_phase": "phase",
    },
    "encoder_scale": {"scale": "scale"},
    "clock_drift": {"drift": "drift"},
    "supply_sag": {"sag": "max_drop"},
    "thermal_derating": {"cooling": "cooling"},
}  # fmt: skip
"""Fields of `laws.Drive` and the parameters of the catalogue that they are."""


COMMUTING = frozenset({"command_delay", "first_order_lag"})


def numbers(cause: str, values: Numbers, limit: float) -> Numbers:
    """Fields of `laws.Drive` that a known cause sets; none if it changes the model.

    Args:
        cause: of the catalogue.
        values: all of its parameters.
        limit: torque limit of the joint, N m.
    """
    fixed = {field: values[name] for field, name in NUMBERS.get(cause, {}).items()}
    match cause:
        case "speed_limit":
            return {"speed" if values["on_motor"] else "rate": values["limit"]}
        case "asymmetric_friction":
            there = values["torque"] != 0.0
            return {"lean": -0.5 * values["torque"],
                    "one_sided": values["viscous"] if there else 0.0}  # fmt: skip
        case "encoder_offset":
            return {"zero_in" if values["in_loop"] else "zero_out": values["offset"]}
        case "torque_saturation":
            return {"soft": 1.0 / values["torque"]}
        case "thermal_derating":
            usual = WARM**2 * values["cooling"]  # in squares of the limit
            heat = values["heat"] / limit**2
            return fixed | {
                "heat": values["lost_fraction"] / (usual if np.isnan(heat) else heat)
            }
    return fixed


class Start(NamedTuple):
    """A model file, and rows of causes (as in world.json) that are known."""

    source: str
    rows: tuple[dict, ...] = ()
    world_file: str | None = None  # that they were read from
    contact: Law | None = None  # of the floor, in place of the model file's

    def world(self, period: float, timestep: float | None = None) -> World:
        """The simulation that logs are compared with.

        Args:
            period: of control, s.
            timestep: of the physics, s; the model file's if left out.
        """
        world = nominal(Task(control_period=period), self.source, timestep)
        if self.contact is not None:
            world = with_contact(world, self.contact)
        return add_rows(world, self.rows)

    def model(self) -> mujoco.MjModel:
        """The robot with all known changes of its bodies, joints and servos."""
        model = robot_model.load(self.source)
        if self.contact is not None:
            model = with_law(model, self.contact)
        fields, _ = causes.of_model(model, self.rows)  # gears are laws of the joint
        derived.settle(model, fields)
        return model

    def joints(self, model: mujoco.MjModel) -> list[Assumed]:
        """What is assumed of each joint besides this model, which `model` made."""
        names = robot_model.joint_names(model)
        every = float(model.actuator_forcerange[:, 1].sum())
        motors = (
            _motors(robot_model.load(self.source)) if self.rows else [()] * len(names)
        )
        return [
            self._assumed(name, every)._replace(motor=motor)
            for name, motor in zip(names, motors, strict=True)
        ]

    def _assumed(self, name: str, every: float) -> Assumed:
        """Of one joint; `every` is the sum of all torque limits, N m."""
        rows = [row for row in self.rows if {name, "all"} & set(row["where"])]
        own = [(row["cause"], causes.completed(row), row["values"]) for row in rows]

        def law(limit: float) -> Numbers:
            found: Numbers = {}
            for cause, values, given in own:
                told = numbers(cause, values, limit)
                told |= {
                    field: found[field]  # of the gear that is there, no default
                    for field, name in _GEAR.items()
                    if field in told and field in found and name not in given
                }
                added = {name: found.get(name, 0.0) + told[name] for name in told}
                found |= added if cause in ADDING else told  # as in the simulator
            return found

        sags = [values["total"] for cause, values, _ in own if cause == "supply_sag"]
        total = (0.5 * every if np.isnan(sags[0]) else sags[0]) if sags else None
        named = {row["cause"] for row in rows if row.get("role") != "calibration"}
        barred = frozenset(cause for cause, *_ in own) - ADDING
        return Assumed(law, barred, frozenset(named), total)


def _motors(model: mujoco.MjModel) -> list[tuple[float, ...]]:
    """Numbers of each drive in a model file; joints of one motor have the same."""
    held = model.actuator_trnid[:, 0]
    dof = model.jnt_dofadr[held]
    rows = np.stack([
        model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 2],
        model.actuator_forcerange[:, 1], model.dof_damping[dof],
        model.dof_frictionloss[dof], model.dof_armature[dof],
    ], 1)  # fmt: skip
    return [tuple(row) for row in rows.tolist()]


def read_start(path: Path) -> Start:
    """What a world file knows, or that of a folder.

    Raises:
        FileNotFoundError: it or its model does not exist.
        ValueError: it is no world file, or has what a diagnosis cannot start from.
    """
    file = world_file(path)
    if file.suffix == ".xml":
        raise ValueError(f"{file} is no world file; an MJCF model is given as --model")
    if file.is_file() and read_json(file).get("grounding"):
        raise ValueError(
            f"{file} has a grounding, which hides causes; diagnose from a world without"
        )
    world, _ = read_world(path)
    return started(world, file)


def started(world: World, file: Path) -> Start:
    """What a world knows, as a start; `file` has it, or will.

    Bounds of a search are nothing that is known of a robot, and are left out.

    Raises:
        ValueError: it has what a diagnosis cannot start from.
    """
    seen: set[tuple[str, str]] = set()
    rows = tuple(row for row in world.causes if row.get("role") != "bound")
    for row in rows:
        cause, places = row["cause"], _places(world, row)
        reason = _unfit(row)
        if cause not in ADDING and seen & {(cause, place) for place in places}:
            reason = "comes twice at one joint"
        if reason:
            raise ValueError(f"{file}: {cause} {reason}; leave it out")
        seen |= {(cause, place) for place in places}
    _check_order(world, rows, file)
    return Start(world.source, rows, str(file), world.contact)


def turn(row: dict[str, Any]) -> int:
    """When a cause acts on the way from the command to the joint; -1: anywhere.

    An encoder's error that only the log shows has a turn among such errors alone.
    """
    return CHAIN.index(row["cause"]) if row["cause"] in CHAIN else -1


def _check_order(world: World, rows: Sequence[dict], file: Path) -> None:
    """Refuse rows of a joint in another order than that of the simulated joint."""
    for number, row in enumerate(rows):
        for before in rows[:number]:
            shared = {*_places(world, row)} & {*_places(world, before)}
            late = turn(row) != -1 and turn(before) > turn(row)
            late &= _logged(row) == _logged(before) or _encoder(row) == _encoder(before)
            if shared and late and not {row["cause"], before["cause"]} <= COMMUTING:
                raise ValueError(
                    f"{file}: {before['cause']} stands before {row['cause']}, and acts "
                    f"before it; a diagnosis has causes of a joint in the order "
                    f"{', '.join(CHAIN)}: put them in it if that is what you mean"
                )


def _encoder(row: dict[str, Any]) -> bool:
    """Whether a cause is an error of an encoder."""
    return row["cause"].startswith("encoder")


def _logged(row: dict[str, Any]) -> bool:
    """Whether it is one that the log shows and the servo does not see."""
    return _encoder(row) and row["values"].get("in_loop", 0.0) == 0.0


def _places(world: World, row: dict[str, Any]) -> tuple[str, ...]:
    """Joints that a row is about."""
    every = robot_model.joint_names(world.model)
    return every if row["where"] == ["all"] else tuple(row["where"])


def _unfit(row: dict[str, Any]) -> str:
    """Why a diagnosis cannot start from a row, or nothing."""
    entry, values = CATALOGUE[row["cause"]], causes.completed(row)
    if entry.place in ("imu", "ground", "foot"):
        return "is about no joint, and only joints can be started from"
    if any(part.slot == "command" for part in entry.parts):
        return "hits ticks that nobody knows"
    if row["cause"] == "current_limit":
        return "is no law of the single joint"
    if row["cause"] == "encoder_scale" and values["in_loop"]:
        return "in the loop is no law of the single joint"
    return ""
