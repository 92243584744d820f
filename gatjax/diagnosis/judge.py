"""The judge: the claims that would explain more than what is known about each joint."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from gatjax.diagnosis import case as cases
from gatjax.diagnosis import drops, lost
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.accepting import Accepting
from gatjax.diagnosis.bank import CAUSES
from gatjax.diagnosis.case import mapped
from gatjax.diagnosis.claims import (
    BODY,
    PLACE,
    SHARED,
    WHOLE,
    WORTH,
    Claim,
    occam,
    outdone,
    price,
    shared_value,
    uncertainty,
)
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis, combined, pinned
from gatjax.diagnosis.joint import BOUNCING, OBSERVED, PULLS, Joint
from gatjax.diagnosis.known import ASTRAY, PARTED, parted

STRAYING = 0.3  # of the residual before, that it leaves at least
MOST = 4  # shared causes that are looked into
BODIES = 2  # bodies that are looked into closely
RIVAL = 0.4  # of the best gain at a joint: a body cause must come that near


class Judge(Accepting):
    """Finds the claims that explain a case best, given what is explained already."""

    most = 3  # causes of a case
    worth = WORTH  # nats that a first one needs

    def apart(self, joints: Collection[int]) -> bool:
        """Whether joints show what is wrong with them, whatever the others do."""
        return True

    def visibility(self, claim: Claim) -> float:
        """Visibility d of a claim: its RMS change over the scatter from tolerances.

        The definition of d in docs/diagnosis.md: the cause alone on the nominal model;
        the largest of its joints counts.
        """
        largest = 0.0
        for index in claim.fits:
            joint = self._bearing(index, claim)
            plain = fits.start(joint, [(None, np.zeros(COUNT))])
            scatter = fits.scatter(joint, fits.linearised(joint, plain)[0])
            if claim.lost:
                other = drops.with_commands(
                    joint, self.case.commands(index), claim.lost[index]
                )
                alone = fits.start(other, [(None, np.zeros(COUNT))])[0]
            else:
                alone = fits.start(
                    joint, [(pinned(claim.hypothesis, claim.own), np.zeros(COUNT))]
                )[0]
            change = np.sqrt(np.mean(np.square(alone.residual - plain[0].residual)))
            largest = max(largest, float(change / scatter))
        return largest

    def tolerates(self, index: int) -> bool:
        """Whether a joint may leave more than its own tolerances explain."""
        return False

    def signals(self) -> list[dict[str, Any]]:
        """Misfits of what is logged besides the joints; a fixed base uses none."""
        return []

    def _bearing(self, index: int, claim: Claim) -> Joint:
        """A joint of the case as a claim sees it, drawn no more than it has to be."""
        joint = self.case.joints[index]
        if claim.body is not None:
            joint = self.case.carrying(joint, claim.body)
        return joint.drawn(0.0)

    def claims(self) -> list[Claim]:
        """All claims worth a look, best first."""
        missing = [k for k in range(len(self.joints)) if k not in self.found]
        fits = mapped(self.explained, missing, lambda share: self.tell("causes", share))
        self.found |= dict(zip(missing, fits, strict=True))
        out = lost.claims(self, missing)
        solved = {k for claim in out for k in claim.fits}
        if fewer := self._leave_aside([k for k in missing if k not in solved]):
            out = lost.claims(self, fewer)
            solved = {k for claim in out for k in claim.fits}
        left = [k for k in missing if k not in solved]
        for rate in (*PULLS, BOUNCING):
            self._pull([k for k in left if self._misses(k, rate)], rate)
        found = self._single() + out
        if len(self.joints) > 1:
            shared = [c for c in self._shared(found) if not outdone(c, found)]
            found += shared + self._bodies(found)
        return sorted(filter(self._possible, found), key=lambda claim: -claim.gain)

    def _possible(self, claim: Claim) -> bool:
        """Whether a claim is about all joints if its cause can only be."""
        partly = len(claim.where) < len(self.joints)
        return not (partly and claim.hypothesis.cause in WHOLE)

    def _misses(self, index: int, rate: float) -> bool:
        """Whether a joint is drawn less, and even its best explanation goes astray."""
        joint, best = self.joints[index], self.best(index)
        known = self.known[index].rms()
        if known > ASTRAY * joint.noise and parted(joint, best):
            missed = best.rms() > PARTED * joint.noise
        else:
            missed = best.rms() > max(ASTRAY * joint.noise, STRAYING * known)
            missed &= rate in PULLS
        least = 0.0 if joint.servoed else OBSERVED
        return missed and self.case.pulled.get(index, least) < rate

    def _leave_aside(self, joints: list[int]) -> list[int]:
        """Look at joints again without pieces that nothing explains; those that had."""
        strays = {k: self.strays(k, self.best(k)) for k in joints}
        aside = self.case.aside
        strays = {k: runs for k, runs in strays.items() if runs != aside.get(k, ())}
        if strays:
            self._renew(cases.left_aside(self.case, strays), strays)
            found = mapped(self.explained, strays, lambda s: self.tell("aside", s))
            self.found |= dict(zip(strays, found, strict=True))
        return [*strays]

    def _pull(self, joints: list[int], rate: float) -> None:
        """Look at joints again, drawn to their measured motion at a rate in 1/s."""
        self._draw(dict.fromkeys(joints, rate))
        found = mapped(self.explained, joints, lambda share: self.tell("astray", share))
        self.found |= dict(zip(joints, found, strict=True))

    def _single(self) -> list[Claim]:
        """Claims about one joint."""
        out = []
        for index in range(len(self.joints)):
            for fit in self.found[index]:
                assert fit.hypothesis is not None
                newest = fit.hypothesis.newest
                count = len(newest.low)
                own, sure = fit.x[len(fit.x) - count :], uncertainty([fit], count)
                gain = self.score(index, fit) - occam(newest, own, sure) - PLACE
                claim = Claim(newest, own, (index,), {index: fit}, gain)
                out.append(claim._replace(covariance=sure))
        return out

    def _free(
        self, index: int, joint: Joint, hypotheses: list[Hypothesis], rounds: int
    ) -> list[Fit]:
        """A joint's own best value of each of some causes."""
        known = self.known[index]
        begins = [h.begins(joint, known.residual) for h in hypotheses]
        points = [
            (combined(known.hypothesis, h), np.append(known.x, s))
            for h, some in zip(hypotheses, begins, strict=True) for s in some
        ]  # fmt: skip
        first, out = fits.start(joint, points), []
        for some in begins:
            mine, first = first[: len(some)], first[len(some) :]
            out.append(min(mine, key=lambda fit: fit.cost))
        return fits.improve(joint, out, rounds)

    def _fixed(
        self, index: int, joint: Joint, values: list[tuple[Hypothesis, np.ndarray]],
        free: list[Fit],
    ) -> list[Fit]:  # fmt: skip
        """A joint's fits with given values of causes; `free` has its own values."""
        known = self.known[index]
        points = [
            (combined(known.hypothesis, pinned(h, own)), x)
            for (h, own), mine in zip(values, free, strict=True)
            for x in (known.x, fits.unspent(known.x), mine.x[: len(known.x)])
        ]  # fmt: skip
        first = fits.start(joint, points)
        triples = zip(first[::3], first[1::3], first[2::3], strict=True)
        best = [min(triple, key=lambda fit: fit.cost) for triple in triples]
        return fits.improve(joint, best, 6)

    def _shared(self, single: list[Claim]) -> list[Claim]:
        """Claims about groups of joints with one value."""
        seen: dict[tuple, list[Claim]] = {}
        for claim in single:
            if claim.hypothesis.cause in SHARED and claim.gain > 0.25 * WORTH:
                key = claim.hypothesis.law
                seen.setdefault(key, []).append(claim)
        groups = [
            group for group in seen.values()
            if len(group) > 1 or group[0].hypothesis.cause in WHOLE
        ]  # fmt: skip
        groups.sort(key=lambda group: -sum(claim.gain for claim in group))
        chosen = groups[:MOST]
        if not chosen:
            return []
        hypotheses = [group[0].hypothesis for group in chosen]
        every = range(len(self.joints))
        best = {c.where[0]: c for c in sorted(single, key=lambda claim: claim.gain)}
        free = mapped(lambda k: self._free(k, self.joints[k], hypotheses, 6), every)
        for n, group in enumerate(chosen):  # what was searched for longer may be better
            for index, fit in (pair for claim in group for pair in claim.fits.items()):
                free[index][n] = min(free[index][n], fit, key=lambda one: one.cost)
        values = [
            (h, shared_value([free[c.where[0]][n] for c in group], h))
            for n, (h, group) in enumerate(zip(hypotheses, chosen, strict=True))
        ]
        fixed = mapped(lambda k: self._fixed(k, self.joints[k], values, free[k]), every)
        out = []
        for n, (hypothesis, own) in enumerate(values):
            suspects = [claim.where[0] for claim in chosen[n]]
            law = hypothesis.law
            voters = tuple(k for k in sorted(best) if best[k].hypothesis.law == law)
            for group in self._groups(suspects) | (
                {voters} if len(voters) > 1 else set()
            ):
                if any(
                    hypothesis.cause in self.joints[k].assumed.barred for k in group
                ):
                    continue
                mine = {k: fixed[k][n] for k in group}
                sure = uncertainty([free[k][n] for k in group], len(own))
                out.append(self._joint_claim(hypothesis, own, mine, sure))
        return out

    def _joint_claim(
        self, hypothesis: Hypothesis, own: np.ndarray, mine: dict[int, Fit],
        sure: np.ndarray | None,
    ) -> Claim:  # fmt: skip
        """A claim about several joints."""
        gain = sum(self.score(k, fit) for k, fit in mine.items())
        claim = Claim(hypothesis, own, tuple(mine), mine, gain, covariance=sure)
        return claim._replace(gain=gain - price(claim, len(self.joints)))

    def _groups(self, suspects: list[int]) -> set[tuple[int, ...]]:
        """All joints, the suspects, and joints with the same motor as a suspect."""
        groups = {tuple(range(len(self.joints)))}
        if len(suspects) > 1:
            groups.add(tuple(sorted(suspects)))
        for suspect in suspects:
            mine = self.joints[suspect].motor
            twins = tuple(
                k for k, joint in enumerate(self.joints) if joint.motor == mine
            )
            if 1 < len(twins) < len(self.joints):
                groups.add(twins)
        return groups

    def _bodies(self, single: list[Claim]) -> list[Claim]:
        """Claims about a body, which all joints that carry it must bear out."""
        best = {k: max((c.gain for c in single if c.where == (k,)), default=0.0)
                for k in range(len(self.joints))}  # fmt: skip
        hot = {
            c.where[0] for c in single
            if c.hypothesis.cause in BODY
            and c.gain > max(WORTH, RIVAL * best[c.where[0]])
        }  # fmt: skip
        return self.borne({b for index in hot for b in self.case.moved_by(index)})

    def borne(self, bodies: Collection[int]) -> list[Claim]:
        """Claims about the best of some bodies, of joints that they belong to."""
        hypotheses = [h for h in CAUSES if h.cause in BODY]
        spare = filter(self.spare, sorted(bodies))
        tried = [self._borne(body, hypotheses) for body in spare]
        tried.sort(key=lambda row: -row[0])
        return [claim for _, make in tried[:BODIES] for claim in make()]

    def _borne(self, body: int, hypotheses: list[Hypothesis]) -> tuple:
        """How well a changed body is borne out, and how to make its claims."""
        bearers = self.case.bearers(body)
        joints = {k: self.case.carrying(self.joints[k], body) for k in bearers}
        free = dict(
            zip(
                bearers,
                mapped(lambda k: self._free(k, joints[k], hypotheses, 4), bearers),
                strict=True,
            )
        )  # fmt: skip
        gains = [
            sum(self.score(k, free[k][n], joints[k]) for k in bearers)
            for n in range(len(hypotheses))
        ]

        def make() -> list[Claim]:
            values = [
                (h, shared_value([free[k][n] for k in bearers], h))
                for n, h in enumerate(hypotheses)
            ]
            fixed = mapped(
                lambda k: self._fixed(k, joints[k], values, free[k]), bearers
            )
            out = []
            for n, (hypothesis, own) in enumerate(values):
                mine = {k: rows[n] for k, rows in zip(bearers, fixed, strict=True)}
                gain = sum(self.score(k, fit, joints[k]) for k, fit in mine.items())
                sure = uncertainty([free[k][n] for k in bearers], len(own))
                gain -= occam(hypothesis, own, sure) + PLACE
                claim = Claim(hypothesis, own, (body,), mine, gain, body)
                out.append(claim._replace(covariance=sure))
            return out

        return max(gains), make
