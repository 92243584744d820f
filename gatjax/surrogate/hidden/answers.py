"""answers.json: what is true about the cases, in the shared schema."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from gatjax.surrogate.hidden.catalogue import CATALOGUE
from gatjax.surrogate.hidden.design import ENGINES, Case
from gatjax.surrogate.hidden.measure import COUNT
from gatjax.surrogate.hidden.places import Effect
from gatjax.surrogate.hidden.robots import ROBOTS, robot
from gatjax.surrogate.hidden.study import Result

SCHEMA = "hidden-effects.answers/1"
VISIBLE = 0.8
MEASURED = ("lost_fraction", "max_drop")  # parameters that a run decides
SECOND = {"stiction": {"velocity": "rad/s"},
          "torque_ripple": {"cycles": "1/rad", "phase": "rad"}}  # fmt: skip
"""Further parameters that docs/diagnosis.md names."""


def alias_classes(names: Iterable[str] = ROBOTS) -> list[dict[str, Any]]:
    """What cannot be told apart in these recordings."""
    lone = [name for name in names if len(robot(name).joints) == 1]
    return [
        {
            "name": "transport",
            "members": ["command_delay", "measurement_delay"],
            "when": "no channel that sees the command arrive (always, in these logs)",
        },
        {
            "name": "damping",
            "members": ["damping_error", "viscous_friction"],
            "when": "motor powered in the whole log",
        },
        {
            "name": "gravity_phase",
            "members": ["com_shift", "gravity_tilt"],
            "when": "one joint only",
            "robots": lone,
        },
    ]


def accepted(case: Case, name: str) -> list[str]:
    """The names that count for a cause of a case."""
    for entry in alias_classes([case.robot.name]):
        inside = name in entry["members"]
        if inside and case.robot.name in entry.get("robots", [case.robot.name]):
            return entry["members"]
    return [name]


def _effect(effect: Effect, number: int, result: Result) -> dict[str, Any]:
    """One effect of a case."""
    cause = effect.cause
    value = result.values[number]
    if cause.parameter in MEASURED:
        value = result.measured[cause.parameter]
    parameters = {cause.parameter: {"value": value, "unit": cause.unit}}
    for name, unit in SECOND.get(effect.name, {}).items():
        parameters[name] = {"value": effect.details[name], "unit": unit}
    strength = {} if value == result.values[number] else {"rate": result.values[number]}
    return {
        "cause": effect.name,
        "where": list(effect.where),
        "parameters": parameters,
        "main_parameter": cause.parameter,
        "d": round(result.visibility[number], 3),
        "d_where": round(result.where[number], 3),
        "target_d": round(effect.target, 3),
        "largest_channel": result.largest[number],
        "detail": {**effect.details, **strength},
    }


def answer(case: Case, result: Result) -> dict[str, Any]:
    """The entry of a case."""
    effects = [
        _effect(effect, number, result) for number, effect in enumerate(case.effects)
    ]
    outside = case.kind == "outside"
    verdict = {"null": "none", "outside": "unknown"}.get(case.kind, "named")
    weakest = min((effect["d"] for effect in effects), default=None)
    names = [] if outside else [effect.name for effect in case.effects]
    return {
        "id": case.name,
        "robot": case.robot.name,
        "kind": case.kind,
        "verdict": verdict,
        "engine": ENGINES[case.engine],
        "fit_motions": list(case.fit_motions),
        "held_motion": case.held_motion,
        "rate": case.rate,
        "encoder_lsb": COUNT,
        "channels": {
            "vel": case.channels.velocity,
            "temp": case.channels.temperature,
            "volt": case.channels.voltage,
            "tau": case.channels.torque,
        },
        "causes": [] if outside else effects,
        "hidden": effects if outside else None,
        "accepted": {name: accepted(case, name) for name in names},
        "d": weakest,
        "in_main_score": weakest is None or weakest >= VISIBLE,
        "twin": None,
        "oracle": {name: float(f"{v:.5g}") for name, v in result.oracle.items()},
    }


def document(entries: list[dict[str, Any]]) -> dict[str, Any]:
    """The whole file."""
    used = sorted({entry["robot"] for entry in entries})
    return {
        "schema": SCHEMA,
        "alias_classes": alias_classes(used),
        "main_parameter": {name: cause.parameter for name, cause in CATALOGUE.items()},
        "cases": sorted(entries, key=lambda entry: entry["id"]),
    }
