"""The simulator that a run begins with: the ideal one, or that of a world file."""

from __future__ import annotations

from pathlib import Path

from gatjax.settings import LoopSettings
from gatjax.sim.stored import carried, read_world, write_world
from gatjax.sim.walker import walker
from gatjax.sim.world import World, nominal
from gatjax.task import Task

BEGINNING = "world.json"  # in the run folder


def ungrounded(path: str | Path | None, task: Task) -> World:
    """Load the world that a grounding starts from; the ideal simulator without a path.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: one line: it is no world, has a grounding, or cannot walk.
    """
    if path is None:
        return nominal(task)
    world, folder = read_world(Path(path), task)
    if folder is not None:
        raise ValueError(
            f"{path} has a grounding already ({folder}); ground the world without it"
        )
    return walker(world)


def beginning(folder: Path, settings: LoopSettings, task: Task) -> World:
    """The simulator of a run, which keeps a copy of the world that it was given."""
    if settings.world is None:
        return nominal(task)
    file = folder / BEGINNING
    if not file.exists():
        world = carried(ungrounded(settings.world, task), folder)
        write_world(file, world, {"verb": "run", "world": settings.world}, None)
    return read_world(file, task)[0]
