"""Effects that are in no list; the right verdict is `unknown`."""

from __future__ import annotations

import numpy as np

from gatjax.surrogate.hidden.causes import (
    Cause,
    Details,
    between,
    by_gain,
    either_sign,
    extra,
    plain,
    rungs,
    with_details,
)
from gatjax.surrogate.hidden.numbers import Specimen
from gatjax.surrogate.hidden.robots import Robot


def _springs(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    gain = robot.model.actuator_gainprm[joints[0], 0]
    rest = robot.home[joints[0]] + rng.uniform(-0.3, 0.3)
    return rungs(0.01 * gain, 0.4 * gain), {"rest": float(rest)}


def _hysteresis(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    gain = robot.model.actuator_gainprm[joints[0], 0]
    return rungs(0.02 * gain, 1.5 * gain), {"width": float(rng.uniform(0.05, 0.3))}


def _side(robot: Robot, joints: list[int], rng: np.random.Generator) -> Details:
    """A place near home on one side of a joint."""
    side = float(rng.choice([-1.0, 1.0]))
    room = robot.high[joints[0]] - robot.low[joints[0]]
    start = robot.home[joints[0]] + side * room * rng.uniform(-0.02, 0.08)
    return {"side": side, "start": float(start)}


def _stops(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    gain = robot.model.actuator_gainprm[joints[0], 0]
    return rungs(0.05 * gain, 4.0 * gain), _side(robot, joints, rng)


def _cables(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    gain = robot.model.actuator_gainprm[joints[0], 0]
    return rungs(0.02 * gain, 1.0 * gain), _side(robot, joints, rng)


def _patches(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    values, _ = by_gain(0.01, 0.15)(robot, joints, rng)
    centre = robot.home[joints[0]] + rng.uniform(-0.2, 0.2)
    return values, {"centre": float(centre), "width": float(rng.uniform(0.05, 0.2))}


def _drags(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    damping = robot.model.dof_damping[robot.velocity[joints[0]]]
    return rungs(0.05 * damping, 1.5 * damping), {}


def _neighbours(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    others = [j for j in range(len(robot.joints)) if abs(j - joints[0]) in (1, 2)]
    source = int(rng.choice(others))
    values = rng.choice([-1.0, 1.0]) * rungs(0.02, 0.8)
    return values, {"ahead": float(source - joints[0])}


def _skew(
    specimen: Specimen, robot: Robot, joints: list[int], value: float, more: Details
) -> Specimen:
    return extra("sign_gain", "skew")(specimen, robot, joints, value, more)


OUTSIDE: dict[str, Cause] = {
    "parallel_spring": Cause(
        "stiffness", "N*m/rad", _springs, extra("spring", "stiffness")
    ),
    "quadratic_drag": Cause(
        "coefficient", "N*m*s^2/rad^2", _drags, extra("drag", "coefficient")
    ),
    "cross_talk": Cause(
        "gain", "1", _neighbours, extra("cross_talk", "gain"), robots="many", sites=4
    ),
    "periodic_disturbance": Cause(
        "amplitude",
        "N*m",
        with_details(
            by_gain(0.004, 0.1), frequency=between(0.3, 3.0), phase=between(0.0, 6.28)
        ),
        extra("shake", "amplitude"),
    ),
    "sudden_torque": Cause(
        "torque",
        "N*m",
        either_sign(with_details(by_gain(0.006, 0.1), start=between(2.0, 6.0))),
        extra("onset", "torque"),
    ),
    "rough_patch": Cause("torque", "N*m", _patches, extra("rough_patch", "torque")),
    "integral_term": Cause(
        "gain",
        "N*m/(rad*s)",
        lambda robot, joints, rng: (
            rungs(0.1, 4.0) * robot.model.actuator_gainprm[joints[0], 0],
            {},
        ),
        extra("integral", "gain"),
    ),
    "encoder_eccentricity": Cause(
        "amplitude",
        "rad",
        with_details(plain(0.01, 0.25), phase=between(-3.1, 3.1)),
        extra("eccentricity", "amplitude"),
    ),
    "soft_stop": Cause("stiffness", "N*m/rad", _stops, extra("soft_stop", "stiffness")),
    "cable_pull": Cause("pull", "N*m/rad", _cables, extra("cable", "pull")),
    "sticking_episode": Cause(
        "torque",
        "N*m",
        with_details(
            by_gain(0.02, 0.4), start=between(1.0, 5.0), duration=between(1.0, 3.0)
        ),
        extra("episode", "torque"),
    ),
    "power_loss": Cause(
        "duration",
        "s",
        with_details(
            plain(0.04, 0.5), start=between(0.5, 2.0), interval=between(1.5, 3.0)
        ),
        extra("power_loss", "duration"),
    ),
    "hysteretic_spring": Cause(
        "stiffness", "N*m/rad", _hysteresis, extra("bouc_wen", "stiffness")
    ),
    "uneven_gain": Cause("skew", "1", either_sign(plain(0.04, 0.7)), _skew),
}
