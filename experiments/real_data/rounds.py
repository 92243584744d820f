"""Diagnose, and again on the simulation that this extended, until nothing is new.

What a round has named is part of the model in the next one, as if it had always been.
A real joint may be wrong in so many ways that no cause explains enough to be named:
then the best one is taken for a guess if it is worth a hundred nats, and said so.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gatjax.cli import main as gatjax
from gatjax.effects.catalogue import CATALOGUE
from gatjax.runs import read_json, write_json

MOST = 5  # rounds
WORTH = 100.0  # nats of a guess


def repeated(start: list[str], given: list[str], out: Path) -> tuple[list[Path], Path]:
    """Diagnose logs until nothing new is found; all rounds' folders, the last world.

    Args:
        start: `--model` or `--world` with its file.
        given: all other arguments.
        out: gets a folder for each round; those that are there stay.
    """
    folders: list[Path] = []
    for number in range(MOST):
        folder = out / f"round_{number}"
        if not (folder / "diagnosis.json").is_file() and (
            code := gatjax(["diagnose", *start, *given, "--out", str(folder)])
        ):
            raise SystemExit(code)
        folders.append(folder)
        start = ["--world", str(_taken(folder))]
        if not found(folder):
            break
    return folders, Path(start[1])


def found(folder: Path) -> list[dict[str, Any]]:
    """What a round named, or else its guess: cause, where, parameters, sure or not."""
    said = read_json(folder / "diagnosis.json")
    rows = [(row, row["probability"]) for row in said["causes"]]
    guesses = (
        row for row in said["candidates"]
        if row["cause"] in CATALOGUE and row["log_evidence"] >= WORTH
        and row["parameters"]  # joints that differ have none in common
    )  # fmt: skip
    best = next(guesses, None)
    if not rows and best is not None and said["verdict"] == "unknown":
        rows = [(best, None)]
    return [
        {"cause": row["cause"], "where": row["where"], "probability": sure,
         "values": {each.name: row["parameters"][each.name]["value"]
                    for each in CATALOGUE[row["cause"]].parameters
                    if each.name in row["parameters"]}}
        for row, sure in rows
    ]  # fmt: skip


def _taken(folder: Path) -> Path:
    """The world of a round with what it found taken for granted; a file beside it."""
    world = read_json(folder / "world.json")
    rows = [row | {"role": "calibration"} for row in world["effects"]]
    rows += [
        {name: row[name] for name in ("cause", "where", "values")}
        | ({"where": ["all"]} if CATALOGUE[row["cause"]].place == "all" else {})
        | {"role": "calibration"}
        for row in found(folder)
        if row["probability"] is None
    ]
    write_json(folder / "model.json", world | {"effects": rows})
    return folder / "model.json"
