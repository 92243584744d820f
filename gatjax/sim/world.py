"""A World: a simulation with everything that was added to it, as one value."""

from __future__ import annotations

import dataclasses
import math
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
from gatjax.sim import causes, derived
from gatjax.sim.causes import GEAR
from gatjax.sim.contact import Law, law_of, with_law
from gatjax.task import Task

ROLES = ("cause", "calibration", "bound")
ANGLED = ("dead_band", "encoder_offset", "encoder_scale", "speed_limit")
"""Causes in motors that turn a target by the joint's angle."""
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
    contact: Law | None = None  # of the floor, in place of the model file's

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


def with_contact(world: World, law: Law) -> World:
    """The same world, its contacts by another law."""
    if law == law_of(world.model):
        return world
    model = with_law(world.model, law)
    return dataclasses.replace(world, model=model, contact=law)


def dividing(period: float, step: float) -> float:
    """The longest physics step up to `step` that divides a control period, both s."""
    parts = period / step
    whole = abs(parts - round(parts)) < 1e-6 and parts > 0.5
    return step if whole else period / math.ceil(parts)


def add_command(world: World, name: str, effect: Effect, params: Any) -> World:
    """Put a command effect, e.g. a grounding, ahead of the others.

    What was learned from logs of commands acts on what is commanded: causes that delay
    or lose commands act on what it makes of them.
    """
    return dataclasses.replace(
        world,
        command={name: effect, **world.command},
        values=world.values._replace(command={name: params, **world.values.command}),
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
    angled = name in ANGLED and any(part.slot == "motor" for part in parts)
    if angled or any(part.slot in ("joint", GEAR) for part in parts):
        derived.check_drives(world.model, name)
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


def add_rows(world: World, rows: Iterable[Mapping[str, Any]]) -> World:
    """Add causes one after the other, as a world lists them: a row may have a role."""
    for row in rows:
        role = row.get("role", "cause")
        world = add_cause(world, row["cause"], row["where"], row["values"], role)
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
