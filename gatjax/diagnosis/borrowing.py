"""Fits of a joint that start from what explains the other joints of its robot.

Where friction holds or teeth part, a fit ends in the nearest of many valleys. Causes of
a whole robot are alike at its joints: what explains one of them is a good place for
another to begin at.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from gatjax.diagnosis import fit as fits
from gatjax.diagnosis import search, sharing
from gatjax.diagnosis.aliases import covered
from gatjax.diagnosis.bank import CAUSES, of_drive
from gatjax.diagnosis.case import LED_ASTRAY, PASSES, along, mapped
from gatjax.diagnosis.claims import LATER
from gatjax.diagnosis.fit import Fit, parts_of, put_together
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis
from gatjax.diagnosis.joint import Joint
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.option import Option

SPREAD = 6  # causes that are tried at each joint as they are at others
LENDERS = 3  # joints that each of them is borrowed from
TRIED, EARLY, ROUNDS = 2, 2, 4  # starts that are followed, their iterations, its own
REFITTING = 8  # iterations of a joint whose loads or causes have changed

Parts = list[tuple[Hypothesis, np.ndarray]]  # causes with coordinates


def borrowed(
    joint: Joint, places: Sequence[np.ndarray], sets: Sequence[Sequence[Parts]]
) -> list[Fit]:
    """A joint's best fits with causes as they are at other joints.

    Args:
        joint: in question.
        places: tolerances [COUNT] to begin with.
        sets: for each fit that is wanted the causes at other joints, one at least.

    Returns:
        A fit for each set.
    """
    points = [[put_together(x, each) for each in some for x in places] for some in sets]
    first = iter(fits.start(joint, [point for some in points for point in some]))
    tried = [_best(first, len(some))[:TRIED] for some in points]
    begun = iter(fits.improve(joint, [f for some in tried for f in some], EARLY))
    return fits.improve(joint, [_best(begun, len(some))[0] for some in tried], ROUNDS)


def _best(found: Iterator[Fit], count: int) -> list[Fit]:
    """The next so many fits, best first."""
    return sorted((next(found) for _ in range(count)), key=lambda fit: fit.cost)


def _lent(joint: Joint, others: Sequence[Fit]) -> list[Parts]:
    """The causes of other joints' fits as a joint can have them, if it can."""
    own, found = {h.law: h for h in of_drive(joint, CAUSES)}, []
    for fit in others:
        parts = [(own.get(part.law), x) for part, x in parts_of(fit)]
        known = [(h, np.clip(x, h.low, h.high)) for h, x in parts if h is not None]
        if known and len(known) == len(parts):
            found.append(known)
    return found


def spread(judge: Judge, known: Mapping[int, Fit], options: list[Option]) -> None:
    """Try the most promising causes at each joint as they are at the others.

    An option gets the fits that are better than its own.
    """
    options = sorted(options, key=lambda option: -_promise(option, len(known)))[:SPREAD]

    def one(index: int) -> list[Fit | None]:
        joint, x = judge.joints[index], known[index].x[:COUNT]
        sets = [_lent(joint, _lenders(option, index)) for option in options]
        found = iter(borrowed(joint, [x, np.zeros(COUNT)], [s for s in sets if s]))
        return [next(found) if some else None for some in sets]

    for index, rows in zip(known, mapped(one, known), strict=True):
        joint = judge.joints[index]
        before = sharing.alone(joint, known[index])
        for option, fit in zip(options, rows, strict=True):
            gain = sharing.alone(joint, fit) - before if fit else 0.0
            if fit and gain > option.gains.get(index, 0.0):
                option.gains[index], option.fits[index] = gain, fit


def _promise(option: Option, joints: int) -> float:
    """Nats at single joints; of many without the one that gains most: it may be odd."""
    gains = sorted(option.gains.values())
    return float(sum(gains[:-1] if joints >= sharing.MANY else gains))


def _lenders(option: Option, index: int) -> list[Fit]:
    """Fits of the joints that an option helps most, but for one."""
    others = sorted(option.fits.keys() - {index}, key=lambda k: -option.gains[k])
    return [option.fits[k] for k in others[:LENDERS]]


def retried(judge: Judge, known: Mapping[int, Fit]) -> dict[int, Fit]:
    """Fits that begin anew with the causes of another joint where these are better."""

    def one(index: int) -> Fit:
        joint, fit = judge.joints[index], known[index]
        sets = _lent(joint, [other for k, other in known.items() if k != index])
        if not sets:
            return fit
        (lent,) = borrowed(joint, [fit.x[:COUNT], np.zeros(COUNT)], [sets])
        return max(fit, lent, key=lambda each: sharing.alone(joint, each))

    return dict(zip(known, mapped(one, known), strict=True))


def followed(judge: Judge, known: Mapping[int, Fit]) -> dict[int, Fit]:
    """Fits on loads along the motion that they make, where that explains more.

    Loads along the measured motion are smoothed, and lack what friction and teeth do.
    The judge gets a case with the new loads and its joints; what it knows of joints
    without a fit in `known` stays as it was.
    """
    best = retried(judge, known)
    for _ in range(PASSES):
        case, joints = judge.case, judge.joints
        begun, best = best, refitted(judge, best)
        judge.case = along(case, joints, _moving(judge, begun))
        judge.joints = judge.altered(judge.case)
        tried = refitted(judge, begun)
        more = sharing.nats(judge.joints, tried) - sharing.nats(joints, best)
        if more < LATER:
            judge.case, judge.joints = case, joints
            break
        best = tried
    return best


def _moving(judge: Judge, known: Mapping[int, Fit]) -> list[Fit]:
    """Fits of all joints that tell how these move.

    What one joint has besides, an encoder offset say, must not be in the loads of its
    neighbours: it gets the cause that suits it best beside those of the best joint.
    """
    every = [known.get(k, fit) for k, fit in enumerate(judge.known)]
    left = judge.left(known)
    astray = [k for k in left if left[k] >= LED_ASTRAY]
    if len(left) < sharing.MANY or len(astray) != 1:
        return every
    (odd,) = astray
    joint = judge.joints[odd]
    for parts in _lent(joint, [known[min(left, key=left.__getitem__)]]):
        (base,) = fits.start(joint, [put_together(np.zeros(COUNT), parts)])
        never = {c for part, _ in parts for c in covered(part, len(judge.joints))}
        bank = tuple(h for h in of_drive(joint, CAUSES) if h.cause not in never)
        best = min(search.proposals(joint, base, bank), key=lambda fit: fit.cost)
        every[odd] = fits.improve(joint, [best], REFITTING)[0]
    return every


def refitted(
    judge: Judge, known: Mapping[int, Fit], without: str = ""
) -> dict[int, Fit]:
    """Fits after more iterations, on the loads that joints have now; less a cause."""

    def one(index: int) -> Fit:
        fit = known[index]
        parts = [(h, own) for h, own in parts_of(fit) if h.cause != without]
        return fits.refitted(judge.joints[index], fit, parts, REFITTING)

    return dict(zip(known, mapped(one, known), strict=True))
