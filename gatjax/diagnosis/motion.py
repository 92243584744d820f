"""How the joints moved in a run, on the even grid of the simulations."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.sim.limbs import settling

WINDOW = 0.09  # s, of the local parabola that gives velocity and acceleration
LEAD = 0.4  # s at rest before a run, at least
FINE = 5  # simulation steps between two points of a motion
WHOLE = 2000  # steps: grids are multiples of it, so that logs share compiled programs


class Ride(NamedTuple):
    """How a base moves, as MuJoCo has the coordinates of a free joint."""

    position: np.ndarray  # [M, 7]
    velocity: np.ndarray  # [M, 6]
    acceleration: np.ndarray  # [M, 6]


class Motion(NamedTuple):
    """Motion of one run on an even grid [M] s; the others are [M, J], in rad and s."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    base: Ride | None = None  # of a robot that stands; None: it is fixed


def smoothed(run: JointRun, angle: np.ndarray, time: np.ndarray) -> Motion:
    """Fit a parabola around every sample (Savitzky and Golay 1964, on an even grid).

    Args:
        run: gives the stamps.
        angle: [N, J] rad at the stamps.
        time: [M] s since the first stamp, of the result.
    """
    stamps = run.time - run.time[0]
    count = round(stamps[-1] / float(np.median(np.diff(stamps)))) + 1
    even = np.linspace(0.0, stamps[-1], count)
    half = max(2, round(0.5 * WINDOW / even[1]))
    padded = np.stack([np.interp(even, stamps, q) for q in angle.T], -1)
    padded = np.pad(padded, ((half, half), (0, 0)), mode="edge")
    ahead = even[1] * np.arange(-half, half + 1)
    parabola = np.linalg.pinv(np.vander(ahead, 3, increasing=True))  # of the readings
    series = []
    for scale, weights in zip((1.0, 1.0, 2.0), parabola, strict=True):
        smooth = [scale * np.correlate(q, weights, mode="valid") for q in padded.T]
        series.append(np.stack([np.interp(time, even, s) for s in smooth], -1))
    position, velocity, acceleration = series
    return Motion(time, position, velocity, acceleration)


def simulated(
    run: JointRun, time: np.ndarray, angle: np.ndarray, rest: np.ndarray
) -> Motion:
    """A simulated motion [M, J], carried to the measured one by a smooth difference.

    The simulation has the fast parts that smoothing would lose, the measurement the
    slow ones that the simulation misses.

    Args:
        run: gives the stamps.
        time: [M] s.
        angle: simulated [M, J] rad.
        rest: measured minus simulated readings [N, J] rad at the stamps.
    """
    added = smoothed(run, rest, time)
    step = time[1] - time[0]
    velocity = np.gradient(angle, step, axis=0)
    acceleration = np.zeros_like(angle)
    acceleration[1:-1] = np.diff(angle, 2, axis=0) / step**2
    return Motion(
        time, angle + added.position, velocity + added.velocity,
        acceleration + added.acceleration,
    )  # fmt: skip


def lead_of(model: mujoco.MjModel) -> float:
    """How long a robot that hangs is told the first command before a run, s."""
    return max(settling(model), LEAD)


def grid_time(runs: list[JointRun], step: float, lead: float = LEAD) -> np.ndarray:
    """Grid of the simulations [K] s: a lead at rest, s, then the longest run."""
    lead = round(lead / step)
    longest = max(run.time[-1] - run.time[0] for run in runs)
    count = -(-(lead + int(np.ceil(longest / step)) + 2) // WHOLE) * WHOLE
    return (np.arange(count) - lead) * step


def cells(time: np.ndarray, command: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Mean of a held command [N, J] over each step of a grid [K] -> [K, J]."""
    step = grid[1] - grid[0]
    edges = np.append(grid, grid[-1] + step)
    start = np.concatenate([[min(edges[0], time[0]) - step], time[1:], [edges[-1] + 1]])
    total = np.concatenate(
        [
            np.zeros((1, command.shape[1])),
            np.cumsum(command * np.diff(start)[:, None], 0),
        ]
    )
    area = np.stack([np.interp(edges, start, column) for column in total.T], -1)
    return np.diff(area, axis=0) / step


def spread(grid: np.ndarray, time: np.ndarray, series: np.ndarray) -> np.ndarray:
    """Interpolate series [N, ...] onto the grid [K], held at the ends."""
    flat = series.reshape(len(time), -1)
    out = np.stack([np.interp(grid, time, column) for column in flat.T], -1)
    return out.reshape(len(grid), *series.shape[1:])
