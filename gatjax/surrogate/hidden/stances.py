"""What a robot on its feet is told to do: slow enough not to fall."""

from __future__ import annotations

import numpy as np

from gatjax.surrogate.hidden.motions import gait, multisine
from gatjax.surrogate.hidden.robots import Robot

ARMS = ("Shoulder", "Elbow", "Wrist", "Head")
STANCES = ("squat", "shift", "sway", "stepping")
SIDE = 0.17  # rad, hip and ankle roll that bring the weight over one foot
FADE = 0.8  # s


def _edge(time: np.ndarray, seconds: float) -> np.ndarray:
    edge = np.clip(np.minimum(time, seconds - time) / FADE, 0.0, 1.0)
    return edge**2 * (3.0 - 2.0 * edge)


def stance(
    robot: Robot, kind: str, time: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Commands [K, J] rad at times [K] s of a robot on the floor.

    Args:
        robot: a NAO.
        kind: squat, shift (weight from foot to foot), sway (both, and arms), stepping
            (in place; the free foot leaves the ground).
        time: from 0.
        rng: draws sizes and rhythms.
    """
    target = np.tile(robot.home, (len(time), 1))
    slot = {name: index for index, name in enumerate(robot.joints)}
    edge = _edge(time, time[-1])
    bend, side = np.zeros_like(time), np.zeros_like(time)
    lift = {"L": np.zeros_like(time), "R": np.zeros_like(time)}
    if kind in ("squat", "sway"):
        shape = gait(time, 1, rng)[:, 0] + 0.4 * multisine(time, 1, rng)[:, 0]
        bend = rng.uniform(0.15, 0.25) * shape
    if kind in ("shift", "sway"):
        share = rng.uniform(0.35, 0.65)
        side = share * SIDE * np.sin(2.0 * np.pi * rng.uniform(0.25, 0.45) * time)
    if kind == "stepping":
        beat = rng.uniform(0.3, 0.38) * time
        lean = np.tanh(1.5 * np.sin(2.0 * np.pi * beat)) / np.tanh(1.5)
        side = SIDE * rng.uniform(0.72, 0.82) * lean
        raise_ = np.clip(np.sin(2.0 * np.pi * beat), 0.0, None) ** 3
        lower = np.clip(-np.sin(2.0 * np.pi * beat), 0.0, None) ** 3
        height = rng.uniform(0.06, 0.14)
        lift = {"L": height * lower, "R": height * raise_}
    side = side * edge
    for leg in "LR":
        flex = edge * (bend + lift[leg])
        target[:, slot[f"{leg}HipPitch"]] -= flex
        target[:, slot[f"{leg}KneePitch"]] += 2.0 * flex
        target[:, slot[f"{leg}AnklePitch"]] -= flex
        target[:, slot[f"{leg}HipRoll"]] += side
        target[:, slot[f"{leg}AnkleRoll"]] -= side
    arms = [index for name, index in slot.items() if any(arm in name for arm in ARMS)]
    size = {"squat": 0.5, "shift": 0.5, "sway": 0.6, "stepping": 0.2}[kind]
    moves = gait(time, len(arms), rng) + multisine(time, len(arms), rng)
    target[:, arms] += size * rng.uniform(0.3, 1.0, len(arms)) * moves
    return np.clip(target, robot.low, robot.high)
