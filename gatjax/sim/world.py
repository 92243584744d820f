"""A World: a simulation with everything that was added to it, as one value."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from gatjax.effects import sensor
from gatjax.effects.catalogue import cause
from gatjax.effects.effect import Effect, chain
from gatjax.records import Reading
from gatjax.robot import model as robot_model
from gatjax.task import Task

SCHEMA = "gatjax.world/1"
SENSOR_NOISE = Reading(angle=0.0, gyro=0.005, accelerometer=0.0, force=0.03)
"""Nominal simulator: gyro 5 mrad/s (HULKs' simulator), foot forces 3 % [A]."""


class Values(NamedTuple):
    """Every number of a world that may be fitted, searched or randomised."""

    command: dict[str, Any]  # params by effect name
    motor: dict[str, Any]
    sensor: dict[str, Any]
    body: dict[str, np.ndarray]  # MuJoCo field -> value


@dataclasses.dataclass(frozen=True, kw_only=True)
class World:
    """Structure (closed over by compiled code) and values (its argument)."""

    model: mujoco.MjModel
    task: Task
    command: Mapping[str, Effect]  # once per control tick, in this order
    motor: Mapping[str, Effect]  # once per physics step
    sensor: Mapping[str, Effect]  # once per control tick
    values: Values
    causes: tuple[dict, ...] = ()  # as in world.json
    source: str = "nao"  # model file, or "nao"

    @property
    def substeps(self) -> int:
        """Physics steps in a control tick."""
        return round(self.task.control_period / self.model.opt.timestep)

    def chains(self) -> tuple[Effect, Effect, Effect]:
        """Command, motor and sensor effects, each as one effect."""
        return chain(**self.command), chain(**self.motor), chain(**self.sensor)


def nominal(task: Task = Task(), source: str | Path = "nao") -> World:
    """Return the ideal simulator of a robot: sensor noise, no other effect."""
    model = robot_model.load(source)
    period, step = task.control_period, model.opt.timestep
    if abs(period / step - round(period / step)) > 1e-6:
        step = 0.005 if abs(period / 0.005 - round(period / 0.005)) < 1e-6 else 0.002
        model.opt.timestep = step
    return World(
        model=model,
        task=task,
        command={},
        motor={},
        sensor={"noise": sensor.noise()},
        values=Values(command={}, motor={}, sensor={"noise": SENSOR_NOISE}, body={}),
        source=str(source),
    )


def add_command(world: World, name: str, effect: Effect, params: Any) -> World:
    """Append a command effect, e.g. a grounding."""
    return dataclasses.replace(
        world,
        command={**world.command, name: effect},
        values=world.values._replace(command={**world.values.command, name: params}),
    )


def _per_joint(names: tuple[str, ...], where: list[str], value: float, neutral: float):
    if where == ["all"]:
        return np.full(len(names), value)
    unknown = sorted(set(where) - set(names))
    if unknown:
        raise ValueError(f"the model has no joint {unknown[0]!r}; it has {list(names)}")
    return np.where(np.isin(names, where), value, neutral)


def add_cause(world: World, name: str, where: list[str], value: float) -> World:
    """Add a cause of the catalogue.

    Args:
        world: the world to extend.
        name: a name of `gatjax.effects.catalogue.CATALOGUE`.
        where: joint names, or ["all"].
        value: its parameter, in the catalogue's unit.
    """
    entry = cause(name)
    names = robot_model.joint_names(world.model)
    params = _per_joint(names, where, value, entry.neutral)
    if value != entry.neutral and not entry.low <= value <= entry.high:
        raise ValueError(
            f"{name}: {entry.parameter} {value} {entry.unit} is out of range; use "
            f"{entry.low} to {entry.high}, or {entry.neutral} for none"
        )
    row = {"cause": name, "where": list(where), "values": {entry.parameter: value}}
    causes = (*world.causes, row)
    if entry.slot == "body":
        fields = entry.build(world.model, dict(world.values.body), params)
        values = world.values._replace(body=fields)
        return dataclasses.replace(world, values=values, causes=causes)
    slot = entry.slot
    period = (
        world.task.control_period if slot == "command" else world.model.opt.timestep
    )
    key = f"{name}_{len(world.causes)}"
    added = {
        slot: {**getattr(world, slot), key: entry.build(period)},
        "values": world.values._replace(
            **{slot: {**getattr(world.values, slot), key: params}}
        ),
    }
    return dataclasses.replace(world, causes=causes, **added)


def fields_applied(world: World) -> mujoco.MjModel:
    """Return a copy of the model with the world's field changes written into it."""
    changed = mujoco.MjModel.__copy__(world.model)
    for name, value in world.values.body.items():
        getattr(changed, name)[...] = value
    return changed


def dropped_by_mjx(model: mujoco.MjModel) -> list[str]:
    """Name what MJX would silently ignore or refuse in a model."""
    found = []
    if np.any(np.asarray(model.actuator_delay) > 0):
        found.append("actuator delay (use the cause command_delay instead)")
    if np.any(model.actuator_biastype == mujoco.mjtBias.mjBIAS_DCMOTOR):
        found.append("dcmotor actuators (use position actuators and effects)")
    return found


def write_world(path: Path, world: World, made_by: dict, grounding: str | None) -> None:
    """Write world.json."""
    source = world.source
    if source != "nao":  # beside the world file, so that both can move together
        source = os.path.relpath(source, path.parent)
    text = {
        "schema": SCHEMA,
        "model": source,
        "effects": list(world.causes),
        "grounding": grounding,
        "made_by": made_by,
    }
    path.write_text(json.dumps(text, indent=2) + "\n")


def read_world(path: Path, task: Task = Task()) -> tuple[World, Path | None]:
    """Load world.json; also return its grounding folder, if it has one."""
    try:
        text = json.loads(Path(path).read_text())
    except FileNotFoundError as error:
        raise FileNotFoundError(f"world file {path} does not exist") from error
    except json.JSONDecodeError as error:
        raise ValueError(f"{path} is not JSON: {error}") from error
    if text.get("schema") != SCHEMA:
        raise ValueError(f"{path}: schema is {text.get('schema')!r}, need {SCHEMA!r}")
    missing = [key for key in ("model", "effects") if key not in text]
    if missing:
        raise ValueError(f"{path}: {missing[0]!r} is missing; see docs/files.md")
    source = text["model"]
    world = nominal(task, source if source == "nao" else Path(path).parent / source)
    for row in text["effects"]:
        entry = cause(row["cause"])
        if entry.parameter not in row["values"]:
            raise ValueError(f"{path}: {row['cause']} needs {entry.parameter!r}")
        world = add_cause(
            world, row["cause"], row["where"], row["values"][entry.parameter]
        )
    grounding = text.get("grounding")
    return world, Path(path).parent / grounding if grounding else None
