"""The best policies of a generation walk again, in worlds that nobody can rule out.

The best of a few rollouts is a lucky one, and suits its simulator to the last gram. In
worlds whose bodies and grip differ by what nobody knows of a robot, those that will
fall on it fall already (experiments/table1/doubted.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import jax
import numpy as np

from gatjax.diagnosis.loads import perturbed
from gatjax.diagnosis.tolerances import USUAL
from gatjax.loop.candidates import Job
from gatjax.ranking import policy_costs
from gatjax.records import Array
from gatjax.search import GenerationInfo
from gatjax.sim.backend import pairs, prepare
from gatjax.sim.world import Values, World, fields_applied

FIRST, AGAIN = 5, 20  # policies of a generation that are rechecked, rollouts of each
WORLDS = 4  # in which they walk; they share the rollouts
BODIES = USUAL._replace(mass=0.05, com=0.005)
"""Twice what a diagnosis takes for usual: 5 % of each mass, 5 mm."""
GRIP = (0.6, 1.2)  # of the simulator's friction with the floor
STREAM = 10**6  # random keys above all that `verify` splits the same one into

Recheck = Callable[[int, GenerationInfo], Array]
"""(number of the generation, its policies and costs) -> a policy [15]."""


def rechecks(kinds: Sequence[str]) -> int:
    """Rollouts of a generation besides those of its search."""
    return (FIRST + 1) * AGAIN if "rechecked" in kinds else 0


def rechecking(job: Job) -> Recheck:
    """Return what finds the policy of a generation that costs least in worlds in doubt.

    The FIRST best and the mean walk AGAIN times more, on the whole model of the world
    that was searched, with random numbers that the search did not have.
    """
    run = prepare(job.world, "native").outcome  # compiled once for all generations

    def rechecked(number: int, info: GenerationInfo) -> Array:
        order = np.argsort(info.costs, kind="stable")[:FIRST]
        policies = np.concatenate([info.policies[order], info.mean_policy[None]])
        own = jax.random.fold_in(job.check_key, STREAM + number)
        walks, bodies = jax.random.split(own)
        drawn = doubted(job.world, WORLDS, int(jax.random.bits(bodies)))
        keys = jax.random.split(walks, (WORLDS, AGAIN // WORLDS))
        found = [
            pairs(run, values, policies, some).cost
            for values, some in zip(drawn, keys, strict=True)
        ]
        costs = policy_costs(np.concatenate(found, axis=1))
        return policies[int(np.argmin(costs))]

    return rechecked


def doubted(world: World, count: int, seed: int) -> list[Values]:
    """Values of a world for so many worlds with other bodies and another grip.

    Each has masses, inertias and centres of mass drawn from `BODIES`, a mounting that
    is tilted as much, and friction with the floor scaled by a factor from `GRIP`.

    Args:
        world: the simulator; the values are for its native backend.
        count: of worlds.
        seed: of what is drawn.
    """
    model, draw = fields_applied(world), np.random.default_rng(seed)
    found = []
    for _ in range(count):
        other = perturbed(model, BODIES, draw)
        fields = {
            "body_mass": other.body_mass,
            "body_inertia": other.body_inertia,
            "body_ipos": other.body_ipos,
            "opt.gravity": np.array(other.opt.gravity),
            "geom_friction": model.geom_friction * [draw.uniform(*GRIP), 1.0, 1.0],
        }
        found.append(world.values._replace(body=world.values.body | fields))
    return found
