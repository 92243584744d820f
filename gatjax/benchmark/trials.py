"""One trial of an experiment: a run of the loop that can go on, also with more methods.

What defines the numbers of a method (sizes, seeds, robot) may not change in a folder;
which methods are compared may, since none depends on another.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from gatjax import loop, runs
from gatjax.loop import Robot
from gatjax.loop.explain import EXPLAINED
from gatjax.report import build_report
from gatjax.settings import LoopSettings

Shown = Callable[[float], AbstractContextManager[runs.Progress]]
"""Units of work -> progress to be told of them."""


def with_methods(settings: LoopSettings, names: list[str]) -> LoopSettings:
    """Return settings that compare methods by name, also `explained`."""
    methods = tuple(name for name in names if name != EXPLAINED)
    return dataclasses.replace(settings, methods=methods, explain=EXPLAINED in names)


def opened(out: Path, name: str, settings: LoopSettings) -> Path:
    """Open the run folder of a trial, new or again; its config names all methods.

    Raises:
        ValueError: one line with the first setting that differs from before.
    """
    if not (out / name / "config.json").exists():
        return runs.open_run(out, settings, name).path
    before = runs.read_json(out / name / "config.json")
    runs.resume_run(out / name, settings, loop.COMPARED)
    known = dict.fromkeys((*before["methods"], *settings.methods))
    explain = before["explain"] or settings.explain
    whole = dataclasses.replace(settings, methods=tuple(known), explain=explain)
    runs.write_json(out / name / "config.json", dataclasses.asdict(whole))
    return out / name


def run_trials(
    out: Path, settings: Sequence[LoopSettings], robot: Robot, shown: Shown
) -> list[Path]:
    """Run trials side by side, or go on with them.

    Args:
        out: folder of the trials.
        settings: of each trial; their seeds alone differ.
        robot: that settings name.
        shown: shows progress.

    Returns:
        Their run folders `out/ROBOT_SEED`, each with a report.
    """
    settings = [loop.resolved(one) for one in settings]
    folders = [opened(out, f"{one.robot}_{one.seed}", one) for one in settings]
    with shown(sum(map(loop.total_work, settings))) as progress:
        loop.run_all(folders, settings, robot, progress)
    for folder in folders:
        build_report(folder)
    return folders
