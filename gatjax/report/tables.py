"""What the numbers of a run say: candidates, methods and the paper beside them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from gatjax.report.intervals import (
    LEVEL,
    Interval,
    difference_interval,
    gain_interval,
    mean_interval,
    share_interval,
)
from gatjax.report.read import CHOSEN, THETA0, Rollout, Run

LABELS = {
    "none": "no grounding",
    "envelope": "noise envelope",
    "guided": "guided",
    "gat": "GAT",
    "dagger": "GAT, retrained",
    "sgat": "stochastic GAT",
    "sensing": "GAT and gyro",
    "rgat": "reinforced GAT",
    "garat": "adversarial GAT",
    "explained": "GAT after diagnosis",
    "oracle": "search on the robot",
    THETA0: "theta0",
}
UNGROUNDED = "none"
# What is compared with UNGROUNDED: the first of them that the run has, named in advance
# so that nobody can pick the better one afterwards.
GROUNDED = ("gat", "guided")
CM = 100.0  # cm in a metre


class Paper(NamedTuple):
    """Hanna and Stone 2017, table 1: SimSpark to Gazebo, mean of 10 trials."""

    gain: float  # per cent over theta0
    failed: int  # trials of 10 without a stable improvement
    generation: float  # in which the best policy was found, mean
    remark: str = ""  # what differs from the method of the same name here


PAPER = {
    "none": Paper(gain=11.1, failed=7, generation=1.3),
    "envelope": Paper(gain=18.9, failed=5, generation=6.6, remark="theirs: N(0, 1)"),
    "gat": Paper(gain=22.5, failed=1, generation=2.7),
}
PAPER_THETA0 = 19.52  # cm/s on the NAO, table 2


class Candidate(NamedTuple):
    """One policy and all its walks on the robot."""

    method: str
    iteration: int
    generation: int
    candidate: str  # best, mean, rechecked or chosen
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
        return f"{self.method}_{self.iteration}_{self.generation}_{self.candidate}"


class Falls(NamedTuple):
    """Falls over all candidates of the search after the first generation."""

    count: int
    rollouts: int
    shares: tuple[float, ...]  # one per candidate

    @property
    def share(self) -> Interval:
        """Share of walks that fell, with the candidates as samples.

        Walks of one policy fall alike. The candidates of one search are not independent
        either, so the interval speaks of this search and not of a search anew.
        """
        if len(self.shares) < 2 or len(set(self.shares)) == 1:
            return share_interval(self.count, self.rollouts)
        ends = mean_interval(self.shares)
        share = self.count / self.rollouts
        low, high = max(ends.low, 0.0), min(ends.high, 1.0)
        return Interval(share, min(low, share), max(high, share))


class Method(NamedTuple):
    """How one method did on the robot."""

    name: str
    candidates: list[Candidate]  # of the search, without the chosen one
    best: Candidate | None  # the chosen one, else the fastest with no fall
    gain: Interval | None  # per cent over theta0
    falls: Falls | None  # None if only the first generation was evaluated

    @property
    def evaluated(self) -> bool:
        """Whether any learned walk of it has been on the robot."""
        return bool(self.candidates) or self.best is not None

    @property
    def which(self) -> str:
        """Which of its candidates count, in words after what is said of them."""
        return "" if self.falls is None else " after the first generation"

    @property
    def confirmed(self) -> bool:
        """Whether its best walk was walked again with fresh seeds."""
        return self.best is not None and self.best.candidate == CHOSEN

    @property
    def stands(self) -> bool:
        """Whether its best walk never fell."""
        return self.best is not None and self.best.falls == 0

    @property
    def label(self) -> str:
        """Name for people."""
        return label_of(self.name)


class Summary(NamedTuple):
    """The whole comparison."""

    theta0: Candidate | None
    methods: list[Method]  # in the order of LABELS
    grounded: str  # the method that is compared with no grounding

    @property
    def ranked(self) -> list[Method]:
        """Methods whose best walk has a velocity, the first is the best.

        One that never fell goes before one that did, a confirmed one before one that
        was measured on the walks it was picked by, and then the faster one.
        """
        walking = [each for each in self.methods if each.best and each.best.upright]
        return sorted(
            walking,
            key=lambda each: (each.stands, each.confirmed, speed(each)),
            reverse=True,
        )

    @property
    def confirmed(self) -> bool:
        """Whether any best walk of the run was walked again with fresh seeds."""
        return any(method.confirmed for method in self.methods)


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
    planned = set(names)
    if isinstance(run.config.get("methods"), list):
        planned |= {str(name) for name in run.config["methods"]}
    grounded = next((name for name in GROUNDED if name in planned), GROUNDED[0])
    return Summary(theta0=theta0, methods=methods, grounded=grounded)


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
        if row.candidate == CHOSEN:  # a copy says nothing about where a search began
            continue
        key = (row.method, row.iteration)
        first[key] = min(first.get(key, row.generation), row.generation)
    return first


def summarise_method(
    name: str,
    walked: list[Candidate],
    theta0: Candidate | None,
    first: dict[tuple[str, int], int],
) -> Method:
    """Best walk of a method, its gain, and the falls of all candidates.

    As in the paper, the first generation does not count where there are later ones: its
    policies are drawn at random, nothing was learned yet.
    """
    later = [
        each
        for each in walked
        if each.generation > first.get((name, each.iteration), each.generation - 1)
    ]
    candidates = [each for each in walked if each.candidate != CHOSEN]
    searched = [each for each in later if each.candidate != CHOSEN]
    best = best_of(later if searched else walked)
    falls = None
    if searched:
        falls = Falls(
            count=sum(each.falls for each in searched),
            rollouts=sum(each.rollouts for each in searched),
            shares=tuple(each.falls / each.rollouts for each in searched),
        )
    gain = gain_over(theta0, best)
    return Method(name, candidates, best, gain, falls)


def best_of(walked: list[Candidate]) -> Candidate | None:
    """The chosen candidate of the last iteration that has one, falls or not.

    Without one it is the fastest candidate that never fell.
    """
    chosen = [each for each in walked if each.candidate == CHOSEN]
    if chosen:
        return max(chosen, key=lambda each: (each.iteration, each.generation))
    return fastest_standing(walked)


def fastest_standing(candidates: Iterable[Candidate]) -> Candidate | None:
    """The fastest candidate that never fell, on the walks that it is picked by."""
    standing = [each for each in candidates if each.falls == 0]
    return max(standing, key=_mean_velocity, default=None)


def gain_over(
    theta0: Candidate | None, best: Candidate | None, level: float = LEVEL
) -> Interval | None:
    """Gain of a walk over theta0 in per cent; None if one of them never stood."""
    if best is None or theta0 is None or not (best.upright and theta0.upright):
        return None
    return gain_interval(best.upright, theta0.upright, level)


def faster(one: Candidate, other: Candidate) -> Interval:
    """Velocity of `one` minus velocity of `other`, cm/s."""
    return difference_interval(one.upright, other.upright)


def fewer_falls(one: Falls, other: Falls) -> Interval:
    """Share of falls of `one` minus that of `other`.

    The wider of two intervals: over candidates (Welch), and over walks from the ends of
    two Wilson intervals (Newcombe 1998), which is not of width zero where all
    candidates of both searches agree.
    """
    welch = difference_interval(one.shares, other.shares)
    first = share_interval(one.count, one.rollouts)
    second = share_interval(other.count, other.rollouts)
    mean = first.mean - second.mean
    below = math.hypot(first.mean - first.low, second.high - second.mean)
    above = math.hypot(first.high - first.mean, second.mean - second.low)
    return Interval(mean, min(welch.low, mean - below), max(welch.high, mean + above))


def speed(method: Method) -> float:
    """Mean velocity of the best walk, cm/s; -inf without one."""
    best = method.best
    return _mean_velocity(best) if best and best.upright else -math.inf


def _mean_velocity(candidate: Candidate) -> float:
    return sum(candidate.upright) / len(candidate.upright)
