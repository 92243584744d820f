"""Effects on the way from the sensors to the pilot."""

from __future__ import annotations

from gatjax.effects.effect import Effect, memoryless
from gatjax.records import Reading, Sensed


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
