"""Lies: wrong facts about a robot, and the cause that is there because of each.

They change the model, the log, or what is known of the robot besides its model.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from gatjax.data.recording import Recording
from gatjax.diagnosis.aliases import UPSIDE_DOWN

Rows = tuple[dict[str, Any], ...]
Log = Callable[[Recording], Recording]


class Lie(NamedTuple):
    """A wrong fact, and the cause that is there because of it."""

    cause: str
    joint: str
    spec: Callable[[Any], None] = lambda spec: None  # changes the model
    log: Log = lambda log: log
    rows: Callable[[Rows], Rows] = lambda rows: rows  # changes what is known besides
    variant: str = ""  # of the cause, where it decides


def shifted(joint: str, seconds: float) -> Log:
    """Commands of a joint that a log has earlier than they were sent."""

    def change(log: Recording) -> Recording:
        name = f"command.{joint}"
        sent = np.array(log.columns[name])
        for run in np.unique(log.trajectory):
            rows = log.trajectory == run
            time = log.time[rows]
            held = np.searchsorted(time, time + seconds + 1e-6, side="right") - 1
            sent[rows] = sent[rows][np.minimum(held, rows.sum() - 1)]
        return log._replace(columns=log.columns | {name: sent})

    return change


def read_as(joint: str, scale: float, offset: float) -> Log:
    """Positions as an encoder with a wrong scale and zero has them."""

    def change(log: Recording) -> Recording:
        name = f"position.{joint}"
        seen = scale * log.columns[name] + offset
        return log._replace(columns=log.columns | {name: seen})

    return change


def more(cause: str, joint: str, **values: float) -> Callable[[Rows], Rows]:
    """A correction of the model the wrong way."""
    row = {"cause": cause, "where": [joint], "values": values, "role": "calibration"}
    return lambda rows: (*rows, row)


def lighter(body: str, kg: float) -> Callable[[Any], None]:
    """A link that is heavier than its model by `kg`."""

    def change(spec: Any) -> None:
        spec.body(body).mass -= kg

    return change


def nearer(body: str, share: float) -> Callable[[Any], None]:
    """A link whose centre of mass is farther out than its model says."""

    def change(spec: Any) -> None:
        spec.body(body).ipos = np.asarray(spec.body(body).ipos) * (1.0 - share)

    return change


def upside_down(spec: Any) -> None:
    """Gravity with the wrong sign."""
    spec.option.gravity = -np.asarray(spec.option.gravity)


def supplied(joint: str, share: float) -> Callable[[Any], None]:
    """A servo that is taken to get `share` of its voltage: of its gain and torque."""

    def change(spec: Any) -> None:
        servo = spec.actuator(joint)
        gain, bias = np.array(servo.gainprm), np.array(servo.biasprm)
        gain[0], bias[1] = share * gain[0], share * bias[1]
        servo.gainprm, servo.biasprm = gain, bias
        servo.forcerange = share * np.array(servo.forcerange)

    return change


def limited(share: float) -> Callable[[Rows], Rows]:
    """Known torque limits of servos that are taken to get `share` of their voltage."""

    def less(row: dict[str, Any]) -> dict[str, Any]:
        if row["cause"] != "torque_limit":
            return row
        return row | {"values": {k: share * v for k, v in row["values"].items()}}

    return lambda rows: tuple(map(less, rows))


def tilted(pitch: float) -> Callable[[Any], None]:
    """A mounting that is turned about y."""

    def change(spec: Any) -> None:
        spec.option.gravity = 9.81 * np.array([np.sin(pitch), 0.0, -np.cos(pitch)])

    return change


def of_pendulum(joint: str, torque: float) -> dict[str, Lie | None]:
    """Lies about one joint with a pendulum; one has `torque` N m more friction."""
    lies: dict[str, Lie | None] = {
        f"offset {rad:+.2f}": Lie("encoder_offset", joint, log=read_as(joint, 1.0, rad))
        for rad in (0.1, -0.15)
    }
    for scale in (1.1, 0.88):
        lies[f"scale {scale}"] = Lie(
            "encoder_scale", joint, log=read_as(joint, scale, 0.0)
        )
    for late in (0.03, 0.06):
        lies[f"delay {late}"] = Lie("command_delay", joint, log=shifted(joint, late))
    for scale in (0.5, 2.0):  # servos are often left at half of their usual gain
        wrong = more("gain_error", joint, scale=scale)
        lies[f"gain {scale}"] = Lie("gain_error", joint, rows=wrong)
    for kg in (0.12, 0.2):
        lies[f"lighter {kg}"] = Lie("payload", joint, spec=lighter("pendulum", kg))
    lies["nearer"] = Lie("com_shift", joint, spec=nearer("pendulum", 0.25))
    lies["tilted"] = Lie("gravity_tilt", joint, spec=tilted(0.2))
    lies["upside down"] = Lie(
        "gravity_tilt", joint, spec=upside_down, variant=UPSIDE_DOWN
    )
    wrong = more("coulomb_friction", joint, torque=torque)
    lies[f"friction {torque:+.2f}"] = Lie("coulomb_friction", joint, rows=wrong)
    return lies


def of_servo(joint: str, volts: float) -> dict[str, Lie | None]:
    """Lies about one position servo with a pendulum, which gets `volts`."""
    lies = of_pendulum(joint, 0.03)
    for told in (5.0, 12.0):
        share = told / volts
        lies[f"{told:.0f} V"] = Lie(
            "gain_error", joint, spec=supplied(joint, share), rows=limited(share)
        )
    return lies


def of_arm() -> dict[str, Lie | None]:
    """Lies about the SO-101: of one joint, of all servos (P 32 for 16), of gravity."""
    shift, turn = "Elbow", "Wrist_Roll"
    lies: dict[str, Lie | None] = {
        "offset": Lie("encoder_offset", shift, log=read_as(shift, 1.0, 0.12)),
        "scale": Lie("encoder_scale", turn, log=read_as(turn, 1.15, 0.0)),
        "P 32": Lie("gain_error", "all", rows=more("gain_error", "all", scale=2.0)),
        "tilted": Lie("gravity_tilt", "all", spec=tilted(0.3)),
        "upside down": Lie(
            "gravity_tilt", "all", spec=upside_down, variant=UPSIDE_DOWN
        ),
        "lighter": Lie("payload", turn, spec=lighter("gripper", 0.07)),
        "nearer": Lie("com_shift", "Elbow", spec=nearer("lower_arm", 0.7)),
    }
    for joint, late in (("Rotation", 0.06), ("Jaw", 0.08)):
        lies[f"delay {joint}"] = Lie("command_delay", joint, log=shifted(joint, late))
    for joint, scale in (("Wrist_Pitch", 0.4), ("Elbow", 2.5)):
        wrong = more("gain_error", joint, scale=scale)
        lies[f"gain {joint}"] = Lie("gain_error", joint, rows=wrong)
    for joint, coefficient in (("Rotation", -0.5), ("Wrist_Pitch", 1.5)):
        wrong = more("viscous_friction", joint, coefficient=coefficient)
        lies[f"damping {joint}"] = Lie("viscous_friction", joint, rows=wrong)
    return lies
