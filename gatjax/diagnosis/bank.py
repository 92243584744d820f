"""The hypotheses about a single joint: the catalogue's causes, and laws it lacks.

Torques are coordinates in shares of the joint's torque limit, stiffnesses in shares of
its gain, so that the same bank serves a finger and a hip. Positive numbers are searched
as logarithms.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from gatjax.diagnosis import quantum
from gatjax.diagnosis.hypotheses import Hypothesis, Numbers, Starts
from gatjax.diagnosis.joint import GRAVITY, Joint
from gatjax.diagnosis.loads import BODY_TERMS, TERMS, tilted
from gatjax.diagnosis.tolerances import SHARES

Scale = Callable[[Joint], float]


def _one(joint: Joint) -> float:
    return 1.0


def _limit(joint: Joint) -> float:
    return min(joint.nominal["limit"], joint.nominal["kp"])


def _gain(joint: Joint) -> float:
    return joint.nominal["kp"]


def _resistance(joint: Joint) -> float:
    return joint.nominal["damping"] + joint.nominal["kv"] + 1e-3


def _armature(joint: Joint) -> float:
    return joint.nominal["armature"] + 1e-4


def _positive(
    cause: str, parameter: str, field: str, low: float, high: float,
    starts: Sequence[float], scale: Scale = _one, added: bool = False,
    step: float = 0.03,
) -> Hypothesis:  # fmt: skip
    """One positive number: set, or added to what the joint has already."""

    def size(joint: Joint, x: np.ndarray) -> float:
        return scale(joint) * float(np.exp(x[0]))

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        drive[field] = size(joint, x) + (drive.get(field, 0.0) if added else 0.0)

    logs = tuple((float(np.log(start)),) for start in starts)
    plain = Hypothesis(
        cause, "", put, logs, (step,), (np.log(low),), (np.log(high),),
        lambda joint, x: {parameter: size(joint, x)},
    )  # fmt: skip
    if field in ("delay", "late"):
        return plain._replace(
            imitator="delay", taken=lambda joint, x: np.log(joint.allowed.late * x)
        )
    if field not in SHARES:
        return plain

    def taken(joint: Joint, x: float) -> float:
        grown = np.expm1(getattr(joint.allowed, field) * x)
        return float(np.log(joint.nominal[field] * grown / scale(joint)))

    return plain._replace(imitator=field, taken=taken)


def _of(base: Hypothesis, variant: str, fixed: Numbers) -> Hypothesis:
    """The same cause with some numbers fixed."""

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        base.put(drive, joint, x)
        drive.update(fixed)

    return base._replace(variant=variant, put=put)


def _geared(base: Hypothesis, side: str) -> Hypothesis:
    """The same cause with the motor and the link apart, each with some friction.

    The encoder sits on one `side`, motor or link.
    """
    sensed = float(side == "motor")

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        base.put(drive, joint, x[:-1])
        drive.update({"sensed": sensed, "link_share": float(x[-1])})

    return base._replace(
        variant=f"encoder on {side}", put=put, geared=True,
        starts=tuple((*s, share) for s in base.starts for share in (0.1, 0.8)),
        steps=(*base.steps, 0.05), low=(*base.low, 0.0), high=(*base.high, 1.0),
        values=lambda joint, x: (
            base.values(joint, x[:-1])
            | {"encoder_on_motor": sensed, "link_share": float(x[-1])}
        ),
    )  # fmt: skip


def _factor(
    cause: str, field: str, low: float, high: float, starts: Sequence[float]
) -> Hypothesis:
    """A factor on a nominal number that replaces its tolerance."""

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        drive[field] = joint.nominal[field] * float(np.exp(x[0]))

    def values(joint: Joint, x: np.ndarray) -> Numbers:
        scale = float(np.exp(x[0]))
        limits = cause == "torque_limit"
        return {"limit": joint.nominal[field] * scale} if limits else {"scale": scale}

    logs = tuple((float(np.log(start)),) for start in starts)
    return Hypothesis(
        cause, "", put, logs, (0.03,), (np.log(low),), (np.log(high),), values,
        imitator=field, taken=lambda joint, x: getattr(joint.allowed, field) * x,
    )  # fmt: skip


def _of_zero(field: str) -> dict[str, Any]:
    """The imitator of an offset: what an encoder's zero may be off."""
    if field not in ("zero_in", "zero_out"):
        return {}
    return {"imitator": field, "taken": lambda joint, x: joint.allowed.zero * x}


def _signed(
    cause: str, variant: str, field: str, parameter: str, size: float, high: float,
    scale: Scale = _one, neutral: float = 0.0, values: Numbers | None = None,
) -> Hypothesis:  # fmt: skip
    """A number of either sign, searched as it is."""

    def number(joint: Joint, x: np.ndarray) -> float:
        return neutral + scale(joint) * float(x[0])

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        drive[field] = number(joint, x)

    starts = tuple((k * size,) for k in (0.3, -0.3, 1.0, -1.0))
    return Hypothesis(
        cause, variant, put, starts, (0.02 * size,), (-high,), (high,),
        lambda joint, x: {parameter: number(joint, x)} | (values or {}),
        **_of_zero(field),
    )  # fmt: skip


