"""What the numbers of a run say: candidates, methods and the paper beside them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from gatjax.report.intervals import (
    Interval,
    difference_interval,
    gain_interval,
    mean_interval,
    share_interval,
)
from gatjax.report.read import THETA0, Rollout, Run

LABELS = {
    "none": "no grounding",
    "envelope": "noise envelope",
    "guided": "guided",
    "gat": "GAT",
    THETA0: "theta0",
}
UNGROUNDED = "none"
BASELINES = ("none", "envelope")  # they learn nothing from the robot's recordings
CM = 100.0  # cm in a metre


class Paper(NamedTuple):
    """Hanna and Stone 2017, table 1: SimSpark to Gazebo, mean of 10 trials."""

    gain: float  # per cent over theta0
    failed: int  # trials of 10 without a stable improvement
    generation: float  # in which the best policy was found, mean


PAPER = {
    "none": Paper(gain=11.1, failed=7, generation=1.3),
    "envelope": Paper(gain=18.9, failed=5, generation=6.6),
    "gat": Paper(gain=22.5, failed=1, generation=2.7),
}
PAPER_THETA0 = 19.52  # cm/s on the NAO, table 2


class Candidate(NamedTuple):
    """One policy and all its walks on the robot."""

    method: str
    iteration: int
    generation: int
    candidate: str  # best or mean
    upright: tuple[float, ...]  # cm/s of the walks that did not fall
    falls: int
    rollouts: int

    @property
    def velocity(self) -> Interval | None:
        """Velocity in cm/s of the walks that did not fall; None if all fell."""
        return mean_interval(self.upright) if self.upright else None

    @property
    def stem(self) -> str:
        """Name of its policy file, without the ending."""
        if self.method == THETA0:
            return THETA0
        return f"{self.method}_{self.iteration}_{self.generation}_{self.candidate}"


class Falls(NamedTuple):
    """Falls over all candidates after the first generation."""

    count: int
    rollouts: int
    shares: tuple[float, ...]  # one per candidate

    @property
    def share(self) -> Interval:
        """Share of walks that fell, resampled by candidate.

        Walks of one policy fall alike, so the candidates are the samples.
        """
        if len(self.shares) < 2 or len(set(self.shares)) == 1:
            return share_interval(self.count, self.rollouts)
        ends = mean_interval(self.shares)
        share = self.count / self.rollouts
        return Interval(share, min(ends.low, share), max(ends.high, share))


class Method(NamedTuple):
    """How one method did on the robot."""

    name: str
    candidates: list[Candidate]
    best: Candidate | None  # fastest candidate with no fall
    gain: Interval | None  # per cent over theta0
    falls: Falls | None  # None if only the first generation was evaluated

    @property
    def label(self) -> str:
        """Name for people."""
        return label_of(self.name)


class Summary(NamedTuple):
    """The whole comparison."""

    theta0: Candidate | None
    methods: list[Method]  # in the order of LABELS


def label_of(method: str) -> str:
    """Name of a method for people."""
    return LABELS.get(method, method)


def ordered(names: Iterable[str]) -> list[str]:
    """Sort method names as LABELS lists them, unknown ones last."""
    known = list(LABELS)
    return sorted(
        set(names), key=lambda name: (known.index(name) if name in known else 99, name)
    )


def summarise(run: Run) -> Summary:
    """Group the walks on the robot by candidate and method."""
    candidates = group_candidates(run.rollouts)
    theta0 = next((each for each in candidates if each.method == THETA0), None)
    names = ordered({row.method for row in (*run.rollouts, *run.metrics)} - {THETA0})
    first = first_generations(run)
    methods = [
        summarise_method(
            name, [each for each in candidates if each.method == name], theta0, first
        )
        for name in names
    ]
    return Summary(theta0=theta0, methods=methods)


def group_candidates(rollouts: Sequence[Rollout]) -> list[Candidate]:
    """Collect the walks of each policy; theta0 is one policy whatever its rows say."""
    groups: dict[tuple[str, int, int, str], list[Rollout]] = {}
    for row in rollouts:
        key = (row.method, row.iteration, row.generation, row.candidate)
        if row.method == THETA0:
            key = (THETA0, 0, 0, "best")
        groups.setdefault(key, []).append(row)
    return [
        Candidate(
            *key,
            upright=tuple(CM * row.velocity_m_s for row in rows if not row.fell),
            falls=sum(row.fell for row in rows),
            rollouts=len(rows),
        )
        for key, rows in sorted(groups.items())
    ]


def first_generations(run: Run) -> dict[tuple[str, int], int]:
    """Number of the first generation of each method and iteration."""
    first: dict[tuple[str, int], int] = {}
    for row in (*run.metrics, *run.rollouts):
        key = (row.method, row.iteration)
        first[key] = min(first.get(key, row.generation), row.generation)
    return first


def summarise_method(
    name: str,
    candidates: list[Candidate],
    theta0: Candidate | None,
    first: dict[tuple[str, int], int],
) -> Method:
    """Best candidate without a fall, its gain, and the falls of all candidates."""
    standing = [each for each in candidates if each.falls == 0]
    best = max(standing, key=_mean_velocity, default=None)
    later = [
        each for each in candidates if each.generation > first[name, each.iteration]
    ]
    falls = None
    if later:
        falls = Falls(
            count=sum(each.falls for each in later),
            rollouts=sum(each.rollouts for each in later),
            shares=tuple(each.falls / each.rollouts for each in later),
        )
    gain = None
    if best and theta0 and theta0.upright:
        gain = gain_interval(best.upright, theta0.upright)
    return Method(name, candidates, best, gain, falls)


def faster(one: Candidate, other: Candidate) -> Interval:
    """Velocity of `one` minus velocity of `other`, cm/s."""
    return difference_interval(one.upright, other.upright)


def _mean_velocity(candidate: Candidate) -> float:
    return sum(candidate.upright) / len(candidate.upright)
