"""Causes of a whole robot, where most joints are wrong and no single cause is enough.

What explains such a robot best alone need not be one of its causes: a soft servo can
stand for a delay, friction and a speed limit together. So causes are added by what they
explain at all joints together, and after each one every other is looked for anew beside
the rest, until none changes (stepwise selection with exchange, a group a cause).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gatjax.diagnosis import fit as fits
from gatjax.diagnosis import search
from gatjax.diagnosis.aliases import covered
from gatjax.diagnosis.bank import CAUSES, of_drive
from gatjax.diagnosis.case import mapped
from gatjax.diagnosis.claims import LATER, PLACE, SHARED, occam, uncertainty
from gatjax.diagnosis.findings import ROUGH
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis, combined
from gatjax.diagnosis.joint import Joint
from gatjax.diagnosis.judge import Judge

FEWEST, SHARE = 3, 0.5  # joints that are wrong at least, and their share of all
LEFT = 0.05  # of its misfit, that a single cause may leave at a joint
PROBES = 6  # joints that are looked at
MOST = 6  # causes
TURNS = 3  # of exchanges after each new cause
BETTER = 3.0  # nats that an exchange has to bring
REFITTING = 8  # iterations of a joint that a cause was taken from


class Option(NamedTuple):
    """A cause beside others, with a value of its own at each joint that it helps."""

    hypothesis: Hypothesis
    gains: dict[int, float]  # nats
    fits: dict[int, Fit]  # the cause comes last

    @property
    def gain(self) -> float:
        """Nats, all of these joints together."""
        return sum(self.gains.values())


Known = dict[int, Fit]  # what is known of some joints


def causes(judge: Judge) -> list[list[Option]]:
    """The causes of a whole robot; none where a single one may be enough.

    Returns:
        For each cause the options in its place, itself first and then the best.
    """
    every = range(len(judge.joints))
    wrong = [k for k in every if not _right(judge, k, judge.known[k])]
    if judge.most == 1 or len(wrong) < max(FEWEST, SHARE * len(every)):
        return []
    known = {k: judge.known[k] for k in _probes(judge, wrong)}
    found: list[list[Option]] = []
    while len(found) < MOST:
        judge.tell("everywhere", len(found) / MOST)
        options = _ranked(judge, known, [each[0] for each in found])
        if not options:
            break
        known = known | options[0].fits
        found.append(options)
        left = [k for k, fit in known.items() if not _right(judge, k, fit)]
        if len(found) == 1 and len(left) < max(FEWEST, SHARE * len(known)):
            break
        found, known = _exchanged(judge, found, known)
    return found if len(found) > 1 else []


def parts_of(fit: Fit) -> list[tuple[Hypothesis, np.ndarray]]:
    """The causes of a fit with their coordinates."""
    owner, out, first = fit.hypothesis, [], COUNT
    for part in () if owner is None else owner.parts or (owner,):
        out.append((part, fit.x[first : first + len(part.low)]))
        first += len(part.low)
    return out


def put_together(
    x: np.ndarray, parts: list[tuple[Hypothesis, np.ndarray]]
) -> tuple[Hypothesis | None, np.ndarray]:
    """Tolerances x [COUNT] and causes as a point to fit from."""
    owner = None
    for part, _ in parts:
        owner = combined(owner, part)
    return owner, np.concatenate([x, *(own for _, own in parts)])


def _right(judge: Judge, index: int, fit: Fit) -> bool:
    """Whether a fit leaves no more at a joint than the law of one cause would."""
    before = judge.case.healthy[index].rms()
    return fit.rms() < max(ROUGH * judge.joints[index].noise, LEFT * before)


def _probes(judge: Judge, wrong: list[int]) -> list[int]:
    """Joints to look at: of each kind of motor in turn those that are most wrong."""
    order = sorted(wrong, key=lambda k: -judge.known[k].rms() / judge.joints[k].noise)
    seen: dict[tuple, int] = {}
    rank = {}
    for k in order:
        motor = judge.joints[k].motor
        rank[k] = seen[motor] = seen.get(motor, -1) + 1
    return sorted(sorted(order, key=lambda k: rank[k])[:PROBES])


def _ranked(judge: Judge, known: Known, beside: list[Option]) -> list[Option]:
    """Causes beside others that are worth it at most joints, best first."""
    count = len(judge.joints)
    never = {c for option in beside for c in covered(option.hypothesis, count)}
    for joint in judge.joints:
        never |= joint.assumed.barred
    allowed = tuple(h for h in CAUSES if h.cause in SHARED and h.cause not in never)

    def one(index: int) -> list[Fit]:
        joint = judge.joints[index]
        return search.proposals(joint, known[index], of_drive(joint, allowed))

    options: dict[tuple[str, str], Option] = {}
    for index, rows in zip(known, mapped(one, known), strict=True):
        joint = judge.joints[index]
        before = _nats(joint, known[index])
        for fit in rows:
            assert fit.hypothesis is not None
            newest, gain = fit.hypothesis.newest, _nats(joint, fit) - before
            option = options.setdefault(newest[:2], Option(newest, {}, {}))
            if gain > 0.0:
                option.gains[index], option.fits[index] = gain, fit
    common = [
        option for option in options.values()
        if sum(gain > LATER for gain in option.gains.values()) > SHARE * len(known)
    ]  # fmt: skip
    return sorted(common, key=lambda option: -option.gain)


def _exchanged(
    judge: Judge, found: list[list[Option]], known: Known
) -> tuple[list[list[Option]], Known]:
    """Causes of which each is the best beside the others; the newest one is so far."""
    for _ in range(TURNS):
        moved = False
        for place, (mine, *_) in enumerate(found[:-1]):
            rest = found[:place] + found[place + 1 :]
            base = _without(judge, known, mine.hypothesis.cause)
            options = _ranked(judge, base, [each[0] for each in rest])
            if not options:
                continue
            (best, *_), tried = options, base | options[0].fits
            better = _total(judge, tried) - _total(judge, known) > BETTER
            known = tried if better else known
            if better and best.hypothesis.cause != mine.hypothesis.cause:
                found, moved = [*rest, options], True
                break
            cause = best.hypothesis.cause if better else mine.hypothesis.cause
            options.sort(key=lambda each: each.hypothesis.cause != cause)
            if options[0].hypothesis.cause == cause:
                found[place] = options
        if not moved:
            break
    return found, known


def _without(judge: Judge, known: Known, cause: str) -> Known:
    """The same without a cause, the rest fitted anew."""

    def one(index: int) -> Fit:
        fit, joint = known[index], judge.joints[index]
        parts = [(h, own) for h, own in parts_of(fit) if h.cause != cause]
        first = fits.start(joint, [put_together(fit.x[:COUNT], parts)])
        return fits.improve(joint, first, REFITTING)[0]

    return dict(zip(known, mapped(one, known), strict=True))


def _nats(joint: Joint, fit: Fit) -> float:
    """Evidence of a fit, less what its causes cost."""
    price, first = 0.0, COUNT
    for part, own in parts_of(fit):
        sure = uncertainty([fit], len(own), first) if len(own) else None
        price += occam(part, own, sure) + PLACE
        first += len(own)
    return fits.evidence(joint, fit) - price


def _total(judge: Judge, known: Known) -> float:
    return sum(_nats(judge.joints[k], fit) for k, fit in known.items())