def _vector(
    cause: str, first: int, names: tuple[str, ...], norm: str, size: float, high: float
) -> Hypothesis:
    """Load terms that belong together, e.g. the axes of a displacement."""
    count = len(names)

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        drive.update({f"term{first + k}": float(v) for k, v in enumerate(x)})

    def values(joint: Joint, x: np.ndarray) -> Numbers:
        parts = {name: float(v) for name, v in zip(names, x, strict=True)}
        return {norm: float(np.linalg.norm(x))} | parts

    starts = tuple(tuple(row) for k in (size, -size) for row in np.eye(count) * k)
    return Hypothesis(
        cause, "", put, starts, (0.05 * size,) * count, (-high,) * count,
        (high,) * count, values, prior=((3.0 / high) ** 2,) * count,
    )  # fmt: skip


def _payload() -> Hypothesis:
    """A point mass beside the link's centre of mass: loads by first moments.

    Its own moment of inertia about that centre is left out.
    """

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        mass, weight = float(np.exp(x[0])), max(joint.link.mass, 1e-3)
        shift = mass * x[1:] / weight
        drive[f"term{TERMS}"] = mass
        drive.update({f"term{TERMS + 1 + k}": float(s) for k, s in enumerate(shift)})

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


def _tilt() -> Hypothesis:
    """A mounting turned by roll and pitch: loads are linear in the gravity vector."""
    first = TERMS + len(BODY_TERMS)

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        gravity = np.array([joint.nominal[name] for name in GRAVITY])
        change = tilted(gravity, x) - gravity
        drive.update({f"term{first + k}": float(v) for k, v in enumerate(change)})

    plain = _vector("gravity_tilt", first, ("roll", "pitch"), "angle", 0.1, 0.6)
    more = tuple((k * a, k * b) for k in (0.3, -0.3) for a, b in ((1, 0), (0, 1)))
    return plain._replace(put=put, starts=plain.starts + more)


