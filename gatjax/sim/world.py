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
from gatjax.runs import write_json
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

    @property
    def rate_hz(self) -> float:
        """Control rate as it is written down: 50.0, 100.0 or 83.3 Hz."""
        return round(1.0 / self.task.control_period, 1)

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
    """Write world.json, whole or not at all."""
    source = world.source
    if source != "nao":  # beside the world file, so that both can move together
        source = os.path.relpath(source, path.parent)
    text = {
        "schema": SCHEMA,
        "model": source,
        "rate_hz": world.rate_hz,
        "effects": list(world.causes),
        "grounding": grounding,
        "made_by": made_by,
    }
    write_json(path, text)


def read_world(path: Path, task: Task = Task()) -> tuple[World, Path | None]:
    """Load world.json (a folder means the one in it) and name its grounding folder.

    Raises:
        FileNotFoundError: the file or its model does not exist.
        ValueError: one line that says what is wrong in the file.
    """
    path = world_file(path)
    text = _world_text(path)
    source = text["model"]
    world = nominal(task, source if source == "nao" else path.parent / source)
    for number, row in enumerate(text["effects"], start=1):
        name, where, value = _effect_row(row, f"{path}: effect {number}")
        world = add_cause(world, name, where, value)
    grounding = text.get("grounding")
    if not grounding:
        return world, None
    check_rate(world, text.get("rate_hz"), str(path))
    return world, path.parent / grounding


def world_file(path: str | Path) -> Path:
    """Return the world file that a path means; a folder means its world.json."""
    return Path(path) / "world.json" if Path(path).is_dir() else Path(path)


def check_rate(world: World, rate_hz: float | None, name: str) -> None:
    """Refuse what was learned at another control rate than the world's.

    Args:
        world: where it is to be used.
        rate_hz: that it was learned at; None where it does not say.
        name: of what was learned, for the message.
    """
    if rate_hz is not None and abs(rate_hz / world.rate_hz - 1.0) > 0.01:
        raise ValueError(
            f"{name}: learned at {rate_hz:g} Hz, used at {world.rate_hz:g} Hz; choose "
            f"--rate-hz {rate_hz:g}, or ground at {world.rate_hz:g} Hz"
        )


def _world_text(path: Path) -> dict[str, Any]:
    """Read a world file and check all but its effects."""
    try:
        text = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise FileNotFoundError(f"world file {path} does not exist") from error
    except ValueError as error:
        raise ValueError(f"{path} is not JSON: {error}") from error
    if not isinstance(text, dict):
        raise ValueError(f"{path}: expected {{key: value}}; see docs/files.md")
    if text.get("schema") != SCHEMA:
        raise ValueError(f"{path}: schema is {text.get('schema')!r}, need {SCHEMA!r}")
    wanted: dict[str, Any] = {"model": str, "effects": list}
    missing = [key for key in wanted if key not in text]
    if missing:
        raise ValueError(f"{path}: {missing[0]!r} is missing; see docs/files.md")
    wanted |= {"grounding": str | None, "rate_hz": int | float | None}
    for key, kind in wanted.items():
        if not isinstance(text.get(key), kind) or text.get(key) is True:
            raise ValueError(f"{path}: {key} is {text[key]!r}; see docs/files.md")
    if text.get("rate_hz") is not None and not 0.0 < text["rate_hz"] < np.inf:
        raise ValueError(f"{path}: rate_hz is {text['rate_hz']}; it is a number > 0")
    return text


def _effect_row(row: Any, name: str) -> tuple[str, list[str], float]:
    """Check one row of `effects`; return cause, joints and value."""
    if not isinstance(row, dict) or not isinstance(row.get("cause"), str):
        raise ValueError(f"{name} must be {{cause, where, values}}, it is {row!r}")
    entry, where, values = cause(row["cause"]), row.get("where"), row.get("values")
    if (
        not isinstance(where, list)
        or not where
        or not all(isinstance(joint, str) for joint in where)
    ):
        raise ValueError(
            f"{name}, {row['cause']}: where is {where!r}; it must be a list of joint "
            f'names or ["all"]'
        )
    if not isinstance(values, dict) or set(values) != {entry.parameter}:
        raise ValueError(
            f"{name}, {row['cause']} needs {entry.parameter!r} in values and nothing "
            f"else; values is {values!r}"
        )
    value = values[entry.parameter]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(
            f"{name}, {row['cause']}: {entry.parameter} is {value!r}; it must be a "
            f"number in {entry.unit}"
        )
    return row["cause"], where, float(value)
