"""Worlds that walk: what was learned of a NAO in the air, put on its feet."""

from __future__ import annotations

from gatjax.robot.model import HUNG, check_walker
from gatjax.sim.world import World, add_rows, nominal

MOUNTING = "gravity_tilt"  # of a hung robot: it is left behind where it walks


def lasting(world: World) -> list[dict]:
    """Causes, as rows of world.json, that a robot has wherever it stands or hangs."""
    hung = world.source == HUNG
    return [row for row in world.causes if not (hung and row["cause"] == MOUNTING)]


def walker(world: World) -> World:
    """Return the world of a NAO that walks; one that hangs is put on its feet.

    That gets the nominal physics step: worlds differ by their causes alone.

    Raises:
        ValueError: one line: this robot cannot walk.
    """
    if world.source == HUNG:
        world = add_rows(nominal(world.task), lasting(world))
    check_walker(world.model, str(world.source))
    return world
