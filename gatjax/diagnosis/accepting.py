"""How what is known about each joint changes when a claim is accepted."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from gatjax.diagnosis import case as cases
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.bank import CAUSES
from gatjax.diagnosis.case import along, mapped
from gatjax.diagnosis.claims import SEVERAL, Claim, shared_value, uncertainty
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import Hypothesis, combined, pinned
from gatjax.diagnosis.joint import BOUNCING
from gatjax.diagnosis.known import ASTRAY, PARTED, Known, astray, parted

STRAY, FEW = 2.5, 0.2  # times the middle piece's misfit; share of pieces left aside
CHANGED = 3.0  # nats: a joint whose evidence changed less keeps its fits
ODD = 2.0  # times what the next worst of them leaves, that this one leaves
SETTLING = 3  # iterations in which joints settle on a value
SIZING = 6  # times that joints settle on the size of a body, at most
CONVERGING = 40  # iterations at most of the fit of an accepted claim
PASSES = 6  # over the loads that a new claim makes, at most


class Accepting(Known):
    """What explains each joint, and takes further claims for known."""

    def accept(self, claim: Claim) -> Claim:
        """Take a claim for known, with the loads along the motion that it makes.

        Returns:
            The claim with its numbers on those loads.
        """
        before = [self._evidence(k) for k in range(len(self.joints))]
        prior, drawn = list(self.known), self.case.pulled
        self.accepted.append(claim)
        self.joints = self.altered(self.case)
        for index, fit in claim.fits.items():
            self.known[index] = fit
        held = set(drawn) & set(claim.fits)
        state = self.case, self.joints, list(self.known)
        self._draw(dict.fromkeys(held, 0.0))
        free = self._settled(claim, prior)
        if not all(self._followed(k) for k in held):
            self.case, self.joints, self.known = state
            free = self._settled(claim, prior)
        self._let_go()
        self._count_again(free.fits)
        claim = self.accepted[-1] = self._converged(free)
        for index, old in enumerate(before):
            moved = abs(self._evidence(index) - old) > CHANGED
            if moved or index in claim.fits:
                self.found.pop(index, None)
        return claim

    def _followed(self, index: int) -> bool:
        """Whether a joint can be followed undrawn, with one cause more if need be.

        What is drawn shows little of a second cause. It has to explain all but noise:
        any further law explains a part.
        """
        joint, known = self.joints[index], self.known[index]
        if known.rms() <= astray(joint, known) * joint.noise:
            return True
        best = min(fit.rms() for fit in self.explained(index, CAUSES))
        return best <= PARTED * joint.noise

    def _converged(self, claim: Claim) -> Claim:
        """A claim about one joint with its fit at rest, in however flat a valley.

        The search ends when it can tell causes apart, which is earlier. A servo's joint
        that is drawn is left there: it is not followed, and what would fit it best then
        predicts less (motors, which are always drawn a little, are followed).
        """
        count, index = len(claim.own), claim.where[0]
        alone = len(claim.fits) == 1 and claim.body is None and count
        if not alone or index in self.case.pulled:
            return claim
        joint, before = self.joints[index], self.known[index]
        fit = self.known[index] = fits.improve(joint, [before], CONVERGING)[0]
        more = fits.evidence(joint, fit) - fits.evidence(joint, before)
        return claim._replace(
            own=fit.x[-count:], fits={index: fit}, gain=claim.gain + more,
            covariance=uncertainty([fit], count),
        )  # fmt: skip

    def take(self, claims: list[Claim], known: list[Fit]) -> None:
        """Take claims about all joints for known, with the fits that they make.

        Joints that these follow to near their noise are not searched any further.
        """
        self.accepted += claims
        self.known = known
        for _ in range(PASSES):
            old = self.case, self.joints, self.known
            total = self.evidence()
            self._weigh()
            better = self.evidence() - total
            if better < CHANGED:
                if better < -CHANGED:
                    self.case, self.joints, self.known = old
                break
        left = self.left(dict(enumerate(self.known)))
        self.found = {k: [] for k, rms in left.items() if rms < PARTED}

    def bounced(self, known: list[Fit]) -> bool:
        """Draw joints with a gap that nobody can follow; whether there were any.

        One that is further off than the others has something else besides, and is not.

        Args:
            known: fits of all joints.
        """
        left = self.left(dict(enumerate(known)))
        most = ODD * float(np.median([*left.values()]))
        gaps = [
            k for k, rms in left.items()
            if ASTRAY < rms < most and parted(self.joints[k], known[k])
        ]  # fmt: skip
        self._draw(dict.fromkeys(gaps, BOUNCING))
        return bool(gaps)

    def _let_go(self) -> None:
        """Stop drawing joints without a cause that by now can be followed without."""
        named = {k for claim in self.accepted for k in claim.fits}
        idle = {k: rate for k, rate in self.case.pulled.items() if k not in named}
        if not idle:
            return
        self._draw(dict.fromkeys(idle, 0.0))
        left = self.left({k: self.known[k] for k in idle})
        self._draw({k: rate for k, rate in idle.items() if left[k] > ASTRAY})

    def _count_again(self, joints: Collection[int]) -> None:
        """Count pieces of joints that were left aside, but for those still astray."""
        back: dict[int, tuple[int, ...]] = {
            k: () for k in joints if self.case.aside.get(k)
        }
        if not back:
            return
        self._renew(cases.left_aside(self.case, back), back)
        every = {k: self.strays(k, self.known[k]) for k in back}
        if strays := {k: runs for k, runs in every.items() if runs}:
            self._renew(cases.left_aside(self.case, strays), strays)

    def strays(self, index: int, best: Fit) -> tuple[int, ...]:
        """The pieces of logs that a joint's best explanation misses, if they are few.

        Such as a chirp's fastest end, where a drive does what no law of the bank tells.
        Those that are left aside already stay so.
        """
        joint, gone = self.joints[index], self.case.aside.get(index, ())
        if not all(run.within for run in self.case.runs):
            return ()
        counts = joint.valid.sum(1)
        parts = np.split(np.square(best.residual), np.cumsum(counts)[:-1])
        left = {
            run: float(np.sqrt(part.mean()))
            for run, part in enumerate(parts) if len(part)
        }  # fmt: skip
        middle, worst = float(np.median([*left.values()])), max(left.values())
        least = max(STRAY * middle, ASTRAY * joint.noise, worst / 2.0)
        every = (*gone, *(run for run, rms in left.items() if rms > least))
        return every if len(every) <= FEW * (len(gone) + len(left)) else gone

    def _settled(self, claim: Claim, prior: list[Fit]) -> Claim:
        """The newest claim on the loads of the motion that it makes.

        Args:
            claim: to settle, accepted already.
            prior: what was known about each joint before it.
        """
        odd = self._odd(claim.fits)
        if claim.body is not None and self.case.base.follows:
            claim = self._sized(claim, prior, odd)
        for _ in range(PASSES if len(self.joints) > 1 else 0):
            old = claim, self.case, self.joints, self.known
            total = self.evidence(odd)
            self._weigh()
            claim = self._agreed(claim, prior, odd)
            better = self.evidence(odd) - total
            if better < -CHANGED:
                claim, self.case, self.joints, self.known = old
            self.accepted[-1] = claim
            if better < CHANGED and not claim.moved(old[0]):
                break
        return claim

    def _sized(self, claim: Claim, prior: list[Fit], odd: int | None) -> Claim:
        """The newest claim about a body on the loads of the measured motion.

        Of a wrong size, what a body does to one joint shows in the motion of the
        others, and loads along what they simulate bear that size out, each joint by
        itself. Loads as they were are kept where they suit better.
        """
        best = claim, self.case, self.joints, self.known
        most = self.evidence(odd)
        self.case = along(self.case, [], [])
        self.joints = self.altered(self.case)
        self.known = mapped(self._again, range(len(self.joints)))
        for _ in range(SIZING):
            before, claim = claim, self._agreed(claim, prior, odd)
            if (now := self.evidence(odd)) > most:
                best, most = (claim, self.case, self.joints, list(self.known)), now
            if not claim.moved(before):
                break
        claim, self.case, self.joints, self.known = best
        self.accepted[-1] = claim
        return claim

    def _agreed(self, claim: Claim, prior: list[Fit], odd: int | None) -> Claim:
        """A claim at the value that its joints agree on now, all but an odd one."""
        count = len(claim.own)
        if not count:
            return claim
        if len(claim.fits) == 1 and claim.body is None:
            fit = self.known[claim.where[0]]
            return claim._replace(
                own=fit.x[-count:], fits={claim.where[0]: fit},
                covariance=uncertainty([fit], count),
            )  # fmt: skip

        def advanced(index: int, newest: Hypothesis, x: np.ndarray) -> Fit:
            joint, owner = self.joints[index], combined(prior[index].hypothesis, newest)
            return fits.improve(joint, fits.start(joint, [(owner, x)]), SETTLING)[0]

        def free(index: int) -> Fit:
            x = np.append(self.known[index].x, claim.own)
            return advanced(index, claim.hypothesis, x)

        found = dict(zip(claim.fits, mapped(free, claim.fits), strict=True))
        heard = [fit for k, fit in found.items() if k != odd]
        own = shared_value(heard, claim.hypothesis)
        same = pinned(claim.hypothesis, own)
        every = mapped(lambda k: advanced(k, same, found[k].x[:-count]), found)
        settled = dict(zip(found, every, strict=True))
        sure = uncertainty(heard, count)
        for index, fit in settled.items():
            self.known[index] = fit
        return claim._replace(own=own, fits=settled, covariance=sure)

    def _odd(self, found: dict[int, Fit]) -> int | None:
        """The joint that an agreed value suits badly, where it suits the others.

        It has a cause of its own besides, and no say in what the others agree on.
        """
        left = self.left(found)
        if len(left) < SEVERAL:
            return None
        *_, second, worst = sorted(left, key=lambda k: left[k])
        return worst if left[worst] > max(ASTRAY, ODD * left[second]) else None
