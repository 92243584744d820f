"""Whether named causes predict a motion that they were not found in.

A law that is not the right one, but can be bent to the fit logs, predicts another
motion worse than its name promises. Then the name is told with a doubt.
"""

from __future__ import annotations

from gatjax.diagnosis.measure import Errors
from gatjax.diagnosis.verdict import TOLERABLE, Cause, Verdict, word

LEAVES = 0.1  # share of the error's power on another motion that a right cause leaves
UNSURE = 0.7  # probability at most of one that leaves more
RANDOM = frozenset({"dropped_commands"})  # what it does to another motion is chance


def borne_out(verdict: Verdict, before: Errors, after: Errors) -> Verdict:
    """The verdict with a doubt about causes that do not predict the held-out logs.

    Args:
        verdict: of the fit logs, of a robot held in the air.
        before: errors of the nominal world on the held-out logs.
        after: those of the extended one.
    """
    nominal, extended = before.rmse() ** 2, after.rmse() ** 2

    def doubted(cause: Cause) -> Cause:
        if cause.claim.hypothesis.cause in RANDOM:
            return cause
        joints = [verdict.judge.joints[k] for k in cause.claim.fits]
        left = sum(
            max(extended[j.index] - (TOLERABLE * j.noise) ** 2, 0.0) for j in joints
        )
        if left < LEAVES * sum(nominal[joint.index] for joint in joints):
            return cause
        low = min(cause.probability, UNSURE)
        return cause._replace(probability=low, borne_out=False)

    causes = [doubted(cause) for cause in verdict.causes]
    return verdict._replace(verdict=word(causes, verdict.unexplained), causes=causes)
