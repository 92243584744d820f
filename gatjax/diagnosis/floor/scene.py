"""A standing robot as all claims about it are weighed: what is known, and suspects."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis.floor import causes, contact, played
from gatjax.diagnosis.floor.causes import Suspect
from gatjax.diagnosis.floor.observed import (
    Observed,
    Weighed,
    observe,
    vector,
    weighed,
    widened,
)
from gatjax.diagnosis.floor.played import Rows
from gatjax.diagnosis.floor.standing import Standing
from gatjax.effects.sensor import turned
from gatjax.sim.world import Values, World

TOLERATED = {"sole_geometry": (0, 0.19), "ground_compliance": (1, 0.29)}
"""Node, and share of its change, that is a tolerance: 0.15 mm; a fifth of the time."""


class Robot(NamedTuple):
    """A standing robot as far as it is known."""

    world: World
    runs: list[JointRun]  # the logs, with the commands that came through
    askew: np.ndarray  # [3] rad, roll, pitch, yaw of its inertial unit

    def own(self) -> list[Rows]:
        """Its rows of each run."""
        return self._logged([self.world.values])

    def rows(self, worlds: list[World]) -> list[Rows]:
        """Rows of each run in worlds that differ from it in the causes' fields."""
        return self._logged(causes.batch(self.world, worlds))

    def _logged(self, values: list[Values]) -> list[Rows]:
        rows = played.replayed(self.world, self.runs, values)
        return [askew(row, self.askew) for row in rows]


class Scene(NamedTuple):
    """A standing robot as all its claims are weighed."""

    standing: Standing
    robot: Robot  # nominal, with the causes that are known
    rows: list[Rows]  # its own, of each run; none: not simulated yet
    suspects: list[Suspect]
    simulated: list[np.ndarray]  # channels [K, C, B] at the nodes of each suspect
    seen: Observed
    known: Weighed  # the robot as far as it is known


def prepare(standing: Standing, tell: Callable[[str, float], None]) -> Scene:
    """Simulate all suspects of a robot, and widen its tolerances by small ones.

    Args:
        standing: the robot.
        tell: is called with a stage and the share of it that is done.
    """
    world = standing.ensembles[0].world
    robot = Robot(world, standing.runs, np.zeros(3))
    rows = [_first(row) for row in standing.ensembles[0].rows]
    suspects = causes.suspects(standing.model)
    seen = observe(standing)
    nominal = vector(standing, seen.names, rows)[0]
    known = weighed(seen, nominal)
    first = Scene(standing, robot, rows, suspects, [], seen, known)
    simulated = _simulated(first, tell)
    columns = _tolerances(suspects, simulated, nominal, standing.allowed.tilt)
    if (other := contact.nearby(world)) is not None:
        rows_of = played.replayed(other, standing.runs, [other.values])
        grip = vector(standing, seen.names, rows_of)[0] - nominal
        columns = np.concatenate([columns, grip[..., None]], -1)
    wide = widened(seen, columns)
    known = weighed(wide, nominal)
    return first._replace(simulated=simulated, seen=wide, known=known)


def beside(scene: Scene, robot: Robot, known: Weighed) -> Scene:
    """The scene of a robot of which more is known; no suspect is simulated yet."""
    return scene._replace(robot=robot, rows=[], known=known)


def resimulated(scene: Scene, tell: Callable[[str, float], None]) -> Scene:
    """The scene with what its robot and all suspects beside it would log."""
    rows = scene.robot.own()
    return scene._replace(rows=rows, simulated=_simulated(scene, tell))


def _simulated(scene: Scene, tell: Callable[[str, float], None]) -> list[np.ndarray]:
    """Channels [K, C, B] at the nodes of each suspect."""
    out, world = [], scene.robot.world
    for number, suspect in enumerate(scene.suspects):
        tell("suspects", number / len(scene.suspects))
        nodes = [suspect.world(world, x) for x in suspect.nodes]
        out.append(predicted(scene, nodes))
    return out


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
            columns += list(tilt * slopes_of(suspect, channels))
    return np.stack(columns, -1)


def replayed(scene: Scene, robot: Robot) -> Weighed:
    """How well a robot of any structure meets the logs."""
    rows = vector(scene.standing, scene.seen.names, robot.own())
    return weighed(scene.seen, rows[0])


def visibility(scene: Scene, best: Weighed) -> float:
    """RMS change over the scatter from tolerances and noise; the largest channel's."""
    change = np.square(scene.known.rest - best.rest).mean(1)
    scatter = np.square(scene.seen.scatter).sum(-1).mean(1) + scene.seen.noise**2
    return float(np.sqrt(change / scatter).max())


def _first(row: Rows) -> Rows:
    """The first world's rows alone."""
    return Rows(row.time, row.command, *(part[:1] for part in row[2:]))


def predicted(scene: Scene, worlds: list[World]) -> np.ndarray:
    """Channels [S, C, B] of worlds that differ in the causes' fields."""
    return vector(scene.standing, scene.seen.names, scene.robot.rows(worlds))


def askew(row: Rows, angles: np.ndarray) -> Rows:
    """Rows of an inertial unit whose axes are turned by roll, pitch, yaw rad."""
    axes = np.stack([turned(axis, angles) for axis in np.eye(3)])
    seen = {name: getattr(row, name) for name in ("gyro", "accelerometer", "up")}
    return row._replace(
        **{name: rows @ axes.T for name, rows in seen.items() if rows.shape[-1]}
    )


def slopes_of(suspect: Suspect, seen: np.ndarray) -> np.ndarray:
    """Channels [P, C, B] per unit of a vector, from simulated pairs [2 P, C, B]."""
    size = np.abs(suspect.nodes).max()
    return (seen[0::2] - seen[1::2]) / (2.0 * size)
