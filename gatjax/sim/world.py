"""A World: a simulation with everything that was added to it, as one value."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import mujoco
import numpy as np

from gatjax.effects import gear, sensor
from gatjax.effects.catalogue import cause
from gatjax.effects.cause import check_range, spread
from gatjax.effects.effect import Effect, chain
from gatjax.effects.joint import stiffness
from gatjax.records import Reading
from gatjax.robot import model as robot_model
from gatjax.runs import write_json
from gatjax.sim import causes, derived
from gatjax.sim.causes import GEAR
from gatjax.task import Task

SCHEMA = "gatjax.world/1"
ROLES = ("cause", "calibration", "bound")
SENSOR_NOISE = Reading(angle=0.0, gyro=0.005, accelerometer=0.0, force=0.03)
"""Nominal simulator: gyro 5 mrad/s (HULKs' simulator), foot forces 3 % [A]."""


class Values(NamedTuple):
    """Every number of a world that may be fitted, searched or randomised."""

    command: dict[str, Any]  # params by effect name
    motor: dict[str, Any]
    sensor: dict[str, Any]
    body: dict[str, np.ndarray]  # MuJoCo field -> value
    joint: Any = ()  # params by effect name
    log: Any = ()  # params by cause
    servo: Any = None  # Servo of the joints, in a world with joint effects


@dataclasses.dataclass(frozen=True, kw_only=True)
class World:
    """Structure (closed over by compiled code) and values (its argument)."""

    model: mujoco.MjModel
    task: Task
    command: Mapping[str, Effect]  # once per control tick, in this order
    motor: Mapping[str, Effect]  # once per physics step
    sensor: Mapping[str, Effect]  # once per control tick
    values: Values
    joint: Mapping[str, Effect] = dataclasses.field(default_factory=dict)
    # once per physics step, after motor
    causes: tuple[dict, ...] = ()  # as in world.json
    source: str = "nao"  # model file, or a shipped model's name

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

    def _foreign(self, names: Iterable[str]) -> tuple[str, ...]:
        ours = {_effect(row["cause"], n) for n, row in enumerate(self.causes)}
        return tuple(name for name in names if name not in ours)

    @property
    def learned(self) -> tuple[str, ...]:
        """Names of command effects that come from elsewhere than the catalogue."""
        return self._foreign(self.command)

    @property
    def learned_sensors(self) -> tuple[str, ...]:
        """The same of sensor effects; the noise is the simulator's own."""
        return tuple(each for each in self._foreign(self.sensor) if each != "noise")

    @property
    def foresees(self) -> bool:
        """Whether no effect between command and servo looks at the joints."""
        parts = causes.parts(self.causes, "command", "motor")
        sees = any(part.sees for part in parts)
        return not (self.learned or self.joint or sees)


def nominal(
    task: Task = Task(),
    source: str | Path = "nao",
    timestep: float | None = None,
    held: robot_model.Held | None = None,
) -> World:
    """Return the ideal simulator of a robot: sensor noise, no other effect.

    Args:
        task: what is asked of it, and the control period.
        source: MJCF file, or "nao" or "nao_hung".
        timestep: physics step in s; the file's if left out, shortened until it divides
            the control period. A servo's angle is wrong by what it moves in about half
            a step.
        held: hinges that do not move.
    """
    model = robot_model.load(source, timestep, held)
    model.opt.timestep = dividing(task.control_period, model.opt.timestep)
    return World(
        model=model,
        task=task,
        command={},
        motor={},
        sensor={"noise": sensor.noise()},
        values=Values(command={}, motor={}, sensor={"noise": SENSOR_NOISE}, body={}),
        source=str(source),
    )


def dividing(period: float, step: float) -> float:
    """The longest physics step up to `step` that divides a control period, both s."""
    parts = period / step
    whole = abs(parts - round(parts)) < 1e-6 and parts > 0.5
    return step if whole else period / math.ceil(parts)


def add_command(world: World, name: str, effect: Effect, params: Any) -> World:
    """Append a command effect, e.g. a grounding."""
    return dataclasses.replace(
        world,
        command={**world.command, name: effect},
        values=world.values._replace(command={**world.values.command, name: params}),
    )


def add_sensor(world: World, name: str, effect: Effect, params: Any) -> World:
    """Append a sensor effect, e.g. of a grounding."""
    return dataclasses.replace(
        world,
        sensor={**world.sensor, name: effect},
        values=world.values._replace(sensor={**world.values.sensor, name: params}),
    )


def add_cause(
    world: World,
    name: str,
    where: list[str],
    values: Mapping[str, Any] | float,
    role: str = "cause",
) -> World:
    """Add a cause of the catalogue.

    Args:
        world: the world to extend.
        name: a name of `gatjax.effects.catalogue.CATALOGUE`.
        where: joint names, or ["all"]; "imu", "ground" or feet for causes of those.
        values: {parameter: number} in the catalogue's units, defaults may be left out;
            a number alone is the first parameter.
        role: "calibration" for a small correction of nominal numbers: what changes
            model fields may then have either sign, as long as it stays physical.
            "bound" for what a search may not go beyond, though the robot might.

    Raises:
        ValueError: a name is unknown, or a value is not plausible.
    """
    if role not in ROLES:
        raise ValueError(f"role {role!r} is unknown; choose from {list(ROLES)}")
    entry = cause(name)
    given = values if isinstance(values, Mapping) else {entry.main.name: values}
    row = {"cause": name, "where": list(where), "values": dict(given)}
    row |= {} if role == "cause" else {"role": role}
    full = causes.completed(row)
    parts = entry.active(full)
    places = [causes.places(world.model, row, part) for part in parts]
    if role != "calibration" or any(part.slot != "body" for part in parts):
        check_range(name, entry, full)
    added: dict[str, Any] = {}
    numbers: dict[str, Any] = {}
    for part, names in zip(parts, places, strict=True):
        params = spread(entry, part, names, row["where"], full)
        slot = part.slot
        if slot in ("body", GEAR):
            continue
        key = _sharing(world, slot, row)
        if key:  # an effect of the cause acts at other joints already
            old = getattr(world.values, slot)[key]
            params = _placed(params, old, np.isin(names, where))
        key = key or _effect(name, len(world.causes))
        if part.build is not None and key not in getattr(world, slot):
            period = world.model.opt.timestep
            period = period if slot in ("motor", "joint") else world.task.control_period
            added[slot] = {**getattr(world, slot), key: part.build(period)}
        numbers[slot] = {**dict(getattr(world.values, slot)), key: params}
    world = dataclasses.replace(
        world,
        values=world.values._replace(**numbers),
        causes=(*world.causes, row),
        **added,
    )
    return _refreshed(world, {part.slot for part in parts})


def add_causes(
    world: World, rows: Sequence[tuple[str, list[str], Mapping[str, Any]]]
) -> World:
    """Add causes one after the other; each row is name, where and values."""
    for name, where, values in rows:
        world = add_cause(world, name, where, values)
    return world


def _effect(cause: str, place: int) -> str:
    """Name of the effects of the first row, by its place, of those that share them."""
    return f"{cause}_{place}"


def _placed(params: Any, old: Any, here: np.ndarray) -> Any:
    """Params of a cause: the new ones `here` [J], the old ones elsewhere."""
    return jax.tree.map(lambda new, was: np.where(here, new, was), params, old)


def _sharing(world: World, slot: str, row: dict) -> str | None:
    """Name the last effect of a slot if a row can share it: one cause, other joints."""
    key = next(reversed(getattr(world.values, slot) or {}), "")
    begin = key.rpartition("_")[2]
    if not begin.isdigit():
        return None
    rows = [*world.causes[int(begin) :], row]
    if {each["cause"] for each in rows} != {row["cause"]}:
        return None
    joints = [joint for each in rows for joint in each["where"]]
    known = set(joints) <= set(robot_model.joint_names(world.model))
    active = [cause(row["cause"]).active(causes.completed(each)) for each in rows]
    alike = all(parts == active[0] for parts in active)
    return key if known and alike and len(set(joints)) == len(joints) else None


def _refreshed(world: World, slots: set[str]) -> World:
    """Refresh the model fields and servos, which depend on all causes together."""
    if not world.joint and not slots & {"body", GEAR}:
        return world
    model, joint, params = world.model, dict(world.joint), dict(world.values.joint)
    fields, play = causes.of_model(model, world.causes)
    values = world.values
    if joint or play is not None:
        servo = derived.servo(model, fields)
        if play is not None:
            fields, servo = derived.geared(model, fields, servo, play)
            for part in (joint, params):
                part.pop(GEAR, None)  # it comes last: what it leaves is the link's
            joint[GEAR] = gear.transmission(model.opt.timestep)
            params[GEAR] = play
        values = values._replace(joint=params, servo=servo)
    values = values._replace(body=fields)
    model = derived.solved(model, fields)
    return dataclasses.replace(world, model=model, joint=joint, values=values)


def stiffened(world: World) -> World:
    """Return the world for logs that say how stiff its servos were, row by row."""
    servo = world.values.servo
    if servo is None:
        servo = derived.servo(world.model, world.values.body)
    values = world.values._replace(
        joint={"stiffness": (), **(world.values.joint or {})}, servo=servo
    )
    joints = {"stiffness": stiffness(), **world.joint}
    return dataclasses.replace(world, joint=joints, values=values)


def stacked(values: Sequence[Values]) -> Values:
    """Stack values of worlds of one structure, for `replay_many`: leaves [N, ...]."""
    return jax.tree.map(lambda *leaves: np.stack(leaves), *values)


def fields_applied(world: World) -> mujoco.MjModel:
    """Return a copy of the model with the world's field changes written into it.

    Where effects act on the target inside the servo, they keep it in its range
    themselves: what they make of it is not clamped again.
    """
    changed = mujoco.MjModel.__copy__(world.model)
    derived.settle(changed, world.values.body)
    if world.motor or world.joint:
        changed.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
    return changed


def write_world(path: Path, world: World, made_by: dict, grounding: str | None) -> None:
    """Write world.json, whole or not at all."""
    source = world.source
    if source not in robot_model.SHIPPED:  # beside the world file: both can move
        source = os.path.relpath(source, path.parent)
    text = {
        "schema": SCHEMA,
        "model": source,
        "rate_hz": world.rate_hz,
        "timestep_s": world.model.opt.timestep,
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
    source = source if source in robot_model.SHIPPED else path.parent / source
    world = nominal(task, source, text.get("timestep_s"))
    for number, row in enumerate(text["effects"], start=1):
        where = f"{path}: effect {number}"
        _check_row(row, where)
        try:
            world = add_cause(
                world, row["cause"], row["where"], row["values"],
                row.get("role", "cause"),
            )  # fmt: skip
        except ValueError as error:
            raise ValueError(f"{where}, {error}") from error
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
    number = int | float | None
    wanted |= {"grounding": str | None, "rate_hz": number, "timestep_s": number}
    for key, kind in wanted.items():
        if not isinstance(text.get(key), kind) or text.get(key) is True:
            raise ValueError(f"{path}: {key} is {text[key]!r}; see docs/files.md")
    for key in ("rate_hz", "timestep_s"):
        if text.get(key) is not None and not 0.0 < text[key] < np.inf:
            raise ValueError(f"{path}: {key} is {text[key]}; it is a number > 0")
    return text


def _check_row(row: Any, name: str) -> None:
    """Check the form of one row of `effects`; raise ValueError."""
    if not isinstance(row, dict) or not isinstance(row.get("cause"), str):
        raise ValueError(f"{name} must be {{cause, where, values}}, it is {row!r}")
    where, values = row.get("where"), row.get("values")
    if (
        not isinstance(where, list)
        or not where
        or not all(isinstance(joint, str) for joint in where)
    ):
        raise ValueError(
            f"{name}, {row['cause']}: where is {where!r}; it must be a list of joint "
            f'names or ["all"]'
        )
    if not isinstance(values, dict):
        raise ValueError(
            f"{name}, {row['cause']}: values is {values!r}; it must be "
            "{parameter: number}"
        )
    extra = sorted(set(row) - {"cause", "where", "values", "role"})
    if extra:
        raise ValueError(f"{name}, {row['cause']}: {extra[0]!r} means nothing here")
