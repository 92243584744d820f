"""What a policy costs, from what its rollouts cost; also by a race."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from gatjax.records import Array
from gatjax.settings import SearchSettings
from gatjax.xp import namespace_of

DIVERGED_COST = 1e12
"""Cost of a rollout that has none (NaN, infinite); a higher one counts as this one."""

Evaluate = Callable[[Any, Array, Array], Array]
"""(values, policies [N, P], keys [R]) -> costs [N, R]."""

Judge = Callable[[Any, Array, Array], Array]
"""(values, policies [N, P], keys [R]) -> costs [N], all finite."""


def finite(costs: Array) -> Array:
    """Costs of any shape, with `DIVERGED_COST` for what is not finite or above it."""
    xp = namespace_of(costs)  # NumPy's may be beyond 32 bits
    kept = xp.where(xp.isfinite(costs), xp.minimum(costs, DIVERGED_COST), DIVERGED_COST)
    return jnp.asarray(kept)


def policy_costs(costs: Array) -> Array:
    """Mean cost of every policy; a rollout without a finite cost weighs DIVERGED_COST.

    Args:
        costs: [N, R], one a rollout; may hold NaN and infinities.

    Returns:
        [N], all finite.
    """
    return jnp.mean(finite(costs), axis=-1)


def judged(evaluate: Evaluate, settings: SearchSettings) -> Judge:
    """Return what ranks policies: their mean costs, or a race if the settings say so.

    The function raises ValueError where `evaluate` returns another shape than [N, R].
    """

    def mean(values: Any, policies: Array, keys: Array) -> Array:
        costs, wanted = evaluate(values, policies, keys), (len(policies), len(keys))
        if jnp.shape(costs) != wanted:
            raise ValueError(
                f"evaluate returned costs of shape {jnp.shape(costs)}; it must return "
                f"[population, rollouts] = {wanted}"
            )
        return policy_costs(costs)

    return raced(mean, settings.race) if settings.race else mean


def raced(judge: Judge, first: int) -> Judge:
    """Let the worse half of the policies drop out after their first rollouts.

    A race in the sense of Heidrich-Meisner & Igel 2009, "Hoeffding and Bernstein Races
    for Selecting Policies in Evolutionary Direct Policy Search" (ICML), in two fixed
    stages instead of bounds, so that shapes are known: CMA-ES wants to know which half
    is the better one, and its order. All policies meet the same keys, so their order is
    known better than their costs.

    Args:
        judge: (values, policies [N, P], keys [R]) -> mean costs [N].
        first: rollouts of all policies, below R.

    Returns:
        The same function: of the better half (rounded down) the mean over R rollouts,
        of the others that over their first ones, with what the other rollouts changed
        at the median of the better half. So who falls late comes behind who is slow.
    """

    def race(values: Any, policies: Array, keys: Array) -> Array:
        early = judge(values, policies, keys[:first])
        kept = jnp.argsort(early)[: len(policies) // 2]
        chosen = np.asarray(kept) if isinstance(policies, np.ndarray) else kept
        late = judge(values, policies[chosen], keys[first:])
        share = first / len(keys)
        whole = share * early[kept] + (1.0 - share) * late
        others = early + jnp.median(whole - early[kept])
        return others.at[kept].set(whole)

    return race
