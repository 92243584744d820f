"""Joint trajectories: the path of commands between points that are far apart.

`joint_trajectory_controller` of ros2_control (spline interpolation) goes straight from
point to point, and on cubics where the points have speeds. A new trajectory takes over
when it comes, from where the commands are then, or the joints where there are none.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

FAR = 0.02  # s between points: less is a stream of commands already
STEP = 0.001  # s, of the path: rows hold it until the next one
SPAN = 0.01  # s that tell the speed of a path


class Goal(NamedTuple):
    """What one message asks for."""

    joints: tuple[str, ...]
    begin: float  # s, when it takes over
    time: np.ndarray  # [N] s, of its points
    position: np.ndarray  # [N, J] rad
    velocity: np.ndarray | None  # [N, J] rad/s, where all points have one


class Path(NamedTuple):
    """Commands, message by message."""

    time: np.ndarray  # [N] s
    position: np.ndarray  # [N, J] rad
    filled: bool  # there are others than points of the messages


def goal_of(body: Any, begin: float) -> Goal:
    """What a `trajectory_msgs/JointTrajectory` that takes over at `begin` s asks for.

    It has at least a point.

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
    if (np.diff(time) <= 0.0).any():
        raise ValueError("points of a JointTrajectory are not in the order of time")
    place = np.array([point.positions for point in body.points], float)
    place, speed = place.reshape(len(time), count), None
    if all(len(point.velocities) == count for point in body.points):
        speed = np.array([point.velocities for point in body.points], float)
    return Goal(tuple(body.joint_names), begin, begin + time, place, speed)


def followed(
    goals: Sequence[Goal], joints: Sequence[str], seen: Callable[[str, float], float]
) -> Path:
    """The commands of goals in the order in which they came; each ends the one before.

    Where a goal takes over before its first point, the commands go there from where
    they are; from where the joint is, if it had none. Joints that a goal does not name
    stay where they are.

    Args:
        goals: in the order in which they came.
        joints: that any of them names.
        seen: angle of a joint at a time, s; NaN where it was not measured.

    Returns:
        Commands; NaN where nobody knows them.
    """
    ends = [np.inf]
    for goal in goals[:0:-1]:
        ends.append(min(ends[-1], goal.begin))
    before = Path(np.zeros(1), np.full((1, len(joints)), np.nan), False)
    parts: list[Path] = []
    for goal, end in zip(goals, ends[::-1], strict=True):
        if goal.begin >= end:
            continue  # another one came before it began
        begun = np.array([seen(name, goal.begin) if name in goal.joints else np.nan
                          for name in joints])  # fmt: skip
        before = _path(_joined(before, _every(goal, joints, before), begun))
        own = before.time < end
        parts.append(Path(before.time[own], before.position[own], before.filled))
    return Path(
        np.concatenate([part.time for part in parts]),
        np.concatenate([part.position for part in parts]),
        any(part.filled for part in parts),
    )


def _places(before: Path, time: np.ndarray) -> np.ndarray:
    """Where commands were, [N, J]; NaN before there were any."""
    return np.stack(
        [np.interp(time, before.time, q, left=np.nan) for q in before.position.T], 1
    )


def _every(goal: Goal, joints: Sequence[str], before: Path) -> Goal:
    """A goal of all joints, in their order."""
    place = np.tile(_places(before, np.array([goal.begin])), (len(goal.time), 1))
    columns = [joints.index(name) for name in goal.joints]
    place[:, columns] = goal.position
    speed = None
    if goal.velocity is not None:
        speed = np.zeros_like(place)
        speed[:, columns] = goal.velocity
    return goal._replace(joints=tuple(joints), position=place, velocity=speed)


def _joined(before: Path, goal: Goal, begun: np.ndarray) -> Goal:
    """A goal with a point where it takes over, if its own begin later.

    Joints without commands until then, as they were measured, begin at `begun` [J].
    """
    at = np.array([goal.begin - SPAN, goal.begin])
    place = _places(before, at)
    fresh = ~np.isfinite(place).all(0)
    place[:, fresh] = begun[fresh]
    if goal.time[0] <= goal.begin or np.isnan(place).all():
        return goal
    speed = goal.velocity
    if speed is not None:
        still = goal.begin >= before.time[-1]
        now = (place[1:] - place[:1]) * (0.0 if still else 1.0 / SPAN)
        speed = np.concatenate([np.nan_to_num(now), speed])
    return Goal(
        goal.joints,
        goal.begin,
        np.concatenate([at[1:], goal.time]),
        np.concatenate([place[1:], goal.position]),
        speed,
    )


def _path(goal: Goal) -> Path:
    """Its points, and commands between those that are far apart."""
    time, place, gaps = goal.time, goal.position, np.diff(goal.time)
    if not (gaps > FAR).any():
        return Path(time, place, False)
    between = [
        begin + STEP * np.arange(1, int(np.ceil(gap / STEP - 1e-3)))
        for begin, gap in zip(time[:-1], gaps, strict=True) if gap > FAR
    ]  # fmt: skip
    every = np.sort(np.concatenate([time, *between]))
    straight = np.stack([np.interp(every, time, q) for q in place.T], 1)
    if goal.velocity is None:
        return Path(every, straight, True)
    curved = CubicHermiteSpline(time, np.nan_to_num(place), goal.velocity)(every)
    return Path(every, np.where(np.isnan(straight), np.nan, curved), True)
