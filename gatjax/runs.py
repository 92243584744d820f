"""The run folder: what a run leaves behind, and how another run goes on from it.

The files and their columns are in `docs/files.md`. Everything is text, and a file is
either written whole or not at all (`write_whole`), so a kill at any moment leaves a
folder that can be read and resumed.
"""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import importlib.metadata
import io
import json
import os
import platform
import shutil
import subprocess
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gatjax.walk.parameters import PARAMETERS, Parameter

FOLDERS = ("recordings", "policies", "grounding", "checkpoints", "walks")
PACKAGES = ("gatjax", "jax", "mujoco", "mujoco-mjx", "dartpy", "evosax", "numpy")
POLICY = {"schema": "gatjax.policy/1", "robot": "nao", "engine": "walk2014-ut15"}
BOUND_SLACK = 1e-6  # of a parameter's range: what float32 may round off


class Table(NamedTuple):
    """Columns of a csv table; one row for each value of the key."""

    key: tuple[str, ...]
    values: tuple[str, ...]


TABLES = {
    "metrics.csv": Table(
        key=("method", "iteration", "generation", "candidate"),
        values=(
            *("simulator_cost", "simulator_velocity_m_s", "simulator_falls", "sigma"),
            *("robot_velocity_m_s", "robot_falls", "robot_rollouts", "seconds"),
        ),
    ),
    "prediction.csv": Table(
        key=("method", "iteration", "joint", "horizon_s"),
        values=("before_rad", "after_rad"),
    ),
    "evaluations.csv": Table(
        key=("method", "iteration", "generation", "candidate", "seed"),
        values=("velocity_m_s", "fell_at_s"),
    ),
}
"""The tables of a run folder, by file name."""

TEXT_COLUMNS = ("method", "candidate", "joint")


class RunFolder(NamedTuple):
    """An open run; the folders of `FOLDERS` are in it."""

    path: Path
    config: dict[str, Any]  # config.json, as plain data


def open_run(
    root: str | Path, config: Any, name: str | None = None, device: str | None = None
) -> RunFolder:
    """Starts a run folder: config.json and environment.json before any work.

    Args:
        root: the folder of runs, made if it is not there.
        config: a dataclass instance with every setting of the run.
        name: of the folder; None makes one of the time and a digest of the config.
        device: what the run computes on, for environment.json.

    Raises:
        FileExistsError: the folder is there already.
        OSError: one line; no folder is left behind (the disk is full, say).
    """
    settings = _plain(config)
    name = name or f"{time.strftime('%Y%m%d-%H%M%S')}-{_digest(settings)}"
    path = Path(root) / name
    try:
        path.mkdir(parents=True)
    except FileExistsError:
        raise FileExistsError(
            f"{path}: exists already; resume it or choose another name"
        ) from None
    except OSError as error:
        raise OSError(f"{path}: cannot be made ({error.strerror})") from error
    try:
        write_json(path / "config.json", settings)
        write_json(path / "environment.json", _environment(device))
        _make_folders(path)
    except OSError:
        shutil.rmtree(path, ignore_errors=True)
        raise
    return RunFolder(path=path, config=settings)


def resume_run(path: str | Path, config: Any = None) -> RunFolder:
    """Opens a run folder to go on with it.

    Args:
        path: the run folder.
        config: the settings asked for now, which must be those of the run; None takes
            those of the run.

    Raises:
        FileNotFoundError: not a run folder; the line lists the runs beside it.
        ValueError: one line with the first setting that differs.
    """
    path = Path(path)
    if not (path / "config.json").is_file():
        raise FileNotFoundError(
            f"{path}: not a run folder, it has no config.json; {_listed(path.parent)}"
        )
    settings = _read_json(path / "config.json")
    if config is not None:
        _check_same(settings, _plain(config), path)
    _make_folders(path)
    return RunFolder(path=path, config=settings)


