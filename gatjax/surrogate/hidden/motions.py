"""What the robots are told to do."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gatjax.surrogate.hidden.robots import Robot

LIVELY, OTHERS = "rich", ("slow", "steps", "gait", "multisine")
FASTEST = 3.0  # rad/s, of smooth motions
SHARE = 0.4  # of the range of a joint, largest swing around home
WIDEST = 0.75  # rad
FADE = 0.7  # s


def _swing(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """The largest swing [J] of this motion around home, rad."""
    room = np.minimum(SHARE * (robot.high - robot.low), WIDEST)
    return room * rng.uniform(0.55, 1.0, room.shape)


def _sines(
    time: np.ndarray, frequency: np.ndarray, weight: np.ndarray, phase: np.ndarray
) -> np.ndarray:
    """Sums of sines [K, J] within +-1: frequency, weight and phase [S, J]."""
    angle = 2.0 * np.pi * frequency * time[:, None, None] + phase
    speed = 2.0 * np.pi * np.sum(frequency * weight, axis=0)
    shape = np.sum(weight * np.sin(angle), axis=1)
    largest = np.maximum(np.abs(shape).max(0), 1e-9)
    calm = np.minimum(1.0 / largest, FASTEST / WIDEST / np.maximum(speed, 1e-9))
    return shape * calm


def _fade(time: np.ndarray, seconds: float) -> np.ndarray:
    """From 0 to 1 and back [K, 1], smooth."""
    edge = np.clip(np.minimum(time, seconds - time) / FADE, 0.0, 1.0)
    return (edge**2 * (3.0 - 2.0 * edge))[:, None]


def gait(time: np.ndarray, joints: int, rng: np.random.Generator) -> np.ndarray:
    """Periodic and smooth, one rhythm for all joints; [K, J] within +-1."""
    order = np.arange(1.0, 4.0)[:, None] * np.ones(joints)
    weight = rng.uniform(0.3, 1.0, order.shape) / order**1.3
    phase = rng.uniform(0.0, 2.0 * np.pi, order.shape)
    shape = _sines(time, rng.uniform(0.5, 1.1) * order, weight, phase)
    return shape * _fade(time, time[-1])


def multisine(time: np.ndarray, joints: int, rng: np.random.Generator) -> np.ndarray:
    """Seven sines a joint from 0.1 to 3 Hz; [K, J] within +-1."""
    count = (7, joints)
    frequency = np.exp(rng.uniform(np.log(0.1), np.log(3.0), count))
    weight = (0.3 / frequency) ** 0.6
    phase = rng.uniform(0.0, 2.0 * np.pi, count)
    return _sines(time, frequency, weight, phase) * _fade(time, time[-1])


def steps(time: np.ndarray, joints: int, rng: np.random.Generator) -> np.ndarray:
    """Jumps to random places; [K, J] within +-1."""
    shape = np.zeros((len(time), joints))
    for joint in range(joints):
        moment, place = rng.uniform(0.3, 0.8), 0.0
        while moment < time[-1]:
            place = np.clip(place + rng.choice([-1, 1]) * rng.uniform(0.25, 1), -1, 1)
            shape[time >= moment, joint] = place
            moment += rng.uniform(0.5, 1.4)
    return shape * 0.7


def slow(time: np.ndarray, joints: int, rng: np.random.Generator) -> np.ndarray:
    """Ramps with reversals and rests; [K, J] within +-1."""
    shape = np.zeros((len(time), joints))
    for joint in range(joints):
        moments, places = [0.0, 0.3], [0.0, 0.0]
        while moments[-1] < time[-1]:
            place = rng.uniform(0.25, 1.0) * (-1.0 if places[-1] > 0.0 else 1.0)
            pace = np.exp(rng.uniform(np.log(0.15), np.log(1.2)))
            moments.append(moments[-1] + abs(place - places[-1]) / pace + 0.05)
            places.append(place)
            if rng.uniform() < 0.4:
                moments.append(moments[-1] + rng.uniform(0.2, 0.8))
                places.append(place)
        shape[:, joint] = np.interp(time, moments, places)
    return shape


def chirp(time: np.ndarray, joints: int, rng: np.random.Generator) -> np.ndarray:
    """From 0.2 to some 4 Hz, smaller as it gets faster; [K, J] within +-1."""
    top = rng.uniform(3.0, 5.0, joints)
    rate = np.log(top / 0.2) / time[-1]
    growth = np.exp(rate * time[:, None])
    phase = 2.0 * np.pi * 0.2 * (growth - 1.0) / rate + rng.choice([0.0, np.pi], joints)
    size = np.minimum(1.0, FASTEST / WIDEST / (2.0 * np.pi * 0.2 * growth))
    return size * np.sin(phase) * _fade(time, time[-1])


def rich(time: np.ndarray, joints: int, rng: np.random.Generator) -> np.ndarray:
    """Chirp, steps, slow ramps and a rest, one after the other; [K, J] within +-1."""
    shape = np.zeros((len(time), joints))
    parts, first = (chirp, steps, slow), 0
    for part, share in zip(parts, (0.42, 0.26, 0.26), strict=True):
        last = first + int(share * len(time))
        piece = part(time[: last - first], joints, rng)
        shape[first:last] = piece + (shape[first - 1] - piece[0] if first else 0.0)
        first = last
    shape[first:] = shape[first - 1]
    return np.clip(shape, -1.0, 1.0)


MOTIONS: dict[str, Callable[..., np.ndarray]] = {
    "rich": rich, "slow": slow, "steps": steps, "gait": gait, "multisine": multisine,
}  # fmt: skip


def commands(
    robot: Robot, kind: str, time: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Commands [K, J] rad at times [K] s from 0; they begin near home.

    Raises:
        ValueError: there is no such motion.
    """
    if kind not in MOTIONS:
        raise ValueError(f"motion {kind!r} is unknown; choose from {list(MOTIONS)}")
    shape = MOTIONS[kind](time, len(robot.joints), rng)
    target = robot.home + _swing(robot, rng) * shape
    return np.clip(target, robot.low, robot.high)
