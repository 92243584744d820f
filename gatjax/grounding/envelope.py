"""Noise envelope: Gaussian noise on the actions, as wide as what was measured.

Jakobi, Husbands & Harvey 1995: noise in the simulator keeps a search from exploiting
what reality does not offer, if it is as large as the difference to reality. The paper
adds standard Gaussian noise (1 degree, if its unit is the degree of SimSpark); ours
takes its size per joint from the logs, so that a simulator that is right gets none.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from gatjax.effects import drive
from gatjax.effects.effect import Effect
from gatjax.records import Signal

Array = Any


class Envelope(NamedTuple):
    """Parameters of the noise envelope."""

    alpha: Array  # [] 0..1, share of the noise
    deviation: Array  # [J] rad, RMS one-step error of the simulator on the robot's logs


def envelope_effect() -> Effect:
    """Noise of `alpha * deviation` on every target; params: `Envelope`."""
    noise = drive.noise()

    def apply(params: Envelope, state: tuple, signal: Signal) -> tuple[tuple, Signal]:
        return noise.apply(params.alpha * params.deviation, state, signal)

    return Effect(init=lambda params, signal: (), apply=apply)