def latest_run(root: str | Path) -> Path:
    """Finds the run that was started last.

    Raises:
        FileNotFoundError: there is no run in `root`.
    """
    runs = _runs(Path(root))
    if not runs:
        raise FileNotFoundError(f"{root}: no run here; start one with: gatjax run")
    environments = [_read_json(run / "environment.json") for run in runs]
    started = [str(environment.get("started")) for environment in environments]
    return runs[started.index(max(started))]


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
    for parameter, value in zip(PARAMETERS, values, strict=True):
        _check_bounds(parameter, value, path)
    parameters = {
        parameter.name: {"value": float(value), "unit": parameter.unit}
        for parameter, value in zip(PARAMETERS, values, strict=True)
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
        there = ", ".join(names) if names else "no policies"
        raise FileNotFoundError(f"{path}: no such policy; {path.parent} has {there}")
    policy = _read_json(path)
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


def add_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Adds rows to a table of `TABLES`; the file name says which.

    A row whose key is there already fills in that row, so a generation that is run
    again after a kill, or evaluated on the robot later, does not stand there twice.
    Columns that a row leaves out stay empty.

    Raises:
        ValueError: one line: unknown table or column, a key that is not complete, or
            one that comes twice.
        OSError: one line; nothing was changed.
    """
    table = _table(path)
    columns = table.key + table.values
    merged = {
        tuple(row[column] for column in table.key): row
        for row in (read_table(path) if path.is_file() else [])
    }
    seen = set()
    for row in rows:
        unknown = [column for column in row if column not in columns]
        if unknown:
            raise ValueError(
                f"{path}: unknown column {', '.join(unknown)}; it has "
                f"{', '.join(columns)}"
            )
        typed = {c: _value(_cell(v), c, f"{path}") for c, v in row.items()}
        key = tuple(typed.get(column) for column in table.key)
        if None in key:
            raise ValueError(f"{path}: a row needs {', '.join(table.key)}; got {row}")
        if key in seen:
            raise ValueError(f"{path}: two rows for {', '.join(map(str, key))}")
        seen.add(key)
        merged[key] = {**merged.get(key, dict.fromkeys(columns)), **typed}
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in merged.values():
        writer.writerow([_cell(row[column]) for column in columns])
    write_whole({path: text.getvalue().encode()})


def read_table(path: str | Path) -> list[dict[str, Any]]:
    """Reads a table of `TABLES`: text, int or float, None where a cell is empty.

    A last line without its end is a truncated one and is left out.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: one line with the row (from 1, without header) and column.
    """
    path = Path(path)
    table = _table(path)
    columns = list(table.key + table.values)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such table; the run has not got that far")
    text = path.read_text(encoding="utf-8")
    lines = list(csv.reader(text[: text.rfind("\n") + 1].splitlines()))
    if lines and lines[0] != columns:
        raise ValueError(f"{path}: the header is not {','.join(columns)}")
    rows = []
    for number, cells in enumerate(lines[1:], start=1):
        where = f"{path}: row {number}"
        if len(cells) != len(columns):
            raise ValueError(f"{where} has {len(cells)} cells, not {len(columns)}")
        named = zip(columns, cells, strict=True)
        rows.append({column: _value(cell, column, where) for column, cell in named})
    return rows


def write_json(path: Path, tree: Mapping[str, Any]) -> None:
    """Writes a json file, whole or not at all.

    Raises:
        OSError: one line; nothing was changed.
    """
    write_whole({path: (json.dumps(tree, indent=2, default=_as_json) + "\n").encode()})


def write_whole(files: Mapping[Path, bytes]) -> None:
    """Writes files beside their places and then renames them: all or none.

    Raises:
        OSError: one line; nothing was changed.
    """
    halves = {path.with_name(f".{path.name}.{os.getpid()}"): path for path in files}
    target = next(iter(files))
    try:
        for half, target in halves.items():
            with open(half, "wb") as file:
                file.write(files[target])
                file.flush()
                os.fsync(file.fileno())
        for half, target in halves.items():
            os.replace(half, target)
    except OSError as error:
        raise OSError(
            f"{target}: cannot be written ({error.strerror}); nothing was changed, "
            f"free some space or choose another folder"
        ) from error
    finally:
        for half in halves:
            half.unlink(missing_ok=True)


def _plain(config: Any) -> dict[str, Any]:
    """A dataclass as the plain data that config.json gives back."""
    return json.loads(json.dumps(dataclasses.asdict(config), default=_as_json))


def _as_json(value: Any) -> Any:
    """What json does not know: paths, numpy numbers and arrays."""
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{value!r} is a {type(value).__name__}, which json can not hold")


def _digest(settings: Mapping[str, Any]) -> str:
    """Eight characters that change with any setting."""
    text = json.dumps(settings, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def _make_folders(path: Path) -> None:
    """Makes the subfolders of a run."""
    for folder in FOLDERS:
        (path / folder).mkdir(exist_ok=True)


def _environment(device: str | None) -> dict[str, Any]:
    """What the run ran with and on; reads installed metadata, imports nothing."""
    return {
        "started": datetime.now(UTC).isoformat(timespec="microseconds"),
        "python": platform.python_version(),
        "packages": {package: _version(package) for package in PACKAGES},
        "platform": platform.platform(),
        "cpu_count": os.cpu_count(),
        "device": device,
        "commit": _git("rev-parse", "HEAD"),
        "changed_since_commit": bool(_git("status", "--porcelain", "--", ".")),
    }


def _version(package: str) -> str | None:
    """Installed version of a package, None if it is not installed."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _git(*arguments: str) -> str | None:
    """What git says of gatjax's source; None where it is not a git checkout."""
    source = Path(__file__).parent
    try:
        for command in (("ls-files", "--error-unmatch", __file__), arguments):
            line = ["git", "-C", str(source), *command]
            answer = subprocess.run(line, capture_output=True, text=True, timeout=10)
            if answer.returncode:
                return None
    except (OSError, subprocess.TimeoutExpired):
        return None
    return answer.stdout.strip()


def _runs(root: Path) -> list[Path]:
    """The run folders in a folder, by name."""
    return sorted(
        path.parent
        for path in root.glob("*/config.json")
        if (path.parent / "environment.json").is_file()
    )


def _listed(root: Path) -> str:
    """The runs in a folder, for a message."""
    names = [run.name for run in _runs(root)]
    return f"runs in {root}: {', '.join(names) if names else 'none'}"


def _check_same(old: Any, new: Any, path: Path, field: str = "") -> None:
    """Refuses two configs that differ, with the first field that does."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in [*new, *(key for key in old if key not in new)]:
            name = f"{field}.{key}" if field else key
            _check_same(old.get(key), new.get(key), path, name)
    elif old != new:
        raise ValueError(
            f"{path}: started with {field} = {old!r}, now it is {new!r}; resume with "
            f"the same settings or start a new run"
        )


def _read_json(path: Path) -> dict[str, Any]:
    """A json file that holds an object."""
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: not JSON: {error}") from error
    if not isinstance(tree, dict):
        raise ValueError(f"{path}: expected {{key: value}}")
    return tree


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
    if isinstance(value, bool) or not isinstance(value, int | float):
        form = f'{{"value": number, "unit": "{unit}"}}'
        raise ValueError(f"{path}: parameter {name} must be {form}")
    given = entry.get("unit")
    if given != unit:
        raise ValueError(f"{path}: unit of {name} is {given!r}; it must be {unit!r}")
    _check_bounds(parameter, float(value), path)
    return float(value)


def _table(path: Path) -> Table:
    """The table that a file name stands for."""
    if path.name not in TABLES:
        raise ValueError(f"{path}: not a table of a run; those are {', '.join(TABLES)}")
    return TABLES[path.name]


def _cell(value: Any) -> str:
    """A value as text; numbers at full precision."""
    if value is None:
        return ""
    return str(value.item() if hasattr(value, "item") else value)


def _value(cell: str, column: str, where: str) -> Any:
    """The text of a cell as what the column holds."""
    if cell == "":
        return None
    if column in TEXT_COLUMNS:
        if not cell.isprintable():
            raise ValueError(f"{where}, column {column!r}: {cell!r} is not one line")
        return cell
    for kind in (int, float):
        try:
            return kind(cell)
        except ValueError:
            continue
    raise ValueError(f"{where}, column {column!r}: {cell!r} is not a number")
