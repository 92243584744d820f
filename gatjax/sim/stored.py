"""A world as a file: world.json (docs/files.md)."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from gatjax.robot import model as robot_model
from gatjax.runs import write_json
from gatjax.sim.contact import CONES, Law
from gatjax.sim.world import World, add_rows, nominal, with_contact
from gatjax.task import Task

SCHEMA = "gatjax.world/1"


def write_world(path: Path, world: World, made_by: dict, grounding: str | None) -> None:
    """Write world.json, whole or not at all."""
    source = world.source
    if source not in robot_model.SHIPPED:  # beside the world file: both can move
        there = _straight(robot_model.model_file(source))
        source = os.path.relpath(there, path.parent.resolve())
    text = {
        "schema": SCHEMA,
        "model": source,
        "rate_hz": world.rate_hz,
        "timestep_s": world.model.opt.timestep,
        **({"contact": world.contact._asdict()} if world.contact else {}),
        "effects": list(world.causes),
        "grounding": grounding,
        "made_by": made_by,
    }
    write_json(path, text)


def carried(world: World, folder: Path) -> World:
    """A world whose model lies in a folder, with all files that it needs.

    Meshes and included files keep their places to each other. A shipped model, one that
    lies in the folder already, and one whose copy cannot be loaded stay where they are.

    Args:
        world: to be written there.
        folder: that can be moved then; it gets `model_<digest>/`.
    """
    if world.source in robot_model.SHIPPED:
        return world
    source = robot_model.model_file(world.source)
    if source.resolve().is_relative_to(folder.resolve()):
        return world
    name, files = model_files(source)
    place = folder / f"model_{model_digest(source)[:8]}"
    for part, file in files.items():
        (place / part).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, place / part)
    try:
        robot_model.load(place / name)
    except ValueError:  # paths that lead through folders without a file of it
        shutil.rmtree(place)
        return world
    return replace(world, source=str(place / name))


def _straight(file: Path) -> Path:
    """A file's path without links on the way to it, which lead to other parents."""
    return file.parent.resolve() / file.name


def model_files(source: Path) -> tuple[str, dict[str, Path]]:
    """A model file's name among all files that it needs, by their places to each other.

    Included models, meshes and pictures lie where they do, below one folder.
    """
    source = _straight(source)
    files = {*mujoco.mju_getXMLDependencies(str(source)), str(source)}
    files = sorted(file for file in files if os.path.isfile(file))  # some may not count
    base = os.path.commonpath([os.path.dirname(file) for file in files])
    near = {Path(os.path.relpath(file, base)).as_posix(): Path(file) for file in files}
    return source.relative_to(base).as_posix(), near


def model_digest(source: Path) -> str:
    """SHA-256 of a model file and all that it includes."""
    digest = hashlib.sha256()
    for file in model_files(source)[1].values():
        digest.update(file.read_bytes())
    return digest.hexdigest()


def read_world(path: Path, task: Task = Task()) -> tuple[World, Path | None]:
    """Load world.json (a folder means the one in it) and name its grounding folder.

    Raises:
        FileNotFoundError: the file or its model does not exist.
        ValueError: one line that says what is wrong in the file.
    """
    path = world_file(path)
    text = _world_text(path)
    source = text["model"]
    if source not in robot_model.SHIPPED:
        source = path.parent.resolve() / source  # `..` goes up from where links lead
    world = nominal(task, source, text.get("timestep_s"))
    if text.get("contact"):
        world = with_contact(world, _contact(text["contact"], path))
    for number, row in enumerate(text["effects"], start=1):
        where = f"{path}: effect {number}"
        _check_row(row, where)
        try:
            world = add_rows(world, [row])
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
    wanted["contact"] = dict | None
    for key, kind in wanted.items():
        if not isinstance(text.get(key), kind) or text.get(key) is True:
            raise ValueError(f"{path}: {key} is {text[key]!r}; see docs/files.md")
    for key in ("rate_hz", "timestep_s"):
        if text.get(key) is not None and not 0.0 < text[key] < np.inf:
            raise ValueError(f"{path}: {key} is {text[key]}; it is a number > 0")
    return text


def _contact(told: dict[str, Any], path: Path) -> Law:
    """The law of contacts that a world file names."""
    match told:
        case {"cone": str(cone), "impratio": int(ratio) | float(ratio)} if (
            len(told) == 2 and cone in CONES and 0.0 < ratio < np.inf
        ):
            return Law(cone, float(ratio))
    raise ValueError(
        f"{path}: contact is {told}; it has a cone ({' or '.join(CONES)}) and an "
        f"impratio > 0"
    )


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
