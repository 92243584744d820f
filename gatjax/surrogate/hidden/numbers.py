"""The numbers of one robot specimen: nominal, or drawn around the nominal ones.

`Numbers` is a dict of arrays; `stack` puts specimens together along a first axis.
What only a few joints have (play, dead band, ripple...) is an `Extra`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gatjax.surrogate.hidden.robots import Robot

Numbers = dict[str, np.ndarray]

TOLERANCE = {
    "kp": 0.05, "kv": 0.10, "damping": 0.10, "armature": 0.10, "limit": 0.06,
    "coulomb": 0.30, "mass": 0.025, "inertia": 0.05,
}  # fmt: skip
"""Relative standard deviations (docs/files.md: every nominal number is wrong)."""
CENTRE = 0.002  # m, centre of mass, all three axes together
MOUNTING = np.deg2rad(0.2)
ZERO = np.deg2rad(0.1)
TRANSPORT = 0.002  # s, at most
PERIOD = 0.001  # s, servo loop, at most
STRIBECK = 0.4  # of the dry friction, at most
WIDEST = 2.0  # standard deviations, draws beyond are cut


class Extra(NamedTuple):
    """Something that one joint of one specimen has and the nominal robot lacks."""

    kind: str  # a name in `terms.TERMS`, "gear" or "heat"
    joint: int
    values: dict[str, float]


class Specimen(NamedTuple):
    """One robot."""

    numbers: Numbers
    extras: tuple[Extra, ...] = ()


def nominal(robot: Robot) -> Numbers:
    """The numbers of the robot file; [J], [B] and scalars as arrays."""
    model, zero = robot.model, np.zeros(len(robot.joints))
    damping, friction = model.dof_damping.copy(), model.dof_frictionloss.copy()
    for follower, driver in zip(model.eq_obj1id, model.eq_obj2id, strict=True):
        one, other = model.jnt_dofadr[follower], model.jnt_dofadr[driver]
        damping[other] += damping[one]  # both joints turn with one motor
        friction[other] += friction[one]
    return {
        "kp": model.actuator_gainprm[:, 0].copy(),
        "kv": -model.actuator_biasprm[:, 2],
        "limit": model.actuator_forcerange[:, 1].copy(),
        "damping": damping[robot.velocity],
        "armature": model.dof_armature.copy(),  # [nv]
        "coulomb": friction[robot.velocity],
        "stribeck": zero.copy(),  # N m
        "stribeck_velocity": zero + 0.1,  # rad/s
        "mass": model.body_mass.copy(),  # [B] kg
        "centre": model.body_ipos.copy(),  # [B, 3] m
        "inertia": model.body_inertia.copy(),  # [B, 3] kg m^2
        "tilt": np.zeros(2),  # rad, roll and pitch of the mounting or the ground
        "period": np.array(0.0),  # s, servo loop
        "bristle": np.array(6e-4),  # rad, deflection at which friction gives way
        "sag": np.array(0.0),  # share lost per N m of all motors together
        "delay": zero.copy(),  # s, command
        "lag": zero.copy(),  # s
        "lost": zero.copy(),  # share of targets
        "quantum": zero.copy(),  # rad
        "target_speed": zero + np.inf,  # rad/s
        "offset_loop": zero.copy(),  # rad, seen by the servo and the log
        "offset_log": zero.copy(),  # rad, in the log only
        "scale_log": zero + 1.0,
        "late": zero.copy(),  # s, measurement
        "drift": np.array(0.0),  # s/s
        "imu": np.zeros(3),  # rad, rotation vector
        "mu": np.array(1.0),
        "softness": np.array(0.012),  # s, contact time constant
        "wear": np.zeros(8),  # m, per sole corner
    }


def draw(robot: Robot, rng: np.random.Generator) -> Numbers:
    """A specimen from the production line; nothing of this is a hidden effect."""
    numbers = nominal(robot)

    def normal(shape: tuple[int, ...] | int) -> np.ndarray:
        return np.clip(rng.standard_normal(shape), -WIDEST, WIDEST)

    for name, tolerance in TOLERANCE.items():
        shape = numbers[name].shape[:1]
        factor = np.maximum(1.0 + tolerance * normal(shape), 0.1)
        numbers[name] = (numbers[name].T * factor).T
    shift = CENTRE / np.sqrt(3.0) * normal(numbers["centre"].shape)
    numbers["centre"] = numbers["centre"] + shift
    numbers["tilt"] = MOUNTING * normal(2)
    count = len(robot.joints)
    numbers["offset_log"] = ZERO * normal(count)
    numbers["delay"] = np.full(count, rng.uniform(0.0, TRANSPORT))
    numbers["period"] = np.array(rng.uniform(0.0, PERIOD))
    numbers["stribeck"] = numbers["coulomb"] * rng.uniform(0.0, STRIBECK, count)
    numbers["stribeck_velocity"] = rng.uniform(0.05, 0.3, count)
    numbers["bristle"] = np.array(np.exp(rng.uniform(np.log(3e-4), np.log(1.2e-3))))
    numbers["mu"] = np.array(1.0 + 0.1 * float(normal(1)[0]))
    numbers["softness"] = np.array(0.012 * (1.0 + 0.1 * float(normal(1)[0])))
    return numbers


def stack(specimens: list[Specimen]) -> Numbers:
    """All numbers with a first axis [L]."""
    first = specimens[0].numbers
    return {name: np.stack([s.numbers[name] for s in specimens]) for name in first}
