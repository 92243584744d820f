"""The best value of a cause from simulated channels, and its 90 % interval."""

from __future__ import annotations

import itertools

import numpy as np

from gatjax.diagnosis.floor.observed import Observed, Weighed, weighed

FINE = 12  # values between two simulated ones
BAND = 1.645  # standard deviations of a 90 % interval
DROP = 0.5 * BAND**2  # nats below the best: where that interval ends


def improved(
    seen: Observed, now: Weighed, x: np.ndarray, slopes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """One Gauss-Newton step beside the tolerances.

    Args:
        seen: what was measured.
        now: misfit of the prediction at x.
        x: parameters [P].
        slopes: channels [P, C, B] per unit of each.

    Returns:
        The next x [P] and its covariance [P, P].
    """
    bins = seen.measured.shape[1]
    weight = np.repeat(1.0 / (seen.noise * now.level), bins)
    tolerances = seen.scatter.reshape(len(weight), -1) * weight[:, None]
    own = slopes.reshape(len(slopes), -1).T * weight[:, None]
    normal = tolerances.T @ tolerances + np.eye(tolerances.shape[1])
    apart = own - tolerances @ np.linalg.solve(normal, tolerances.T @ own)
    covariance = np.linalg.pinv(own.T @ apart)
    return x + covariance @ (apart.T @ (now.rest.ravel() * weight)), covariance


def length(x: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
    """90 % interval of the length of a vector."""
    size = float(np.linalg.norm(x))
    way = x / max(size, 1e-9)
    spread = BAND * float(np.sqrt(way @ covariance @ way))
    return max(0.0, size - spread), size + spread


def profile(
    seen: Observed, curve: dict[float, np.ndarray], neutral: float
) -> dict[float, Weighed]:
    """Misfits along a curve of simulated values, with straight lines between them.

    Args:
        seen: what was measured.
        curve: value -> channels [C, B], at least three.
        neutral: the value without the cause, which is no answer.
    """
    places = sorted(curve)
    found = {x: weighed(seen, curve[x]) for x in places}
    top = places.index(max(places, key=lambda x: found[x].evidence))
    near = places[max(top - 1, 0) : top + 2]
    for low, high in itertools.pairwise(near):
        for share in np.linspace(0.0, 1.0, FINE + 1)[1:-1]:
            mixed = (1.0 - share) * curve[low] + share * curve[high]
            found[float(low + share * (high - low))] = weighed(seen, mixed)
    del found[neutral]
    return found


def inside(found: dict[float, Weighed]) -> tuple[float, float]:
    """90 % interval: values whose evidence is near that of the best."""
    top = max(one.evidence for one in found.values())
    kept = [x for x, one in found.items() if one.evidence > top - DROP]
    return min(kept), max(kept)
