"""Effects on the way from the commanded target to the servo.

Each acts on `Signal.target` and works in the command slot (per control tick) or in the
motor slot (per physics step): `period` is the time between two calls, s. Parameters are
[J] arrays or scalars; the neutral value of each changes nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gatjax.effects.effect import Effect, memoryless
from gatjax.records import Signal
from gatjax.xp import namespace_of

Array = Any


def delay(period: float, longest: float) -> Effect:
    """Hand on the target late; params: delay in s, 0 <= delay <= longest.

    Between whole calls the two nearest targets are mixed linearly. The number of calls
    is limited with where, so that gradients are right at both ends too (a clip halves
    them there).
    """
    slots = int(np.ceil(longest / period - 1e-9)) + 1

    def init(seconds: Array, signal: Signal) -> Array:
        xp = namespace_of(signal.target)
        return xp.stack([signal.target] * (slots + 1), axis=-2)

    def apply(seconds: Array, held: Array, signal: Signal) -> tuple[Array, Signal]:
        xp = namespace_of(signal.target, seconds)
        newest = signal.target[..., None, :]
        held = xp.concatenate([newest, held[..., :-1, :]], axis=-2)
        calls, most = seconds / period, slots - 1.0
        calls = xp.where(calls < 0.0, 0.0, xp.where(calls > most, most, calls))
        calls = xp.broadcast_to(calls, signal.target.shape)
        whole = xp.floor(calls)
        first = whole.astype(int)[..., None, :]
        newer, older = (
            xp.take_along_axis(held, index, axis=-2)[..., 0, :]
            for index in (first, xp.minimum(first + 1, slots))
        )
        return held, signal._replace(target=newer + (calls - whole) * (older - newer))

    return Effect(init, apply)


def lag(period: float) -> Effect:
    """First-order low pass of the target; params: time constant in s, 0 is neutral.

    tau y' = target - y, exact for a target that is held between calls.
    """

    def init(tau: Array, signal: Signal) -> Array:
        return signal.target

    def apply(tau: Array, held: Array, signal: Signal) -> tuple[Array, Signal]:
        xp = namespace_of(signal.target, tau)
        share = 1.0 - xp.exp(-period / xp.maximum(tau, 1e-9))
        held = held + (signal.target - held) * share
        return held, signal._replace(target=held)

    return Effect(init, apply)


def speed_limit(period: float) -> Effect:
    """Limit the speed of the target; params: limit in rad/s, inf is neutral."""

    def init(limit: Array, signal: Signal) -> Array:
        return signal.target

    def apply(limit: Array, held: Array, signal: Signal) -> tuple[Array, Signal]:
        xp = namespace_of(signal.target, limit)
        step = limit * period
        held = held + xp.clip(signal.target - held, -step, step)
        return held, signal._replace(target=held)

    return Effect(init, apply)


def _beyond(xp: Any, error: Array, half: Array) -> Array:
    """Part of an error outside the band +-half; its gradient is right at half = 0."""
    return xp.sign(error) * xp.maximum(xp.abs(error) - half, 0.0)


def dead_band() -> Effect:
    """Servo that ignores small errors; params: half width in rad, 0 is neutral."""

    def change(half: Array, signal: Signal) -> Signal:
        xp = namespace_of(signal.target, half)
        left = _beyond(xp, signal.target - signal.angle, half)
        return signal._replace(target=signal.angle + left)

    return memoryless(change)


def quantization() -> Effect:
    """Servo that rounds its target; params: step in rad, 0 is neutral."""

    def change(step: Array, signal: Signal) -> Signal:
        xp = namespace_of(signal.target, step)
        count = signal.target / xp.where(step > 0.0, step, 1.0)
        rounded = xp.floor(count + 0.5) * step
        return signal._replace(target=xp.where(step > 0.0, rounded, signal.target))

    return memoryless(change)


def shifted() -> Effect:
    """Servo whose encoder has a wrong zero; params: offset in rad, 0 is neutral."""
    return memoryless(
        lambda offset, signal: signal._replace(target=signal.target - offset)
    )


def scaled() -> Effect:
    """Servo whose encoder has a wrong scale; params: scale, 1 is neutral.

    The servo acts on target - scale angle; its damping keeps the true speed.
    """

    def change(scale: Array, signal: Signal) -> Signal:
        return signal._replace(target=signal.target + (1.0 - scale) * signal.angle)

    return memoryless(change)


def loss() -> Effect:
    """Lose targets, in bursts, and hold the last one; params: probability, burst.

    probability is the share of targets that is lost (0 is neutral), burst the mean
    number of targets lost together, 1 at least, and so many that one comes through
    between two bursts. The draws of the tick decide: a target is lost where Phi(noise)
    is less than the chance of it, so that a noise of 0 loses nothing as long as the
    chances are below one half, and -9 loses for sure. Where all joints lose alike, a
    message is one to all of them: the first one's draw counts.
    """

    def init(params: dict[str, Array], signal: Signal) -> tuple[Array, Array]:
        return signal.target, 0.0 * signal.target

    def apply(
        params: dict[str, Array], state: tuple[Array, Array], signal: Signal
    ) -> tuple[tuple[Array, Array], Signal]:
        xp = namespace_of(signal.target, params["probability"])
        held, lost = state
        share = params["probability"]
        odds = share / xp.maximum(1.0 - share, 1e-6)
        burst = xp.maximum(params["burst"], odds)  # of shorter ones no more fit in
        begin = odds / burst
        chance = xp.where(share > 0.0, lost * (1.0 - 1.0 / burst), 0.0)
        chance = chance + (1.0 - lost) * begin
        draw, still = signal.noise, 0.0 * signal.noise
        both = share + still, burst + still
        alike = [(each == each[..., :1]).all(-1)[..., None] for each in both]
        draw = xp.where(alike[0] & alike[1], draw[..., :1], draw)
        below = 0.5 * (1.0 + xp.tanh(0.7978846 * (draw + 0.044715 * draw**3)))
        gone = below < chance
        held = xp.where(gone, held, signal.target)
        return (held, gone + 0.0 * held), signal._replace(target=held)

    return Effect(init, apply)


def noise() -> Effect:
    """Gaussian noise on the target; params: standard deviation in rad, 0 is neutral."""

    def change(deviation: Array, signal: Signal) -> Signal:
        return signal._replace(target=signal.target + deviation * signal.noise)

    return memoryless(change)
