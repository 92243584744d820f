"""The 15 parameters of the walk, which are the policy, and the engine's constants.

Sources: LARG/robotics-2018 @ 34e3697c (names, limits), LARG/spl-release @ 94452106
(theta0, December 2016, the time of the paper). Bounds and search steps come from a
feasibility study of gatjax (closed loop on a NAO model, CMA-ES).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

Array = Any


class Parameter(NamedTuple):
    """One searchable number of the walk."""

    name: str
    unit: str
    theta0: float  # value of the hand-tuned walk
    low: float  # bounds of the search
    high: float
    step: float  # one unit of the search distribution
    meaning: str


PARAMETERS = (
    Parameter("com_offset", "m", 0.010, -0.015, 0.035, 0.003, "body ahead of feet"),
    Parameter("forward_change", "m/s", 0.15, 0.08, 0.35, 0.03, "speed gain per step"),
    Parameter("left_change", "m/s", 0.20, 0.03, 0.40, 0.03, "side speed gain per step"),
    Parameter("turn_change", "rad/s", 0.80, 0.10, 2.0, 0.10, "inert in practice"),
    Parameter("base_walk_period", "s", 0.23, 0.18, 0.30, 0.012, "time of one step"),
    Parameter("walk_hip_height", "m", 0.23, 0.19, 0.243, 0.004, "hip over ground"),
    Parameter("max_forward", "m/s", 0.30, 0.15, 0.50, 0.04, "speed at request 1"),
    Parameter("max_left", "m/s", 0.20, 0.05, 0.30, 0.03, "side speed at request 1"),
    Parameter("max_turn", "rad/s", 0.87, 0.30, 1.5, 0.10, "turn speed at request 1"),
    Parameter("base_leg_lift", "m", 0.010, 0.003, 0.035, 0.002, "foot lift"),
    Parameter("arm_swing", "rad/m", 6.0, 0.0, 14.0, 1.0, "arm against leg"),
    Parameter(
        "pendulum_height", "mm", 300.0, 200.0, 400.0, 30.0, "inert in the engine"
    ),
    Parameter(
        "forward_extra_foot_height", "m/m", 0.01, 0.0, 0.1, 0.01, "lift per step"
    ),
    Parameter(
        "left_extra_foot_height", "m/m", 0.02, 0.0, 0.1, 0.01, "lift per sidestep"
    ),
    Parameter("start_lift_divisor", "1", 3.5, 1.5, 6.0, 0.5, "lower first step"),
)
"""Order of the policy vector [15]."""

NAMES = tuple(parameter.name for parameter in PARAMETERS)
THETA0 = np.array([parameter.theta0 for parameter in PARAMETERS])
LOW = np.array([parameter.low for parameter in PARAMETERS])
HIGH = np.array([parameter.high for parameter in PARAMETERS])
STEP = np.array([parameter.step for parameter in PARAMETERS])


class Gait(NamedTuple):
    """The policy vector by name; units as in `PARAMETERS`."""

    com_offset: Array
    forward_change: Array
    left_change: Array
    turn_change: Array
    base_walk_period: Array
    walk_hip_height: Array
    max_forward: Array
    max_left: Array
    max_turn: Array
    base_leg_lift: Array
    arm_swing: Array
    pendulum_height: Array
    forward_extra_foot_height: Array
    left_extra_foot_height: Array
    start_lift_divisor: Array


def unpack(policy: Array) -> Gait:
    """Name the entries of a policy vector [..., 15]."""
    return Gait(*(policy[..., index] for index in range(len(PARAMETERS))))


class Constants(NamedTuple):
    """Engine constants outside the 15 parameters (ut15 values)."""

    stand_hip_height: float = 0.248  # m
    crouch_stand_period: float = 0.5  # s
    sidestep_extra_period: float = 0.05  # s at full sideways speed
    min_switch_fraction: float = 0.75  # of the step time
    timeout_multiple: float = 3.0  # of the step time
    gyro_filter_old_weight: float = 0.75  # per 10 ms
    ankle_gyro_divisor: float = 25.0  # 1/s, gain 0.04 rad per rad/s
