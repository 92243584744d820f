"""The best policies of a generation walk again, in worlds that nobody can rule out.

The best of a few rollouts is a lucky one, and suits its simulator to the last gram. In
worlds whose bodies and grip differ by what nobody knows of a robot, those that will
fall on it fall already (experiments/table1/doubted.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import mujoco
import numpy as np
from mujoco import batch

from gatjax.diagnosis.loads import copied, perturbed
from gatjax.diagnosis.tolerances import USUAL
from gatjax.loop.candidates import Job
from gatjax.ranking import policy_costs
from gatjax.records import Array
from gatjax.search import GenerationInfo
from gatjax.sim.backend import pairs
from gatjax.sim.native import Native
from gatjax.sim.world import World

FIRST, AGAIN = 5, 20  # policies of a generation that are rechecked, rollouts of each
BODIES = USUAL._replace(mass=0.05, com=0.005)
"""Of each mass 5 %, centres of mass 5 mm; a diagnosis takes 2.5 % and 2 mm for usual.
Inertias and mounting are as uncertain as there (5 %, 0.2 deg)."""
GRIP = (0.6, 1.2)  # of the simulator's friction with the floor
STREAM = 10**6  # random keys above all that `verify` splits the same one into

Recheck = Callable[[int, GenerationInfo], Array]
"""(number of the generation, its policies and costs) -> a policy [15]."""


def rechecks(kinds: Sequence[str]) -> int:
    """Rollouts of a generation besides those of its search."""
    return (FIRST + 1) * AGAIN if "rechecked" in kinds else 0


def rechecking(job: Job) -> Recheck:
    """Return what finds the policy of a generation that costs least in worlds in doubt.

    The FIRST best and the mean walk AGAIN times more, each time in another world, on
    the whole model, with random numbers that the search did not have. All generations
    meet the same worlds.
    """
    seed = int(jax.random.bits(jax.random.fold_in(job.check_key, STREAM - 1)))
    native = in_doubt(job.world, AGAIN, seed)  # compiled once for all generations

    def rechecked(number: int, info: GenerationInfo) -> Array:
        order = np.argsort(info.costs, kind="stable")[:FIRST]
        policies = np.concatenate([info.policies[order], info.mean_policy[None]])
        key = jax.random.fold_in(job.check_key, STREAM + number)
        keys = jax.random.split(key, AGAIN)
        found = pairs(native.outcome, job.world.values, policies, keys)
        return policies[int(np.argmin(policy_costs(found.cost)))]

    return rechecked


def in_doubt(world: World, count: int, seed: int) -> Native:
    """The runs of a world whose robots differ: the k-th is in world k % `count`.

    What gears and speed limits know of the masses behind them stays as it was.

    Args:
        world: the simulator.
        count: of worlds with other bodies and another grip.
        seed: of what they are drawn with.
    """

    def engine(model: mujoco.MjModel, nsim: int) -> Any:
        physics = batch.Batch(copied(model), nsim)
        for name, rows in doubted(model, count, seed).items():
            physics.expand(name)[:] = rows[np.arange(nsim) % count]
        physics.set_const()
        return physics

    return Native(world, engine, shares=lambda robots: 1)  # so rows keep their places


def doubted(model: mujoco.MjModel, count: int, seed: int) -> dict[str, np.ndarray]:
    """Fields of a model [count, ...] in so many worlds that nobody can rule out.

    Each has masses, inertias, centres of mass and a mounting drawn from `BODIES`, and
    friction of all that touches scaled by a factor from `GRIP`.

    Args:
        model: with what causes make of it.
        count: of worlds.
        seed: of what is drawn.
    """
    draw, names = np.random.default_rng(seed), ("body_mass", "body_inertia")
    found: dict[str, list[np.ndarray]] = {}
    for _ in range(count):
        other = perturbed(model, BODIES, draw)
        fields = {name: getattr(other, name) for name in (*names, "body_ipos")}
        fields["opt.gravity"] = other.opt.gravity
        fields["geom_friction"] = model.geom_friction * [draw.uniform(*GRIP), 1.0, 1.0]
        for name, value in fields.items():
            found.setdefault(name, []).append(np.array(value))
    return {name: np.stack(rows) for name, rows in found.items()}
