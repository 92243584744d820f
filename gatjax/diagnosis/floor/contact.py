"""How soles grip: which of MuJoCo's contact laws the logs of a standing robot follow.

A soft contact lets a loaded sole creep along the floor. How fast depends on the shape
of the friction cone (pyramidal or elliptic) and on `impratio`, its stiffness sideways
over that upwards (MuJoCo manual, Computation, Contact). Model files seldom have either
from a measurement, and a robot on two feet that creep otherwise moves otherwise at
every joint: no cause shows beside that. So the law is chosen before causes are weighed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gatjax.diagnosis.floor import causes, played
from gatjax.diagnosis.floor.observed import Observed, observe, vector, weighed
from gatjax.diagnosis.floor.standing import Standing
from gatjax.sim.contact import Law, law_of
from gatjax.sim.world import World, with_contact

RATIOS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)  # `impratio` of elliptic cones
FINER = (2.0**0.5, 2.0**0.25)  # factors by which the best of them is looked for again
NEAR = 1.2  # the same that is a tolerance
SURE = 10.0  # nats by which another law has to be better than the model's
FLOORS = {"ground_friction": slice(1, None, 2), "ground_compliance": slice(2, None, 2)}
"""Causes that each law is tried with, too: a floor of ice looks like another law."""


def best(standing: Standing, tell: Callable[[str, float], None]) -> Law:
    """The law that meets the logs best; the model's own, unless another surely does.

    Args:
        standing: the robot, simulated with its model's law.
        tell: is called with a stage and the share of it that is done.
    """
    seen, own = observe(standing), law_of(standing.model)
    others = [Law("pyramidal", 1.0), *(Law("elliptic", ratio) for ratio in RATIOS)]
    laws = [own, *(law for law in others if law != own)]
    found = {}
    for number, law in enumerate(laws):
        tell("contact", number / (len(laws) + 2 * len(FINER)))
        found[law] = _evidence(standing, seen, law)
    top = max(laws, key=lambda law: found[law])
    if found[top] <= found[own] + SURE:
        return own
    for factor in FINER if top.cone == "elliptic" else ():
        tell("contact", len(found) / (len(laws) + 2 * len(FINER)))
        for ratio in (top.impratio * factor, top.impratio / factor):
            law = Law(top.cone, float(f"{ratio:.3g}"))
            found[law] = _evidence(standing, seen, law)
        top = max(found, key=lambda law: found[law])
    return top


def nearby(world: World) -> World | None:
    """A world whose soles grip a little otherwise; None where the law has no size."""
    cone, ratio = law_of(world.model)
    if cone != "elliptic":
        return None
    return with_contact(world, Law(cone, NEAR * ratio))


def _evidence(standing: Standing, seen: Observed, law: Law) -> float:
    """Of a law, with the floor that suits it best."""
    world = with_contact(standing.ensembles[0].world, law)
    floors = [
        suspect.world(world, x)
        for suspect in causes.suspects(standing.model)
        if suspect.cause in FLOORS
        for x in suspect.nodes[FLOORS[suspect.cause]]
    ]
    values = causes.batch(world, [world, *floors])
    rows = played.replayed(world, standing.runs, values)
    every = vector(standing, seen.names, rows)
    whole = [one for one in every if np.isfinite(one).all()]  # none fell apart
    return max((weighed(seen, one).evidence for one in whole), default=-np.inf)
