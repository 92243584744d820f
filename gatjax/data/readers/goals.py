"""Joint trajectories: the path of commands between points that are far apart.

`joint_trajectory_controller` of ros2_control (spline interpolation) goes straight from
point to point, and on cubics where the points have speeds.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

FAR = 0.02  # s between points: less is a stream of commands already
STEP = 0.01  # s


class Path(NamedTuple):
    """Commands of one message."""

    time: np.ndarray  # [N] s from its start
    position: np.ndarray  # [N, J] rad
    filled: bool  # there are others than its points


def path_of(body: Any) -> Path:
    """The commands that a `trajectory_msgs/JointTrajectory` asks for.

    Raises:
        ValueError: one line: points without positions, or not in order.
    """
    count = len(body.joint_names)
    after = [point.time_from_start for point in body.points]
    time = np.array([each.sec + 1e-9 * each.nanosec for each in after])
    if not count or any(len(point.positions) != count for point in body.points):
        raise ValueError(
            f"a JointTrajectory of {', '.join(body.joint_names)} has a point without a "
            f"position of each"
        )
    place = np.array([point.positions for point in body.points], float)
    place = place.reshape(len(time), count)
    gaps = np.diff(time)
    if (gaps <= 0.0).any():
        raise ValueError("points of a JointTrajectory are not in the order of time")
    if not (gaps > FAR).any():
        return Path(time, place, False)
    between = [
        begin + STEP * np.arange(1, int(np.ceil(gap / STEP)))
        for begin, gap in zip(time[:-1], gaps, strict=True) if gap > FAR
    ]  # fmt: skip
    every = np.sort(np.concatenate([time, *between]))
    if all(len(point.velocities) == count for point in body.points):
        speed = np.array([point.velocities for point in body.points], float)
        return Path(every, CubicHermiteSpline(time, place, speed)(every), True)
    straight = [np.interp(every, time, place[:, j]) for j in range(count)]
    return Path(every, np.stack(straight, 1), True)
