"""What is known about each joint, beside which claims are looked at."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Collection, Mapping
from typing import TypeVar

import numpy as np

from gatjax.diagnosis import case as cases
from gatjax.diagnosis import drops, search
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.bank import CAUSES, OTHERS, of_drive
from gatjax.diagnosis.case import Case, along, mapped
from gatjax.diagnosis.claims import BODY, Claim, uncertainty
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis, combined, pinned
from gatjax.diagnosis.joint import Joint

ASTRAY = 3.5  # times the noise that the best explanation leaves: look again
PARTED = 1.7  # the same with a gap, which parts any two runs, or a further cause
REFITTING = 12  # iterations of a claim beside something else

Mine = TypeVar("Mine", bound="Known")


def parted(joint: Joint, fit: Fit) -> bool:
    """Whether a fit has motor and link apart, where teeth may bounce."""
    return fit.geared or joint.assumed.geared


def astray(joint: Joint, fit: Fit) -> float:
    """Times the noise that a joint leaves which cannot be followed open loop."""
    return PARTED if parted(joint, fit) else ASTRAY


def changed(case: Case, claim: Claim, index: int, joint: Joint) -> Joint:
    """A joint of a case with the body and the commands that a claim changes."""
    if claim.body is not None:
        joint = case.carrying(joint, claim.body)
    if claim.lost and index in claim.lost:
        commands = case.commands(index)
        joint = drops.with_commands(joint, commands, claim.lost[index])
    return joint


class Known:
    """What explains each joint so far, on the loads of the motion that it makes."""

    def __init__(self, case: Case, tell: Callable[[str, float], None]) -> None:
        """Start from the tolerances."""
        self.case = case
        self.tell = tell
        self.joints: list[Joint] = list(case.joints)
        self.known: list[Fit] = list(case.healthy)
        self.found: dict[int, list[Fit]] = {}
        self.losses: dict[int, Claim | None] = {}
        self.accepted: list[Claim] = []

    def fork(self: Mine) -> Mine:
        """The same, but it may accept another claim."""
        other = copy.copy(self)
        other.joints, other.known = list(self.joints), list(self.known)
        other.accepted, other.found = list(self.accepted), dict(self.found)
        other.losses = dict(self.losses)
        return other

    def altered(self, case: Case) -> list[Joint]:
        """The case's joints with the bodies and the commands that claims changed."""
        out = list(case.joints)
        for claim in self.accepted:
            for index in claim.fits:
                out[index] = changed(case, claim, index, out[index])
        return out

    def evidence(self, without: int | None = None) -> float:
        """Nats of what is known, all joints together but for one that is left out.

        Which commands were lost has its price, as large as it takes to write them down.
        """
        every = range(len(self.joints))
        paid = sum(claim.coded for claim in self.accepted)
        return sum(self._evidence(k) for k in every if k != without) - paid

    def _evidence(self, index: int) -> float:
        return fits.evidence(self.joints[index], self.known[index])

    def left(self, known: Mapping[int, Fit]) -> dict[int, float]:
        """What fits of joints leave, times the noise of each."""
        return {k: fit.rms() / self.joints[k].noise for k, fit in known.items()}

    def score(self, index: int, fit: Fit, joint: Joint | None = None) -> float:
        """Nats of a fit over what is known about a joint."""
        return fits.evidence(joint or self.joints[index], fit) - self._evidence(index)

    def explained(
        self, index: int, bank: tuple[Hypothesis, ...] = CAUSES + OTHERS
    ) -> list[Fit]:
        """Fits of a bank's laws that explain a joint best, beside what is known."""
        joint = self.joints[index]
        bank = of_drive(joint, bank)
        if self.lent(index) not in (None, index):
            bank = tuple(h for h in bank if h.cause not in BODY)
        return search.explain(joint, self.known[index], bank)

    def best(self, index: int) -> Fit:
        """The best explanation of a joint."""
        every = [self.known[index], *self.found[index]]
        return min(every, key=lambda fit: fit.rms())

    def _draw(self, rates: dict[int, float]) -> None:
        """Draw joints to their measured motion at other rates, 1/s; 0: not at all."""
        self._renew(cases.pulled(self.case, rates), rates)

    def _renew(self, case: Case, joints: Collection[int]) -> None:
        """Go on with a case that differs at some joints; they are fitted again."""
        healthy = list(case.healthy)
        for k in joints:
            healthy[k] = search.healthy(case.joints[k], healthy[k].x)
        self.case = dataclasses.replace(case, healthy=healthy)
        self.joints = self.altered(self.case)
        for index, fit in zip(joints, mapped(self._again, joints), strict=True):
            self.known[index] = fit

    def _weigh(self) -> None:
        """Weigh loads along the motion that the fits make, and fit again on them."""
        self.case = along(self.case, self.joints, self.known)
        self.joints = self.altered(self.case)
        self.known = mapped(self._again, range(len(self.joints)))

    def _again(self, index: int) -> Fit:
        """The known fit of a joint on its new loads."""
        fit = self.known[index]
        first = fits.start(self.joints[index], [(fit.hypothesis, fit.x)])
        return fits.improve(self.joints[index], first, 6)[0]

    def current(self, claim: Claim) -> Claim:
        """A claim about one joint with its size beside what was accepted after it."""
        count, alone = len(claim.own), len(claim.fits) == 1 and claim.body is None
        if not (count and alone) or len(self.accepted) < 2:
            return claim
        (index,) = claim.fits
        fit, first = self.known[index], COUNT
        for part, own in fits.parts_of(fit):
            if part.law == claim.hypothesis.law and len(own) == count:
                sure = uncertainty([fit], count, first)
                return claim._replace(own=own, fits={index: fit}, covariance=sure)
            first += len(own)
        return claim

    def refitted(self, claim: Claim) -> Claim:
        """A claim with its size, beside what is known here about its joints.

        Where several joints agree on a size, it stays as it is.
        """
        alone = len(claim.fits) == 1 and claim.body is None
        own = claim.own if alone else np.zeros(0)
        newest = claim.hypothesis if alone else pinned(claim.hypothesis, claim.own)

        def one(index: int) -> Fit:
            joint = changed(self.case, claim, index, self.joints[index])
            known = self.known[index]
            owner = combined(known.hypothesis, newest)
            begins = known.x, fits.unspent(known.x)
            points = [(owner, np.append(x, own)) for x in begins]
            first = fits.improve(joint, fits.start(joint, points), REFITTING)
            return min(first, key=lambda fit: fit.cost)

        return claim._replace(fits={k: one(k) for k in claim.fits})

    def carried(self, claim: Claim) -> Claim:
        """A claim about one joint's link as one that all joints that carry it bear.

        It has to be refitted. Another claim stays as it is.
        """
        if claim.hypothesis.cause not in BODY or claim.body is not None:
            return claim
        (body,) = claim.where
        bearers = self.case.bearers(body)
        if len(bearers) == 1 or not self.spare(body):
            return claim
        return claim._replace(body=body, fits=dict.fromkeys(bearers, claim.fits[body]))

    def lent(self, index: int) -> int | None:
        """The joint whose changed body the terms of a joint are of; None: free."""
        for claim in self.accepted:
            if claim.hypothesis.cause in BODY and index in claim.fits:
                return index if claim.body is None else claim.body
        return None

    def spare(self, body: int) -> bool:
        """Whether no joint that moves a body has the terms of another changed one."""
        return all(self.lent(k) in (None, body) for k in self.case.bearers(body))
