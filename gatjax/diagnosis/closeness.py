"""How close a simulation comes to logs: what the next diagnosis may leave, too.

No simulation of a real robot is right within an encoder's step. Whoever asks what has
changed since the last logs wants to hear of more than what was left of those.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.given import Given, Logs, given, judged
from gatjax.diagnosis.joint import Joint
from gatjax.diagnosis.start import started
from gatjax.diagnosis.tolerances import SCHEMA, USUAL, WIDE, Tolerances, surer
from gatjax.diagnosis.verdict import Verdict
from gatjax.sim.world import World

WINDOW = 2.0  # correlation times: an exponential's integral is right within 2 %
LONGEST = 1.0  # s, that residuals count as one: a few seconds of logs tell something


def left(
    verdict: Verdict, data: Given, world: World, allowed: Tolerances
) -> dict[str, Any]:
    """What a simulation leaves of the angles of each joint, as a file of tolerances.

    Besides noise, rad rms, and how long it lasts, s. Of held-out logs, if there are
    any, with its numbers fitted within the tolerances of the next diagnosis; else of
    those that it was made from. Where it was drawn to those, or some of them were left
    aside, they are simulated again.

    Args:
        verdict: of the diagnosis of a robot on a fixed base.
        data: that it is about.
        world: the simulation that it extended.
        allowed: tolerances of the diagnosis: what was surer than usual stays so.
    """
    sure, case = surer(allowed), verdict.judge.case
    joints, fits = verdict.judge.joints, verdict.judge.known
    try:
        start = started(world, Path(data.start.source))
    except ValueError:  # no diagnosis goes on from it
        start = None
    if start is not None and (data.files.held or case.pulled or case.aside):
        other = given(start, Logs(data.files.held or data.files.fit, []), data.seed)
        then = judged(other, lambda stage, share: None, USUAL._replace(**sure)).case
        joints, fits = then.joints, then.healthy
    pairs = list(zip(joints, fits, strict=True))
    return {
        "schema": SCHEMA, **sure,
        "angle": {joint.name: beyond_noise(joint, fit) for joint, fit in pairs},
        "lasting": {joint.name: lasting(joint, fit) for joint, fit in pairs},
    }  # fmt: skip


def lasting(joint: Joint, fit: Fit) -> float:
    """Correlation time of what a fit leaves, s: the integral of its autocorrelation.

    All runs together, over WINDOW correlation times (Sokal 1997, section 3); LONGEST at
    most.
    """
    left, (_, rows) = np.zeros_like(joint.time), joint.time.shape
    left[joint.valid] = fit.residual
    size = 2 * rows
    power = np.square(np.abs(np.fft.rfft(left, size, axis=1))).sum(0)
    series = np.fft.irfft(power, size)[:rows]
    times = 2.0 * np.cumsum(series) / max(series[0], 1e-30) - 1.0
    wide = np.arange(rows) >= WINDOW * times
    period = np.median(np.diff(joint.time, axis=1)[joint.valid[:, 1:]])
    found = times[np.argmax(wide)] if wide.any() else np.inf
    return float(np.clip(period * found, period, LONGEST))


def beyond_noise(joint: Joint, fit: Fit) -> float:
    """RMS of what a fit leaves besides noise, rad; WIDE at most, as files may have."""
    noise = joint.noise**2 - joint.allowed.close(joint.name) ** 2
    return float(np.sqrt(np.clip(fit.rms() ** 2 - noise, 0.0, WIDE**2)))
