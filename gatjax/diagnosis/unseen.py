"""Whether named causes predict a motion that they were not found in.

A law that is not the right one, but can be bent to the fit logs, predicts another
motion worse than its name promises. Then the name is told with a doubt; if it is not
proven to predict better than the nominal model, it explains nothing.
"""

from __future__ import annotations

from gatjax.diagnosis import measure
from gatjax.diagnosis.findings import TOLERABLE
from gatjax.diagnosis.measure import Errors
from gatjax.diagnosis.verdict import Cause, Verdict, word

LEAVES = 0.1  # share of the error's power on another motion that a right cause leaves
UNSURE = 0.7  # probability at most of one that leaves more
REFUTED = 0.5  # the same where no gain is proven
RANDOM = frozenset({"dropped_commands"})  # what it does to another motion is chance


def borne_out(verdict: Verdict, before: Errors, after: Errors, seed: int) -> Verdict:
    """The verdict with a doubt about causes that do not predict the held-out logs.

    Args:
        verdict: of the fit logs, of a robot held in the air.
        before: errors of the nominal world on the held-out logs.
        after: those of the extended one.
        seed: of the bootstrap.
    """
    causes, unexplained = [], set(verdict.unexplained)
    for cause in verdict.causes:
        if _left(verdict, cause, before, after) < LEAVES:
            causes.append(cause)
            continue
        joints = set(cause.claim.fits)
        gains = [measure.interval(before, after, k, seed)[0] for k in joints]
        refuted = max(gains) <= 0.0
        low = min(cause.probability, REFUTED if refuted else UNSURE)
        causes.append(cause._replace(probability=low, borne_out=False))
        unexplained |= joints if refuted else set()
    left = sorted(unexplained)
    return verdict._replace(verdict=word(causes, left), causes=causes, unexplained=left)


def _left(verdict: Verdict, cause: Cause, before: Errors, after: Errors) -> float:
    """Share of the nominal error's power that a cause leaves at its joints.

    Joints that lost commands do not count.
    """
    chance = {
        k for each in verdict.causes if each.claim.hypothesis.cause in RANDOM
        for k in each.claim.fits
    }  # fmt: skip
    joints = [verdict.judge.joints[k] for k in set(cause.claim.fits) - chance]
    nominal, extended = before.rmse() ** 2, after.rmse() ** 2
    tolerated = [(TOLERABLE * joint.noise) ** 2 for joint in joints]
    left = [
        max(extended[joint.index] - power, 0.0)
        for joint, power in zip(joints, tolerated, strict=True)
    ]
    return sum(left) / max(sum(nominal[joint.index] for joint in joints), 1e-18)
