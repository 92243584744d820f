"""From a verdict to a World: its causes, and the tolerances fitted beside them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from gatjax.diagnosis import patterns
from gatjax.diagnosis.claims import Claim
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, TOLERANCES, numbers
from gatjax.diagnosis.joint import Joint
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.start import turn
from gatjax.diagnosis.tolerances import USUAL
from gatjax.diagnosis.verdict import Verdict
from gatjax.effects.catalogue import CATALOGUE
from gatjax.robot.model import joint_names
from gatjax.sim import causes
from gatjax.sim import world as worlds
from gatjax.sim.contact import law_of
from gatjax.sim.world import World

TIMESTEP = 5e-4  # s: a position servo's angle is off by its motion in half a step
LEAST = 0.25  # of its tolerance, the usual one at most: joints off by less are left
OF = {"zero_in": "zero", "zero_out": "zero", "delay": "late"}  # in `Tolerances`
OWN = {  # fields of a driven joint alone; others may be tied to it
    "armature": "dof_armature", "coulomb_friction": "dof_frictionloss",
    "viscous_friction": "dof_damping",
}  # fmt: skip
Row = dict[str, Any]


def parameters(judge: Judge, claim: Claim) -> dict[str, float]:
    """A claim's parameters under the catalogue's names, SI; the scored one first."""
    if claim.stance is not None:
        return claim.stance.values
    if claim.lost:
        return patterns.statistics(*pattern(judge, claim))
    values = claim.hypothesis.values(_driven(judge, claim), claim.own)
    return {name: float(value) for name, value in values.items()}


def pattern(judge: Judge, claim: Claim) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Masks [N] and commands [N] rad of a claim that commands got lost, run by run."""
    lost = claim.lost or {}
    masks = [mask for masks in lost.values() for mask in masks]
    return masks, [command for k in lost for command in judge.case.commands(k)]


def _driven(judge: Judge, claim: Claim) -> Joint:
    """The first joint of a claim, its drive as fitted where a size depends on it.

    How warm a motor gets depends on its torques and on the limit that they are a share
    of; whatever else is known of the joint decides both.
    """
    joint = judge.joints[claim.where[0]]
    if claim.hypothesis.cause != "thermal_derating":
        return joint
    fit = claim.fits[joint.index]
    drive = numbers(joint, fit.hypothesis, fit.x)
    return joint._replace(nominal=joint.nominal | drive)


def world_values(judge: Judge, claim: Claim) -> dict[str, float]:
    """A claim's parameters as the World's effect takes them."""
    values = parameters(judge, claim)
    if claim.stance is not None:
        return values
    cause = claim.hypothesis.cause
    if cause == "speed_limit":
        on_motor = "no_torque_speed" in values
        limit = values.get("no_torque_speed", values["limit"])
        return {"limit": limit, "on_motor": float(on_motor)}
    if cause == "thermal_derating":
        limit = _driven(judge, claim).nominal["limit"]
        heat = values["lost_fraction"] * limit**2 / np.exp(claim.own[0])
        return values | {"heat": float(max(heat, 1e-12))}
    if cause == "supply_sag":
        return values | {"total": judge.case.supply}
    if cause in OWN and min(values.values()) < 0.0:
        owners = [judge.joints[k] for k in claim.where]
        most = min(_own(judge.case.model, OWN[cause], joint) for joint in owners)
        return {name: max(value, -most) for name, value in values.items()}
    return values


def places(judge: Judge, claim: Claim) -> list[str]:
    """Names of the joints of a claim, or ["all"]; imu, ground or a foot."""
    joints = judge.joints
    if claim.stance is not None:
        return [claim.stance.where]
    if CATALOGUE[claim.hypothesis.cause].place == "all":
        return ["all"]
    if len(claim.where) == len(joints) > 1:
        return ["all"]
    return [joints[k].name for k in claim.where]


def pieces(judge: Judge, claim: Claim) -> list[Claim]:
    """A claim by joints that have the same numbers.

    What several joints share may be a share of their torque limits or gains: then each
    kind of motor has a value of its own, N m or N m/rad.
    """
    name = claim.hypothesis.cause
    if claim.stance is not None or CATALOGUE[name].place == "all":
        return [claim]
    groups: list[tuple[dict[str, float], list[int]]] = []
    for k in claim.where:
        values = world_values(judge, claim._replace(where=(k,)))
        mine = next((where for known, where in groups if known == values), None)
        if mine is None:
            groups.append((values, [k]))
        else:
            mine.append(k)
    return [claim._replace(where=tuple(where)) for _, where in groups]


def effects(judge: Judge, claim: Claim) -> list[tuple[str, list[str], dict]]:
    """Cause, places and values of a claim's effects in a World."""
    name = claim.hypothesis.cause
    return [
        (name, places(judge, piece), world_values(judge, piece))
        for piece in pieces(judge, claim)
    ]


def calibration(verdict: Verdict) -> list[Row]:
    """Corrections of nominal numbers within their tolerances, as rows of a world.

    Of a joint all or none: fitted together, they make up for each other.
    """
    rows: list[Row] = []
    model = verdict.judge.case.model
    for joint, fit in zip(verdict.judge.joints, verdict.judge.known, strict=True):
        if joint.index in verdict.unexplained:
            continue  # its tolerances imitate what is not known
        own = {
            name: row for name, row in _corrections(joint, fit, model).items()
            if not _idle(joint, fit, name, *row[:2])
        }  # fmt: skip
        if not any(_tells(joint, fit, name) for name in own):
            continue
        for cause, value, more in own.values():
            values = {CATALOGUE[cause].main.name: float(value)} | more
            rows.append(
                {"cause": cause, "where": [joint.name], "values": values,
                 "role": "calibration"}
            )  # fmt: skip
    # in an order in which they share effects
    return sorted(rows, key=lambda row: (row["cause"], len(row["values"])))


