"""Cases with answers: made by the generator of hidden effects, or read from files."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pyarrow import parquet

from gatjax.runs import read_json
from gatjax.surrogate.hidden import MIX, ROBOTS, write_cases


class Case(NamedTuple):
    """One case: what a solver gets, and the truth."""

    name: str
    model: Path  # MJCF
    fit: tuple[Path, ...]
    held: tuple[Path, ...]
    joints: tuple[str, ...]  # that the logs hold
    truth: dict[str, Any]  # the entry of answers.json


def make(
    folder: Path, wanted: Mapping[str, Any], progress: Callable[[int, int], None]
) -> None:
    """Make the cases that a folder lacks.

    Args:
        folder: gets models/, cases/, answers.json, and asked.json with what was asked.
        wanted: cases and seed; kinds, robots and causes, empty for all;
            least_visibility that effects aim at.
        progress: called with the number of cases made and of all.

    Raises:
        ValueError: an unknown kind, robot or cause, or the folder has other cases.
    """
    _check_robots(wanted["robots"])
    write_cases(
        folder,
        wanted["cases"],
        wanted["seed"],
        {kind: MIX[kind] for kind in wanted["kinds"] or MIX},
        wanted["robots"] or None,
        wanted["causes"] or None,
        progress,
        wanted["least_visibility"],
    )


def _check_robots(names: Collection[str]) -> None:
    """Refuse robots that the generator lacks."""
    for name in names:
        if name not in ROBOTS:
            known = ", ".join(ROBOTS)
            raise ValueError(f"--robots {name} is unknown; choose from {known}")


def read_cases(
    folder: Path, kinds: Collection[str] = (), robots: Collection[str] = ()
) -> list[Case]:
    """Read the cases of a folder, in the order of answers.json.

    Args:
        folder: holds answers.json, models/ and cases/.
        kinds: to keep; all if empty.
        robots: to keep; all if empty.

    Raises:
        FileNotFoundError: answers.json or a file of a case is not there.
        ValueError: no cases in answers.json, or nothing is left.
    """
    answers = folder / "answers.json"
    if not answers.is_file():
        raise FileNotFoundError(f"{answers}: no such file; --folder needs the answers")
    told = read_json(answers)
    if not isinstance(told, dict) or "cases" not in told:
        raise ValueError(f"{answers}: no list of cases in it; docs/files.md has one")
    entries = told["cases"]
    found = [
        _case(folder, entry)
        for entry in entries
        if (not kinds or entry["kind"] in kinds)
        and (not robots or entry["robot"] in robots)
    ]
    if not found:
        there = sorted({(entry["robot"], entry["kind"]) for entry in entries})
        has = ", ".join(f"{robot} {kind}" for robot, kind in there)
        raise ValueError(f"{folder}: no case of that robot and kind; it has {has}")
    return found


def _case(folder: Path, entry: dict[str, Any]) -> Case:
    """The files of one case."""
    name = entry["id"]
    files = sorted((folder / "cases" / name).glob("*.parquet"))
    fit = tuple(file for file in files if file.name.startswith("fit"))
    if not fit:
        raise FileNotFoundError(f"{folder / 'cases' / name}: no fit*.parquet")
    columns = parquet.read_schema(fit[0]).names
    return Case(
        name=name,
        model=folder / "models" / f"{entry['robot']}.xml",
        fit=fit,
        held=tuple(file for file in files if file.name.startswith("held")),
        joints=tuple(c[8:] for c in columns if c.startswith("command.")),
        truth=entry,
    )
