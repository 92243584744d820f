"""Reads what a run folder holds and lists what it lacks.

A run may have been stopped anywhere, so nothing here raises over a missing or cut file:
the part is left empty and a sentence about it goes into `Run.problems`.
"""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, get_type_hints

THETA0 = "theta0"
DIAGNOSIS = Path("diagnosis", "diagnosis.json")  # only in a run with --explain
SKIPPED = Path("diagnosis", "skipped.txt")
EXTENDED = "extended.json"  # the world that is searched in after a diagnosis
CHOSEN = "chosen"  # candidate of the walks that confirm a winner on fresh seeds

Row = TypeVar("Row", bound=tuple)


class Rollout(NamedTuple):
    """One walk on the robot: a row of evaluations.csv."""

    method: str
    iteration: int
    generation: int
    candidate: str
    seed: int
    velocity_m_s: float
    fell_at_s: float  # nan or inf if it never fell

    @property
    def fell(self) -> bool:
        """Whether this walk ended in a fall."""
        return math.isfinite(self.fell_at_s)


class Metric(NamedTuple):
    """One candidate of one generation in the simulator: a row of metrics.csv."""

    method: str
    iteration: int
    generation: int
    candidate: str
    simulator_cost: float  # m/s, +15 for a fall
    simulator_velocity_m_s: float
    simulator_falls: float
    sigma: float
    seconds: float


class Prediction(NamedTuple):
    """Prediction error of the simulator at one joint: a row of prediction.csv."""

    method: str
    iteration: int
    joint: str
    horizon_s: float
    before_rad: float
    after_rad: float


class Value(NamedTuple):
    """One number of a policy file."""

    value: float
    unit: str


class Run(NamedTuple):
    """Everything the report shows, except the walks."""

    folder: Path
    config: dict[str, Any]
    environment: dict[str, Any]
    robot: dict[str, Any]
    metrics: list[Metric]
    predictions: list[Prediction]
    rollouts: list[Rollout]
    policies: dict[str, dict[str, Value]]  # file stem -> parameter name -> value
    problems: list[str]
    diagnosis: dict[str, Any]  # diagnosis/diagnosis.json of a run with --explain
    skipped: str  # why there is no GAT after diagnosis; empty where there is
    extended: dict[str, Any]  # the world that GAT after diagnosis searches in


def read_run(folder: Path) -> Run:
    """Read a run folder, as far as it got.

    Args:
        folder: A run folder as docs/files.md describes it.

    Raises:
        FileNotFoundError: `folder` is not a folder.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(
            f"{folder} is not a folder; give the folder that `gatjax run` wrote"
        )
    problems: list[str] = []
    rollouts = read_table(folder / "evaluations.csv", Rollout, problems)
    diagnosis, extended = folder / DIAGNOSIS, folder / EXTENDED
    kept = [row for row in rollouts if math.isfinite(row.velocity_m_s)]
    if len(kept) < len(rollouts):
        lost = len(rollouts) - len(kept)
        problems.append(f"evaluations.csv: {lost} rollouts without a velocity left out")
    if not kept and not any("evaluations.csv" in problem for problem in problems):
        problems.append("evaluations.csv is empty: nothing has walked on the robot yet")
    return Run(
        folder=folder,
        config=read_json(folder / "config.json", problems),
        environment=read_json(folder / "environment.json", problems),
        robot=read_json(folder / "robot.json", problems),
        metrics=read_table(folder / "metrics.csv", Metric, problems),
        predictions=read_table(folder / "prediction.csv", Prediction, problems),
        rollouts=kept,
        policies=read_policies(folder / "policies", problems),
        problems=problems,
        diagnosis=read_json(diagnosis, problems) if diagnosis.is_file() else {},
        skipped=read_text(folder / SKIPPED),
        extended=read_json(extended, problems) if extended.is_file() else {},
    )


def read_json(path: Path, problems: list[str]) -> dict[str, Any]:
    """Read a json object; an empty one and a problem if that fails."""
    if not path.is_file():
        problems.append(f"{path.name} is missing")
        return {}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, OSError) as error:
        problems.append(f"{path.name} cannot be read: {error}")
        return {}
    if not isinstance(content, dict):
        problems.append(f"{path.name} holds no json object")
        return {}
    return content


def read_text(path: Path) -> str:
    """Read a line of text; an empty one without the file."""
    return path.read_text(encoding="utf-8").strip() if path.is_file() else ""


def read_table(path: Path, record: type[Row], problems: list[str]) -> list[Row]:
    """Read the columns of a csv file that `record` names; bad rows are left out."""
    if not path.is_file():
        problems.append(f"{path.name} is missing")
        return []
    rows = []
    try:
        with path.open(newline="", encoding="utf-8") as file:
            for number, cells in enumerate(csv.DictReader(file), start=2):
                try:
                    rows.append(_record(record, cells))
                except (ValueError, KeyError) as error:
                    problems.append(f"{path.name} line {number} left out: {error}")
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        problems.append(f"{path.name} cannot be read to its end: {error}")
    return rows


def _record(record: type[Row], cells: dict[str, str | None]) -> Row:
    """Build one record; an empty float is nan, an empty int 0, a cut row an error."""
    values = []
    for name, kind in get_type_hints(record).items():
        if name not in cells:
            raise KeyError(f"column {name} is missing")
        text = cells[name]
        if text is None:
            raise ValueError("the line is cut")
        if kind is str:
            values.append(text)
        elif kind is int:
            values.append(int(float(text or 0)))
        else:
            values.append(float(text) if text else math.nan)
    return record(*values)


def read_policies(folder: Path, problems: list[str]) -> dict[str, dict[str, Value]]:
    """Read every policy file by its stem."""
    if not folder.is_dir():
        problems.append("policies/ is missing")
        return {}
    policies = {}
    for path in sorted(folder.glob("*.json")):
        values = policy_values(read_json(path, problems))
        if values:
            policies[path.stem] = values
    return policies


def policy_values(content: dict[str, Any]) -> dict[str, Value]:
    """Named numbers of a policy file: `name: number` or `name: {value, unit}`."""
    named = content.get("parameters", content)
    units = content.get("units", {})
    if isinstance(named, list):
        named = {entry.get("name", ""): entry for entry in named}
    values = {}
    for name, entry in named.items():
        unit = units.get(name, "") if isinstance(units, dict) else ""
        if isinstance(entry, dict):
            unit = entry.get("unit", unit)
            entry = entry.get("value")
        if isinstance(entry, (int, float)) and math.isfinite(entry):
            values[name] = Value(float(entry), str(unit))
    return values
