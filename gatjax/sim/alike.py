"""Worlds with different causes as worlds of one structure, for one compiled call.

What one world has and another lacks is added to that with values that change nothing.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from difflib import SequenceMatcher
from typing import Any

import jax
import mujoco
import numpy as np

from gatjax.effects.body import now
from gatjax.effects.catalogue import cause
from gatjax.robot.model import joint_names
from gatjax.sim import derived
from gatjax.sim.causes import GEAR, completed
from gatjax.sim.contact import law_of
from gatjax.sim.world import Values, World, add_command, add_rows, add_sensor

Row = dict[str, Any]
Layer = list[Row]  # rows of one cause, at different joints: they share their effects

FIELDS = {"body", GEAR}  # slots of what is no effect of its own
WEIGHED = (*derived.INERTIAL, *derived.CONSTANTS)  # fields of what bodies weigh
UNUSED = ("cam_", "light_", "actuator_acc0", "dof_length")  # no walk needs them


def alike(worlds: Sequence[World]) -> list[World] | None:
    """Return worlds of one structure, whose values may be stacked.

    Each walks as the world that it is made of, but for the iterations of the solver:
    all have as many as the one that has most.

    Args:
        worlds: of one robot and task; their causes may differ.

    Returns:
        One for each; None where they differ in more than causes and numbers.
    """
    if len({_size(world) for world in worlds}) > 1:
        return None
    names = list(joint_names(worlds[0].model))
    layers, plan = [_layers(world, names) for world in worlds], []
    for each in layers:
        plan = _merged(plan, each)
    placed = [_placed(plan, each, names) for each in layers]
    rows = [[row for row in world.causes if not _acts(row)] for world in worlds]
    gears = [row for some in rows for row in some if GEAR in _slots(row)]
    made = []
    for world, first, rest in zip(worlds, _filled(placed), rows, strict=True):
        none = [_neutral(row, []) for row in gears[:1]]  # one effect of all joints
        made.append(_rebuilt(world, [*first, *none, *rest]))
    return _stackable(made)


def _size(world: World) -> tuple:
    """What worlds must have in common."""
    return (
        world.source, world.task, world.model.nv, world.model.ngeom,
        world.model.opt.timestep, law_of(world.model), world.learned,
        world.learned_sensors,
    )  # fmt: skip


def _slots(row: Row) -> set[str]:
    return {part.slot for part in cause(row["cause"]).active(completed(row))}


def _acts(row: Row) -> bool:
    """Whether a row has effects, beside changes of the model."""
    return not _slots(row) <= FIELDS


def _key(layer: Layer) -> tuple[str, tuple[bool, ...]]:
    """Cause of a layer, and which of its parts act."""
    row = layer[0]
    active, entry = cause(row["cause"]).active(completed(row)), cause(row["cause"])
    return row["cause"], tuple(part in active for part in entry.parts)


def _joint(row: Row) -> bool:
    """Whether a row lists joints."""
    return cause(row["cause"]).place == "joint"


def _layers(world: World, names: list[str]) -> list[Layer]:
    """Rows that have effects, in their order; all joints by their names."""
    layers: list[Layer] = []
    for row in filter(_acts, world.causes):
        if _joint(row) and row["where"] == ["all"]:
            row = row | {"where": names}
        last = layers[-1] if layers else []
        taken = {joint for each in last for joint in each["where"]}
        apart = taken.isdisjoint(row["where"]) and _joint(row)
        if last and apart and _key(last) == _key([row]):
            last.append(row)
        else:
            layers.append([row])
    return layers


def _merged(plan: list[Layer], layers: list[Layer]) -> list[Layer]:
    """A plan with the layers that it lacks, where their neighbours are."""
    keys = [[_key(layer) for layer in each] for each in (plan, layers)]
    found: list[Layer] = []
    for tag, i, j, k, m in SequenceMatcher(None, *keys, autojunk=False).get_opcodes():
        found += plan[i:j] if tag == "equal" else [*plan[i:j], *layers[k:m]]
    return found


def _placed(plan: list[Layer], layers: list[Layer], names: list[str]) -> list[Layer]:
    """Layers in their places in a plan, and neutral ones where there is none."""
    left, found = list(layers), []
    for layer in plan:
        if left and _key(left[0]) == _key(layer):
            found.append(left.pop(0))
        else:
            everywhere = names if _joint(layer[0]) else ["all"]
            found.append([_neutral(layer[0], everywhere)])
    return found


def _neutral(row: Row, where: list[str]) -> Row:
    """A row that changes nothing."""
    entry = cause(row["cause"])
    values = row["values"] | {entry.main.name: entry.neutral}
    return row | {"where": where, "values": values}


def _filled(placed: Sequence[list[Layer]]) -> list[list[Row]]:
    """Rows of each world, as many in all: effects are named by their place."""
    found: list[list[Row]] = [[] for _ in placed]
    for layers in zip(*placed, strict=True):
        most = max(len(layer) for layer in layers)
        for rows, layer in zip(found, layers, strict=True):
            nowhere = [_neutral(layer[0], [])] * (most - len(layer))
            rows += [*layer, *nowhere]
    return found


def _rebuilt(world: World, rows: list[Row]) -> World:
    """A world with other rows; what was learned stands where it did."""
    old = world.values
    noise = {"noise": old.sensor["noise"]}
    made = dataclasses.replace(
        world,
        command={},
        motor={},
        joint={},
        sensor={"noise": world.sensor["noise"]},
        values=Values(command={}, motor={}, sensor=noise, body={}),
        causes=(),
    )
    made = add_rows(made, rows)
    for name in world.learned:
        made = add_command(made, name, world.command[name], old.command[name])
    for name in world.learned_sensors:
        made = add_sensor(made, name, world.sensor[name], old.sensor[name])
    return made


def _stackable(worlds: list[World]) -> list[World] | None:
    """Worlds of one model: what differs in the models is among the values."""
    first = worlds[0].model
    differ = {name for world in worlds for name in _different(first, world.model)}
    if not differ <= set(WEIGHED):
        return None
    names = differ.union(*(world.values.body for world in worlds))
    model = max((world.model for world in worlds), key=lambda m: m.opt.iterations)
    found = []
    for world in worlds:
        body = {
            name: now(world.model, world.values.body, name) for name in sorted(names)
        }
        values = world.values._replace(body=body)
        found.append(dataclasses.replace(world, model=model, values=values))
    shapes = {str(jax.tree.map(np.shape, world.values)) for world in found}
    return found if len(shapes) == 1 else None


def _different(one: mujoco.MjModel, other: mujoco.MjModel) -> list[str]:
    """Names of fields that walks depend on and that differ."""
    arrays = [
        name
        for name in dir(one)
        if isinstance(getattr(one, name), np.ndarray) and not name.startswith(UNUSED)
    ]
    return [n for n in arrays if not np.array_equal(getattr(one, n), getattr(other, n))]
