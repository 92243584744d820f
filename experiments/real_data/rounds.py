"""Diagnose, and again on the simulation that this extended, until nothing is new."""

from __future__ import annotations

from pathlib import Path

from gatjax.cli import main as gatjax
from gatjax.runs import read_json

MOST = 4  # rounds


def repeated(start: list[str], given: list[str], out: Path) -> list[Path]:
    """Diagnose logs until nothing new is named; the folders of all rounds.

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
        if not read_json(folder / "diagnosis.json")["causes"]:
            break
        start = ["--world", str(folder / "world.json")]
    return folders
