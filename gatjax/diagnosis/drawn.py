"""Errors on held-out logs of joints that are drawn to their measured motion.

Where stick, slip or a gap decide when a joint moves, no law predicts a whole log: a
small difference parts two runs for good. What a right law explains of the fit logs
while the joint is drawn, it explains of another motion the same way.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis.case import Held, unfitted
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, TOLERANCES, numbers
from gatjax.diagnosis.joint import BOUNCING, NOTHING, Joint
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.measure import APART, BLOCK, Errors

SHAPES = np.array([name.startswith("term") for name in TOLERANCES])
"""Tolerances of load shapes, which other runs have others of."""


def drawn_errors(
    judge: Judge, unseen: Sequence[JointRun]
) -> dict[int, tuple[Errors, Errors]]:
    """Errors [n, 1] of each joint that is drawn: tolerances alone, with causes.

    Joints without a servo always are, and those with a gap, even if the fit logs are
    followed without. Joints that lost commands are left out: which ones, is chance.

    Args:
        judge: of a robot held in the air, with its causes accepted.
        unseen: held-out runs.
    """
    case, base = judge.case, judge.case.base
    lost = {k for claim in judge.accepted for k in claim.lost or {}}
    free = {joint.index: 0.0 for joint in case.joints if not joint.servoed}
    parted = {k: BOUNCING for claim in judge.accepted
              if claim.hypothesis.cause == "backlash" for k in claim.fits}  # fmt: skip
    rates = free | case.pulled | parted
    wanted = {k: rate for k, rate in rates.items() if k not in lost}
    if not (wanted and isinstance(base, Held)):
        return {}
    runs = list(unseen)
    known = base.assumed or [NOTHING] * len(case.joints)
    supply = known[0].supply or case.supply
    assumed = [each._replace(supply=supply) for each in known]
    other = unfitted(base._replace(runs=runs, assumed=assumed), runs)

    def errors(index: int, joint: Joint, fit: Fit) -> Errors:
        return _errors(joint.drawn(wanted[index]), judge.joints[index], fit)

    found = {}
    for k in wanted:
        bodies = [c.body for c in judge.accepted if k in c.fits and c.body is not None]
        after = other.joints[k]
        for body in bodies:  # one at most
            after = other.carrying(after, body)
        healthy, known = case.healthy[k], judge.known[k]
        found[k] = errors(k, other.joints[k], healthy), errors(k, after, known)
    return found


def _errors(joint: Joint, fitted: Joint, fit: Fit) -> Errors:
    """Squared errors [n, 1] of a joint with a fit of the same joint in other runs."""
    x = fit.x.copy()
    x[:COUNT][SHAPES] = 0.0
    drive = numbers(fitted, fit.hypothesis, x)
    residual = joint.residual([drive], fit.geared)
    run = np.broadcast_to(np.arange(len(joint.time))[:, None], joint.time.shape)
    block = APART * run + (joint.time / BLOCK).astype(int)
    return Errors(np.square(residual), block[joint.valid])
