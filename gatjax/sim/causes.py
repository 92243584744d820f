"""Rows of causes, as a world and its file hold them: {cause, where, values, role}."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from gatjax.effects import gear
from gatjax.effects.catalogue import cause
from gatjax.effects.cause import Part, complete, spread
from gatjax.robot import model as robot_model
from gatjax.sim import derived

GEAR = "gear"  # name of the joint effect that all causes of slot gear make up


def completed(row: dict) -> dict[str, float]:
    """Return the values of a row with their defaults."""
    return complete(row["cause"], cause(row["cause"]), row["values"])


def reported_late(model: mujoco.MjModel, rows: Sequence[dict]) -> np.ndarray:
    """How late encoders report each joint of a model, [J] s."""
    names, late = robot_model.joint_names(model), np.zeros(model.nu)
    for row in rows:
        if row["cause"] == "measurement_delay":
            seen = [bool({name, "all"} & {*row["where"]}) for name in names]
            late += np.where(seen, row["values"]["delay"], 0.0)
    return late


def parts(rows: Sequence[dict], *slots: str) -> list[Part]:
    """Return the parts of causes in some slots, in order."""
    return [
        part
        for row in rows
        for part in cause(row["cause"]).active(completed(row))
        if part.slot in slots
    ]


def places(model: mujoco.MjModel, row: dict, part: Part) -> tuple[str, ...]:
    """Check `where` and name what a part's params are listed by; () for numbers."""
    place, where = cause(row["cause"]).place, row["where"]
    if part.follows and not robot_model.servoed(model):
        values = f"{row['cause']} {dict(row['values'])}"
        raise ValueError(f"{values}: only position servos have it, the model has none")
    names = robot_model.joint_names(model)
    if place == "foot":
        if where == ["all"]:
            raise ValueError(f"{row['cause']}: where is {where}; name bodies, the feet")
        names = tuple(model.body(index).name for index in range(model.nbody))
    elif place != "joint":
        if where not in ([place], ["all"]):
            raise ValueError(f"{row['cause']}: where is {where}; it must be {[place]}")
        there = robot_model.slots(model)
        if place == "imu" and not (len(there.gyro) and len(there.accelerometer)):
            raise ValueError(
                f"{row['cause']}: the model has no IMU; give it a gyro and an "
                f"accelerometer (<sensor>), or leave the cause out"
            )
        return names if part.slot in ("joint", "log") else ()
    unknown = sorted(set(where) - set(names)) if where != ["all"] else []
    if unknown:
        kind = "body" if place == "foot" else "joint"
        raise ValueError(
            f"the model has no {kind} {unknown[0]!r}; it has {list(names)}"
        )
    return names


def of_model(
    model: mujoco.MjModel, rows: Sequence[dict]
) -> tuple[dict[str, Any], gear.Gear | None]:
    """Return what all causes together change in a model.

    Args:
        model: the nominal one; it is not changed.
        rows: causes.

    Returns:
        {MuJoCo field: value} with the constants that MuJoCo derives, and the gears of
        the joints, None where no cause is one.
    """
    names, play = robot_model.joint_names(model), None
    fields: dict[str, Any] = {}
    for row in rows:
        entry, full = cause(row["cause"]), completed(row)
        for part in entry.active(full):
            if part.slot not in ("body", GEAR):
                continue
            params = spread(entry, part, places(model, row, part), row["where"], full)
            if part.build is None:
                here = np.isin(names, row["where"]) | (row["where"] == ["all"])
                play = gear.absent(len(names)) if play is None else play
                play = gear.changed(play, here, params, row["values"])
                continue
            fields = part.build(model, fields, params)
            derived.check(model, fields, row["cause"])
    return derived.constants(model, fields), play
