"""The hypotheses about a single joint: the catalogue's causes, and laws it lacks."""

from __future__ import annotations

import numpy as np

from gatjax.diagnosis import quantum, ripple
from gatjax.diagnosis.aliases import LOGGED, UPSIDE_DOWN
from gatjax.diagnosis.coordinates import (
    AMPLITUDES,
    LESS,
    add_terms,
    armature_of,
    factor,
    gain_of,
    geared,
    lessened,
    limit_of,
    positive,
    resistance_of,
    signed,
    variant_of,
    vector,
    wave,
)
from gatjax.diagnosis.hypotheses import Hypothesis, Numbers, Starts
from gatjax.diagnosis.joint import GRAVITY, Joint
from gatjax.diagnosis.loads import BODY_TERMS, TERMS, tilted

ARM = 0.08  # m, how far from the centre of mass a payload is expected
_LATE = (0.006, 0.02, 0.06, 0.15)  # s
_SPEEDS = (0.5, 0.8, 1.2, 1.8, 2.7, 4.0, 6.0, 9.0)  # rad/s
_BANDS = tuple(np.geomspace(0.003, 0.08, 10))  # rad
_SHARES = tuple(np.geomspace(0.05, 0.85, 16))  # of a limit
_QUANTA = tuple(np.geomspace(0.004, 0.25, 12))
_CYCLES = tuple(np.geomspace(5.5, 40.0, 16))
_FREQUENCIES = tuple(2.0 * np.pi * np.geomspace(0.1, 8.0, 26))


def _payload() -> Hypothesis:
    """A point mass beside the link's centre of mass."""

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        mass, weight = float(np.exp(x[0])), max(joint.link.mass, 1e-3)
        shift = mass * x[1:] / weight
        add_terms(drive, TERMS, [mass, *shift, mass * joint.link.swung(x[1:])])

    def values(joint: Joint, x: np.ndarray) -> Numbers:
        place = dict(zip("xyz", map(float, joint.link.centre + x[1:]), strict=True))
        return {"mass": float(np.exp(x[0]))} | place

    starts = tuple(
        (float(np.log(mass)), *row)
        for mass in (0.1, 0.4, 1.5)
        for size in (ARM, -ARM)
        for row in np.eye(3) * size
    )
    return Hypothesis(
        "payload", "beside it", put, starts, (0.03, 0.004, 0.004, 0.004),
        (np.log(0.01), -0.3, -0.3, -0.3), (np.log(10.0), 0.3, 0.3, 0.3), values,
        prior=(0.0, *((1.0 / ARM) ** 2,) * 3),
    )  # fmt: skip


def _shift() -> Hypothesis:
    """A centre of mass elsewhere: first moments, and the square of the shift.

    The square turns about the joint's axis (spin); about others it is left out.
    """
    plain = vector("com_shift", TERMS + 1, ("x", "y", "z"), "distance", 0.02, 0.17)

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        spin = joint.link.mass * joint.link.swung(x)
        add_terms(drive, TERMS + 1, [*x, spin])

    return plain._replace(put=put)


