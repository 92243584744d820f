"""Poses of a torso: matrices, quaternions, roll and pitch."""

from __future__ import annotations

from typing import Any

import numpy as np

from gatjax.records import Base

Array = Any


def placed(pose: Array) -> Base:
    """Position and quaternion of a pose [4, 4], world from torso."""
    r = pose[:3, :3]
    # Four times the outer product of the quaternion with itself; its longest row leads.
    off = [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]
    square = np.zeros((4, 4))
    square[0, 0] = 1.0 + np.trace(r)
    square[0, 1:] = square[1:, 0] = off
    square[1:, 1:] = r + r.T + (1.0 - np.trace(r)) * np.eye(3)
    row = square[np.argmax(np.diag(square))]
    quaternion = row / np.linalg.norm(row)
    sign = 1.0 if quaternion[0] >= 0.0 else -1.0
    return Base(pose[:3, 3].copy(), sign * quaternion)


def tilt_of(quaternion: Array) -> Array:
    """Roll and pitch [2] of a torso, rad: quaternion w x y z, torso to world."""
    w, x, y, z = quaternion
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return np.array([roll, np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))])


def tilt_below(up: Array) -> Array:
    """Roll and pitch [2] of a torso, rad, in whose axes this [3] is up (any length)."""
    x, y, z = up
    return np.array([np.arctan2(y, z), np.arctan2(-x, np.hypot(y, z))])
