"""Causes that are worth it at most joints of a robot, beside those that it has."""

from __future__ import annotations

from gatjax.diagnosis import search, sharing
from gatjax.diagnosis.aliases import covered
from gatjax.diagnosis.bank import CAUSES, of_drive
from gatjax.diagnosis.borrowing import spread
from gatjax.diagnosis.case import mapped
from gatjax.diagnosis.claims import LATER, SHARED
from gatjax.diagnosis.fit import Fit, parts_of, with_last
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.option import Option

Fits = dict[int, Fit]  # of the joints that are looked at


def ranked(judge: Judge, known: Fits, beside: list[Option]) -> list[Option]:
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


def scored(judge: Judge, option: Option, known: Fits, base: Fits) -> Option:
    """A cause as it stands now, over what is known without it."""
    gains = {}
    for k, fit in known.items():
        if _has(fit, option.hypothesis.cause):
            joint = judge.joints[k]
            gains[k] = sharing.alone(joint, fit) - sharing.alone(joint, base[k])
    gain = sharing.gained(judge.joints, base, known)
    return option._replace(gains=gains, gain=gain)


def current(option: Option, known: Fits) -> Option:
    """A cause with its values beside all others."""
    cause = option.hypothesis.cause
    fits = {k: with_last(fit, cause) for k, fit in known.items() if _has(fit, cause)}
    return option._replace(fits=fits)


def _has(fit: Fit, cause: str) -> bool:
    return any(part.cause == cause for part, _ in parts_of(fit))
