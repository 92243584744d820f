"""Laws that single joints add to the common servo and friction, and where they act.

A law gets its parameters [n], its state, the flat indices [n] of its joints and what
is true `Now`, and returns [n] numbers:

    error     the position error that the servo goes on with, rad
    push      added to the servo's torque before it saturates, N m
    room      torque (low, high) that the motor can give at its speed, N m
    power     factor on the motor torque
    friction  added to the level of dry friction, N m
    motor     torque on the motor side, N m
    link      torque on the link, N m
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from gatjax.surrogate.hidden.numbers import Specimen


class Now:
    """What is true in this step; every array flat [L * J]."""

    time: float  # s, negative while the robot settles
    step: float  # s
    angle: np.ndarray  # rad, link
    speed: np.ndarray  # rad/s, link
    motor_angle: np.ndarray  # rad
    motor_speed: np.ndarray  # rad/s
    error: np.ndarray  # rad
    torque: np.ndarray  # N m, of the servo, one step old
    limit: np.ndarray  # N m


Law = Callable[[dict[str, np.ndarray], dict[str, Any], np.ndarray, Now], Any]


def dead_band(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """Errors within the band count as none."""
    error = now.error[at]
    return error - np.clip(error, -p["half_width"], p["half_width"])


def sign_gain(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """Positive and negative errors are weighed differently."""
    error = now.error[at]
    return error * (1.0 + p["skew"] * np.sign(error))


def eccentricity(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """The encoder disc sits off its axis, and the servo believes it."""
    return now.error[at] - p["amplitude"] * np.sin(now.angle[at] + p["phase"])


def integral(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """An integral part, bounded to half of the limit."""
    total = state.get("sum", np.zeros(len(at))) + p["gain"] * now.error[at] * now.step
    bound = 0.5 * now.limit[at]
    state["sum"] = np.clip(total, -bound, bound)
    return state["sum"]


def motor_line(p: dict, state: dict, at: np.ndarray, now: Now) -> tuple:
    """Torque falls with speed to nothing at the top speed, back EMF."""
    share = now.motor_speed[at] / p["limit"]
    limit = now.limit[at]
    low = np.clip(-1.0 - share, -1.0, 1.0) * limit
    return low, np.clip(1.0 - share, -1.0, 1.0) * limit


def power_loss(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """Now and then the motor is without power for a moment."""
    phase = np.mod(now.time - p["start"], p["interval"])
    off = (now.time >= p["start"]) & (phase < p["duration"])
    return np.where(off, 0.0, 1.0)


def saturation(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """Iron that saturates: half of the torque is missing where it is `torque`."""
    return p["torque"] / (p["torque"] + np.abs(now.torque[at]))


def stiction(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """Extra near standstill; Gauss curve after Armstrong-Helouvry 1991."""
    ratio = now.motor_speed[at] / p["velocity"]
    return p["excess"] * np.exp(-(ratio**2))


def load_friction(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """Friction in proportion to the transmitted torque."""
    return p["coefficient"] * np.abs(now.torque[at])


def one_way(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """Extra friction in the direction of the sign of `torque`."""
    along = now.motor_speed[at] * p["torque"] > 0.0
    return np.abs(p["torque"]) * along


def rough_patch(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """More friction around one angle."""
    return p["torque"] * np.exp(-(((now.angle[at] - p["centre"]) / p["width"]) ** 2))


def episode(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """The joint binds for some time."""
    inside = (now.time >= p["start"]) & (now.time < p["start"] + p["duration"])
    return p["torque"] * inside


def ripple(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """Cogging."""
    phase = p["cycles"] * now.motor_angle[at] + p["phase"]
    return p["amplitude"] * np.sin(phase)


def spring(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """A spring from link to parent."""
    return -p["stiffness"] * (now.angle[at] - p["rest"])


def cable(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """A cable that is slack up to an angle and then pulls back ever harder."""
    past = np.maximum(p["side"] * (now.angle[at] - p["start"]), 0.0)
    return -p["side"] * p["pull"] * (past + 2.0 * past**2)


def soft_stop(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """A rubber stop inside the range; it only pushes."""
    past = p["side"] * (now.angle[at] - p["start"])
    push = p["stiffness"] * (past + 0.02 * p["side"] * now.speed[at])
    return -p["side"] * np.where(past > 0.0, np.maximum(push, 0.0), 0.0)


def drag(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """Fluid drag."""
    speed = now.speed[at]
    return -p["coefficient"] * speed * np.abs(speed)


def cross_talk(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """Torque of another joint leaks in (`ahead`: its flat index less ours)."""
    return p["gain"] * now.torque[at + p["ahead"].astype(int)]


def shake(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """A periodic torque from outside."""
    return p["amplitude"] * np.sin(2.0 * np.pi * p["frequency"] * now.time + p["phase"])


def onset(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """A constant torque from outside that begins at some time."""
    return p["torque"] * (now.time >= p["start"])


def bouc_wen(p: dict, state: dict, at: np.ndarray, now: Now) -> np.ndarray:
    """A hysteretic spring: Bouc-Wen with n = 1, beta = gamma = 0.5 / width."""
    speed = now.speed[at]
    z = state.get("z", np.zeros(len(at)))
    loss = 0.5 * (np.abs(speed) * z + speed * np.abs(z)) / p["width"]
    state["z"] = np.clip(z + now.step * (speed - loss), -p["width"], p["width"])
    return -p["stiffness"] * state["z"]


TERMS: dict[str, tuple[str, Law]] = {
    "dead_band": ("error", dead_band),
    "sign_gain": ("error", sign_gain),
    "eccentricity": ("error", eccentricity),
    "integral": ("push", integral),
    "motor_line": ("room", motor_line),
    "power_loss": ("power", power_loss),
    "saturation": ("power", saturation),
    "stiction": ("friction", stiction),
    "load_friction": ("friction", load_friction),
    "one_way": ("friction", one_way),
    "rough_patch": ("friction", rough_patch),
    "episode": ("friction", episode),
    "ripple": ("motor", ripple),
    "spring": ("link", spring),
    "cable": ("link", cable),
    "soft_stop": ("link", soft_stop),
    "drag": ("link", drag),
    "cross_talk": ("link", cross_talk),
    "shake": ("link", shake),
    "onset": ("link", onset),
    "bouc_wen": ("link", bouc_wen),
}
"""Every kind of extra, but gear and heat: where it acts and its law."""


class Bound(NamedTuple):
    """A law with the joints that have it."""

    at: np.ndarray  # [n] int, flat
    law: Law
    values: dict[str, np.ndarray]  # each [n]
    state: dict[str, Any]

    def __call__(self, now: Now) -> Any:
        """The law's numbers [n] now."""
        return self.law(self.values, self.state, self.at, now)


def gather(
    specimens: Sequence[Specimen], joints: int, kind: str
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Flat indices [n] and parameters, each [n], of all extras of a kind."""
    found = [
        (lane * joints + extra.joint, extra.values)
        for lane, specimen in enumerate(specimens)
        for extra in specimen.extras
        if extra.kind == kind
    ]
    names = found[0][1] if found else {}
    values = {name: np.array([v[name] for _, v in found], float) for name in names}
    return np.array([at for at, _ in found], int), values


def bind(specimens: Sequence[Specimen], joints: int) -> dict[str, list[Bound]]:
    """All laws that these specimens need, by the place where they act."""
    bound: dict[str, list[Bound]] = {place: [] for place, _ in TERMS.values()}
    for kind, (place, law) in TERMS.items():
        at, values = gather(specimens, joints, kind)
        if at.size:
            bound[place].append(Bound(at, law, values, {}))
    return bound
