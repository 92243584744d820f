"""Kinds of hypotheses: how the coordinates of a cause become numbers of a joint.

Torques are coordinates in shares of the joint's torque limit, stiffnesses in shares of
its gain, so that the same bank serves a finger and a hip. Positive numbers are searched
as logarithms.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from gatjax.diagnosis.hypotheses import Hypothesis, Numbers
from gatjax.diagnosis.joint import Joint
from gatjax.diagnosis.tolerances import SHARES

Scale = Callable[[Joint], float]
LESS = "less than nominal"


def _one(joint: Joint) -> float:
    return 1.0


def limit_of(joint: Joint) -> float:
    """Torque that shares are of, N m: the limit, or what a radian of error gives."""
    most = joint.nominal["kp"] if joint.servoed else np.inf
    return min(joint.nominal["limit"], most)


TRACE = 0.05  # the unit of what a model has none of


def gain_of(joint: Joint) -> float:
    """Stiffness of the servo, N m/rad; without one, the limit per tenth of a turn."""
    if joint.servoed:
        return joint.nominal["kp"]
    return joint.nominal["limit"] / (0.2 * np.pi)


def resistance_of(joint: Joint) -> float:
    """Damping of joint and servo, N m s/rad, or a trace of the critical one."""
    known = joint.nominal["damping"] + joint.nominal["kv"] + 1e-3
    inertia = joint.inertia + joint.nominal["armature"]
    return max(known, TRACE * float(np.sqrt(gain_of(joint) * inertia)))


def armature_of(joint: Joint) -> float:
    """Nominal armature, kg m^2, or a trace of what it moves."""
    return max(joint.nominal["armature"] + 1e-4, TRACE * joint.inertia)


def positive(
    cause: str, parameter: str, field: str, low: float, high: float,
    starts: Sequence[float], scale: Scale = _one, added: bool = False,
    step: float = 0.03,
) -> Hypothesis:  # fmt: skip
    """One positive number: set, or added to what the joint has already."""

    def size(joint: Joint, x: np.ndarray) -> float:
        return scale(joint) * float(np.exp(x[0]))

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        known = joint.nominal if field == "late" else drive  # no tolerance sets it
        drive[field] = size(joint, x) + (known.get(field, 0.0) if added else 0.0)

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


def variant_of(base: Hypothesis, variant: str, fixed: Numbers) -> Hypothesis:
    """The same cause with some numbers fixed, which are parameters of it, too."""

    def values(joint: Joint, x: np.ndarray) -> Numbers:
        return base.values(joint, x) | fixed

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        base.put(drive, joint, x)
        drive.update(fixed)

    return base._replace(variant=variant, put=put, values=values)


def geared(base: Hypothesis, variant: str, sensed: float, linked: float) -> Hypothesis:
    """The same cause with the motor and the link apart, each with some of the joint's.

    The last coordinates are the link's shares of friction and of armature (wheels of
    the gear turn with it), and ln of the damping ratio, which says how teeth bounce.

    Args:
        base: backlash or elasticity.
        variant: says the rest.
        sensed: 1: the encoder sits on the motor; 0: on the link.
        linked: 1: the servo's kv goes by the speed of the link; 0: of the motor.
    """
    own, fixed = len(base.low), {"encoder_on_motor": sensed, "kv_on_link": linked}

    def rest(x: np.ndarray) -> tuple[float, float, float]:
        return float(x[own]), float(x[own + 1]), float(np.exp(x[own + 2]))

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        base.put(drive, joint, x[:own])
        drive["sensed"], drive["linked"] = sensed, linked
        drive["link_share"], drive["behind"], drive["ratio"] = rest(x)

    def values(joint: Joint, x: np.ndarray) -> Numbers:
        names = "link_share", "armature_share", "damping_ratio"
        numbers = dict(zip(names, rest(x), strict=True))
        return base.values(joint, x[:own]) | fixed | numbers

    return base._replace(
        variant=variant, put=put, geared=True, values=values,
        starts=tuple(
            (*s, share, 0.1, float(np.log(ratio)))
            for s in base.starts
            for share, ratio in ((0.1, 0.1), (0.1, 0.3), (0.8, 0.2))
        ),
        steps=(*base.steps, 0.05, 0.05, 0.1), low=(*base.low, 0.0, 0.0, np.log(0.02)),
        high=(*base.high, 1.0, 0.5, np.log(1.0)),
    )  # fmt: skip


def factor(
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


def lessened(cause: str, parameter: str, field: str) -> Hypothesis:
    """A nominal number that is too large: ln of the share of it that is there."""

    def values(joint: Joint, x: np.ndarray) -> Numbers:
        return {parameter: joint.nominal[field] * float(np.expm1(x[0]))}

    share = factor(cause, field, 0.02, 0.97, (0.1, 0.3, 0.6))
    return share._replace(variant=LESS, values=values)


def signed(
    cause: str, variant: str, field: str, parameter: str, size: float, high: float,
    scale: Scale = _one, neutral: float = 0.0, values: Numbers | None = None,
) -> Hypothesis:  # fmt: skip
    """A number of either sign, searched as it is."""

    def number(joint: Joint, x: np.ndarray) -> float:
        return neutral + scale(joint) * float(x[0])

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        known = joint.nominal.get(field, neutral) - neutral
        drive[field] = known + number(joint, x)

    starts = tuple((k * size,) for k in (0.3, -0.3, 1.0, -1.0))
    plain = Hypothesis(
        cause, variant, put, starts, (0.02 * size,), (-high,), (high,),
        lambda joint, x: {parameter: number(joint, x)} | (values or {}),
    )  # fmt: skip
    if field not in ("zero_in", "zero_out"):
        return plain._replace(linear=True)
    return plain._replace(  # it takes the place of what the encoder's zero may be off
        imitator=field, taken=lambda joint, x: joint.allowed.zero * x
    )


def add_terms(drive: Numbers, first: int, sizes: Sequence[float] | np.ndarray) -> None:
    """Add to load terms that follow each other; another cause may have set them."""
    for term, size in enumerate(sizes, start=first):
        drive[f"term{term}"] = drive.get(f"term{term}", 0.0) + float(size)


def vector(
    cause: str, first: int, names: tuple[str, ...], norm: str, size: float, high: float
) -> Hypothesis:
    """Load terms that belong together, e.g. the axes of a displacement."""
    count = len(names)

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        add_terms(drive, first, x)

    def values(joint: Joint, x: np.ndarray) -> Numbers:
        parts = {name: float(v) for name, v in zip(names, x, strict=True)}
        return {norm: float(np.linalg.norm(x))} | parts

    starts = tuple(tuple(row) for k in (size, -size) for row in np.eye(count) * k)
    return Hypothesis(
        cause, "", put, starts, (0.05 * size,) * count, (-high,) * count,
        (high,) * count, values, prior=((3.0 / high) ** 2,) * count, linear=True,
    )  # fmt: skip


AMPLITUDES = ((0.03, 0.0), (0.0, 0.03))  # of sine and cosine, that starts try


def wave(
    cause: str, variant: str, fields: tuple[str, str, str], rates: Sequence[float]
) -> Hypothesis:
    """A sine of position or time: amplitudes in shares of the limit, then the rate.

    The fields get amplitude, phase and rate.
    """

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        drive[fields[0]], drive[fields[2]], drive[fields[1]] = values(joint, x).values()

    def values(joint: Joint, x: np.ndarray) -> Numbers:
        return {
            "amplitude": limit_of(joint) * float(np.hypot(x[0], x[1])),
            fields[2]: float(np.exp(x[2])),
            "phase": float(np.arctan2(x[1], x[0]) % (2.0 * np.pi)),
        }

    starts = tuple((*pair, float(np.log(r))) for r in rates for pair in AMPLITUDES)
    low, high = np.log(rates[0]) - 0.2, np.log(rates[-1]) + 0.2
    return Hypothesis(
        cause, variant, put, starts, (0.003, 0.003, 0.002), (-1.0, -1.0, low),
        (1.0, 1.0, high), values,
    )  # fmt: skip
