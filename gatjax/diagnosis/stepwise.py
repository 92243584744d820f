"""Causes of a whole robot, one after the other, each exchanged while another is better.

Of several starts each gets the best cause beside it before one is chosen (beam search),
then causes are added stepwise, a group a cause; loads are weighed along the motion that
they make.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gatjax.diagnosis import sharing
from gatjax.diagnosis.bank import CAUSES
from gatjax.diagnosis.borrowing import borrowed, followed, refitted, retried
from gatjax.diagnosis.case import mapped
from gatjax.diagnosis.claims import LATER
from gatjax.diagnosis.fit import Fit, parts_of
from gatjax.diagnosis.hypotheses import COUNT
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.option import Option
from gatjax.diagnosis.proposed import Fits, current, ranked, scored

WIDTHS, NEAR = (4, 3), 0.5  # starts that get one more, their least share of gain
AHEAD = 3  # causes to add, of which each gets one more
MOST = 6  # causes
GAP = "backlash"
TURNS = 3  # of exchanges after each new cause


class Partial(NamedTuple):
    """Some causes of a robot, and the fits with them."""

    found: list[list[Option]]
    known: Fits


def begun(judge: Judge, firsts: list[Option], known: Fits) -> Partial:
    """The first two or three causes.

    What explains most alone may be no cause at all, and of two the same: of several
    starts each gets the best cause beside it, and the best of these one more (a beam
    search), before any is exchanged.
    """
    starts = _starts(judge, Partial([], known), firsts)
    for turn, width in enumerate(WIDTHS):
        starts, known = _followed(judge, starts[:width], known)
        for place, start in enumerate(starts):
            judge.tell("everywhere", (turn + place / width) / len(WIDTHS) / MOST)
            starts[place] = _grown(judge, start)
        starts = _nearest(judge, starts, known)
    return _improved(judge, *starts[0])


def added(judge: Judge, before: Partial, options: list[Option]) -> Partial:
    """Causes with the best of some options, and another one beside it if two are near.

    What explains most need not be a cause: where options are near each other, what each
    of them explains with the best one beside it decides. Nothing is added that is worth
    too little without the joint that all causes explain worst.
    """
    starts = _starts(judge, before, options)
    if len(starts) > 1 and len(before.found) + 2 <= MOST:
        starts = [_grown(judge, start) for start in starts[:AHEAD]]
        starts = _nearest(judge, starts, before.known)
    worth = sharing.nats(judge.joints, starts[0].known)
    if worth - sharing.nats(judge.joints, before.known) < LATER:
        return before
    return _improved(judge, *starts[0])


def regeared(judge: Judge, before: Partial) -> Partial:
    """Causes with a gap in the place of a spring, if they explain more.

    Where teeth bounce, a slope tells little of a gap: a spring is found instead, and
    beside it what makes up for the rest. So all others are exchanged beside the gap.
    """
    place = next((n for n, each in enumerate(before.found) if _springy(each[0])), None)
    if place is None or any(GAP in joint.assumed.barred for joint in judge.joints):
        return before
    (spring, *_), rest = before.found[place], before.found[:]
    del rest[place]
    base = refitted(judge, before.known, spring.hypothesis.cause)
    gap = next(h for h in CAUSES if h.law == (GAP, spring.hypothesis.variant))

    def one(index: int) -> Fit:
        sets = [[*parts_of(base[index]), (gap, np.array(own))] for own in gap.starts]
        places = [base[index].x[:COUNT], np.zeros(COUNT)]
        return borrowed(judge.joints[index], places, [sets])[0]

    known = retried(judge, dict(zip(base, mapped(one, base), strict=True)))
    option = scored(judge, current(Option(gap, {}, {}), known), known, base)
    trial = _improved(judge, [*rest, [option]], known)
    worth = sharing.nats(judge.joints, trial.known)
    more = worth - sharing.nats(judge.joints, before.known)
    return trial if more > LATER else before


def _springy(option: Option) -> bool:
    return option.hypothesis.geared and option.hypothesis.cause != GAP


def _starts(judge: Judge, before: Partial, options: list[Option]) -> list[Partial]:
    """Causes with each of some options, those that are near the best, best first."""
    starts = [
        Partial(
            [*before.found, [mine, *(o for o in options if o is not mine)]],
            before.known | mine.fits,
        )
        for mine in options
    ]
    return _nearest(judge, starts, before.known)


def _followed(
    judge: Judge, starts: list[Partial], known: Fits
) -> tuple[list[Partial], Fits]:
    """Starts, and what is known without them, on loads along the best one's motion."""
    case, (first, *others) = judge.case, starts
    best = Partial(first.found, followed(judge, first.known))
    if judge.case is case:
        return [best, *others], known
    rest = [Partial(each.found, refitted(judge, each.known)) for each in others]
    return [best, *rest], refitted(judge, known)


def _grown(judge: Judge, start: Partial) -> Partial:
    """Some causes with the best one beside them, if there is one."""
    known = retried(judge, start.known)
    options = ranked(judge, known, [each[0] for each in start.found])
    if not options:
        return Partial(start.found, known)
    return Partial([*start.found, options], known | options[0].fits)


def _nearest(judge: Judge, starts: list[Partial], known: Fits) -> list[Partial]:
    """Starts that are near the best, best first; one of each set of causes."""
    before = sharing.nats(judge.joints, known)
    gains = [sharing.nats(judge.joints, start.known) - before for start in starts]
    order = sorted(range(len(starts)), key=lambda n: -gains[n])
    kept: dict[frozenset, Partial] = {}
    for n in order:
        if n == order[0] or gains[n] > NEAR * max(gains):
            laws = frozenset(options[0].law for options in starts[n].found)
            kept.setdefault(laws, starts[n])
    return list(kept.values())


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
            options = ranked(judge, base, [each[0] for each in rest])
            mine = scored(judge, mine, known, base)
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
