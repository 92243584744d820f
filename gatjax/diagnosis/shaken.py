"""A hypothesis fitted without slopes, by CMA-ES: for joints that stick or bounce.

Teeth that bounce across a gap part any two runs after a while: the misfit has so many
valleys that Gauss-Newton ends in the first one. Measured on a quadruped's hip with a
gap of 96 mrad (levels in noises): slopes 4.1, this search 1.7 to 2.3 from any start.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from gatjax import search
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT
from gatjax.diagnosis.joint import Joint
from gatjax.settings import SearchSettings

SETTINGS = SearchSettings(population=48, generations=120, sigma=1.0)
WIDTH = 0.15  # of a coordinate's range: a step of the search


def found(joint: Joint, fit: Fit) -> Fit:
    """The best fit of a hypothesis, from healthy tolerances and what it has of its own.

    Args:
        joint: in question.
        fit: of the hypothesis; the result is as good at least.
    """
    low, high = fits.bounds(fit.hypothesis)
    tolerances = np.arange(len(low)) < COUNT
    mean = np.clip(np.where(tolerances, 0.0, fit.x), low, high)
    step = np.where(tolerances, 1.0, WIDTH * (high - low))
    key = jax.random.key(joint.index)
    state = search.start(search.Space(mean, step, low, high), SETTINGS, key)
    best = fit.cost, fit.x
    for number in range(SETTINGS.generations):
        asked = search.ask(state, jax.random.fold_in(key, number))
        points = [(fit.hypothesis, x) for x in np.asarray(asked.policies, float)]
        left = fits.residuals(joint, points).T
        costs = [
            fits.cost_of(joint, point, residual)
            for point, residual in zip(points, left, strict=True)
        ]
        state, _ = search.tell(state, asked, jnp.asarray(costs))
        least = int(np.argmin(costs))
        best = min(best, (costs[least], points[least][1]), key=lambda one: one[0])
    return fits.start(joint, [(fit.hypothesis, best[1])])[0]
