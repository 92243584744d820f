"""How visible effects are, and how strong they must be for a visibility.

Visibility: RMS change of a channel by the effect over the RMS scatter of that channel
from the nominal tolerances and noise (docs/files.md).
"""

from __future__ import annotations

from itertools import chain
from typing import NamedTuple

import numpy as np

from gatjax.surrogate.hidden.causes import RUNGS
from gatjax.surrogate.hidden.design import Case
from gatjax.surrogate.hidden.measure import channels, noises
from gatjax.surrogate.hidden.plant import History
from gatjax.surrogate.hidden.targets import Lane

WILD = 1.0  # rad beyond the largest command
FALLEN = 0.6  # rad


class Sight(NamedTuple):
    """What stage one found: the visibility of every rung."""

    base: np.ndarray  # [K, C] channels without effect
    scatter: np.ndarray  # [C]
    rungs: tuple[np.ndarray, ...]  # per option [RUNGS, C], NaN where it failed


def sane(case: Case, lane: Lane, history: History) -> bool:
    """Whether a run stayed near its commands and upright."""
    if not np.isfinite(history.angle).all() or not np.isfinite(history.body).all():
        return False
    reach = np.abs(lane.log.commands).max() + WILD
    upright = not case.robot.floating or np.abs(history.body[:, 6:8]).max() < FALLEN
    return bool(np.abs(history.angle).max() < reach and upright)


def rms(values: np.ndarray) -> np.ndarray:
    """Root mean squares [...] over the first axis of values [K, ...]."""
    return np.sqrt(np.mean(np.square(values), axis=0))


def first_lanes(case: Case) -> list[Lane]:
    """What stage one runs for a case."""
    log = case.fits[0]
    bodies = [case.bare, *case.others]
    for effect in chain.from_iterable(case.options):
        bodies += [effect.on(case.bare, case.robot, v) for v in effect.ladder]
    return [Lane(body, log) for body in bodies]


def look(case: Case, lanes: list[Lane], histories: list[History]) -> Sight:
    """Turns the runs of stage one into visibilities."""
    shown = [channels(*pair) for pair in zip(lanes, histories, strict=True)]
    base, count = shown[0], 1 + len(case.others)
    line = np.stack(shown[:count])
    spread = np.sqrt(line.var(axis=0, ddof=1).mean(axis=0))
    scatter = np.hypot(spread, noises(len(case.robot.joints), case.robot.floating))
    rungs = []
    for first in range(count, len(shown), RUNGS):
        seen = np.full((RUNGS, base.shape[1]), np.nan)
        for rung in range(RUNGS):
            place = first + rung
            if not sane(case, lanes[place], histories[place]):
                break
            seen[rung] = rms(shown[place] - base) / scatter
        rungs.append(seen)
    return Sight(base, scatter, tuple(rungs))


def settle(case: Case, sight: Sight) -> tuple[Case, Sight]:
    """Decides where the effects sit: first place that shows as much as it should."""
    effects, rungs, first = [], [], 0
    for group in case.options:
        seen = sight.rungs[first : first + len(group)]
        first += len(group)
        tops = [np.nanmax(np.append(one, 0.0)) for one in seen]
        reach = [top >= effect.target for top, effect in zip(tops, group, strict=True)]
        place = reach.index(True) if any(reach) else int(np.argmax(tops))
        effects.append(group[place])
        rungs.append(seen[place])
    return case._replace(effects=tuple(effects)), sight._replace(rungs=tuple(rungs))


def strength(ladder: np.ndarray, seen: np.ndarray, target: float) -> float:
    """The value at which the visibility [RUNGS, C] reaches a target, or the nearest.

    Interpolates log visibility over the logarithm of the distance from neutral.
    """
    largest = np.log(np.maximum(seen.max(axis=1), 1e-3))
    good = np.isfinite(largest)
    if not good.any():
        return float(ladder[0])
    rising = np.maximum.accumulate(largest[good])
    rising = rising + 1e-6 * np.arange(rising.size)
    rung = np.interp(np.log(target), rising, np.arange(rising.size))
    low = int(np.floor(rung))
    high = min(low + 1, rising.size - 1)
    return float(ladder[low] + (rung - low) * (ladder[high] - ladder[low]))
