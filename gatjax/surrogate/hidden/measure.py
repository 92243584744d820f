"""From what a robot did to what its log says."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from gatjax.data.recording import Recording
from gatjax.surrogate.hidden import feet
from gatjax.surrogate.hidden.plant import EVERY, History
from gatjax.surrogate.hidden.robots import Robot
from gatjax.surrogate.hidden.targets import Lane

COUNT = 2.0 * np.pi / 4096.0  # rad, 12-bit encoder
NOISE = np.deg2rad(0.03)
VELOCITY_NOISE = 0.03  # rad/s
TORQUE_NOISE = 0.01  # of the limit
SUPPLY, SUPPLY_DROP, SUPPLY_NOISE = 12.0, 0.002, 0.02  # V, 1/(N m), V
COLD, WARMTH, COOLING = 33.0, 1.5, 30.0  # deg C, deg C/s at the limit, s


class Channels(NamedTuple):
    """Which columns a recording has beside time, command and position."""

    velocity: bool = False
    temperature: bool = False
    voltage: bool = False
    torque: bool = False


def _at(history_field: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """A column of a history [T] at moments [K] s, linear between milliseconds."""
    return np.interp(moments, EVERY * np.arange(len(history_field)), history_field)


def _on_the_bus(lane: Lane, field: np.ndarray) -> np.ndarray:
    """What the joints report [K, J] of a field [T, J]: by their clock, and late."""
    numbers = lane.specimen.numbers
    moments = lane.log.times * (1.0 - float(numbers["drift"]))
    late = np.maximum(moments[:, None] - numbers["late"], 0.0)
    columns = zip(field.T, late.T, strict=True)
    return np.column_stack([_at(column, when) for column, when in columns])


def positions(lane: Lane, history: History) -> np.ndarray:
    """What the encoders show [K, J] rad, before noise and rounding."""
    numbers = lane.specimen.numbers
    shown = _on_the_bus(lane, history.angle)
    for extra in lane.specimen.extras:
        if extra.kind == "eccentricity":
            angle = shown[:, extra.joint]
            wave = np.sin(angle + extra.values["phase"])
            shown[:, extra.joint] = angle + extra.values["amplitude"] * wave
    shown = shown + numbers["offset_loop"]
    return numbers["scale_log"] * shown + numbers["offset_log"]


def channels(lane: Lane, history: History) -> np.ndarray:
    """Everything that a log always has [K, J (+ body)], without noise."""
    shown = [positions(lane, history)]
    moments = lane.log.times * (1.0 - float(lane.specimen.numbers["drift"]))
    shown += [_at(column, moments)[:, None] for column in history.body.T]
    return np.hstack(shown)


def noises(joints: int, floating: bool) -> np.ndarray:
    """Standard deviation of the noise of `channels`, rounding included."""
    position = np.full(joints, np.hypot(NOISE, COUNT / np.sqrt(12.0)))
    return np.concatenate([position, feet.NOISE]) if floating else position


def log_of(
    robot: Robot, lane: Lane, history: History, wanted: Channels
) -> dict[str, np.ndarray]:
    """The columns of one trajectory, noise and rounding included."""
    rng = np.random.default_rng([*lane.log.noise_seed, 11])
    times = lane.log.times
    shown = channels(lane, history)
    count = len(robot.joints)
    noise = np.full(count, NOISE)
    if robot.floating:
        noise = np.concatenate([noise, feet.NOISE])
    shown += noise * rng.standard_normal(shown.shape)
    position = np.rint(shown[:, :count] / COUNT) * COUNT
    columns = {"time": times}
    for joint, name in enumerate(robot.joints):
        columns[f"command.{name}"] = lane.log.commands[:, joint]
        columns[f"position.{name}"] = position[:, joint]
    speed = history.speed * lane.specimen.numbers["scale_log"]
    families = {
        "velocity": (wanted.velocity, speed, VELOCITY_NOISE),
        "torque": (wanted.torque, history.torque, TORQUE_NOISE * _limits(robot)),
        "temperature": (wanted.temperature, _warm(robot, history), 0.0),
    }
    for family, (is_wanted, field, noise) in families.items():
        if is_wanted:
            values = _on_the_bus(lane, field)
            values += noise * rng.standard_normal(values.shape)
            if family == "temperature":
                values = np.rint(values)
            for joint, name in enumerate(robot.joints):
                columns[f"{family}.{name}"] = values[:, joint]
    if wanted.voltage:
        supply = _at(_supply(lane, history), times)
        columns["voltage"] = supply + SUPPLY_NOISE * rng.standard_normal(len(times))
    if robot.floating:
        columns |= dict(zip(feet.BODY_COLUMNS, shown[:, count:].T, strict=True))
    return columns


def _limits(robot: Robot) -> np.ndarray:
    return robot.model.actuator_forcerange[:, 1]


def _warm(robot: Robot, history: History) -> np.ndarray:
    """Motor temperatures [T, J] deg C."""
    load = (history.torque / _limits(robot)) ** 2
    keep = np.exp(-EVERY / COOLING)
    heat = np.asarray(lfilter([1.0], [1.0, -keep], load, axis=0))
    return COLD + WARMTH * EVERY * heat


def _supply(lane: Lane, history: History) -> np.ndarray:
    """Supply voltage [T] V."""
    if float(lane.specimen.numbers["sag"]) > 0.0:
        return SUPPLY * (1.0 - history.lost.min(axis=1))
    return SUPPLY * (1.0 - SUPPLY_DROP * np.abs(history.torque).sum(axis=1))


def recording(
    robot: Robot, logs: list[dict[str, np.ndarray]], rate: float
) -> Recording:
    """One file of one or more trajectories."""
    joined = {name: np.concatenate([log[name] for log in logs]) for name in logs[0]}
    time = joined.pop("time")
    return Recording(
        name=robot.name,
        time=time,
        trajectory=np.repeat(np.arange(len(logs)), [len(log["time"]) for log in logs]),
        columns=joined,
        metadata={
            "robot": robot.name,
            "base": "floating" if robot.floating else "fixed",
            "rate": f"{rate:.4g}",
            "format": "gatjax.recording/1",
        },
    )
