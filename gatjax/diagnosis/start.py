"""What a diagnosis starts from: a model file, and what is known of the robot besides.

Known changes of bodies, joints and servos become fields of the model; other known
causes become numbers of the simulated joints, in place of neutral ones.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from gatjax.diagnosis.joint import Assumed
from gatjax.effects.catalogue import CATALOGUE
from gatjax.effects.joint import WARM
from gatjax.robot import model as robot_model
from gatjax.sim import causes, derived
from gatjax.sim import world as worlds
from gatjax.sim.world import World
from gatjax.task import Task

Numbers = dict[str, float]
GEARS = frozenset({"backlash", "joint_elasticity"})
ADDING = frozenset({
    "armature", "asymmetric_friction", "clock_drift", "com_shift", "command_delay",
    "coulomb_friction", "damping_error", "encoder_offset", "encoder_scale",
    "gain_error", "gravity_tilt", "load_friction", "measurement_delay", "payload",
    "torque_limit", "viscous_friction",
})  # fmt: skip
"""Causes that may be there twice: what is found besides adds up with what is known."""

_SHARES = {
    "sensed": "encoder_on_motor", "link_share": "link_share",
    "behind": "armature_share",
}  # fmt: skip
NUMBERS = {
    "command_delay": {"delay": "delay"},
    "measurement_delay": {"late": "delay"},
    "first_order_lag": {"lag": "time_constant"},
    "stiction": {"stiction": "excess", "creep": "velocity"},
    "load_friction": {"loaded": "coefficient"},
    "backlash": {"width": "width", **_SHARES},
    "joint_elasticity": {"stiffness": "stiffness", **_SHARES},
    "dead_band": {"dead": "half_width"},
    "command_quantization": {"quantum": "step"},
    "torque_ripple": {
        "ripple": "amplitude", "cycles": "cycles", "ripple_phase": "phase",
    },
    "encoder_scale": {"scale": "scale"},
    "clock_drift": {"drift": "drift"},
}  # fmt: skip
"""Fields of `laws.Drive` and the parameters of the catalogue that they are."""


def numbers(cause: str, values: Numbers, limit: float, every: float) -> Numbers:
    """Fields of `laws.Drive` that a known cause sets; none if it changes the model.

    Args:
        cause: of the catalogue.
        values: all of its parameters.
        limit: torque limit of the joint, N m.
        every: sum of all joints' limits, N m.

    Returns:
        SI units; `sag` per N m of all servos' torque.
    """
    fixed = {field: values[name] for field, name in NUMBERS.get(cause, {}).items()}
    match cause:
        case "load_friction":
            return fixed | {"by_servo": 1.0}
        case "speed_limit":
            return {"speed" if values["on_motor"] else "rate": values["limit"]}
        case "asymmetric_friction":
            return {"bias": -0.5 * values["torque"]}
        case "encoder_offset":
            return {"zero_in" if values["in_loop"] else "zero_out": values["offset"]}
        case "supply_sag":
            total = values["total"]
            return {
                "sag": values["max_drop"] / (0.5 * every if np.isnan(total) else total)
            }
        case "thermal_derating":
            heat, cooling = values["heat"], values["cooling"]
            heat = (WARM * limit) ** 2 * cooling if np.isnan(heat) else heat
            lost = values["lost_fraction"] * limit**2 / heat
            return {"heat": lost, "cooling": cooling}
    return fixed


class Start(NamedTuple):
    """A model file, and rows of causes (as in world.json) that are known."""

    source: str
    rows: tuple[dict, ...] = ()

    def world(self, period: float, timestep: float | None = None) -> World:
        """The simulation that logs are compared with.

        Args:
            period: of control, s.
            timestep: of the physics, s; the model file's if left out.
        """
        world = worlds.nominal(Task(control_period=period), self.source, timestep)
        for row in self.rows:
            world = worlds.add_cause(
                world, row["cause"], row["where"], row["values"],
                row.get("role", "cause"),
            )  # fmt: skip
        return world

    def model(self) -> mujoco.MjModel:
        """The robot with all known changes of its bodies, joints and servos."""
        model = robot_model.load(self.source)
        fields, _ = causes.of_model(model, self.rows)  # gears are laws of the joint
        derived.settle(model, fields)
        return model

    def joints(self, model: mujoco.MjModel) -> list[Assumed]:
        """What is assumed of each joint besides this model, which `model` made."""
        most = model.actuator_forcerange[:, 1]
        return [
            self._assumed(name, float(limit), float(most.sum()))
            for name, limit in zip(robot_model.joint_names(model), most, strict=True)
        ]

    def _assumed(self, name: str, limit: float, every: float) -> Assumed:
        rows = [row for row in self.rows if {name, "all"} & set(row["where"])]
        found: Numbers = {}
        for row in rows:
            cause, values = row["cause"], causes.completed(row)
            for field, new in numbers(cause, values, limit, every).items():
                adds = cause in ADDING and field != "by_servo"
                found[field] = new + (found.get(field, 0.0) if adds else 0.0)
        named = frozenset(row["cause"] for row in rows)
        return Assumed(found, named - ADDING, bool(named & GEARS))


def known(path: Path) -> Start:
    """What a world file says, or that of a folder.

    Raises:
        FileNotFoundError: it or its model does not exist.
        ValueError: it is no world file, or has what a diagnosis cannot start from.
    """
    world, grounding = worlds.read_world(path)
    if grounding is not None:
        raise ValueError(
            f"{path} has a grounding ({grounding}), which hides causes; diagnose from "
            f"a world without one"
        )
    for row in world.causes:
        cause, values = row["cause"], causes.completed(row)
        if CATALOGUE[cause].place in ("imu", "ground", "foot"):
            raise ValueError(
                f"{path}: a diagnosis cannot start from {cause}; leave it out"
            )
        if cause in ("dropped_commands", "command_noise"):
            raise ValueError(
                f"{path}: which ticks {cause} hit is not known; leave it out, it will "
                f"be found again"
            )
        if cause == "encoder_scale" and values["in_loop"]:
            raise ValueError(
                f"{path}: encoder_scale in the loop cannot be started from"
            )
    return Start(world.source, world.causes)
