"""Cause names and what they mean: parameters, units, ranges, equation, source, effect.

The names and first parameters are a contract (`docs/files.md`, world file). Ranges are
wider than all that the diagnosis can find on any robot, a finger or an arm that lifts
cars; they refuse wrong signs and units.
"""

from __future__ import annotations

from gatjax.effects import body, drive, ground, joint, sensor
from gatjax.effects.cause import Cause, Part
from gatjax.effects.cause import Parameter as P

INF, NAN = float("inf"), float("nan")
LONGEST = 0.21  # s, of a delay
MOST = 1e6  # N m; with damping, N m s/rad
TURN = 3.2  # rad, half a turn
OVER = 2.0 * TURN  # rad, of a mounting upside down and tilted besides


def _body(build, *takes: str) -> tuple[Part, ...]:
    return (Part("body", build, takes),)


def _plain(build):
    """Fit an effect that needs no period into the catalogue."""
    return lambda period: build()


_GEAR = (
    P("encoder_on_motor", "1", 0.0, 1.0, 0.0),
    P("link_share", "1", 0.0, 1.0, 0.1),
    P("armature_share", "1", 0.0, 0.9, 0.0),
    P("kv_on_link", "1", 0.0, 1.0, 0.0),
)

CATALOGUE = {
    "command_delay": Cause(
        (P("delay", "s", 0.0, LONGEST),), 0.0,
        (Part("motor", lambda period: drive.delay(period, LONGEST), ("delay",)),),
        "servo sees target(t - delay)", "B-Human: request to motion 36 ms, NAO v6",
    ),
    "measurement_delay": Cause(
        (P("delay", "s", 0.0, LONGEST),), 0.0,
        (Part("sensor", lambda period: sensor.delay(period, LONGEST), ("delay",)),),
        "measured(t) = angle(t - delay)", "B-Human: NAO sensors are 1 to 2 cycles old",
    ),
    "dropped_commands": Cause(
        (P("probability", "1", 0.0, 1.0), P("burst", "1", 1.0, 1e5, 2.0)), 0.0,
        (Part("command", _plain(drive.loss), ("probability", "burst")),),
        "target lost with this share, last one held; two-state Markov chain",
        "Gilbert, Bell System Technical Journal 39, 1960",
    ),
    "first_order_lag": Cause(
        (P("time_constant", "s", 0.0, 0.6),), 0.0,
        (Part("motor", drive.lag, ("time_constant",)),),
        "time_constant y' = target - y", "SimRobot 2 servo: 50 ms",
    ),
    "gain_error": Cause(
        (P("scale", "1", 0.02, 10.0),), 1.0, _body(body.gain_error, "scale"),
        "kp -> scale kp", "servo gain of the NAO is unpublished",
    ),
    "damping_error": Cause(
        (P("scale", "1", 0.0, 100.0),), 1.0, _body(body.damping_error, "scale"),
        "kv -> scale kv", "back EMF kt^2/R: 0.03 to 1.6 N m s/rad, BAM parameter files",
    ),
    "torque_limit": Cause(
        (P("limit", "N*m", 1e-6, MOST), P("raised", "N*m", 0.0, MOST, 0.0)), INF,
        _body(body.torque_limit, "limit", "raised"),
        "|servo torque| <= limit, and <= nominal limit + raised",
        "NAO v5 URDF effort: 3.0 and 3.3 N m",
    ),
    "current_limit": Cause(
        (P("limit", "N*m", 1e-6, MOST),), INF,
        (Part("joint", _plain(joint.current_limit), ("limit",)),),
        "|servo torque - damping velocity| <= limit",
        "NAO v5 URDF effort: 3.0 N m, where 60 % of the voltage could drive 3.7",
    ),
    "speed_limit": Cause(
        (P("limit", "rad/s", 0.05, 40.0), P("on_motor", "1", 0.0, 1.0, 0.0)), INF,
        (Part("motor", drive.speed_limit, ("limit",), ("on_motor", 0.0), follows=True),
         Part("joint", joint.speed_line, ("limit",), ("on_motor", 1.0))),
        "on_motor 0: |d target/dt| <= limit inside the servo; 1: torque <= stall "
        "(1 - v / limit)", "NAO6 datasheet: 4.5 and 7.0 rad/s",
    ),
    "viscous_friction": Cause(
        (P("coefficient", "N*m*s/rad", -MOST, MOST),), 0.0,
        _body(body.viscous_friction, "coefficient"),
        "torque = -coefficient velocity; negative: of what the model has",
        "SimRobot 3: 0.01",
    ),
    "coulomb_friction": Cause(
        (P("torque", "N*m", -MOST, MOST),), 0.0,
        _body(body.coulomb_friction, "torque"),
        "dry friction torque added to frictionloss, or taken from it",
        "SimSpark naov4: 0.1 N m",
    ),
    "stiction": Cause(
        (P("excess", "N*m", 0.0, MOST), P("velocity", "rad/s", 0.002, 5.0, 0.1)), 0.0,
        (Part("joint", _plain(joint.stiction), ("excess", "velocity")),
         Part("body", body.holding, ("excess",))),
        "dry friction grows by excess exp(-(v / velocity)^2)",
        "Stribeck; BAM: excess 0.005 to 0.12 N m at 1.5 to 2.9 rad/s",
    ),
    "load_friction": Cause(
        (P("coefficient", "1", 0.0, 5.0), P("of_link", "1", 0.0, 1.0, 0.0)), 0.0,
        (Part("joint", joint.load_friction, ("coefficient", "of_link")),
         Part("body", body.holding, ("coefficient",))),
        "dry friction grows by coefficient |torque|: of_link 0: of the servo; 1: of "
        "what reaches the link", "BAM: 7 to 31 %",
    ),
    "backlash": Cause(
        (P("width", "rad", 0.0, 0.25), P("damping_ratio", "1", 0.0, 2.0, 0.3), *_GEAR),
        0.0,
        (Part("gear", None, ("width", "damping_ratio", *(p.name for p in _GEAR))),),
        "motor and link are two inertias with a gap of this total width between them",
        "B-Human joint play: 1.0-1.4 deg; Dynamixel e-manual: 0.25 deg",
    ),
    "dead_band": Cause(
        (P("half_width", "rad", 0.0, 0.25),), 0.0,
        (Part("motor", _plain(drive.dead_band), ("half_width",), sees=True,
              follows=True),),
        "no torque while |target - angle| < half_width", "E1 prototype: 0.5 deg",
    ),
    "command_quantization": Cause(
        (P("step", "rad", 0.0, 0.35),), 0.0,
        (Part("motor", _plain(drive.quantization), ("step",)),),
        "target -> step floor(target / step + 1/2)", "Dynamixel: 0.088 to 0.3 deg",
    ),
    "joint_elasticity": Cause(
        (P("stiffness", "N*m/rad", 1e-6, 1e8),
         P("damping_ratio", "1", 0.0, 2.0, 0.05), *_GEAR), INF,
        (Part("gear", None, ("stiffness", "damping_ratio", *(p.name for p in _GEAR))),),
        "motor and link are two inertias with a spring between them",
        "Spong 1987, flexible joint model; 8 to 300 N m/rad for servos",
    ),
    "torque_ripple": Cause(
        (P("amplitude", "N*m", 0.0, MOST), P("cycles", "1/rad", 0.1, 300.0, 10.0),
         P("phase", "rad", -20.0, 20.0, 0.0)), 0.0,
        (Part("joint", _plain(joint.ripple), ("amplitude", "cycles", "phase")),),
        "torque = amplitude sin(cycles angle + phase)", "cogging: 1 to 10 % of stall",
    ),
    "asymmetric_friction": Cause(
        (P("torque", "N*m", -MOST, MOST),
         P("viscous", "N*m*s/rad", -MOST, MOST, 0.0)), 0.0,
        (Part("joint", _plain(joint.one_way), ("torque", "viscous")),
         Part("body", body.asymmetric_friction, ("torque",))),
        "dry friction grows by |torque| in the direction of torque only, viscous by "
        "|viscous| in that of viscous",
        "cables and directional gear efficiency: 0.02 to 0.3 N m",
    ),
    "encoder_offset": Cause(
        (P("offset", "rad", -1.0, 1.0), P("in_loop", "1", 0.0, 1.0, 0.0)), 0.0,
        (Part("sensor", _plain(sensor.offset), ("offset",)),
         Part("motor", _plain(drive.shifted), ("offset",), ("in_loop", 1.0),
              follows=True)),
        "measured = angle + offset; in_loop 1: the servo sees it too",
        "NAO joint calibration: 0.3 to 5 deg",
    ),
    "encoder_scale": Cause(
        (P("scale", "1", 0.5, 1.5), P("in_loop", "1", 0.0, 1.0, 0.0)), 1.0,
        (Part("sensor", _plain(sensor.scale), ("scale",)),
         Part("motor", _plain(drive.scaled), ("scale",), ("in_loop", 1.0), True,
              True)),
        "measured = scale angle; in_loop 1: the servo sees it too",
        "potentiometers: 1 to 12 %",
    ),
    "payload": Cause(
        (P("mass", "kg", 0.0, 1000.0), P("x", "m", -10.0, 10.0, NAN),
         P("y", "m", -10.0, 10.0, NAN), P("z", "m", -10.0, 10.0, NAN)), 0.0,
        _body(body.payload, "mass", "x", "y", "z"),
        "point mass on the link at x, y, z (its centre of mass if left out)",
        "NAO: batteries and covers change links by 5 to 100 %",
    ),
    "com_shift": Cause(
        (P("distance", "m", 0.0, 2.0), P("x", "m", -1.0, 1.0, 1.0),
         P("y", "m", -1.0, 1.0, 0.0), P("z", "m", -1.0, 1.0, 0.0)), 0.0,
        _body(body.com_shift, "x", "y", "z"),
        "centre of mass moves by (x, y, z) in the link's frame, |(x, y, z)| = distance",
        "CAD against weighed links: 5 to 30 mm", direction=("x", "y", "z"),
    ),
    "armature": Cause(
        (P("inertia", "kg*m^2", -1e4, 1e4),), 0.0, _body(body.armature, "inertia"),
        "inertia added to the rotor's at the joint, or taken from it",
        "BAM: 0.0011 to 0.028 kg m^2",
    ),
    "gravity_tilt": Cause(
        (P("angle", "rad", 0.0, 2.0 * OVER), P("roll", "rad", -OVER, OVER, 0.0),
         P("pitch", "rad", -OVER, OVER, 1.0)), 0.0,
        _body(body.gravity_tilt, "roll", "pitch"),
        "mounting turned by roll, then pitch; |(roll, pitch)| = angle",
        "grounds of 0.5 to 6 deg", "all", ("roll", "pitch"),
    ),
    "thermal_derating": Cause(
        (P("lost_fraction", "1", 0.0, 0.95), P("cooling", "s", 0.5, 3600.0, 60.0),
         P("heat", "N^2*m^2*s", 1e-12, 1e15, NAN)), 0.0,
        (Part("joint", joint.thermal, ("lost_fraction", "cooling", "heat")),),
        "lost share = lost_fraction warmth / heat, warmth' = torque^2 - warmth/cooling",
        "Aldebaran motor pages: nominal torque is 20 to 25 % of stall",
    ),
    "supply_sag": Cause(
        (P("max_drop", "1", 0.0, 0.9), P("total", "N*m", 1e-6, 100.0 * MOST, NAN)), 0.0,
        (Part("joint", _plain(joint.supply), ("max_drop", "total")),),
        "lost share = max_drop min(1, sum |torque| / total)",
        "Dynamixel stall torque over voltage: 5 to 25 %", "all",
    ),
    "torque_saturation": Cause(
        (P("torque", "N*m", 1e-6, 100.0 * MOST),), INF,
        (Part("joint", _plain(joint.saturation), ("torque",)),),
        "of a servo torque t arrives t / (1 + |t| / torque)",
        "iron and drivers saturate; 1 N m in BAM's logs of an XL-330",
    ),
    "clock_drift": Cause(
        (P("drift", "1", -0.05, 0.05),), 0.0, (Part("log", None, ("drift",)),),
        "row at t holds the angle at (1 - drift) t; acts on replays only",
        "quartz 10 to 500 ppm", "all",
    ),
    "imu_misalignment": Cause(
        (P("angle", "rad", 0.0, 2.0 * TURN), P("roll", "rad", -TURN, TURN, 0.0),
         P("pitch", "rad", -TURN, TURN, 1.0), P("yaw", "rad", -TURN, TURN, 0.0)), 0.0,
        (Part("sensor", _plain(sensor.misalignment), ("roll", "pitch", "yaw")),),
        "sensor axes turned by roll, pitch, yaw; |(roll, pitch, yaw)| = angle",
        "mounting of IMUs: 0.5 to 5 deg", "imu", ("roll", "pitch", "yaw"),
    ),
    "ground_friction": Cause(
        (P("mu", "1", 1e-4, 10.0),), NAN, _body(ground.friction, "mu"),
        "|tangential force| <= mu normal force", "carpet to tiles: 0.2 to 1.2",
        "ground",
    ),
    "ground_compliance": Cause(
        (P("time_constant", "s", 1e-4, 5.0),), NAN,
        _body(ground.compliance, "time_constant"),
        "contacts are a spring and damper with this time constant",
        "MuJoCo solref; grass and carpet: 5 to 200 kN/m", "ground",
    ),
    "sole_geometry": Cause(
        (P("wear", "m", 0.0, 0.03), P("x", "1", -1.0, 1.0, 1.0),
         P("y", "1", -1.0, 1.0, 0.0)), 0.0,
        _body(ground.wear, "wear", "x", "y"),
        "sole is wear thinner on the side x, y (in the foot's frame) of its middle",
        "worn soles: 1 to 5 mm", "foot",
    ),
    "command_noise": Cause(
        (P("deviation", "rad", 0.0, 0.2),), 0.0,
        (Part("command", _plain(drive.noise), ("deviation",)),),
        "target + deviation N(0, 1) each tick", "Jakobi et al. 1995, noise envelope",
    ),
}  # fmt: skip


def cause(name: str) -> Cause:
    """Look a cause up by name."""
    if name not in CATALOGUE:
        raise ValueError(f"cause {name!r} is unknown; choose from {sorted(CATALOGUE)}")
    return CATALOGUE[name]
