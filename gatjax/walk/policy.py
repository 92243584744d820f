"""Policy files: what the robot loads."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gatjax.files import read_json, write_json
from gatjax.walk.parameters import PARAMETERS, Parameter

POLICY = {"schema": "gatjax.policy/1", "robot": "nao", "engine": "walk2014-ut15"}
BOUND_SLACK = 1e-6  # of a parameter's range: what float32 may round off


def write_policy(
    folder: Path, name: str, theta: np.ndarray, made_by: Mapping[str, Any]
) -> Path:
    """Writes `<folder>/<name>.json`, which a robot can load.

    Args:
        folder: where it goes, `policies` of a run folder for one.
        name: of the policy, without ending.
        theta: [15] in the order of `PARAMETERS`.
        made_by: what made it: method, iteration, generation, cost and so on.

    Returns:
        The file.

    Raises:
        ValueError: one line with the parameter that is NaN or out of bounds.
        OSError: one line; nothing was changed.
    """
    path = Path(folder) / f"{name}.json"
    values = np.asarray(theta, np.float64)
    if values.shape != (len(PARAMETERS),):
        raise ValueError(
            f"{path}: a policy has shape ({len(PARAMETERS)},), not {values.shape}"
        )
    for parameter, value in zip(PARAMETERS, values):
        _check_bounds(parameter, value, path)
    parameters = {
        parameter.name: {"value": float(value), "unit": parameter.unit}
        for parameter, value in zip(PARAMETERS, values)
    }
    write_json(path, {**POLICY, "parameters": parameters, "made_by": dict(made_by)})
    return path


def read_policy(path: str | Path) -> np.ndarray:
    """Reads a policy file into theta [15], in the order and units of `PARAMETERS`.

    Raises:
        FileNotFoundError: no such file; the line lists the policies beside it.
        ValueError: one line: another robot or engine, a parameter that is unknown,
            missing, NaN, out of bounds or in another unit.
    """
    path = Path(path)
    if not path.is_file():
        names = sorted(other.name for other in path.parent.glob("*.json"))
        there = f"there are: {', '.join(names)}" if names else "no .json file is there"
        raise FileNotFoundError(f"{path}: no such policy; {there}")
    policy = read_json(path)
    for key, ours in POLICY.items():
        if policy.get(key) != ours:
            raise ValueError(
                f"{path}: {key} is {policy.get(key)!r}, gatjax walks with {ours!r}"
            )
    given = policy.get("parameters")
    names = [parameter.name for parameter in PARAMETERS]
    if not isinstance(given, dict):
        raise ValueError(f"{path}: 'parameters' must hold {', '.join(names)}")
    unknown = ", ".join(name for name in given if name not in names)
    if unknown:
        known = ", ".join(names)
        raise ValueError(f"{path}: unknown parameter {unknown}; known are {known}")
    missing = ", ".join(name for name in names if name not in given)
    if missing:
        raise ValueError(f"{path}: parameter {missing} is missing")
    return np.array([_policy_value(p, given[p.name], path) for p in PARAMETERS])


def _check_bounds(parameter: Parameter, value: float, path: Path) -> None:
    """Refuses a value that is NaN or outside the parameter's bounds."""
    name, unit, _, low, high, *_ = parameter
    slack = BOUND_SLACK * (high - low)
    if not low - slack <= value <= high + slack:  # NaN fails this too
        raise ValueError(
            f"{path}: {name} is {value:g}; it must be {low:g} to {high:g} {unit}"
        )


def _policy_value(parameter: Parameter, entry: Any, path: Path) -> float:
    """One checked value of a policy file."""
    name, unit = parameter.name, parameter.unit
    value = entry.get("value") if isinstance(entry, dict) else None
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        form = f'{{"value": number, "unit": "{unit}"}}'
        raise ValueError(f"{path}: parameter {name} must be {form}")
    given = entry.get("unit")
    if given != unit:
        raise ValueError(f"{path}: unit of {name} is {given!r}; it must be {unit!r}")
    _check_bounds(parameter, float(value), path)
    return float(value)
