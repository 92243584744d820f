"""Claims about floor, feet and inertial unit: what explains the channels best."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gatjax.diagnosis.claims import PLACE, PRICE
from gatjax.diagnosis.floor import carried, estimate
from gatjax.diagnosis.floor.carried import Load
from gatjax.diagnosis.floor.causes import Suspect, of_contacts
from gatjax.diagnosis.floor.observed import (
    Weighed,
    gained,
    vector,
    weighed,
)
from gatjax.diagnosis.floor.scene import (
    Scene,
    askew,
    predicted,
    replayed,
    slopes_of,
    visibility,
)

ROUNDS = 3  # of simulating again at the best value
PROMISING = 3.0  # nats: else a value is not looked into again
LINKS, STEERED = 8, 4  # that are simulated at once; whose payloads are looked into
STEP = 0.002  # rad, of finite differences
INERTIAL = ("gyro", "accelerometer", "orientation")  # what an inertial unit says
AXES = ("roll", "pitch", "yaw")


class FloorClaim(NamedTuple):
    """A cause of floor, feet or inertial unit, and what it explains, in nats."""

    cause: str
    where: str
    values: dict[str, float]  # the catalogue's parameters, the scored one first
    low: float  # 90 % interval of the first parameter
    high: float
    gain: float  # nats over what was known before, prices paid
    channels: dict[str, float]  # nats of each channel
    visibility: float  # RMS change over the scatter from tolerances


def claims(scene: Scene, tell: Callable[[str, float], None]) -> list[FloorClaim]:
    """All claims, best first.

    Args:
        scene: the robot and what is known of it.
        tell: is called with a stage and the share of it that is done.
    """
    unit = any(name.partition(".")[0] in INERTIAL for name in scene.seen.names)
    found = [_imu(scene)] if unit else []
    for number, suspect in enumerate(scene.suspects):
        tell("floor", number / len(scene.suspects))
        fitted = _leaning if len(suspect.axes) > 1 else _along
        found.append(fitted(scene, suspect, scene.simulated[number]))
    found += [claim for claim in _carried(scene) if claim.values["mass"] > 0.0]
    return sorted(found, key=lambda claim: -claim.gain)


def _claim(
    scene: Scene, suspect: Suspect | Load, x: np.ndarray, best: Weighed,
    span: tuple[float, float],
) -> FloorClaim:  # fmt: skip
    """A claim at its best value."""
    bins = scene.seen.measured.shape[1]
    per = bins * np.log(scene.known.level / best.level)
    gain = gained(scene.known, best) - PRICE * len(x) - PLACE
    low, high = np.clip(span, suspect.low, suspect.high)
    channels = dict(zip(scene.seen.names, map(float, per), strict=True))
    return FloorClaim(
        suspect.cause, suspect.where, suspect.values(x), float(low), float(high),
        float(gain), channels, visibility(scene, best),
    )  # fmt: skip


def _imu(scene: Scene) -> FloorClaim:
    """The best misalignment: what the inertial unit says, turned."""
    suspect = Suspect("imu_misalignment", "imu", AXES, np.zeros((0, 3)), {}, 0.0, 1.0)

    def predict(x: np.ndarray) -> np.ndarray:
        rows = [askew(row, x) for row in scene.rows]
        return vector(scene.standing, scene.seen.names, rows)[0]

    x, now, covariance = np.zeros(3), scene.known, np.eye(3)
    for _ in range(ROUNDS):
        here = predict(x)
        slopes = np.stack(
            [(predict(x + row) - here) / STEP for row in np.eye(3) * STEP]
        )
        x, covariance = estimate.improved(scene.seen, now, x, slopes)
        now = weighed(scene.seen, predict(x))
    return _claim(scene, suspect, x, now, estimate.length(x, covariance))


def _leaning(scene: Scene, suspect: Suspect, seen: np.ndarray) -> FloorClaim:
    """The best vector, from simulated pairs."""
    x, now, covariance = _steered(scene, suspect, slopes_of(suspect, seen))
    return _claim(scene, suspect, x, now, estimate.length(x, covariance))


def _carried(scene: Scene) -> list[FloorClaim]:
    """Payloads of the links that explain most to first order, each at its best."""
    nominal = vector(scene.standing, scene.seen.names, scene.rows)
    tried, loads = [], carried.loads(scene.standing.model)
    for first in range(0, len(loads), LINKS):
        some = loads[first : first + LINKS]
        world = scene.robot.world
        seen = predicted(
            scene, [load.world(world, x) for load in some for x in load.nodes]
        )
        for load, part in zip(some, np.split(seen, len(some)), strict=True):
            slopes = load.slopes(part, nominal)
            still = np.zeros(len(slopes))
            x, _ = estimate.improved(scene.seen, scene.known, still, slopes)
            there = weighed(scene.seen, nominal[0] + np.tensordot(x, slopes, 1))
            tried.append((there.evidence, load, slopes))
    tried.sort(key=lambda row: -row[0])
    found = []
    for _, load, slopes in tried[:STEERED]:
        x, now, covariance = _steered(scene, load, slopes)
        half = estimate.BAND * float(np.sqrt(covariance[0, 0]))
        found.append(_claim(scene, load, x, now, (x[0] - half, x[0] + half)))
    return found


def _steered(
    scene: Scene, suspect: Suspect | Load, slopes: np.ndarray
) -> tuple[np.ndarray, Weighed, np.ndarray]:
    """The best coordinates [P] by slopes and simulations at the best; covariance."""
    x, now, covariance = np.zeros(len(slopes)), scene.known, np.eye(len(slopes))
    best = (x, now, covariance)
    for round_ in range(ROUNDS):
        x, covariance = estimate.improved(scene.seen, now, x, slopes)
        world = suspect.world(scene.robot.world, x)
        now = replayed(scene, scene.robot._replace(world=world))
        if round_ and now.evidence <= best[1].evidence:
            break
        best = (x, now, covariance)
        if now.evidence - scene.known.evidence < PROMISING:
            break
    return best


def _along(scene: Scene, suspect: Suspect, seen: np.ndarray) -> FloorClaim:
    """The best severity of one parameter, between simulated ones."""
    neutral = _neutral(scene, suspect)
    nominal = vector(scene.standing, scene.seen.names, scene.rows)
    places = [neutral, *suspect.nodes[:, 0]]
    curve = dict(zip(places, np.concatenate([nominal, seen]), strict=True))
    for round_ in range(ROUNDS):
        found = estimate.profile(scene.seen, curve, neutral)
        best = max(found, key=lambda x: found[x].evidence)
        if found[best].evidence - scene.known.evidence < PROMISING or best in curve:
            break
        if round_ + 1 < ROUNDS:
            world = suspect.world(scene.robot.world, np.array([best]))
            curve[best] = predicted(scene, [world])[0]
    span = estimate.inside(found)
    return _claim(scene, suspect, np.array([best]), found[best], span)


def _neutral(scene: Scene, suspect: Suspect) -> float:
    """The value of a parameter in the nominal model."""
    field = {"mu": "friction", "time_constant": "solref"}.get(suspect.axes[0])
    if field is None:
        return 0.0
    return float(of_contacts(scene.standing.model, field).max())
