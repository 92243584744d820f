"""Causes of a whole robot, where most joints are wrong and no single cause is enough.

What explains such a robot best alone need not be one of its causes: a soft servo can
stand for a delay, friction and a speed limit together. So several starts are followed
to three causes, more are added to the best of them by what they explain at all joints
together, and after each one every other is looked for anew beside the rest, until none
changes (beam search, then stepwise selection with exchange, a group a cause).
"""

from __future__ import annotations

from typing import NamedTuple

from gatjax.diagnosis import search, sharing
from gatjax.diagnosis.aliases import covered
from gatjax.diagnosis.bank import CAUSES, of_drive
from gatjax.diagnosis.borrowing import followed, refitted, retried, spread
from gatjax.diagnosis.case import mapped
from gatjax.diagnosis.claims import LATER, SHARED
from gatjax.diagnosis.findings import ROUGH
from gatjax.diagnosis.fit import Fit, parts_of, with_last
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.option import SHARE, Option

FEWEST = 3  # joints that are wrong at least
ALONE = 0.05  # of its rms misfit, that a single cause may leave at a joint
PROBES = 6  # joints that are looked at
WIDTHS, NEAR = (4, 3), 0.5  # starts that get one more, their least share of gain
MOST = 6  # causes
TURNS = 3  # of exchanges after each new cause
ODD = 0.2  # the largest share of joints that are wrong in ways of their own


Fits = dict[int, Fit]  # of the joints that are looked at


def causes(judge: Judge) -> list[list[Option]]:
    """The causes of a whole robot; none where a single one is enough.

    Where it is enough at most joints, it is taken with what is wrong at the others left
    to be found beside it.

    Args:
        judge: knows tolerances only. It gets a case and joints with the loads along the
            motion that the causes make; what it knows stays as it was without them.

    Returns:
        For each cause the options in its place, itself first and then the best.
    """
    every = range(len(judge.joints))
    if judge.most == 1 or len(every) < FEWEST:
        return []
    wrong = _left(judge, dict(enumerate(judge.known)))
    if _few(wrong, len(every)):
        return []
    known = {k: judge.known[k] for k in _probes(judge, wrong)}
    judge.tell("everywhere", 0.0)
    firsts = _ranked(judge, known, [])
    left = _left(judge, known | firsts[0].fits) if firsts else []
    if len(left) <= max(1, ODD * len(known)):
        return [firsts] if left else []
    found, known = _begun(judge, firsts, known)
    while 0 < len(found) < MOST:
        judge.tell("everywhere", len(found) / MOST)
        known = followed(judge, known)
        beside = [each[0] for each in found]
        options = _ranked(judge, known, beside)
        if not options:
            break
        found, known = _improved(judge, [*found, options], known | options[0].fits)
        if {each[0].law for each in found} <= {option.law for option in beside}:
            break
    if len(found) < 2 and not _few(left, len(known)):
        return []
    return [[_current(mine, known), *rivals] for mine, *rivals in found]


class Partial(NamedTuple):
    """Some causes of a robot, and the fits with them."""

    found: list[list[Option]]
    known: Fits


def _begun(judge: Judge, firsts: list[Option], known: Fits) -> Partial:
    """The first two or three causes.

    What explains most alone may be no cause at all, and of two the same: of several
    starts each gets the best cause beside it, and the best of these one more (a beam
    search), before any is exchanged.
    """
    starts = [
        Partial([[mine, *(o for o in firsts if o is not mine)]], known | mine.fits)
        for mine in firsts
    ]
    starts = _nearest(judge, starts, known)
    for turn, width in enumerate(WIDTHS):
        starts = starts[:width]
        for place, (found, fitted) in enumerate(starts):
            judge.tell("everywhere", (turn + place / width) / len(WIDTHS) / MOST)
            fitted = retried(judge, fitted)
            starts[place] = Partial(found, fitted)
            options = _ranked(judge, fitted, [each[0] for each in found])
            if options:
                starts[place] = Partial([*found, options], fitted | options[0].fits)
        starts = _nearest(judge, starts, known)
    return _improved(judge, *starts[0])


def _nearest(judge: Judge, starts: list[Partial], known: Fits) -> list[Partial]:
    """Starts that are near the best, best first; one of each set of causes."""
    before = sharing.nats(judge.joints, known)
    gains = [sharing.nats(judge.joints, start.known) - before for start in starts]
    order = sorted(range(len(starts)), key=lambda n: -gains[n])
    kept: dict[frozenset, Partial] = {}
    for n in order:
        if gains[n] > NEAR * max(gains):
            laws = frozenset(options[0].law for options in starts[n].found)
            kept.setdefault(laws, starts[n])
    return list(kept.values())