def _tilt(variant: str = "") -> Hypothesis:
    """A mounting turned by roll and pitch: loads are linear in the gravity vector.

    A model with gravity upside down is half a turn off, about the axis that gravity is
    farther from.
    """
    first = TERMS + len(BODY_TERMS)

    def turned(joint: Joint, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        gravity = np.array([joint.nominal[name] for name in GRAVITY])
        over = np.eye(2)[int(abs(gravity[0]) > np.hypot(*gravity[1:]))] * np.pi
        return gravity, x + over * (variant == UPSIDE_DOWN)

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        gravity, angles = turned(joint, x)
        add_terms(drive, first, tilted(gravity, angles) - gravity)

    def values(joint: Joint, x: np.ndarray) -> Numbers:
        return plain.values(joint, turned(joint, x)[1])

    plain = vector("gravity_tilt", first, ("roll", "pitch"), "angle", 0.1, 0.6)
    more = tuple((k * a, k * b) for k in (0.3, -0.3) for a, b in ((1, 0), (0, 1)))
    starts = ((0.0, 0.0),) if variant else plain.starts + more
    return plain._replace(
        variant=variant, put=put, starts=starts, values=values, linear=not variant
    )


FADED = 0.3  # of the top speed of a joint: there stiction has faded at the latest


def _stiction() -> Hypothesis:
    def values(joint: Joint, x: np.ndarray) -> Numbers:
        return {
            "excess": limit_of(joint) * float(np.exp(x[0])),
            "velocity": float(np.exp(x[1])),
        }

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        drive["stiction"], drive["creep"] = values(joint, x).values()

    starts = [(a, v) for a in (0.03, 0.1, 0.2, 0.4) for v in (0.03, 0.1, 0.3, 1.0)]
    return Hypothesis(
        "stiction", "", put, tuple((np.log(a), np.log(v)) for a, v in starts),
        (0.03, 0.05), (np.log(0.005), np.log(0.01)), (np.log(1.0), np.log(3.0)), values,
    )  # fmt: skip


def _thermal() -> Hypothesis:
    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        drive["heat"], drive["cooling"] = float(np.exp(x[0])), float(np.exp(x[1]))

    def values(joint: Joint, x: np.ndarray) -> Numbers:
        drive: Numbers = {}
        put(drive, joint, x)
        heat = joint.outcome([drive], False).heat.max()
        lost = float(np.clip(drive["heat"] * heat, 0.0, 0.95))
        return {"lost_fraction": lost, "cooling": drive["cooling"]}

    starts = tuple((a, c) for c in (2.0, 3.2) for a in (-5.0, -3.5, -2.0, -0.5, 1.0))
    return Hypothesis(
        "thermal_derating", "", put, starts, (0.05, 0.05), (-8.0, 1.0), (4.0, 5.0),
        values,
    )  # fmt: skip


def _saturation() -> Hypothesis:
    """A torque that falls short: ln of the limit over the torque that halves it."""

    def values(joint: Joint, x: np.ndarray) -> Numbers:
        return {"torque": limit_of(joint) * float(np.exp(-x[0]))}

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        drive["soft"] = 1.0 / values(joint, x)["torque"]

    starts = tuple((float(np.log(share)),) for share in (0.1, 0.3, 1.0))
    return Hypothesis(
        "torque_saturation", "", put, starts, (0.03,), (np.log(0.02),), (np.log(10.0),),
        values,
    )  # fmt: skip


def _torque_speed() -> Hypothesis:
    """Torque-speed line; the catalogue's limit is the speed that friction allows."""
    base = positive("speed_limit", "limit", "speed", 0.3, 30.0, _SPEEDS)

    def values(joint: Joint, x: np.ndarray) -> Numbers:
        n, zero = joint.nominal, float(np.exp(x[0]))
        top = (n["limit"] - n["friction"]) / (n["damping"] + n["limit"] / zero)
        return {"limit": top, "no_torque_speed": zero}

    return base._replace(variant="motor", values=values)


def _directed() -> Hypothesis:
    """Friction of one direction whose viscous part has a direction of its own."""

    def values(joint: Joint, x: np.ndarray) -> Numbers:
        torque = limit_of(joint) * float(x[0])
        return {"torque": torque, "viscous": resistance_of(joint) * float(x[1])}

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        torque, viscous = values(joint, x).values()
        drive["asymmetric"] = torque
        drive["one_sided"] = joint.nominal.get("one_sided", 0.0) + viscous

    starts = tuple((0.02 * a, 0.3 * b) for a in (1.0, -1.0) for b in (1.0, -1.0))
    return Hypothesis(
        "asymmetric_friction", "grows with speed", put, starts, (0.0024, 0.01),
        (-1.0, -20.0), (1.0, 20.0), values,
    )  # fmt: skip


def _steps(joint: Joint, residual: np.ndarray) -> Starts:
    """Steps of the target that a residual tells of."""
    return tuple((float(np.log(step)),) for step in quantum.steps(joint, residual))


def _rates(joint: Joint, residual: np.ndarray) -> Starts:
    """Rates along the angle that a residual tells of, a pair of amplitudes each."""
    return tuple(
        (*pair, float(np.log(rate)))
        for rate in ripple.rates(joint, residual)
        for pair in AMPLITUDES
    )


def _spring() -> Hypothesis:
    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        drive["spring"] = gain_of(joint) * float(x[0])
        known = joint.nominal.get("bias", 0.0)
        drive["bias"] = known + limit_of(joint) * float(x[1])

    starts = ((0.05, 0.0), (0.2, 0.0), (-0.05, 0.0), (0.0, 0.1), (0.0, -0.1))
    return Hypothesis(
        "", "parallel spring", put, starts, (0.005, 0.005), (-0.5, -1.0), (2.0, 1.0),
        lambda joint, x: {"k": gain_of(joint) * x[0], "torque": limit_of(joint) * x[1]},
        linear=True,
    )  # fmt: skip


def _hysteresis() -> Hypothesis:
    """A spring beside the servo that slips: cables, hoses, rubber (Prandtl 1928).

    Dry friction that yields far before it slips, the joint's own with it; ln of its
    level and of that way, rad.
    """

    def values(joint: Joint, x: np.ndarray) -> Numbers:
        level, give = limit_of(joint) * float(np.exp(x[0])), float(np.exp(x[1]))
        return {"stiffness": level / give, "torque": level}

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        drive["friction"] = drive.get("friction", 0.0) + values(joint, x)["torque"]
        drive["give"] = float(np.exp(x[1]))

    shares, ways = (0.02, 0.1, 0.4), (0.05, 0.2)
    starts = tuple((float(np.log(a)), float(np.log(b))) for a in shares for b in ways)
    return Hypothesis(
        "", "hysteretic spring", put, starts, (0.03, 0.03),
        (np.log(0.003), np.log(0.02)), (np.log(2.0), np.log(1.0)), values,
    )  # fmt: skip


_SIDES = (
    ("encoder on link", 0.0, 0.0), ("encoder and kv on link", 0.0, 1.0),
    ("encoder on motor", 1.0, 0.0),
)  # fmt: skip
_LOAD = positive("load_friction", "coefficient", "loaded", 0.02, 3.0, (0.1, 0.3, 0.8))
_WIDTH = positive("backlash", "width", "width", 0.002, 0.2, (0.008, 0.02, 0.04, 0.08))
_SPRING = positive(
    "joint_elasticity", "stiffness", "stiffness", 0.05, 60.0, (0.3, 1.0, 3.0), gain_of
)

CAUSES: tuple[Hypothesis, ...] = (
    positive("command_delay", "delay", "delay", 0.002, 0.2, _LATE, added=True),
    positive("measurement_delay", "delay", "late", 0.002, 0.2, _LATE, added=True),
    positive("first_order_lag", "time_constant", "lag", 0.002, 0.5, _LATE),
    factor("gain_error", "kp", 0.05, 5.0, (0.4, 0.7, 1.4, 2.0)),
    factor("damping_error", "kv", 0.02, 60.0, (0.3, 2.0, 6.0, 20.0)),
    factor("torque_limit", "limit", 0.02, 0.97, _SHARES),
    _torque_speed(),
    positive("speed_limit", "limit", "rate", 0.2, 20.0, _SPEEDS)._replace(
        variant="target"
    ),
    positive(
        "viscous_friction", "coefficient", "damping", 0.05, 60.0, (0.3, 1.0, 4.0),
        resistance_of, True,
    ),
    positive(
        "coulomb_friction", "torque", "friction", 0.003, 1.0, (0.02, 0.06, 0.2),
        limit_of, True,
    ),
    lessened("viscous_friction", "coefficient", "damping"),
    lessened("coulomb_friction", "torque", "friction"),
    lessened("armature", "inertia", "armature"),
    _stiction(),
    variant_of(_LOAD, "of the link's torque", {"of_link": 1.0}),
    variant_of(_LOAD, "of the servo's torque", {"of_link": 0.0}),
    *(geared(_WIDTH, *side) for side in _SIDES),
    positive("dead_band", "half_width", "dead", 0.002, 0.2, _BANDS),
    positive(
        "command_quantization", "step", "quantum", quantum.LEAST, quantum.MOST, _QUANTA,
        step=0.004,
    )._replace(guess=_steps, rung=0.001),
    *(geared(_SPRING, *side) for side in _SIDES),
    wave("torque_ripple", "", ("ripple", "ripple_phase", "cycles"), _CYCLES)._replace(
        guess=_rates
    ),
    signed(
        "asymmetric_friction", "", "asymmetric", "torque", 0.12, 1.0, limit_of
    )._replace(linear=False),  # what rubs in one direction is not the other's opposite
    _directed(),
    signed(
        "encoder_offset", "in loop", "zero_in", "offset", 0.06, 0.6,
        values={"in_loop": 1.0},
    ),
    signed(
        "encoder_offset", LOGGED, "zero_out", "offset", 0.06, 0.6,
        values={"in_loop": 0.0},
    ),
    signed("encoder_scale", "", "scale", "scale", 0.08, 0.4, neutral=1.0),
    positive(
        "payload", "mass", f"term{TERMS}", 0.01, 10.0, (0.05, 0.2, 0.6, 1.5, 4.0)
    )._replace(variant="at the centre of mass"),
    _payload(),
    _shift(),
    positive(
        "armature", "inertia", "armature", 0.1, 150.0, (0.5, 1.5, 5.0, 25.0),
        armature_of, True,
    ),
    _tilt(),
    _tilt(UPSIDE_DOWN),
    _thermal(),
    signed("clock_drift", "", "drift", "drift", 0.0015, 0.02),
    positive("supply_sag", "max_drop", "sag", 0.02, 0.7, (0.08, 0.2, 0.4)),
    _saturation(),
)  # fmt: skip
"""Causes of the catalogue that a single joint can show."""

SERVOED = frozenset({"dead_band", "command_quantization", "speed_limit (target)",
                     "encoder_offset (in loop)", "integral action",
                     "uneven gain"})  # fmt: skip
"""Names of what only a position servo can have."""

SURE = {  # tolerances, and what cannot be where one is 0
    "kp": ("gain_error",), "kv": ("damping_error",), "damping": ("viscous_friction",),
    "armature": ("armature",), "friction": ("coulomb_friction",),
    "limit": ("torque_limit", "torque_saturation"),
}  # fmt: skip

OTHERS: tuple[Hypothesis, ...] = (
    signed("", "quadratic drag", "drag", "coefficient", 0.1, 5.0, limit_of),
    _spring(),
    _hysteresis(),
    wave("", "periodic torque", ("wave", "wave_phase", "frequency"), _FREQUENCIES),
    signed("", "integral action", "integral", "rate", 3.0, 50.0),
    signed("", "uneven gain", "skew", "skew", 0.3, 0.95),
)
"""Laws without an entry in the catalogue: when one wins, the cause is unknown."""


def of_drive(joint: Joint, bank: tuple[Hypothesis, ...]) -> tuple[Hypothesis, ...]:
    """Those hypotheses of a bank that the drive of a joint can have, not known yet.

    Stiction has to fade within its motion: else it is dry friction by another name.
    """
    barred = joint.assumed.barred | (frozenset() if joint.servoed else SERVOED)
    barred |= {c for name, some in SURE.items() for c in some
               if getattr(joint.allowed, name) == 0.0}  # fmt: skip
    return tuple(
        _of_joint(each, joint)
        for each in bank
        if not {each.cause, each.name} & barred
        and not (each.cause == "stiction" and _never_fades(each, joint))
        and (each.variant != LESS or joint.nominal[each.imitator])
    )


def _of_joint(each: Hypothesis, joint: Joint) -> Hypothesis:
    """A hypothesis as one joint can show it."""
    if each.cause == "stiction":
        return _fading(each, joint)
    if each.cause == "encoder_offset" and not joint.servoed:
        return each._replace(variant="")  # there is no loop that could see it
    return each


def _never_fades(stiction: Hypothesis, joint: Joint) -> bool:
    """Whether a joint is too slow for any stiction to fade."""
    return bool(FADED * joint.fastest <= np.exp(stiction.low[1]))


def _fading(stiction: Hypothesis, joint: Joint) -> Hypothesis:
    """Stiction that has faded at a share of the joint's top speed."""
    slowest, usual = np.exp([stiction.low[1], stiction.high[1]])
    most = float(np.log(np.clip(FADED * joint.fastest, slowest, usual)))
    starts = {(excess, min(speed, most)): None for excess, speed in stiction.starts}
    return stiction._replace(starts=tuple(starts), high=(stiction.high[0], most))
