"""Which hypotheses explain a joint: scan the whole bank, refine the promising ones."""

from __future__ import annotations

from collections import Counter

import numpy as np

from gatjax.diagnosis import fit as fits
from gatjax.diagnosis import shaken
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis, combined, information
from gatjax.diagnosis.joint import Joint

STARTS = 2  # of each hypothesis that are refined
KEPT = (40, 12, 6, 4)  # hypotheses after each round
ROUNDS = (1, 2, 3, 5)  # iterations in each round
PROPOSED = ((60, 3, 1), (24, 2, 2), (12, 1, 3))  # fits, a law, and iterations, a round
RIVALS = 8  # fits that are returned; those that were dropped are not at their best
ANEW = 4  # iterations of a fit that begins anew
SURE, BEHIND = 2, 40.0  # iterations until fits so many nats behind are dropped
TWINS = 2  # fits of a law that are followed, from different starts
PROMISING = 2.0  # nats: less is nothing
SHAKEN = 2  # of the best fits, which are searched for anew if they are rough
FEW = 20  # starts at most of a cause that tolerances may imitate
ROUGH = 1.6  # times the noise: a fit that leaves more may be in a bad place
ZOOMS, RUNGS = 3, 31  # rounds of zooming in, and points of each
CLOSER = 0.1  # of what the best start explains, that one has to for a closer look
LARGER = (0.0, 0.35, 0.7, 1.05)  # of a cause that begins anew: logarithms, or shares
CALM, SPARE = 1.35, 10.0  # times the noise; squared deviations of all tolerances


def healthy(joint: Joint, x: np.ndarray | None = None) -> Fit:
    """The joint with its tolerances only, fitted from coordinates x [COUNT]."""
    start = np.zeros(COUNT) if x is None else x
    first = fits.start(joint, [(None, start)])
    return fits.improve(joint, first, 12 if x is None else 6)[0]


def scan(joint: Joint, base: Fit, bank: tuple[Hypothesis, ...]) -> list[Fit]:
    """Best starts of every hypothesis added to a fit, the rest adjusted or not.

    Sine laws start as pairs of equal rate, whose two amplitudes are solved for.
    """
    base = fits.linearised(joint, [base])[0]
    owners = [combined(base.hypothesis, h) for h in bank]
    begins = [np.array(h.begins(joint, base.residual)) for h in bank]
    points = [
        (owner, np.append(base.x, s))
        for owner, some in zip(owners, begins, strict=True)
        for s in some
    ]
    found = fits.residuals(joint, points)
    options, first = [], 0
    for owner, hypothesis, starts in zip(owners, bank, begins, strict=True):
        shifts = found[:, first : first + len(starts)] - base.residual[:, None]
        first += len(starts)
        if _is_sine(hypothesis):
            starts, shifts = _solved(joint, base, starts, shifts)
        tries = [
            (*_adjusted(joint, base, shift), own)
            for own, shift in zip(starts, shifts.T, strict=True)
        ]
        tries.sort(key=lambda option: option[0])
        options += [(owner, np.append(x, own)) for _, x, own in tries[:STARTS]]
        plain = np.square(base.residual[:, None] + shifts).sum(0)
        options.append((owner, np.append(base.x, starts[int(np.argmin(plain))])))
        if hypothesis.linear:
            options.append((owner, _straight(joint, base, hypothesis, shifts)))
        relieved = hypothesis.relieved(joint, base.x)
        options += [] if relieved is None else [(owner, relieved)]
    found = _zoomed(joint, base, fits.start(joint, options))
    return [_lent(fit, base) for fit in found]


def _zoomed(joint: Joint, base: Fit, found: list[Fit]) -> list[Fit]:
    """Starts of laws with steps, each at the best point up to its neighbours.

    Only where it explains something to begin with, beside the best of all.
    """
    least = min((fit.cost for fit in found), default=base.cost)
    worth = base.cost - CLOSER * max(base.cost - least, 0.0)
    widths = {
        k: f.hypothesis.newest.rung for k, f in enumerate(found)
        if f.hypothesis and f.hypothesis.newest.rung and f.cost < worth
    }  # fmt: skip
    out = list(found)
    for _ in range(ZOOMS if widths else 0):
        points = [
            (out[k].hypothesis, np.append(out[k].x[:-1], own))
            for k, width in widths.items()
            for own in out[k].x[-1] + width * np.linspace(-1.0, 1.0, RUNGS)
        ]
        tries = fits.start(joint, points)
        for row, k in enumerate(widths):
            mine = tries[row * RUNGS : (row + 1) * RUNGS]
            out[k] = min([out[k], *mine], key=lambda one: one.cost)
            widths[k] *= 4.0 / (RUNGS - 1)
    return out


