"""A joint as the diagnosis simulates it: its numbers, loads and measurements."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from gatjax.diagnosis import kernel, laws, plant
from gatjax.diagnosis.tolerances import USUAL, Tolerances

STEP = 1e-3  # s, of the single-joint simulation
GRAVITY = ("gravity_x", "gravity_y", "gravity_z")  # in `nominal`, m/s^2
GEARS = frozenset({"backlash", "joint_elasticity"})
SPARSE = 50  # steps of the simulation: loads are slow
PULLS = (10.0, 30.0)  # 1/s, how fast a servo's joint is drawn to it, in angle alone
BOUNCING = 60.0  # 1/s, of one with a gap: slower, chance says where teeth meet
OBSERVED = 10.0  # 1/s, how fast a joint without a servo is drawn to its measured motion


class Assumed(NamedTuple):
    """What is known of a joint besides its model."""

    law: Callable[[float], dict[str, float]]  # torque limit N m -> fields of laws.Drive
    barred: frozenset[str]  # causes that are not looked for again
    named: frozenset[str]  # causes that act here; calibration is none
    supply: float | None  # N m of all servos at which the supply sags most
    motor: tuple[float, ...] = ()  # numbers of the drive before anything was known

    @property
    def geared(self) -> bool:
        """Whether motor and link are simulated apart."""
        return bool(self.barred & GEARS)


NOTHING = Assumed(lambda limit: {}, frozenset(), frozenset(), None)


class Link(NamedTuple):
    """The body that a joint moves, or another one that it carries."""

    mass: float  # kg
    centre: np.ndarray  # [3] m, of mass, in the body's frame
    axis: np.ndarray  # [3] of its joint, in the body's frame

    def swung(self, shift: np.ndarray) -> float:
        """Square of a shift's [3] part across the axis, m^2 (parallel axes)."""
        return float(shift @ shift - (shift @ self.axis) ** 2)


class Joint(NamedTuple):
    """One joint over R runs of at most N rows."""

    name: str
    index: int
    nominal: dict[str, float]  # fields of laws.Drive that are not neutral
    grid: laws.Grid
    lead: int
    time: np.ndarray  # [R, N] s
    measured: np.ndarray  # [R, N] rad
    valid: np.ndarray  # [R, N] what counts: no padding, stop or gap
    noise: float  # rad, standard deviation of a reading, or how close is close enough
    allowed: Tolerances = USUAL
    link: Link = Link(1.0, np.zeros(3), np.eye(3)[0])
    limited: bool = True  # whether the model says what torque it has
    assumed: Assumed = NOTHING
    whole: np.ndarray | None = None  # [R, N] `valid` with the runs that are left aside

    @property
    def servoed(self) -> bool:
        """Whether a servo holds it; else it is told a torque or a voltage."""
        return self.nominal["hold"] > 0.0

    @property
    def motor(self) -> tuple[float, ...]:
        """Numbers of the drive as the model file gives them: one motor, one tuple."""
        names = "kp", "kv", "damping", "friction", "armature"
        limit = self.nominal["limit"] if self.limited else 0.0
        given = (*(self.nominal[name] for name in names), limit)
        return self.assumed.motor or given

    @property
    def inertia(self) -> float:
        """Of what it moves, kg m^2, the mean over its motion; without the armature."""
        return float(np.mean(self.grid.inertia[::SPARSE]))

    @property
    def fastest(self) -> float:
        """Speed that a hundredth of its motion exceeds, rad/s."""
        path, runs = self.grid.path, self.grid.running
        speed = np.abs(np.diff(path, axis=0))[runs[1:] > 0.0] / STEP
        return float(np.quantile(speed, 0.99))

    def drawn(self, rate: float) -> Joint:
        """The same, drawn to its measured motion at a rate in 1/s; 0: not at all.

        One without a servo always is: nothing else would keep two open loops together.
        """
        kept = ("pull", "steer")
        free = {name: n for name, n in self.nominal.items() if name not in kept}
        if not self.servoed:
            return self._replace(nominal=free | observed(max(rate, OBSERVED)))
        alone = {"pull": rate, "steer": 0.0}
        law = observed(rate) if rate > PULLS[-1] else alone
        return self._replace(nominal=free | (law if rate else {}))

    def without(self, runs: Sequence[int]) -> Joint:
        """The same; these runs do not count, and all others do."""
        whole = self.valid if self.whole is None else self.whole
        valid = whole.copy()
        valid[list(runs)] = False
        return self._replace(valid=valid, whole=whole)

    def residual(self, drives: list[dict[str, float]], geared: bool) -> np.ndarray:
        """Measured minus simulated at all valid rows [n, S], rad."""
        seen = self.simulate(drives, geared)
        return (self.measured[..., None] - seen)[self.valid]

    def simulate(self, drives: list[dict[str, float]], geared: bool) -> np.ndarray:
        """Readings [R, N, S] rad of joints whose drives differ."""
        return self.outcome(drives, geared).readings

    def outcome(
        self, drives: list[dict[str, float]], geared: bool, moving: bool = False
    ) -> plant.Outcome:
        """Everything that the simulation gives; where the link was, if asked for."""
        drawn, apart = "pull" in self.nominal, geared or self.assumed.geared
        return kernel.simulate(
            self.packed(drives), self.grid, self.time, self.lead, STEP, apart, drawn,
            moving,
        )  # fmt: skip

    def packed(self, drives: list[dict[str, float]]) -> laws.Drive:
        """Numbers of many drives as arrays [S]; what is not named is nominal."""
        names = [name for name in laws.Drive._fields if name != "terms"]
        rows = [self.nominal | drive for drive in drives]
        numbers: dict[str, Any] = {
            name: np.array([row.get(name, 0.0) for row in rows], np.float32)
            for name in names
        }
        count = self.grid.rest_terms.shape[-1]
        terms = [[row.get(f"term{k}", 0.0) for k in range(count)] for row in rows]
        return laws.Drive(**numbers, terms=np.array(terms, np.float32))


def observed(rate: float) -> dict[str, float]:
    """An observer (Luenberger 1964) with both poles at a rate in 1/s."""
    return {"pull": 2.0 * rate, "steer": rate**2}