def _few(left: list[int], joints: int) -> bool:
    """Whether joints that are wrong are too few for a cause of the whole robot."""
    return len(left) < max(FEWEST, SHARE * joints)


def _left(judge: Judge, known: Fits) -> list[int]:
    """Joints that are still wrong."""
    return [k for k, fit in known.items() if not _right(judge, k, fit)]


def _right(judge: Judge, index: int, fit: Fit) -> bool:
    """Whether a fit leaves no more at a joint than the law of one cause would."""
    before = judge.case.healthy[index].rms()
    return fit.rms() < max(ROUGH * judge.joints[index].noise, ALONE * before)


def _probes(judge: Judge, wrong: list[int]) -> list[int]:
    """Joints to look at: of each kind of motor in turn those that are most wrong."""
    order = sorted(wrong, key=lambda k: -judge.known[k].rms() / judge.joints[k].noise)
    seen: dict[tuple, int] = {}
    rank = {}
    for k in order:
        motor = judge.joints[k].motor
        rank[k] = seen[motor] = seen.get(motor, -1) + 1
    return sorted(sorted(order, key=lambda k: rank[k])[:PROBES])


def _ranked(judge: Judge, known: Fits, beside: list[Option]) -> list[Option]:
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
        before = sharing.alone(joint, known[index])
        for fit in rows:
            assert fit.hypothesis is not None
            newest, gain = fit.hypothesis.newest, sharing.alone(joint, fit) - before
            option = options.setdefault(newest.law, Option(newest, {}, {}))
            if gain > 0.0:
                option.gains[index], option.fits[index] = gain, fit
    spread(judge, known, [option for option in options.values() if option.fits])
    common = [
        o._replace(gain=sharing.gained(judge.joints, known, known | o.fits))
        for o in options.values()
        if o.common(len(known))
    ]
    worth = [option for option in common if option.gain > LATER]
    return sorted(worth, key=lambda option: -option.gain)


def _improved(judge: Judge, found: list[list[Option]], known: Fits) -> Partial:
    """Causes of which each is the best beside the others; the newest one is so far.

    Another one may take the place of a cause, and one that is worth nothing beside the
    others is dropped.
    """
    for turn in range(TURNS):
        moved, looked = False, found[:-1] if turn == 0 else found
        for place, (mine, *_) in enumerate(looked):
            done = (turn + place / len(looked)) / TURNS
            judge.tell("everywhere", (len(found) - 1 + done) / MOST)
            rest = found[:place] + found[place + 1 :]
            base = retried(judge, refitted(judge, known, mine.hypothesis.cause))
            options = _ranked(judge, base, [each[0] for each in rest])
            mine = _scored(judge, mine, known, base)
            tried = base | options[0].fits if options else base
            few = mine.gain <= LATER or not mine.common(len(known))
            worth = sharing.nats(judge.joints, known)
            if options and (few or sharing.nats(judge.joints, tried) > worth):
                known, found[place] = tried, options
                moved = options[0].law != mine.law
            elif not few:
                others = [option for option in options if option.law != mine.law]
                found[place] = [mine, *others]
            else:
                found, known, moved = rest, base, True
            if moved:
                break
        if not moved:
            break
    return Partial(found, known)


def _scored(judge: Judge, option: Option, known: Fits, base: Fits) -> Option:
    """A cause as it stands now, over what is known without it."""
    gains = {}
    for k, fit in known.items():
        if _has(fit, option.hypothesis.cause):
            joint = judge.joints[k]
            gains[k] = sharing.alone(joint, fit) - sharing.alone(joint, base[k])
    gain = sharing.gained(judge.joints, base, known)
    return option._replace(gains=gains, gain=gain)


def _current(option: Option, known: Fits) -> Option:
    """A cause with its values beside all others."""
    cause = option.hypothesis.cause
    fits = {k: with_last(fit, cause) for k, fit in known.items() if _has(fit, cause)}
    return option._replace(fits=fits)


def _has(fit: Fit, cause: str) -> bool:
    return any(part.cause == cause for part, _ in parts_of(fit))


def odd_ones(judge: Judge, known: list[Fit]) -> set[int]:
    """Joints that are still wrong, if they are so few that something else is theirs."""
    wrong = _left(judge, dict(enumerate(known)))
    return set(wrong) if len(wrong) <= ODD * len(known) else set()
