"""Causes of a whole robot, where most joints are wrong and no single cause is enough.

What explains such a robot best alone need not be one of its causes: a soft servo can
stand for a delay, friction and a speed limit together. So several starts are followed
to three causes, more are added to the best of them by what they explain at all joints
together, and after each one every other is looked for anew beside the rest, until none
changes (beam search, then stepwise selection with exchange, a group a cause).
"""

from __future__ import annotations

from gatjax.diagnosis.borrowing import followed
from gatjax.diagnosis.findings import ROUGH
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.option import SHARE, Option
from gatjax.diagnosis.proposed import Fits, current, ranked
from gatjax.diagnosis.stepwise import MOST, Partial, added, begun, regeared

FEWEST = 3  # joints that are wrong at least
ALONE = 0.05  # of its rms misfit, that a single cause may leave at a joint
PROBES = 6  # joints that are looked at
ODD = 0.2  # the largest share of joints that are wrong in ways of their own


def causes(judge: Judge) -> list[list[Option]]:
    """The causes of a whole robot; none where a single one is enough.

    Where it is enough at most joints, it is taken with what is worth it beside it; what
    is wrong at the others is left to be found besides.

    Args:
        judge: knows tolerances only. It gets a case and joints with the loads along the
            motion that the causes make; what it knows stays as it was without them.

    Returns:
        For each cause the options in its place, itself first and then the best.
    """
    every = range(len(judge.joints))
    if not judge.apart(every) or len(every) < FEWEST:
        return []
    wrong = _left(judge, dict(enumerate(judge.known)))
    if _few(wrong, len(every)):
        return []
    known = {k: judge.known[k] for k in _probes(judge, wrong)}
    judge.tell("everywhere", 0.0)
    firsts = ranked(judge, known, [])
    left = _left(judge, known | firsts[0].fits) if firsts else []
    if not left:
        return []
    enough = len(left) <= max(1, ODD * len(known))
    first = Partial([firsts], known | firsts[0].fits)
    before = _more(judge, first if enough else begun(judge, firsts, known))
    after = regeared(judge, before)
    found, known = before if after is before else _more(judge, after)
    if len(found) < 2 and not _few(left, len(known)):
        return []
    return [[current(mine, known), *rivals] for mine, *rivals in found]


def _more(judge: Judge, before: Partial) -> Partial:
    """Causes with others beside them, one after the other, until none is worth it."""
    found, known = before
    while 0 < len(found) < MOST:
        judge.tell("everywhere", len(found) / MOST)
        known = followed(judge, known)
        beside = [each[0] for each in found]
        options = ranked(judge, known, beside)
        if not options:
            break
        found, known = added(judge, Partial(found, known), options)
        if {each[0].law for each in found} <= {option.law for option in beside}:
            break
    return Partial(found, known)


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


def odd_ones(judge: Judge, known: list[Fit]) -> set[int]:
    """Joints that are still wrong, if they are so few that something else is theirs."""
    wrong = _left(judge, dict(enumerate(known)))
    return set(wrong) if len(wrong) <= ODD * len(known) else set()
