"""The patterns that motions are made of: offsets from the middle, zero at both ends."""

from __future__ import annotations

from typing import Any, Callable, NamedTuple

import numpy as np

Array = Any

PUSH = 0.5  # share of the speed limit that quick patterns use
FADE = 0.5  # s in which a vibration grows and dies
SLOWEST, FASTEST = 0.2, 5.0  # Hz, of the sweep; a servo's bandwidth lies between
TONES = np.geomspace(0.15, 4.0, 10)  # Hz, of the multisine
SMALL = 0.03  # rad, 20 steps of a 12-bit encoder, a few times a gear's play
SLOW, CREEP = 0.5, 0.03  # rad/s at most; friction fades with speed near the latter
BURST = 1.5  # Hz
HOLD = (0.5, 1.0)  # s between two steps, drawn
POSES = 5
REPEATS = 5
GROUPS = 6  # joints move alone up to this number, in as many groups beyond


class Stage(NamedTuple):
    """Where a pattern is played."""

    rows: int
    rate_hz: float
    half: Array  # [J] rad, largest offset
    speed: Array  # [J] rad/s
    rng: np.random.Generator

    @property
    def time(self) -> np.ndarray:
        """Time of the rows [T, 1], s; the middle was left one row before the first."""
        return np.arange(1, self.rows + 1)[:, None] / self.rate_hz

    @property
    def seconds(self) -> float:
        """Length, s."""
        return self.rows / self.rate_hz

    @property
    def sides(self) -> np.ndarray:
        """Draw the side to which each joint goes first, [J] of -1 and 1."""
        return self.rng.choice([-1.0, 1.0], len(self.half))

    def swing(self, frequency: Array) -> np.ndarray:
        """Amplitude of a vibration at `frequency` Hz that is not too fast, rad."""
        return np.minimum(self.half, PUSH * self.speed / (2.0 * np.pi * frequency))


Pattern = Callable[[Stage], np.ndarray]  # -> [T, J] rad