def _tells(joint: Joint, fit: Fit, name: str) -> bool:
    """Whether a number is off by what its tolerance makes worth telling."""
    size, of = abs(fit.x[TOLERANCES.index(name)]), OF.get(name, name)
    own, usual = getattr(joint.allowed, of), getattr(USUAL, of)
    return bool(size >= LEAST or own * size >= LEAST * usual)


def _idle(joint: Joint, fit: Fit, name: str, cause: str, value: float) -> bool:
    """Whether a correction is none, of what a joint has not, or what a cause sets."""
    neutral = CATALOGUE[cause].neutral
    none = fit.x[TOLERANCES.index(name)] == 0.0 or value == neutral
    sooner = name == "delay" and value < 0.0
    unheard = name == "zero_in" and not joint.servoed
    boundless = name == "limit" and not joint.limited
    wanting = none or sooner or unheard or boundless
    return bool(wanting) or set_by_cause(joint, fit, name)


def set_by_cause(joint: Joint, fit: Fit, name: str) -> bool:
    """Whether a named cause sets the number that a tolerance is about."""
    without = fit.x.copy()
    without[TOLERANCES.index(name)] = 0.0
    one, other = (numbers(joint, fit.hypothesis, x)[name] for x in (fit.x, without))
    return bool(one == other)


def _corrections(
    joint: Joint, fit: Fit, model: mujoco.MjModel
) -> dict[str, tuple[str, float, dict[str, float]]]:
    """By tolerance: the cause that corrects it, its value and further parameters."""
    before = joint.assumed.law(joint.nominal["limit"])
    drive = joint.nominal | numbers(joint, None, fit.x[:COUNT])
    more = {
        name: max(drive[name] - joint.nominal[name], -_own(model, OWN[cause], joint))
        for name, cause in (
            ("damping", "viscous_friction"), ("friction", "coulomb_friction"),
            ("armature", "armature"),
        )
    } | {
        name: drive[name] - before.get(name, 0.0)
        for name in ("zero_out", "zero_in", "delay")
    }  # fmt: skip
    raised = max(drive["limit"] - joint.nominal["limit"], 0.0)
    return {
        "kp": ("gain_error", drive["kp"] / joint.nominal["kp"], {}),
        "kv": ("damping_error", drive["kv"] / max(joint.nominal["kv"], 1e-9), {}),
        "damping": ("viscous_friction", more["damping"], {}),
        "friction": ("coulomb_friction", more["friction"], {}),
        "armature": ("armature", more["armature"], {}),
        "limit": ("torque_limit", drive["limit"], {"raised": raised}),
        "zero_out": ("encoder_offset", more["zero_out"], {}),
        "zero_in": ("encoder_offset", more["zero_in"], {"in_loop": 1.0}),
        "delay": ("command_delay", more["delay"], {}),
    }


def _own(model: mujoco.MjModel, field: str, joint: Joint) -> float:
    """What a model gives a driven joint itself."""
    dof = model.jnt_dofadr[model.actuator_trnid[joint.index, 0]]
    return float(getattr(model, field)[dof])


def neutral(rows: list[Row]) -> list[Row]:
    """Rows of calibration that change nothing, for a world of the same structure."""
    return [
        row | {"values": row["values"] | {entry.main.name: entry.neutral}}
        for row in rows
        for entry in [CATALOGUE[row["cause"]]]
    ]


def extended(verdict: Verdict, world: World, rows: list[Row]) -> World:
    """A world with the verdict's causes and rows of calibration.

    Args:
        verdict: of the diagnosis.
        world: that the diagnosis started from.
        rows: from `calibration`, or none.
    """
    claims = [cause.claim for cause in verdict.causes]
    return claimed(verdict.judge, claims, world, rows)


def claimed(
    judge: Judge, claims: list[Claim], world: World, rows: Sequence[Row] = ()
) -> World:
    """A world with some claims, and more rows.

    Effects act in the order in which a world lists them: here that of the simulated
    joint, in which they were fitted. A delay after a dead band would delay what the
    dead band has made of the angle.
    """
    found = [
        {"cause": name, "where": where, "values": values}
        for claim in claims
        for name, where, values in effects(judge, claim)
    ]
    every = _merged([*world.causes, *found, *rows], joint_names(world.model))
    every.sort(key=turn)
    bare = worlds.nominal(world.task, world.source, world.model.opt.timestep)
    law = law_of(judge.case.model)
    return worlds.add_rows(worlds.with_contact(bare, law), every)


def _merged(rows: list[Row], names: Sequence[str]) -> list[Row]:
    """Rows with one asymmetric friction a joint and direction.

    Viscous parts add up, as in the simulated joint; by themselves a positive and a
    negative one would each damp a direction.
    """
    cause = "asymmetric_friction"
    own = [
        (row["where"], causes.completed(row)) for row in rows if row["cause"] == cause
    ]
    if len(own) < 2:
        return rows
    groups: dict[tuple[float, float], list[str]] = {}
    for name in names:
        here = [values for where, values in own if {name, "all"} & {*where}]
        viscous = sum(v["viscous"] for v in here)
        ways = [sum(v["torque"] for v in here if way * v["torque"] > 0.0)
                for way in (1.0, -1.0)]  # fmt: skip
        for torque in sorted(filter(None, ways), key=abs, reverse=True):
            groups.setdefault((torque, viscous), []).append(name)
            viscous = 0.0  # once
    return [row for row in rows if row["cause"] != cause] + [
        {
            "cause": cause,
            "where": where,
            "values": {"torque": torque, "viscous": viscous},
        }
        for (torque, viscous), where in groups.items()
    ]