def _stiction() -> Hypothesis:
    def values(joint: Joint, x: np.ndarray) -> Numbers:
        return {
            "excess": _limit(joint) * float(np.exp(x[0])),
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
        heat = np.asarray(joint.outcome([drive], False).heat).max()
        lost = float(np.clip(drive["heat"] * heat, 0.0, 0.95))
        return {"lost_fraction": lost, "cooling": drive["cooling"]}

    starts = tuple((a, c) for c in (2.0, 3.2) for a in (-5.0, -3.5, -2.0, -0.5, 1.0))
    return Hypothesis(
        "thermal_derating", "", put, starts, (0.05, 0.05), (-8.0, 1.0), (4.0, 5.0),
        values,
    )  # fmt: skip


def _torque_speed() -> Hypothesis:
    """Torque-speed line; the catalogue's limit is the speed that friction allows."""
    base = _positive("speed_limit", "limit", "speed", 0.3, 30.0, _SPEEDS)

    def values(joint: Joint, x: np.ndarray) -> Numbers:
        n, zero = joint.nominal, float(np.exp(x[0]))
        top = (n["limit"] - n["friction"]) / (n["damping"] + n["limit"] / zero)
        return {"limit": top, "no_torque_speed": zero}

    return base._replace(variant="motor", values=values)


def _wave(
    cause: str, variant: str, fields: tuple[str, str, str], rates: Sequence[float]
) -> Hypothesis:
    """A sine of position or time: amplitudes in shares of the limit, then the rate."""

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        drive[fields[0]] = _limit(joint) * float(x[0])
        drive[fields[1]] = _limit(joint) * float(x[1])
        drive[fields[2]] = float(np.exp(x[2]))

    def values(joint: Joint, x: np.ndarray) -> Numbers:
        return {
            "amplitude": _limit(joint) * float(np.hypot(x[0], x[1])),
            fields[2]: float(np.exp(x[2])),
            "phase": float(np.arctan2(x[1], x[0]) % (2.0 * np.pi)),
        }

    pairs = ((0.03, 0.0), (0.0, 0.03))
    starts = tuple((a, b, float(np.log(r))) for r in rates for a, b in pairs)
    low, high = np.log(rates[0]) - 0.2, np.log(rates[-1]) + 0.2
    return Hypothesis(
        cause, variant, put, starts, (0.003, 0.003, 0.002), (-1.0, -1.0, low),
        (1.0, 1.0, high), values,
    )  # fmt: skip


def _steps(joint: Joint, residual: np.ndarray) -> Starts:
    """Steps of the target that a residual tells of."""
    return tuple((float(np.log(step)),) for step in quantum.steps(joint, residual))


def _spring() -> Hypothesis:
    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        drive["spring"] = _gain(joint) * float(x[0])
        drive["bias"] = _limit(joint) * float(x[1])

    starts = ((0.05, 0.0), (0.2, 0.0), (-0.05, 0.0), (0.0, 0.1), (0.0, -0.1))
    return Hypothesis(
        "", "parallel spring", put, starts, (0.005, 0.005), (-0.5, -1.0), (2.0, 1.0),
        lambda joint, x: {"k": _gain(joint) * x[0], "torque": _limit(joint) * x[1]},
    )  # fmt: skip


ARM = 0.08  # m, how far from the centre of mass a payload is expected
_SPEEDS = (0.5, 0.8, 1.2, 1.8, 2.7, 4.0, 6.0, 9.0)  # rad/s
_BANDS = tuple(np.geomspace(0.003, 0.08, 10))  # rad
_SHARES = tuple(np.geomspace(0.05, 0.85, 16))  # of a limit
_QUANTA = tuple(np.geomspace(0.004, 0.25, 12))
_CYCLES = tuple(np.geomspace(5.5, 40.0, 16))
_FREQUENCIES = tuple(2.0 * np.pi * np.geomspace(0.1, 8.0, 26))
_LOAD = _positive("load_friction", "coefficient", "loaded", 0.02, 3.0, (0.1, 0.3, 0.8))
_WIDTH = _positive("backlash", "width", "width", 0.002, 0.2, (0.008, 0.02, 0.04, 0.08))
_SPRING = _positive(
    "joint_elasticity", "stiffness", "stiffness", 0.05, 60.0, (0.3, 1.0, 3.0), _gain
)

CAUSES: tuple[Hypothesis, ...] = (
    _positive(
        "command_delay", "delay", "delay", 0.002, 0.2, (0.006, 0.02, 0.06), added=True
    ),
    _positive("measurement_delay", "delay", "late", 0.002, 0.2, (0.006, 0.02, 0.06)),
    _positive(
        "first_order_lag", "time_constant", "lag", 0.002, 0.5, (0.006, 0.02, 0.06)
    ),
    _factor("gain_error", "kp", 0.05, 5.0, (0.4, 0.7, 1.4, 2.0)),
    _factor("damping_error", "kv", 0.02, 60.0, (0.3, 2.0, 6.0, 20.0)),
    _factor("torque_limit", "limit", 0.02, 0.97, _SHARES),
    _torque_speed(),
    _positive("speed_limit", "limit", "rate", 0.2, 20.0, _SPEEDS)._replace(
        variant="target"
    ),
    _positive(
        "viscous_friction", "coefficient", "damping", 0.05, 60.0, (0.3, 1.0, 4.0),
        _resistance, True,
    ),
    _positive(
        "coulomb_friction", "torque", "friction", 0.003, 1.0, (0.02, 0.06, 0.2), _limit,
        True,
    ),
    _stiction(),
    _of(_LOAD, "of the link's torque", {"by_servo": 0.0}),
    _of(_LOAD, "of the servo's torque", {"by_servo": 1.0}),
    _geared(_WIDTH, "link"),
    _geared(_WIDTH, "motor"),
    _positive("dead_band", "half_width", "dead", 0.002, 0.2, _BANDS),
    _positive(
        "command_quantization", "step", "quantum", quantum.LEAST, quantum.MOST, _QUANTA,
        step=0.004,
    )._replace(guess=_steps, rung=0.001),
    _geared(_SPRING, "link"),
    _geared(_SPRING, "motor"),
    _wave("torque_ripple", "", ("ripple_sin", "ripple_cos", "cycles"), _CYCLES),
    _signed("asymmetric_friction", "", "asymmetric", "torque", 0.12, 1.0, _limit),
    _signed(
        "encoder_offset", "in loop", "zero_in", "offset", 0.06, 0.6,
        values={"in_loop": 1.0},
    ),
    _signed(
        "encoder_offset", "log only", "zero_out", "offset", 0.06, 0.6,
        values={"in_loop": 0.0},
    ),
    _signed("encoder_scale", "", "scale", "scale", 0.08, 0.4, neutral=1.0),
    _positive(
        "payload", "mass", f"term{TERMS}", 0.01, 10.0, (0.05, 0.2, 0.6, 1.5, 4.0)
    )._replace(variant="at the centre of mass"),
    _payload(),
    _vector("com_shift", TERMS + 1, ("x", "y", "z"), "distance", 0.02, 0.17),
    _positive(
        "armature", "inertia", "armature", 0.1, 40.0, (0.5, 1.5, 5.0), _armature, True
    ),
    _tilt(),
    _thermal(),
    _signed("clock_drift", "", "drift", "drift", 0.0015, 0.02),
    _positive("supply_sag", "max_drop", "sag", 0.02, 0.7, (0.08, 0.2, 0.4)),
)  # fmt: skip
"""Causes of the catalogue that a single joint can show."""

OTHERS: tuple[Hypothesis, ...] = (
    _signed("", "quadratic drag", "drag", "coefficient", 0.1, 5.0, _limit),
    _spring(),
    _wave("", "periodic torque", ("wave_sin", "wave_cos", "frequency"), _FREQUENCIES),
    _signed("", "integral action", "integral", "rate", 3.0, 50.0),
)
"""Laws without an entry in the catalogue: when one wins, the cause is unknown."""