def smooth(share: Array) -> Array:
    """Go from 0 to 1 with `share`, at rest at both ends (least jerk)."""
    share = np.clip(share, 0.0, 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def within_speed(offset: Array, step: Array) -> np.ndarray:
    """Follow offsets [T, J] as closely as steps of at most `step` [J] a row allow.

    Starts within one step of zero and ends there; what is slow enough stays as it is.
    """

    def followed(rows: Array) -> np.ndarray:
        out, last = np.empty_like(rows), np.zeros(rows.shape[1])
        for index, wanted in enumerate(rows):
            last = np.minimum(np.maximum(wanted, last - step), last + step)
            out[index] = last
        return out

    late = followed(offset)
    late[-1] = 0.0
    return followed(late[::-1])[::-1]


def _faded(stage: Stage) -> np.ndarray:
    """Envelope [T, 1] of a vibration."""
    left = np.minimum(stage.time, stage.seconds - stage.time)
    return smooth(left / FADE)


def chirp(stage: Stage) -> np.ndarray:
    """Sweep upwards; what speed forbids is taken off the amplitude."""
    ratio = min(FASTEST, stage.rate_hz / 8.0) / SLOWEST
    own = stage.rng.uniform(0.85, 1.15, len(stage.half))  # joints do not stay in step
    share = stage.time / stage.seconds
    frequency = own * SLOWEST * ratio**share
    cycles = own * SLOWEST * stage.seconds * (ratio**share - 1.0) / np.log(ratio)
    wave = np.sin(2.0 * np.pi * cycles)
    return stage.sides * _faded(stage) * stage.swing(frequency) * wave


def _steps(stage: Stage, size: Array) -> np.ndarray:
    """Jump from side to side between levels of 0.4 to 1 of `size` [J] rad."""
    rows, (shortest, longest) = np.zeros((stage.rows, len(size))), HOLD
    for joint, side in enumerate(stage.sides):
        time = stage.rng.uniform(0.0, longest)
        while time < stage.seconds - longest:
            side = -side
            level = side * stage.rng.uniform(0.4, 1.0) * size[joint]
            rows[stage.time[:, 0] > time, joint] = level
            time += stage.rng.uniform(shortest, longest)
        rows[stage.time[:, 0] > stage.seconds - longest, joint] = 0.0
    return rows


def steps_small(stage: Stage) -> np.ndarray:
    """Jump a little."""
    return _steps(stage, np.minimum(SMALL, stage.half))


def steps_large(stage: Stage) -> np.ndarray:
    """Jump as far as may be."""
    return _steps(stage, stage.half)


def slow(stage: Stage) -> np.ndarray:
    """Ramp up, down and back at three sizes, so that loops lie within loops."""
    sizes = stage.rng.permuted(np.tile([1.0, 0.5, 0.25], (len(stage.half), 1)), axis=1)
    cycle = stage.seconds / sizes.shape[1]
    number = np.minimum(stage.time // cycle, sizes.shape[1] - 1.0).astype(int)
    size = np.take_along_axis(sizes.T, number, axis=0)
    return stage.sides * size * _triangle(stage, cycle, SLOW)


def creep(stage: Stage) -> np.ndarray:
    """Ramp up, down and back once, hardly moving."""
    return stage.sides * _triangle(stage, stage.seconds, CREEP)


def _triangle(stage: Stage, cycle: float, fastest: float) -> np.ndarray:
    """Go up, down and back again in `cycle` s, at most `fastest` rad/s."""
    wave = np.arcsin(np.sin(2.0 * np.pi * stage.time / cycle)) / (0.5 * np.pi)
    return np.minimum(stage.half, 0.25 * fastest * cycle) * wave


def holds(stage: Stage) -> np.ndarray:
    """Rest in poses that share out the range, every joint in its own order."""
    levels = np.tile(np.linspace(-1.0, 1.0, POSES), (len(stage.half), 1))
    levels = stage.rng.permuted(levels, axis=1).T
    ends = np.concatenate([levels, 0.0 * levels[:1]])
    begins = np.concatenate([0.0 * levels[:1], levels])
    slot = stage.time / stage.seconds * len(ends)
    number = np.minimum(slot[:, 0].astype(int), len(ends) - 1)
    share = smooth((slot - number[:, None]) / 0.4)
    return stage.half * (begins[number] + share * (ends - begins)[number])


def multisine(stage: Stage) -> np.ndarray:
    """Sum tones of equal speed and random phase."""
    tones = np.maximum(np.rint(TONES * stage.seconds), 1.0) / stage.seconds
    tones = tones[tones <= stage.rate_hz / 8.0]
    phase = stage.rng.uniform(0.0, 2.0 * np.pi, (len(stage.half), len(tones)))
    angle = 2.0 * np.pi * stage.time[:, :, None] * tones + phase
    wave = _faded(stage) * np.sum(np.sin(angle) / tones, axis=-1)
    fastest = np.abs(np.diff(wave, axis=0)).max(axis=0) * stage.rate_hz
    size = np.minimum(
        stage.half / np.abs(wave).max(axis=0), PUSH * stage.speed / fastest
    )
    return size * wave


def _burst(stage: Stage, begin: float, end: float) -> np.ndarray:
    """Vibrate quickly between two times; unit [T, 1]."""
    share = np.clip((stage.time - begin) / (end - begin), 0.0, 1.0)
    window = np.where(share < 1.0, np.sin(np.pi * share) ** 2, 0.0)
    return window * np.sin(2.0 * np.pi * BURST * (stage.time - begin))


def repeated(stage: Stage) -> np.ndarray:
    """Do the same five times: vibrate, then jump to both sides, then rest."""
    piece = stage._replace(rows=stage.rows // REPEATS)
    share = piece.time / piece.seconds
    jump = 1.0 * ((share > 0.5) & (share <= 0.65)) - 1.0 * (
        (share > 0.65) & (share <= 0.8)
    )
    once = stage.sides * (
        piece.swing(BURST) * _burst(piece, 0.0, 0.45 * piece.seconds)
        + piece.half * jump
    )
    rest = np.zeros((stage.rows - REPEATS * piece.rows, len(stage.half)))
    return np.concatenate([*[once] * REPEATS, rest])


def together_alone(stage: Stage) -> np.ndarray:
    """Vibrate joint after joint, then all at once for twice as long."""
    count = len(stage.half)
    groups = min(count, GROUPS)
    group = stage.rng.permutation(count) % groups
    slot = stage.seconds / (groups + 2)
    wave = _burst(stage, groups * slot, stage.seconds)
    for number in range(groups):
        alone = _burst(stage, number * slot, (number + 1) * slot)
        wave = wave + alone * (group == number)
    return stage.sides * stage.swing(BURST) * wave


def rich(stage: Stage) -> np.ndarray:
    """Sweep, jump, ramp and rest, one after the other."""
    parts = ((chirp, 0.3), (steps_large, 0.25), (slow, 0.25), (holds, 0.2))
    ends = np.rint(np.cumsum([share for _, share in parts]) * stage.rows).astype(int)
    lengths = np.diff(ends, prepend=0)
    return np.concatenate(
        [
            pattern(stage._replace(rows=int(rows)))
            for (pattern, _), rows in zip(parts, lengths)
        ]
    )
