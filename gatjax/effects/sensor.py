"""Effects on the way from the sensors to the pilot and the log."""

from __future__ import annotations

from typing import Any

import numpy as np

from gatjax.effects.effect import Effect, memoryless
from gatjax.records import Reading, Sensed
from gatjax.xp import namespace_of

Array = Any


def noise() -> Effect:
    """Gaussian noise on every channel; params: a Reading of standard deviations.

    Units are those of Reading; 0 is neutral. `force` is a share of the force itself: a
    foot in the air stays at exactly zero.
    """

    def change(deviation: Reading, signal: Sensed) -> Sensed:
        reading, draw = signal.reading, signal.noise
        return signal._replace(
            reading=Reading(
                angle=reading.angle + deviation.angle * draw.angle,
                gyro=reading.gyro + deviation.gyro * draw.gyro,
                accelerometer=reading.accelerometer
                + deviation.accelerometer * draw.accelerometer,
                force=reading.force * (1.0 + deviation.force * draw.force),
            )
        )

    return memoryless(change)


def _angled(signal: Sensed, angle: Array) -> Sensed:
    return signal._replace(reading=signal.reading._replace(angle=angle))


def offset() -> Effect:
    """Encoders with a wrong zero: measured = true + params, [J] rad; 0 is neutral."""

    def change(amount: Array, signal: Sensed) -> Sensed:
        return _angled(signal, signal.reading.angle + amount)

    return memoryless(change)


def scale() -> Effect:
    """Encoders with a wrong scale: measured = params * true, [J]; 1 is neutral."""

    def change(factor: Array, signal: Sensed) -> Sensed:
        return _angled(signal, factor * signal.reading.angle)

    return memoryless(change)


def delay(period: float, longest: float) -> Effect:
    """Report old joint angles; params: delay [J] in s, 0 <= delay <= longest.

    Between two ticks, a cubic goes through the four nearest (a parabola through three
    where the fourth is not measured yet).
    """
    slots = int(np.ceil(longest / period - 1e-9)) + 1

    def init(seconds: Array, signal: Sensed) -> Array:
        xp = namespace_of(signal.reading.angle)
        return xp.stack([signal.reading.angle] * (slots + 2), axis=-2)

    def apply(seconds: Array, held: Array, signal: Sensed) -> tuple[Array, Sensed]:
        angle = signal.reading.angle
        xp = namespace_of(angle, seconds)
        held = xp.concatenate([angle[..., None, :], held[..., :-1, :]], axis=-2)
        ticks = xp.clip(seconds / period, 0.0, slots - 1.0)[..., None, :]
        whole = xp.floor(ticks)
        index = xp.arange(slots + 2, dtype=angle.dtype)[:, None]
        weight = _between(xp, index - whole, ticks - whole, whole)
        return held, _angled(signal, (weight * held).sum(-2))

    return Effect(init, apply)


def _between(xp: Any, place: Array, part: Array, whole: Array) -> Array:
    """Weights of the samples `place` ticks after the whole delay; Lagrange."""
    cubic = (
        (place == -1) * (-part * (part - 1.0) * (part - 2.0) / 6.0)
        + (place == 0) * ((part + 1.0) * (part - 1.0) * (part - 2.0) / 2.0)
        + (place == 1) * (-(part + 1.0) * part * (part - 2.0) / 2.0)
        + (place == 2) * ((part + 1.0) * part * (part - 1.0) / 6.0)
    )
    parabola = (
        (place == 0) * ((part - 1.0) * (part - 2.0) / 2.0)
        + (place == 1) * (-part * (part - 2.0))
        + (place == 2) * (part * (part - 1.0) / 2.0)
    )
    return xp.where(whole > 0.0, cubic, parabola)


def turned(vector: Array, angles: Array) -> Array:
    """Turn a vector [..., 3] by roll, then pitch, then yaw [..., 3] in rad."""
    xp = namespace_of(vector, angles)
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    cos, sin = xp.cos(angles), xp.sin(angles)
    y, z = cos[..., 0] * y - sin[..., 0] * z, sin[..., 0] * y + cos[..., 0] * z
    x, z = cos[..., 1] * x + sin[..., 1] * z, cos[..., 1] * z - sin[..., 1] * x
    x, y = cos[..., 2] * x - sin[..., 2] * y, sin[..., 2] * x + cos[..., 2] * y
    return xp.stack([x, y, z], axis=-1)


def misalignment() -> Effect:
    """An IMU that is mounted askew; params: {roll, pitch, yaw} in rad, 0 is neutral.

    The sensor's axes are the torso's, turned by the three; it reports in its own axes.
    """

    def change(params: dict[str, Array], signal: Sensed) -> Sensed:
        reading = signal.reading
        xp = namespace_of(reading.gyro, params["roll"])
        axes = xp.eye(3, dtype=reading.gyro.dtype)
        angles = xp.stack([params[name] for name in ("roll", "pitch", "yaw")], axis=-1)
        rows = [turned(axes[row], angles) for row in range(3)]  # the sensor's axes

        def seen(vector: Array) -> Array:
            return xp.stack([(vector * row).sum(-1) for row in rows], axis=-1)

        return signal._replace(
            reading=reading._replace(
                gyro=seen(reading.gyro), accelerometer=seen(reading.accelerometer)
            )
        )

    return memoryless(change)


def drifted(angle: Array, drift: Array) -> Array:
    """A log [T, J] rad whose clock runs away: row t holds the angle at t (1 - drift).

    `drift` is [J] in s/s; outside the log its ends are held. Between two rows, a cubic
    goes through the four nearest.
    """
    xp = namespace_of(angle, drift)
    rows = len(angle)
    place = xp.arange(rows, dtype=angle.dtype)[:, None] * (1.0 - drift[None, :])
    place = xp.clip(place, 0.0, rows - 1.0)
    whole = xp.clip(xp.floor(place), 1.0, max(rows - 3.0, 1.0))
    part, first = place - whole, whole.astype(int)
    weights = (
        -part * (part - 1.0) * (part - 2.0) / 6.0,
        (part + 1.0) * (part - 1.0) * (part - 2.0) / 2.0,
        -(part + 1.0) * part * (part - 2.0) / 2.0,
        (part + 1.0) * part * (part - 1.0) / 6.0,
    )
    return sum(
        weight * xp.take_along_axis(angle, xp.clip(first + shift, 0, rows - 1), axis=0)
        for shift, weight in zip((-1, 0, 1, 2), weights, strict=True)
    )
