"""Claims about floor, feet and inertial unit: what explains the channels best."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis.claims import PLACE, PRICE
from gatjax.diagnosis.floor import carried, causes, contact, estimate, played
from gatjax.diagnosis.floor.carried import Load
from gatjax.diagnosis.floor.causes import Suspect, of_contacts
from gatjax.diagnosis.floor.observed import (
    Observed,
    Weighed,
    gained,
    observe,
    vector,
    weighed,
    widened,
)
from gatjax.diagnosis.floor.played import Rows
from gatjax.diagnosis.floor.standing import Standing
from gatjax.effects.sensor import turned
from gatjax.sim.world import World

ROUNDS = 3  # of simulating again at the best value
PROMISING = 3.0  # nats: else a value is not looked into again
LINKS, STEERED = 8, 4  # that are simulated at once; whose payloads are looked into
STEP = 0.002  # rad, of finite differences
TOLERATED = {"sole_geometry": (0, 0.19), "ground_compliance": (1, 0.29)}
"""Node, and share of its change, that is a tolerance: 0.15 mm; a fifth of the time."""
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


class Scene(NamedTuple):
    """A standing robot as all its claims are weighed."""

    standing: Standing
    world: World  # nominal
    rows: list[Rows]  # nominal, of each run
    suspects: list[Suspect]
    simulated: list[np.ndarray]  # channels [K, C, B] at the nodes of each suspect
    seen: Observed
    known: Weighed  # the nominal robot


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


def scene(standing: Standing, tell: Callable[[str, float], None]) -> Scene:
    """Simulate all suspects of a robot, and widen its tolerances by small ones.

    Args:
        standing: the robot.
        tell: is called with a stage and the share of it that is done.
    """
    world = standing.ensembles[0].world
    rows = [_first(row) for row in standing.ensembles[0].rows]
    suspects = causes.suspects(standing.model)
    seen = observe(standing)
    nominal = vector(standing, seen.names, rows)[0]
    simulated = []
    for number, suspect in enumerate(suspects):
        tell("suspects", number / len(suspects))
        nodes = [suspect.world(world, x) for x in suspect.nodes]
        simulated.append(_predicted(standing, seen.names, nodes))
    columns = _tolerances(suspects, simulated, nominal, standing.allowed.tilt)
    if (other := contact.nearby(world)) is not None:
        rows_of = played.replayed(other, standing.runs, [other.values])
        grip = vector(standing, seen.names, rows_of)[0] - nominal
        columns = np.concatenate([columns, grip[..., None]], -1)
    wide = widened(seen, columns)
    known = weighed(wide, nominal)
    return Scene(standing, world, rows, suspects, simulated, wide, known)


def _tolerances(
    suspects: list[Suspect], simulated: list[np.ndarray], nominal: np.ndarray,
    tilt: float,
) -> np.ndarray:  # fmt: skip
    """Small changes [C, B, K] of soles, ground and tilt that are no cause.

    The tilt is a tolerance of the ensemble, too; a direction of its own costs less than
    what a few draws make of it.
    """
    columns = []
    for suspect, channels in zip(suspects, simulated, strict=True):
        if suspect.cause in TOLERATED:
            node, share = TOLERATED[suspect.cause]
            columns.append(share * (channels[node] - nominal))
        if suspect.cause == "gravity_tilt":
            columns += list(tilt * _slopes(suspect, channels))
    return np.stack(columns, -1)


def replayed(scene: Scene, world: World, runs: list[JointRun]) -> Weighed:
    """How well a world of any structure, given the runs' commands, meets the logs."""
    rows = played.replayed(world, runs, [world.values])
    return weighed(scene.seen, vector(scene.standing, scene.seen.names, rows)[0])


def visibility(scene: Scene, best: Weighed) -> float:
    """RMS change over the scatter from tolerances and noise; the largest channel's."""
    change = np.square(scene.known.rest - best.rest).mean(1)
    scatter = np.square(scene.seen.scatter).sum(-1).mean(1) + scene.seen.noise**2
    return float(np.sqrt(change / scatter).max())


def _first(row: Rows) -> Rows:
    """The first world's rows alone."""
    return Rows(row.time, row.command, *(part[:1] for part in row[2:]))


def _predicted(
    standing: Standing, names: tuple[str, ...], worlds: list[World]
) -> np.ndarray:
    """Channels [S, C, B] of worlds that differ in the causes' fields."""
    world = standing.ensembles[0].world
    rows = played.replayed(world, standing.runs, causes.batch(world, worlds))
    return vector(standing, names, rows)


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
        rows = [_askew(row, x) for row in scene.rows]
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


def _askew(row: Rows, angles: np.ndarray) -> Rows:
    """Rows of an inertial unit whose axes are turned by roll, pitch, yaw rad."""
    axes = np.stack([turned(axis, angles) for axis in np.eye(3)])
    seen = {name: getattr(row, name) for name in ("gyro", "accelerometer", "up")}
    return row._replace(
        **{name: rows @ axes.T for name, rows in seen.items() if rows.shape[-1]}
    )


def _leaning(scene: Scene, suspect: Suspect, seen: np.ndarray) -> FloorClaim:
    """The best vector, from simulated pairs."""
    x, now, covariance = _steered(scene, suspect, _slopes(suspect, seen))
    return _claim(scene, suspect, x, now, estimate.length(x, covariance))


def _carried(scene: Scene) -> list[FloorClaim]:
    """Payloads of the links that explain most to first order, each at its best."""
    nominal = vector(scene.standing, scene.seen.names, scene.rows)
    tried, loads = [], carried.loads(scene.standing.model)
    for first in range(0, len(loads), LINKS):
        some = loads[first : first + LINKS]
        worlds = [load.world(scene.world, x) for load in some for x in load.nodes]
        seen = _predicted(scene.standing, scene.seen.names, worlds)
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
        now = replayed(scene, suspect.world(scene.world, x), scene.standing.runs)
        if round_ and now.evidence <= best[1].evidence:
            break
        best = (x, now, covariance)
        if now.evidence - scene.known.evidence < PROMISING:
            break
    return best


def _slopes(suspect: Suspect, seen: np.ndarray) -> np.ndarray:
    """Channels [P, C, B] per unit of a vector, from simulated pairs [2 P, C, B]."""
    size = np.abs(suspect.nodes).max()
    return (seen[0::2] - seen[1::2]) / (2.0 * size)


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
            world = suspect.world(scene.world, np.array([best]))
            curve[best] = _predicted(scene.standing, scene.seen.names, [world])[0]
    span = estimate.inside(found)
    return _claim(scene, suspect, np.array([best]), found[best], span)


def _neutral(scene: Scene, suspect: Suspect) -> float:
    """The value of a parameter in the nominal model."""
    field = {"mu": "friction", "time_constant": "solref"}.get(suspect.axes[0])
    if field is None:
        return 0.0
    return float(of_contacts(scene.standing.model, field).max())
