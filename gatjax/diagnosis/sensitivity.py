"""The smallest effect of each cause that these logs could have shown."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.aliases import UPSIDE_DOWN, alias
from gatjax.diagnosis.bank import CAUSES, of_drive
from gatjax.diagnosis.case import mapped
from gatjax.diagnosis.claims import PLACE, PRICE
from gatjax.diagnosis.findings import needed
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis, combined, pinned
from gatjax.diagnosis.joint import Joint
from gatjax.diagnosis.judge import Judge
from gatjax.effects.catalogue import CATALOGUE

LEVELS = 8  # sizes that are tried in one direction
FINEST = 1e-3  # of the largest size, where a cause has two directions
OTHERS = 3  # settings of a cause's other numbers that are tried
FAINT = 1e-12  # power that counts as none


class Ladder(NamedTuple):
    """Growing sizes of a cause in one direction, evenly spaced as logarithms."""

    hypothesis: Hypothesis
    rungs: np.ndarray  # [LEVELS]
    way: np.ndarray  # [own] of the direction
    base: np.ndarray  # [own] coordinates besides, where their search starts
    grows: bool  # from nothing: the coordinates go with exp(rung), not with the rung

    def own(self, rung: float) -> np.ndarray:
        """Coordinates of a size."""
        return self.base + (np.exp(rung) if self.grows else rung) * self.way

    def value(self, joint: Joint, rung: float) -> float:
        """The scored parameter."""
        values = self.hypothesis.values(joint, self.own(rung))
        return float(values[CATALOGUE[self.hypothesis.cause].main.name])


def smallest(judge: Judge) -> list[dict[str, Any]]:
    """Least detectable size of every cause, at the joint and the way it shows best.

    A cause of a size is simulated beside all that is known: what tolerances cannot
    imitate of it, to first order, has to be worth a finding. Alone, it has to be
    visible. Left out is what would not have been named again, or at all.
    """
    if len(judge.accepted) == judge.most:
        return []
    plain = {h.cause for h in CAUSES if len(h.low) == 1}
    bank = tuple(
        h for h in CAUSES
        if (len(h.low) == 1 or h.cause not in plain) and h.variant != UPSIDE_DOWN
    )  # fmt: skip

    def tried(index: int) -> list[tuple[Ladder, np.ndarray]]:
        joint, told = judge.joints[index], _told(judge, index)
        ladders = [
            ladder
            for h in of_drive(joint, bank)
            if h.cause not in told
            for ladder in _ladders(joint, h)
        ]
        return list(zip(ladders, _margins(judge, index, ladders), strict=True))

    best: dict[str, tuple[float, dict[str, Any]]] = {}
    every = mapped(tried, range(len(judge.joints)))
    for joint, rows in zip(judge.joints, every, strict=True):
        for ladder, margin in rows:
            rung = _threshold(ladder.rungs, margin)
            if rung is None:
                continue
            cause, value = ladder.hypothesis.cause, ladder.value(joint, rung)
            main = CATALOGUE[cause].main
            severity = abs(CATALOGUE[cause].severity(value))
            row = {
                "cause": cause, "where": [joint.name], "parameter": main.name,
                "value": value, "unit": main.unit, "at_most": bool(margin[0] >= 0.0),
            }  # fmt: skip
            if cause not in best or severity < best[cause][0]:
                best[cause] = severity, row
    return [row for _, row in best.values()]


def _told(judge: Judge, index: int) -> set[str]:
    """Causes that are known at a joint already, and their aliases."""
    claims = [claim for claim in judge.accepted if index in claim.where]
    count = len(judge.joints)
    return {cause for claim in claims for cause in alias(claim.hypothesis, count)}


def _ladders(joint: Joint, hypothesis: Hypothesis) -> list[Ladder]:
    """The sizes that are looked for, in each direction that a cause has."""
    low, high = np.array(hypothesis.low), np.array(hypothesis.high)
    axes = np.flatnonzero(low == -high)  # of either sign: parts of a vector, a wave
    if len(low) > 1 and len(axes):
        return [
            _from_nothing(hypothesis, axis, 1.0, rest)
            for axis in axes.tolist() for rest in _rests(hypothesis, axes.tolist())
        ]  # fmt: skip
    rests = _rests(hypothesis, [0])
    found = [
        _along(hypothesis, rest) for rest in rests[: 1 if hypothesis.geared else OTHERS]
    ]
    ends = [found[0].value(joint, end) for end in (low[0], high[0])]
    entry = CATALOGUE[hypothesis.cause]
    if ends[0] < entry.neutral < ends[1]:  # at coordinate 0
        return [_from_nothing(hypothesis, 0, sign, rests[0]) for sign in (-1.0, 1.0)]
    if abs(entry.severity(ends[0])) < abs(entry.severity(ends[1])):
        return found
    return [ladder._replace(rungs=ladder.rungs[::-1]) for ladder in found]


def _rests(hypothesis: Hypothesis, left_out: list[int]) -> list[np.ndarray]:
    """Up to OTHERS settings of the other coordinates, from where searches start."""
    starts = np.array(hypothesis.starts)
    starts[:, left_out] = 0.0
    every = np.unique(starts, axis=0)
    some = np.linspace(0, len(every) - 1, min(len(every), OTHERS)).round().astype(int)
    return list(every[some])


def _along(hypothesis: Hypothesis, rest: np.ndarray) -> Ladder:
    """The range of the first coordinate."""
    rungs = np.linspace(hypothesis.low[0], hypothesis.high[0], LEVELS)
    return Ladder(hypothesis, rungs, np.eye(len(rest))[0], rest, False)


def _from_nothing(
    hypothesis: Hypothesis, axis: int, sign: float, rest: np.ndarray
) -> Ladder:
    """One sign of a coordinate that does nothing at 0."""
    end = hypothesis.high[axis] if sign > 0.0 else -hypothesis.low[axis]
    rungs = np.log(end * np.geomspace(FINEST, 1.0, LEVELS))
    return Ladder(hypothesis, rungs, sign * np.eye(len(rest))[axis], rest, True)


def _margins(judge: Judge, index: int, ladders: list[Ladder]) -> list[np.ndarray]:
    """How far each size is beyond what a finding needs, as logarithms [LEVELS] each.

    Nats and squared visibility of small effects grow as a power of the size, so that
    these are nearly straight along a ladder.
    """
    joint, known = judge.joints[index], judge.known[index]
    free = judge.case.joints[index].drawn(0.0)
    points = [(ladder.hypothesis, ladder.own(rung)) for ladder in ladders
              for rung in ladder.rungs]  # fmt: skip
    prices = np.array([PRICE * len(h.low) + PLACE for h, _ in points])
    nats, visibility = needed(judge, [index])
    worth = np.log(np.maximum(_nats(joint, known, points), FAINT) / (nats + prices))
    seen = np.log(np.maximum(_seen(free, points), FAINT) / visibility**2)
    return np.split(np.minimum(worth, seen), len(ladders))


def _nats(
    joint: Joint, known: Fit, points: list[tuple[Hypothesis, np.ndarray]]
) -> np.ndarray:
    """Evidence of causes beside what is known, prices left out [S].

    It is what tolerances leave of them, and how far off they are when they imitate the
    rest.
    """
    base = fits.linearised(joint, [known])[0]
    both = [(combined(base.hypothesis, h), np.append(base.x, own)) for h, own in points]
    shift = fits.residuals(joint, both) - base.residual[:, None]
    told = base.slopes.T @ shift / fits.spread(joint) ** 2
    x = np.linalg.solve(base.information, told)
    left = np.mean(np.square(shift - base.slopes @ x), axis=0) / max(
        base.rms() ** 2, 1e-30
    )
    spent = np.square(x[:COUNT]).sum(0)
    return 0.5 * (fits.independent(joint) * np.log1p(left) + spent)


def _seen(joint: Joint, points: list[tuple[Hypothesis, np.ndarray]]) -> np.ndarray:
    """Square of the visibility d of causes alone, [S]; as in `Judge.visibility`."""
    plain = fits.linearised(joint, fits.start(joint, [(None, np.zeros(COUNT))]))[0]
    scatter = fits.scatter(joint, plain) ** 2
    alone = [(pinned(h, own), np.zeros(COUNT)) for h, own in points]
    change = fits.residuals(joint, alone) - plain.residual[:, None]
    return np.mean(np.square(change), axis=0) / scatter


def _threshold(rungs: np.ndarray, margins: np.ndarray) -> float | None:
    """Rung of the least size that is a finding, the lowest one if that is; or None."""
    above = np.flatnonzero(margins >= 0.0)
    if not len(above):
        return None
    last = int(above[0])
    first = max(last - 1, 0)
    return float(np.interp(0.0, margins[first : last + 1], rungs[first : last + 1]))
