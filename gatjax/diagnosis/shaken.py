"""A hypothesis fitted without slopes, by CMA-ES: for joints that stick or bounce.

Teeth that bounce across a gap part any two runs after a while: the misfit has so many
valleys that Gauss-Newton ends in the first one. Measured on a quadruped's hip with a
gap of 96 mrad (levels in noises): slopes 4.1, this search 1.7 to 2.3 from any start.
"""

from __future__ import annotations

import jax
import numpy as np

from gatjax import search
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT
from gatjax.diagnosis.joint import Joint
from gatjax.settings import SearchSettings

SETTINGS = SearchSettings(population=48, rollouts=1, generations=120, sigma=1.0)
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
    space = search.Space(mean, step, low, high)
    best = fit.cost, fit.x

    def costs(_values: None, policies: np.ndarray, _keys: jax.Array) -> np.ndarray:
        nonlocal best
        points = [(fit.hypothesis, x) for x in policies.astype(float)]
        left = fits.residuals(joint, points).T
        out = [
            fits.cost_of(joint, point, residual)
            for point, residual in zip(points, left, strict=True)
        ]
        least = int(np.argmin(out))
        best = min(best, (out[least], points[least][1]), key=lambda one: one[0])
        return np.array(out)[:, None]

    generation = search.host_generation(space, SETTINGS, costs)
    state = search.start(space, SETTINGS, jax.random.key(joint.index))
    for number in range(SETTINGS.generations):
        state, _ = generation(state, None, number)
    return fits.start(joint, [(fit.hypothesis, best[1])])[0]
