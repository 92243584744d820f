"""Joints that follow another one by a joint equality of MuJoCo."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.polynomial import polynomial

Array = Any

JOINT = 2  # mjEQ_JOINT
ITSELF = np.array([0.0, 1.0, 0.0, 0.0, 0.0])


def ties(model: Any) -> tuple[Any, Any, Any]:
    """Joints that follow another: ids of followers and leaders, polynomials [E, 5].

    follower - its qpos0 = polynomial(leader - its qpos0), MuJoCo's joint equality. Of a
    line either may be written first: who is driven leads, also by others in between.
    """
    tied = model.eq_type == JOINT
    tied = tied & (model.eq_obj2id >= 0) & model.eq_active0.astype(bool)
    first, second = model.eq_obj1id[tied], model.eq_obj2id[tied]
    driven = set(model.actuator_trnid[:, 0].tolist())
    data = model.eq_data[tied, :5]
    if np.isin(second, list(driven)).all():
        return first, second, data
    rows = list(zip(first.tolist(), second.tolist(), np.array(data), strict=True))
    led = _led(rows, driven)
    followers = [(joint, *told) for joint, told in led.items() if joint not in driven]
    left = [row for row in rows
            if not {*row[:2]} <= led.keys() or {*row[:2]} <= driven]  # fmt: skip
    every = [*followers, *left]
    ids = np.array([row[:2] for row in every], int).reshape(-1, 2)
    return ids[:, 0], ids[:, 1], np.array([row[2] for row in every])


def _led(
    rows: list[tuple[int, int, np.ndarray]], driven: set[int]
) -> dict[int, tuple[int, np.ndarray]]:
    """The driven joint that leads a joint, and its polynomial [5], along the ties."""
    led = {joint: (joint, ITSELF) for joint in driven}
    grown = -1
    while len(led) > grown:
        grown = len(led)
        for one, other, data in rows:
            ends = (one, other, data), (other, one, _inverse(data))
            for follower, leader, law in ends:
                if follower in led or leader not in led or law is None:
                    continue
                root, through = led[leader]
                joined = _through(law, through)
                if joined is not None:
                    led[follower] = root, joined
    return led


def _inverse(law: np.ndarray) -> np.ndarray | None:
    """The line back along one, None for what is none."""
    if law[1] == 0.0 or law[2:].any():
        return None
    return np.array([-law[0], 1.0, 0.0, 0.0, 0.0]) / law[1]


def _through(law: np.ndarray, inner: np.ndarray) -> np.ndarray | None:
    """The polynomial law(inner(x)), None where it has more than five numbers."""
    out = np.zeros(1)
    for number in law[::-1]:  # Horner
        out = polynomial.polyadd(polynomial.polymul(out, inner), [number])
    out = np.trim_zeros(out, "b")
    if len(out) > 5:
        return None
    return np.pad(out, (0, 5 - len(out)))


def coupled(model: Any, qpos: Array) -> tuple[Any, Array]:
    """Places in qpos of joints that follow another, and their positions.

    Args:
        model: of the robot.
        qpos: [..., nq], the leaders in place.

    Returns:
        Indices [E] and positions [..., E] of the followers, rad.
    """
    followers, leaders, polynomials = ties(model)
    addresses = model.jnt_qposadr[followers], model.jnt_qposadr[leaders]
    turned = qpos[..., addresses[1]] - model.qpos0[addresses[1]]
    position = model.qpos0[addresses[0]] + 0.0 * turned
    for power in range(5):
        if polynomials[:, power].any():
            position = position + polynomials[:, power] * turned**power
    return addresses[0], position


def coupled_speed(model: Any, qpos: Array, qvel: Array) -> tuple[Any, Array]:
    """Places in qvel of joints that follow another, and their speeds [..., E] rad/s."""
    followers, leaders, polynomials = ties(model)
    addresses = model.jnt_qposadr[leaders]
    turned = qpos[..., addresses] - model.qpos0[addresses]
    powers = turned[..., None] ** np.arange(4) * np.arange(1, 5)
    slope = (polynomials[:, 1:] * powers).sum(-1)
    return model.jnt_dofadr[followers], slope * qvel[..., model.jnt_dofadr[leaders]]
