"""What a run of the loop is: one frozen value, which is also the command line."""

from __future__ import annotations

from dataclasses import dataclass, field

import tyro

ROBOT_LOG, SIMULATOR_LOG, EVALUATION, CONFIRMATION, EXPLANATION = 1, 2, 3, 4, 5
"""Purposes of walks and motions: each draws from random streams of its own."""
LAST = 9_999  # seed: those after it have the walks of other purposes


def seeds(purpose: int, seed: int, count: int) -> range:
    """Seeds of `count` walks or motions, for a seed from 0 to LAST.

    No two purposes and no two runs share one.
    """
    first = purpose * 10**9 + seed * 10**5
    return range(first, first + count)


def check_seed(name: str, seed: int) -> None:
    """Refuse a seed that `seeds` is not for.

    Raises:
        ValueError: one line, with the name that the seed has there.
    """
    if not 0 <= seed <= LAST:
        raise ValueError(
            f"{name} is {seed}; use 0 to {LAST}: walks of any other seed are those "
            f"of another purpose, or none"
        )


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """How long and how wide to search; the defaults are the paper's search."""

    population: int = 150  # policies a generation
    rollouts: int = 20  # rollouts a policy
    generations: int = 10
    sigma: float = 0.5  # first standard deviation, in steps
    sigma_max: float = 1.5  # largest standard deviation, in steps
    race: int = 0  # rollouts after which the worse half drops out; 0: it never does

    @property
    def walks(self) -> int:
        """Rollouts of one generation."""
        if not self.race:
            return self.population * self.rollouts
        late = self.population // 2 * (self.rollouts - self.race)
        return self.population * self.race + late


@dataclass(frozen=True, kw_only=True)
class LoopSettings:
    """Collect, ground, search, evaluate: everything that shapes the numbers."""

    robot: str = "dart"
    """Robot that the simulator does not know: dart or stiff, or one behind a link:
    lola, simspark, simspark-v4 (see gatjax collect; --rate-hz 83.3 for lola)."""
    body_seed: int = 0
    """Which random body (masses, joint offsets, sensor gains) the robot has."""
    methods: tuple[str, ...] = ("none", "envelope", "guided", "gat")
    """Groundings to compare, in this order: of none, envelope, guided, gat, dagger
    (GAT whose inverse model is retrained where the grounded simulator goes), sgat (GAT
    that samples from a stochastic forward model), sensing (GAT and a correction of the
    gyro), rgat and garat (one network by reinforcement: rewarded for following GAT's
    forward model, or for passing for the robot; they need gatjax[rl] and minutes). And
    oracle: a search on the robot itself, the ceiling."""
    explain: bool = False
    """Diagnose the robot first, and compare GAT in the simulation extended by that."""
    world: str | None = None
    """world.json (of a diagnosis, say) of the simulator to begin with, without a
    grounding; ideal if left out. The run keeps a copy."""
    iterations: int = 1
    """Grounding iterations: re-ground on the best walk found and search again."""
    robot_trajectories: int = 50
    """Runs of the robot to learn from, each iteration."""
    simulator_trajectories: int = 50
    """Runs of the simulator to learn from, each iteration."""
    evaluations: int = 5
    """Runs on the robot for each candidate walk."""
    candidates: tuple[str, ...] = ("best", "mean")
    """Which policies of a generation walk on the robot: best, mean (of what the search
    draws from), rechecked (the one of the five best and the mean that costs least in
    20 more rollouts: the best of few is a lucky one, and may fall)."""
    search: tyro.conf.OmitArgPrefixes[SearchSettings] = field(
        default_factory=SearchSettings
    )
    """CMA-ES: population x rollouts x generations."""
    rate_hz: float = 50.0
    """Control rate: 50 (paper), 100 or 83.3."""
    seed: int = 0
    """Seed of everything random, 0 to 9999."""
    model: str = "light"
    """Search on a robot without the joints that the walk never moves, with longer
    physics steps and fewer solver iterations (light), or on the whole one (full), which
    candidates walk on."""
    backend: str = "auto"
    """Search on: native (CPU threads), mjx (one compiled call), auto."""
    impl: str = "auto"
    """MJX implementation: jax, warp (NVIDIA), or auto: warp where it can run."""


DEMO = LoopSettings(
    robot_trajectories=30,
    simulator_trajectories=30,
    evaluations=4,
    search=SearchSettings(population=40, rollouts=4, generations=6),
)
"""Fits 2 cores in ten minutes."""

PAPER = LoopSettings(evaluations=10, candidates=("best",))
"""The paper's Table 1 on one body: 150 policies x 20 rollouts x 10 generations."""

PRESETS = {"demo": DEMO, "paper": PAPER}
