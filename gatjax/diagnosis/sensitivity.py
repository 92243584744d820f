"""The smallest effect of each cause that these logs could have shown."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.bank import CAUSES
from gatjax.diagnosis.claims import PLACE, PRICE
from gatjax.diagnosis.findings import needed
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis, combined, pinned
from gatjax.diagnosis.joint import Joint
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.verdict import alias
from gatjax.effects.catalogue import CATALOGUE

LEVELS = 8  # sizes that are tried in one direction
FINEST = 1e-3  # of the largest size, where a cause has two directions
FAINT = 1e-12  # power that counts as none


class Ladder(NamedTuple):
    """Growing sizes of a cause in one direction, evenly spaced as logarithms."""

    hypothesis: Hypothesis
    rungs: np.ndarray  # [LEVELS]
    sign: float  # 0: rungs are coordinates; else coordinates are sign exp(rungs)

    def own(self, rung: float) -> np.ndarray:
        """Coordinates of a size, the others where their search starts."""
        first = self.sign * np.exp(rung) if self.sign else rung
        return np.array([first, *self.hypothesis.starts[0][1:]])

    def value(self, joint: Joint, rung: float) -> float:
        """The scored parameter."""
        values = self.hypothesis.values(joint, self.own(rung))
        return float(values[CATALOGUE[self.hypothesis.cause].main.name])


def smallest(judge: Judge) -> list[dict[str, Any]]:
    """Least detectable size of every cause with one number, at its best joint.

    A cause of a size is simulated beside all that is known: what tolerances cannot
    imitate of it, to first order, has to be worth a finding. Alone, it has to be
    visible. Left out is what would not have been named again, or at all.
    """
    if len(judge.accepted) == judge.most:
        return []
    bank = [h for h in CAUSES if len(h.low) == 1 or h.geared]
    best: dict[str, tuple[float, dict[str, Any]]] = {}
    for index, joint in enumerate(judge.joints):
        told = _told(judge, index)
        ladders = [
            ladder for h in bank if h.cause not in told for ladder in _ladders(joint, h)
        ]
        margins = _margins(judge, index, ladders)
        for ladder, margin in zip(ladders, margins, strict=True):
            rung = _threshold(ladder.rungs, margin)
            if rung is None:
                continue
            cause, value = ladder.hypothesis.cause, ladder.value(joint, rung)
            main = CATALOGUE[cause].main
            row = {
                "cause": cause, "where": [joint.name], "parameter": main.name,
                "value": value, "unit": main.unit, "at_most": bool(margin[0] >= 0.0),
            }  # fmt: skip
            if cause not in best or _size(cause, value) < best[cause][0]:
                best[cause] = _size(cause, value), row
    return [row for _, row in best.values()]


def _told(judge: Judge, index: int) -> set[str]:
    """Causes that are known at a joint already, and their aliases."""
    claims = [claim for claim in judge.accepted if index in claim.where]
    count = len(judge.joints)
    return {cause for claim in claims for cause in alias(claim.hypothesis, count)}


def _size(cause: str, value: float) -> float:
    """How far a parameter is from the simulation without the cause."""
    neutral = CATALOGUE[cause].neutral
    return abs(value - neutral) if np.isfinite(neutral) else 1.0 / value


def _ladders(joint: Joint, hypothesis: Hypothesis) -> list[Ladder]:
    """The sizes that are looked for: a factor or a signed number has two directions."""
    cause = hypothesis.cause
    low, high = hypothesis.low[0], hypothesis.high[0]
    plain = Ladder(hypothesis, np.linspace(low, high, LEVELS), 0.0)
    ends = [plain.value(joint, end) for end in (low, high)]
    if ends[0] < CATALOGUE[cause].neutral < ends[1]:  # at coordinate 0
        return [
            Ladder(hypothesis, np.log(end * np.geomspace(FINEST, 1.0, LEVELS)), sign)
            for end, sign in ((-low, -1.0), (high, 1.0))
        ]
    grows = _size(cause, ends[0]) < _size(cause, ends[1])
    return [plain if grows else plain._replace(rungs=plain.rungs[::-1])]


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
    left = np.mean(np.square(shift - base.slopes @ x), axis=0) / base.rms() ** 2
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