def _lent(fit: Fit, base: Fit) -> Fit:
    """A start with the slopes that tolerances have without its cause."""
    slopes = np.zeros_like(fit.slopes)
    slopes[:, :COUNT] = base.slopes[:, :COUNT]
    return fit._replace(slopes=slopes, age=1)


def _is_sine(hypothesis: Hypothesis) -> bool:
    """Whether the starts are pairs of amplitudes with one rate."""
    starts = hypothesis.starts
    return len(starts) > 8 and len(starts[0]) == 3 and starts[0][2] == starts[1][2]


def _adjusted(joint: Joint, base: Fit, shift: np.ndarray) -> tuple[float, np.ndarray]:
    """Cost and coordinates of a fit after a change of its residual, to first order."""
    scale = fits.spread(joint)
    residual = base.residual + shift
    gradient = base.slopes.T @ residual / scale**2
    prior = information(base.hypothesis)
    gradient += prior * base.x
    low, high = fits.bounds(base.hypothesis)
    x = np.clip(base.x - np.linalg.solve(base.information, gradient), low, high)
    residual = residual + base.slopes @ (x - base.x)
    return float(residual @ residual / scale**2 + prior @ np.square(x)), x


def _solved(
    joint: Joint, base: Fit, starts: np.ndarray, shifts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """One start for each pair: the amplitudes that explain most beside the rest."""
    scale = fits.spread(joint)
    solved, moved = [], []
    for k in range(0, len(starts), 2):
        responses = shifts[:, k : k + 2] / scale
        weights = _sizes(joint, base, responses, np.full(2, fits.FAINT))
        amplitudes = np.clip(weights @ starts[k : k + 2, :2], -0.9, 0.9)
        solved.append(np.append(amplitudes, starts[k, 2]))
        moved.append(shifts[:, k : k + 2] @ weights)
    return np.array(solved), np.stack(moved, -1)


def _sizes(
    joint: Joint, base: Fit, responses: np.ndarray, prior: np.ndarray
) -> np.ndarray:
    """Sizes [k] of changes that explain most beside the rest, to first order.

    Args:
        joint: in question.
        base: what is known, linearised.
        responses: [n, k] of the residual over its spread, per unit.
        prior: information [k] on the sizes, around 0.
    """
    scale = fits.spread(joint)
    slopes, target = base.slopes / scale, base.residual / scale
    pull = slopes.T @ target + information(base.hypothesis) * base.x
    left = target - slopes @ np.linalg.solve(base.information, pull)
    apart = responses - slopes @ np.linalg.solve(base.information, slopes.T @ responses)
    return -np.linalg.solve(responses.T @ apart + np.diag(prior), responses.T @ left)


def _straight(
    joint: Joint, base: Fit, hypothesis: Hypothesis, shifts: np.ndarray
) -> np.ndarray:
    """Where a law that is linear around 0 explains most, to first order.

    The starts that a bank names may be so far off that nothing comes of them.

    Args:
        joint: in question.
        base: what is known, linearised.
        hypothesis: the law; one start at least lies on each of its axes.
        shifts: [n, starts] of the residual at its starts, rad.
    """
    scale, count = fits.spread(joint), len(hypothesis.low)
    starts = np.array(hypothesis.starts)
    alone = (starts != 0.0).sum(1) == 1
    far = np.where(alone[:, None] & (starts != 0.0), np.abs(starts), np.inf)
    nearest = far.argmin(0)  # start on each axis
    responses = shifts[:, nearest] / starts[nearest, np.arange(count)] / scale
    own = _sizes(joint, base, responses, hypothesis.weights() + fits.FAINT)
    own = np.clip(own, hypothesis.low, hypothesis.high)
    return np.append(_adjusted(joint, base, scale * responses @ own)[1], own)


def explain(joint: Joint, base: Fit, bank: tuple[Hypothesis, ...]) -> list[Fit]:
    """Fits of the bank's best hypotheses, best first, one per cause and variant."""
    found, calm = _started(joint, base, bank)
    if calm:
        return _best(found, KEPT[-1])
    known = fits.evidence(joint, base)
    dropped: list[Fit] = []
    for kept, rounds in zip(KEPT, ROUNDS, strict=True):
        every = _best(found, len(found))
        dropped += every[kept:]
        laws = {fit.law for fit in every[:kept]}
        found = [fit for fit in found if fit.law in laws]
        found = fits.improve(joint, _best(found, len(found), TWINS), rounds)
        if rounds < SURE:
            continue
        if rounds == SURE:
            found += _relaxed(joint, found)
        gains = [fits.evidence(joint, fit) - known for fit in found]
        least = max(gains) - max(BEHIND, 0.6 * max(gains))
        near = [gain > least for gain in gains]
        dropped += [f for f, kept_on in zip(found, near, strict=True) if not kept_on]
        found = [f for f, kept_on in zip(found, near, strict=True) if kept_on]
    found = _shaken(joint, _best(found, len(found)), dropped)
    return _best(found + dropped, RIVALS)


def proposals(joint: Joint, base: Fit, bank: tuple[Hypothesis, ...]) -> list[Fit]:
    """Fits of promising hypotheses, best first, not at their best yet.

    A start that changes little looks best at first and may lead nowhere: laws keep
    several for some iterations.
    """
    found, calm = _started(joint, base, bank)
    if calm:
        return _best(found, KEPT[-1])
    for kept, each, rounds in PROPOSED:
        if each == 1:
            found += _relaxed(joint, _best(found, kept))
        found = fits.improve(joint, _best(found, kept, each), rounds)
    return _best(found, RIVALS)


def _started(
    joint: Joint, base: Fit, bank: tuple[Hypothesis, ...]
) -> tuple[list[Fit], bool]:
    """Starts beside a fit, and whether none of them needs a closer look.

    If one does, there are starts beside the nominal model, too: tolerances that imitate
    a cause are a bad place to look for it.
    """
    found, known = scan(joint, base, bank), fits.evidence(joint, base)
    if _unsuspicious(joint, base, [fits.evidence(joint, f) - known for f in found]):
        return found, True
    fresh = fits.start(joint, [(base.hypothesis, fits.unspent(base.x))])[0]
    few = tuple(h for h in bank if len(h.starts) < FEW)
    return found + scan(joint, fresh, few), False


def _relaxed(joint: Joint, found: list[Fit]) -> list[Fit]:
    """Fits with improbable tolerances, begun anew with nominal ones and their cause.

    Tolerances that imitated a cause, at their bounds, hold its coordinates back: it
    begins as it is, or larger, whatever misses least.
    """
    strained = [fit for fit in found if fit.spent > SPARE]
    tries = fits.start(joint, [point for fit in strained for point in _larger(fit)])
    each = 2 * len(LARGER)
    begun = [
        min(tries[k : k + each], key=lambda one: one.cost)
        for k in range(0, len(tries), each)
    ]
    return fits.improve(joint, begun, ANEW)


def _larger(fit: Fit) -> list[fits.Point]:
    """A fit with nominal tolerances, its newest cause as large as it is or larger."""
    own, begin = fit.newest, fits.unspent(fit.x)
    place = len(begin) - len(own.low)
    sizes = [begin[place] + more for more in LARGER]
    sizes += [begin[place] * (1.0 + more) for more in LARGER]
    points = []
    for size in sizes:
        x = begin.copy()
        x[place] = np.clip(size, own.low[0], own.high[0])
        points.append((fit.hypothesis, x))
    return points


def _shaken(joint: Joint, found: list[Fit], dropped: list[Fit]) -> list[Fit]:
    """Rough fits, searched for anew where stick, slip and bounces defeat gradients.

    Where even the best one is rough, all those with a gear are; if it has one, gears
    that slopes dropped as well: of teeth that bounce these tell little.
    """
    rough = [fit.rms() > ROUGH * joint.noise for fit in found]
    again = [
        fit for n, fit in enumerate(found)
        if rough[n] and (n < SHAKEN or (rough[0] and fit.geared))
    ]  # fmt: skip
    if rough[0] and found[0].geared:
        every = _best(found + dropped, len(found + dropped))
        known = {id(fit) for fit in found}
        again += [
            fit for fit in every
            if id(fit) not in known and fit.hypothesis and fit.hypothesis.newest.geared
        ]  # fmt: skip
    better = [shaken.found(joint, fit) for fit in again]
    return found + fits.improve(joint, better, 4)


def _unsuspicious(joint: Joint, base: Fit, gains: list[float]) -> bool:
    """Whether a joint fits its tolerances so well that no cause needs a closer look."""
    calm = base.rms() < CALM * joint.noise and base.spent < SPARE
    return calm and max(gains) < PROMISING


def _best(found: list[Fit], kept: int, each: int = 1) -> list[Fit]:
    """The best fits, best first, so many of them, and of each hypothesis."""
    chosen, seen = [], Counter()
    for fit in sorted(found, key=lambda fit: fit.cost):
        seen[fit.law] += 1
        if seen[fit.law] <= each:
            chosen.append(fit)
    return chosen[:kept]
