"""Every cause of the catalogue as a `Cause`, named as in docs/diagnosis.md."""

from __future__ import annotations

import numpy as np

from gatjax.surrogate.hidden import feet
from gatjax.surrogate.hidden.causes import (
    Cause,
    Details,
    add,
    between,
    by_gain,
    either_sign,
    extra,
    field,
    plain,
    put,
    rungs,
    scale,
    whole,
    with_details,
)
from gatjax.surrogate.hidden.numbers import Specimen
from gatjax.surrogate.hidden.robots import Robot

SITES = 4
RIGID = np.inf  # N m/rad, a gear without give


def _gains(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    low = rng.uniform() < 0.6
    return 1.0 - rungs(0.04, 0.75) if low else 1.0 + rungs(0.06, 1.5), {}


def _dampings(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    """A multiple of kv that adds to all damping like a viscous coefficient would."""
    damping, rate = _braking(robot, joints)
    return 1.0 + rungs(0.08, 2.0) * damping / rate, {}


def _viscous(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    return rungs(0.06, 2.0) * _braking(robot, joints)[0], {}


def _braking(robot: Robot, joints: list[int]) -> tuple[float, float]:
    """Damping and kv together, and kv, of the first joint, N m s/rad."""
    rate = -robot.model.actuator_biasprm[joints[0], 2]
    return float(robot.model.dof_damping[robot.velocity[joints[0]]] + rate), float(rate)


def _limits(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    limit = robot.model.actuator_forcerange[joints[0], 1]
    return rungs(0.7 * limit, 0.05 * limit), {}


def _saturations(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    limit = robot.model.actuator_forcerange[joints[0], 1]
    return rungs(3.0 * limit, 0.08 * limit), {}


def _speeds(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    law = "motor" if rng.uniform() < 0.6 else "target"
    return rungs(12.0, 0.7), {"law": law}


def _top_speed(
    specimen: Specimen, robot: Robot, joints: list[int], value: float, more: Details
) -> Specimen:
    if more["law"] == "target":
        return field("target_speed", put)(specimen, robot, joints, value, more)
    ends = _torque_ends(robot, joints[0], value)
    return extra("motor_line", "limit")(specimen, robot, joints, ends, {})


def _torque_ends(robot: Robot, joint: int, top: float) -> float:
    """Speed at which a motor has no torque left, for a top speed against friction."""
    slot, model = robot.velocity[joint], robot.model
    stall = float(model.actuator_forcerange[joint, 1])
    spare = stall - float(model.dof_frictionloss[slot])
    braking = spare / top - float(model.dof_damping[slot])
    return stall / max(braking, 1e-3 * stall)


def _stiffness(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    gain = robot.model.actuator_gainprm[joints[0], 0]
    on_motor = rng.uniform() < 0.5
    # a loop closed around a spring softer than itself swings without end
    softest = 0.2 if on_motor else 1.2
    return rungs(6.0 * gain, softest * gain), {"encoder_on_motor": float(on_motor)}


def _inertias(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    return rungs(0.15, 6.0) * float(robot.inertia[joints[0]]), {}


def _masses(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    """A mass near the end of what hangs on the joint, with a noticeable arm."""
    body = int(robot.body[joints[0]])
    beside = rng.uniform(-0.02, 0.02, 3)
    point = robot.model.body_ipos[body] + beside
    weight = max(float(robot.model.body_mass[body]), 0.1)
    return rungs(0.06 * weight, 6.0 * weight), {"point": point.tolist()}


def load(
    specimen: Specimen, robot: Robot, joints: list[int], value: float, more: Details
) -> Specimen:
    """Adds a point mass to the link moved by a joint."""
    body, numbers = int(robot.body[joints[0]]), dict(specimen.numbers)
    mass, centre = numbers["mass"].copy(), numbers["centre"].copy()
    inertia = numbers["inertia"].copy()
    arm = np.array(more["point"]) - centre[body]
    reduced = value * mass[body] / (value + mass[body])
    # in the principal axes of the link: the small turn of the axes is left out
    inertia[body] += reduced * (arm @ arm - arm**2)
    centre[body] += arm * value / (value + mass[body])
    mass[body] += value
    numbers |= {"mass": mass, "centre": centre, "inertia": inertia}
    return specimen._replace(numbers=numbers)


def _shifts(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    """Across the joint's axis, where it matters."""
    axis = robot.model.jnt_axis[robot.model.body_jntadr[robot.body[joints[0]]]]
    way = np.cross(axis, rng.standard_normal(3))
    return rungs(0.003, 0.12), {"direction": (way / np.linalg.norm(way)).tolist()}


def _shift(
    specimen: Specimen, robot: Robot, joints: list[int], value: float, more: Details
) -> Specimen:
    centre = specimen.numbers["centre"].copy()
    centre[robot.body[joints[0]]] += value * np.array(more["direction"])
    return specimen._replace(numbers={**specimen.numbers, "centre": centre})


def _motor_inertia(
    specimen: Specimen, robot: Robot, joints: list[int], value: float, more: Details
) -> Specimen:
    slots = [int(robot.velocity[joint]) for joint in joints]
    return field("armature", add)(specimen, robot, slots, value, more)


def _tilts(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    heading = rng.uniform(-np.pi, np.pi)
    if len(robot.joints) == 1:  # about the joint's axis, or nothing is seen
        heading = rng.choice([0.0, np.pi]) + rng.normal(0.0, 0.3)
        heading += 0.5 * np.pi * abs(float(robot.model.jnt_axis[0][1]))
    strong = 0.07 if robot.floating else 0.5
    return rungs(0.012 if robot.floating else 0.015, strong), {"heading": heading}


def _tilt(
    specimen: Specimen, robot: Robot, joints: list[int], value: float, more: Details
) -> Specimen:
    way = np.array([np.cos(more["heading"]), np.sin(more["heading"])])
    tilt = specimen.numbers["tilt"] + value * way
    return specimen._replace(numbers={**specimen.numbers, "tilt": tilt})


def _offsets(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    inside = bool(rng.uniform() < 0.35)
    values = rungs(0.02, 0.25) if inside else rungs(0.004, 0.1)
    return values * rng.choice([-1.0, 1.0]), {"in_loop": inside}


def _offset(
    specimen: Specimen, robot: Robot, joints: list[int], value: float, more: Details
) -> Specimen:
    name = "offset_loop" if more["in_loop"] else "offset_log"
    return field(name, add)(specimen, robot, joints, value, more)


def _scales(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    return 1.0 + rng.choice([-1.0, 1.0]) * rungs(0.008, 0.2), {}


def _worn(robot: Robot, joints: list[int], rng: np.random.Generator) -> tuple:
    """Front, rear, left or right of one sole (joints: which foot)."""
    pair = rng.choice(np.array([[0, 1], [2, 3], [0, 2], [1, 3]]))
    return rungs(0.0005, 0.006), {"corners": (4 * joints[0] + pair).tolist()}


CATALOGUE: dict[str, Cause] = {
    "command_delay": Cause(
        "delay", "s", plain(0.0015, 0.07), field("delay", add), "any"
    ),
    "measurement_delay": Cause(
        "delay", "s", plain(0.0015, 0.07), field("late", add), "any"
    ),
    "dropped_commands": Cause(
        "probability", "1", plain(0.01, 0.75), field("lost", put), "any"
    ),
    "first_order_lag": Cause(
        "time_constant", "s", plain(0.0015, 0.08), field("lag", put), "any"
    ),
    "gain_error": Cause("scale", "1", _gains, field("kp", scale), "any"),
    "damping_error": Cause("scale", "1", _dampings, field("kv", scale)),
    "torque_limit": Cause("limit", "N*m", _limits, field("limit", put)),
    "speed_limit": Cause("limit", "rad/s", _speeds, _top_speed),
    "viscous_friction": Cause(
        "coefficient", "N*m*s/rad", _viscous, field("damping", add)
    ),
    "coulomb_friction": Cause(
        "torque", "N*m", by_gain(0.0025, 0.1), field("coulomb", add)
    ),
    "stiction": Cause(
        "excess",
        "N*m",
        with_details(by_gain(0.004, 0.15), velocity=between(0.05, 0.4)),
        extra("stiction", "excess"),
    ),
    "load_friction": Cause(
        "coefficient", "1", plain(0.04, 0.7), extra("load_friction", "coefficient")
    ),
    "backlash": Cause(
        "width",
        "rad",
        plain(0.006, 0.15),
        extra("gear", "play", stiffness=RIGID, encoder_on_motor=0.0),
    ),
    "dead_band": Cause(
        "half_width", "rad", plain(0.003, 0.09), extra("dead_band", "half_width")
    ),
    "command_quantization": Cause(
        "step", "rad", plain(0.005, 0.2), field("quantum", put)
    ),
    "joint_elasticity": Cause(
        "stiffness",
        "N*m/rad",
        _stiffness,
        extra("gear", "stiffness", play=0.0),
        sites=SITES,
    ),
    "torque_ripple": Cause(
        "amplitude",
        "N*m",
        with_details(
            by_gain(0.0025, 0.1), cycles=between(6.0, 40.0), phase=between(-3.1, 3.1)
        ),
        extra("ripple", "amplitude"),
    ),
    "asymmetric_friction": Cause(
        "torque", "N*m", either_sign(by_gain(0.003, 0.12)), extra("one_way", "torque")
    ),
    "encoder_offset": Cause("offset", "rad", _offsets, _offset, sites=SITES),
    "encoder_scale": Cause("scale", "1", _scales, field("scale_log", put)),
    "payload": Cause("mass", "kg", _masses, load, sites=SITES),
    "com_shift": Cause("distance", "m", _shifts, _shift, sites=SITES),
    "armature": Cause("inertia", "kg*m^2", _inertias, _motor_inertia),
    "gravity_tilt": Cause("angle", "rad", _tilts, _tilt, "all"),
    "thermal_derating": Cause(
        "lost_fraction",
        "1",
        with_details(plain(0.03, 20.0), cooling=between(8.0, 40.0)),
        extra("heat", "rate"),
    ),
    "supply_sag": Cause(
        "max_drop", "1", plain(0.003, 0.06), whole("sag"), "all", "many"
    ),
    "torque_saturation": Cause(
        "torque", "N*m", _saturations, extra("saturation", "torque")
    ),
    "clock_drift": Cause("drift", "1", plain(1e-4, 6e-3), whole("drift"), "all"),
    "imu_misalignment": Cause(
        "angle",
        "rad",
        with_details(plain(0.01, 0.15), heading=between(-3.1, 3.1)),
        feet.misalign,
        "imu",
        "floor",
    ),
    "ground_friction": Cause(
        "mu", "1", plain(0.4, 0.02), whole("mu"), "ground", "floor"
    ),
    "ground_compliance": Cause(
        "time_constant", "s", plain(0.02, 0.12), whole("softness"), "ground", "floor"
    ),
    "sole_geometry": Cause("wear", "m", _worn, feet.wear_down, "foot", "floor"),
}
