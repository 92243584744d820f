"""What may be wrong with a joint: tolerances, the catalogue's causes, and other laws.

A hypothesis puts its coordinates into the numbers of a simulated joint. Tolerances come
first, in units of their standard deviation; a cause's own coordinates follow.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from gatjax.diagnosis.joint import Joint
from gatjax.diagnosis.loads import TERMS
from gatjax.diagnosis.tolerances import SHARES

Numbers = dict[str, float]
Put = Callable[[Numbers, Joint, np.ndarray], None]
Starts = tuple[tuple[float, ...], ...]

TOLERANCES = (
    *SHARES, "zero_in", "zero_out", "delay", "stiction",
    *(f"term{k}" for k in range(TERMS)),
)  # fmt: skip
COUNT = len(TOLERANCES)
BOUND = 3.5  # standard deviations that a tolerance may use up


class Hypothesis(NamedTuple):
    """A cause in one variant: where its coordinates go and where to start."""

    cause: str  # name in the catalogue, or "" for a law that it lacks
    variant: str
    put: Put
    starts: Starts
    steps: tuple[float, ...]  # of the finite differences
    low: tuple[float, ...]
    high: tuple[float, ...]
    values: Callable[[Joint, np.ndarray], Numbers]  # the catalogue's parameters, SI
    geared: bool = False
    parts: tuple[Any, ...] = ()  # of a combination: the causes it is made of
    prior: tuple[float, ...] = ()  # information on the coordinates around 0
    rung: float = 0.0  # distance of starts, where slopes tell nothing: zoomed in on
    linear: bool = False  # around 0, where it does nothing; starts lie along its axes
    guess: Callable[[Joint, np.ndarray], Starts] | None = None  # from the residual [n]
    imitator: str = ""  # tolerance that can stand for a little of the cause
    taken: Callable[[Joint, float], float] | None = None  # coordinate for all of it

    @property
    def law(self) -> tuple[str, str]:
        """Cause and variant: the same at any joint and beside any other."""
        return self.cause, self.variant

    @property
    def newest(self) -> Hypothesis:
        """The last part of a combination; alone, itself."""
        return (self.parts or (self,))[-1]

    def begins(self, joint: Joint, residual: np.ndarray) -> Starts:
        """Where to start beside what leaves a residual [n]."""
        more = () if self.guess is None else self.guess(joint, residual)
        return (*self.starts, *more)

    def relieved(self, joint: Joint, x: np.ndarray) -> np.ndarray | None:
        """Coordinates with the cause instead of its imitator; None if it stands not.

        Args:
            joint: in question.
            x: [COUNT + ...] tolerances, and what is known besides.
        """
        if self.taken is None:
            return None
        index = TOLERANCES.index(self.imitator)
        with np.errstate(all="ignore"):
            own = self.taken(joint, float(x[index]))
        if not np.isfinite(own):
            return None
        changed = x.copy()
        changed[index] = 0.0
        return np.append(changed, np.clip(own, self.low[0], self.high[0]))

    def weights(self) -> np.ndarray:
        """Prior information on the coordinates, [own]; 0 where there is none."""
        return np.array(self.prior or (0.0,) * len(self.low))

    @property
    def name(self) -> str:
        """Cause and variant, for people."""
        return (
            f"{self.cause} ({self.variant})"
            if self.cause and self.variant
            else (self.cause or self.variant)
        )


def parts_of(hypothesis: Hypothesis | None) -> tuple[Hypothesis, ...]:
    """The causes that it is made of, in the order of their coordinates."""
    return () if hypothesis is None else hypothesis.parts or (hypothesis,)


def combined(first: Hypothesis | None, second: Hypothesis) -> Hypothesis:
    """Two causes at once; the coordinates of the second follow those of the first."""
    if first is None:
        return second
    own = len(first.low)

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        first.put(drive, joint, x[:own])
        second.put(drive, joint, x[own:])

    return second._replace(
        put=put, starts=(), steps=first.steps + second.steps,
        low=first.low + second.low, high=first.high + second.high,
        geared=first.geared or second.geared,
        prior=(*first.weights(), *second.weights()),
        parts=(*(first.parts or (first,)), second),
    )  # fmt: skip


def pinned(hypothesis: Hypothesis, own: np.ndarray) -> Hypothesis:
    """A hypothesis whose own coordinates are given: only tolerances are left to fit."""

    def put(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
        hypothesis.put(drive, joint, own)

    return hypothesis._replace(
        put=put, starts=(), steps=(), low=(), high=(), prior=(),
        values=lambda joint, x: hypothesis.values(joint, own),
    )  # fmt: skip


def information(hypothesis: Hypothesis | None) -> np.ndarray:
    """Prior information on all coordinates [COUNT + own]."""
    own = hypothesis.weights() if hypothesis else np.zeros(0)
    return np.append(np.ones(COUNT), own)


def tolerated(joint: Joint, x: np.ndarray) -> Numbers:
    """Numbers of a joint whose tolerances are used up by x [COUNT] deviations."""
    drive: Numbers = {}
    allowed = joint.allowed
    for name, value in zip(TOLERANCES, x, strict=True):
        if name in SHARES:
            share = getattr(allowed, name)
            drive[name] = joint.nominal[name] * float(np.exp(share * value))
        elif name in ("zero_in", "zero_out"):
            drive[name] = joint.nominal.get(name, 0.0) + allowed.zero * value
        elif name == "delay":
            drive[name] = max(0.0, joint.nominal["delay"] + allowed.late * value)
        elif name == "stiction":
            excess = allowed.stribeck * max(0.0, 1.0 + value)
            own = joint.nominal["friction"] * excess
            drive[name] = joint.nominal.get(name, own)
        else:
            drive[name] = value
    return drive


def numbers(joint: Joint, hypothesis: Hypothesis | None, x: np.ndarray) -> Numbers:
    """Numbers of a joint under a hypothesis, coordinates x [COUNT + own]."""
    drive = tolerated(joint, x[:COUNT])
    if hypothesis is not None:
        hypothesis.put(drive, joint, x[COUNT:])
    return drive
