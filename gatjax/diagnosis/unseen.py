"""Whether named causes predict a motion that they were not found in.

A law that is not the right one, but can be bent to the fit logs, predicts another
motion worse than its name promises. Then the name is told with a doubt; if it is not
proven to predict better than the nominal model, neither whole logs nor half a second
from a measured state (where dry friction holds, one wrong stop spoils the rest of a
log), it explains nothing. The other way round, a joint whose motion in unseen logs is
predicted open loop is explained, even if the law is too simple for the fit logs' noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from gatjax.diagnosis import chance, measure
from gatjax.diagnosis.findings import TOLERABLE
from gatjax.diagnosis.measure import Errors
from gatjax.diagnosis.verdict import Cause, Verdict, word

LEAVES = 0.2  # share of the error's power on another motion that a right cause leaves
UNSURE = 0.7  # probability at most of one that leaves more
REFUTED = 0.5  # the same where no gain is proven


Pair = tuple[Errors, Errors]
"""Errors of the nominal and of the extended world."""


class Seen(NamedTuple):
    """Errors on the held-out logs."""

    whole: Pair  # over whole logs
    ahead: Callable[[], Pair | None]  # half a second ahead of measured states
    drawn: Mapping[int, Pair]  # of joints that are drawn to them

    def of(self, joint: int) -> Pair:
        """Errors [n, 1] of a joint: drawn, or over whole logs."""
        return self.drawn[joint] if joint in self.drawn else self.over(joint)

    def over(self, joint: int) -> Pair:
        """Errors [n, 1] of a joint over whole logs."""
        first, second = (
            errors._replace(squared=errors.squared[:, joint : joint + 1])
            for errors in self.whole
        )
        return first, second


def borne_out(verdict: Verdict, seen: Seen) -> Verdict:
    """The verdict with a doubt about causes that do not predict the held-out logs.

    Joints of causes that do predict them are explained.

    Args:
        verdict: of the fit logs, of a robot held in the air.
        seen: errors on the held-out logs.
    """
    causes, unexplained = [], set(verdict.unexplained)
    for cause in verdict.causes:
        left = [_left(verdict, cause, pair) for pair in (seen.of, seen.over)]
        right = any(share is not None and share < LEAVES for share in left)
        if right or left[0] is None:
            causes.append(cause._replace(borne_out=right or None))
            continue
        joints = set(cause.claim.fits)
        refuted = not any(_gains(seen, k) for k in joints)
        low = min(cause.probability, REFUTED if refuted else UNSURE)
        causes.append(cause._replace(probability=low, borne_out=False))
        unexplained |= joints if refuted else set()
    borne = {k for c in causes if c.borne_out is not False for k in c.claim.fits}
    lawful = set() if verdict.law is None else set(verdict.law.where)
    rest = [
        k for k in sorted(unexplained)
        if k in lawful or k not in borne or not _predicted(seen, k)
    ]  # fmt: skip
    return verdict._replace(verdict=word(causes, rest), causes=causes, unexplained=rest)


def _predicted(seen: Seen, joint: int) -> bool:
    """Whether a joint's motion is predicted, not only within reach of its noise."""
    nominal, extended = (float(e.rmse()[0]) ** 2 for e in seen.over(joint))
    return extended < LEAVES * nominal


def _gains(seen: Seen, joint: int) -> bool:
    """Whether a gain is proven at a joint."""
    if measure.interval(*seen.of(joint), None)[0] > 0.0:
        return True
    ahead = None if joint in seen.drawn else seen.ahead()
    return ahead is not None and measure.interval(*ahead, joint)[0] > 0.0


def _left(
    verdict: Verdict, cause: Cause, errors: Callable[[int], Pair]
) -> float | None:
    """Share of the nominal error's power that a cause leaves at its joints.

    Joints that lost commands do not count. None where neither model has errors there
    that noise would not excuse: the held-out logs do not show the cause.
    """
    lossy = {
        k for each in verdict.causes if each.claim.hypothesis.cause == chance.LOSS
        for k in each.claim.fits
    }  # fmt: skip
    before = after = excused = 0.0
    for k in set(cause.claim.fits) - lossy:
        nominal, extended = (float(e.rmse()[0]) ** 2 for e in errors(k))
        tolerated = (TOLERABLE * verdict.judge.joints[k].noise) ** 2
        before += nominal
        excused += tolerated
        after += max(extended - tolerated, 0.0)
    return after / max(before, 1e-18) if before > excused or after > 0.0 else None
