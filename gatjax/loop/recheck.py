"""The best policies of a generation walk again in simulation, before a robot walks.

The best of a few rollouts is a lucky one, and what falls in one walk of ten is seldom
seen to.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np

from gatjax.loop.candidates import Job, Recheck, Walk
from gatjax.ranking import policy_costs
from gatjax.records import Array
from gatjax.search import GenerationInfo
from gatjax.sim.backend import pairs

FIRST, AGAIN = 5, 20  # policies of a generation that are rechecked, rollouts of each
STREAM = 10**6  # random keys above all that `verify` splits the same one into


def rechecks(kinds: Sequence[str]) -> int:
    """Rollouts of a generation besides those of its search."""
    return (FIRST + 1) * AGAIN if "rechecked" in kinds else 0


def rechecking(walk: Walk) -> Recheck:
    """Return what finds the policy of a generation that costs least in more walks.

    The FIRST best and the mean walk AGAIN times more, in the whole world that was
    searched, with random numbers that the search did not have.
    """

    def rechecked(job: Job, number: int, info: GenerationInfo) -> Array:
        order = np.argsort(info.costs, kind="stable")[:FIRST]
        policies = np.concatenate([info.policies[order], info.mean_policy[None]])
        key = jax.random.fold_in(job.check_key, STREAM + number)
        keys = jax.random.split(key, AGAIN)
        found = pairs(walk, job.world.values, policies, keys)
        return policies[int(np.argmin(policy_costs(found.cost)))]

    return rechecked
