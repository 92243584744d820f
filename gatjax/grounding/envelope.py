"""Noise envelope: Gaussian noise on the actions, as wide as what was measured.

Jakobi, Husbands & Harvey 1995: noise in the simulator keeps a search from exploiting
what reality does not offer, if it is as large as the difference to reality. The paper
adds standard Gaussian noise (1 degree, if its unit is the degree of SimSpark); ours
takes its size per joint from the logs, so that a simulator that is right gets none.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gatjax.effects.effect import Effect, memoryless
from gatjax.grounding.gat import draws
from gatjax.grounding.grounder import Experience, Grounder
from gatjax.records import JOINTS, Signal
from gatjax.robot.nao import WALKING, WALKING_JOINTS

Array = Any


class Envelope(NamedTuple):
    """Parameters of the noise envelope."""

    alpha: Array  # [] 0..1, share of the noise
    deviation: Array  # [J] rad, RMS one-step error of the simulator on the robot's logs


def envelope_effect(joints: Array) -> Effect:
    """Noise of `alpha * deviation` on these joints' targets; params: `Envelope`."""

    def change(params: Envelope, signal: Signal) -> Signal:
        noise = params.alpha * params.deviation[joints] * draws(signal, joints)
        return signal._replace(target=signal.target.at[joints].add(noise))

    return memoryless(change)


def learn(experience: Experience) -> tuple[Envelope, dict[str, Any]]:
    """Measure how wide the noise of each joint is."""
    deviation = np.zeros(len(JOINTS), np.float32)
    deviation[WALKING] = experience.step_error()
    degrees = np.rad2deg(deviation[WALKING]).tolist()
    facts = {"deviation_deg": dict(zip(WALKING_JOINTS, degrees, strict=True))}
    return Envelope(np.float32(1.0), deviation), facts


def template(joints: int) -> Envelope:
    """Parameters that are all zero; those of a NAO, whatever the joints."""
    return Envelope(np.float32(0.0), np.zeros(len(JOINTS)))


ENVELOPE = Grounder(envelope_effect, learn, template)
