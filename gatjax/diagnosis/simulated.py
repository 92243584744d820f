"""Logs without noise, as simulators write them: how far off the diagnosis itself is."""

from __future__ import annotations

import numpy as np

from gatjax.diagnosis import measure, noise
from gatjax.diagnosis.case import settled
from gatjax.diagnosis.closeness import lasting
from gatjax.diagnosis.given import Given, judged
from gatjax.diagnosis.tolerances import Tolerances

FAR = 0.01  # rad that fits leave of a model that falls apart in steps so long


def as_close(data: Given, allowed: Tolerances) -> Tolerances:
    """Tolerances that let joints read without noise be as far off as fits always are.

    Joints are simulated one by one, along what the others did, and with friction that
    holds: no noise hides what that misses. It is what fits leave of the model itself,
    simulated in its own steps with the same commands.

    Args:
        data: of a robot whose base is fixed.
        allowed: how far the numbers of the model may be off.
    """
    exact = noise.exact(data.logs)
    if not exact.any():
        return allowed
    played = measure.replayed(data.start.world(data.period), data.logs)
    pairs = zip(data.logs, played, strict=True)
    runs = [run._replace(angle=each.angle) for run, each in pairs]
    case = settled(judged(data._replace(logs=runs), _silent, allowed).case, _silent)
    angle, lasts = {}, {}
    for joint, fit, written in zip(case.joints, case.healthy, exact, strict=True):
        name, missed = joint.name, fit.rms()
        near = written and missed < FAR
        angle[name] = float(np.hypot(allowed.close(name), missed if near else 0.0))
        lasts[name] = lasting(joint, fit) if near else allowed.lasts(name)
    return allowed._replace(angle=angle, lasting=lasts)


def _silent(stage: str, share: float) -> None:
    """Tell nothing of a fit that takes a second."""
