"""The judge of a standing robot: claims about what bears it are replayed as a whole.

Two feet on the ground close a chain, so what one joint of a leg does looks like a small
fault of all others. A joint's own fit only proposes: its claim counts what the whole
extended robot explains of all channels, in the same nats as a claim about the floor.

A limb that touches nothing closes none. Its joints show by themselves what is wrong
with them, as those of a robot in the air do; they are no channel of the whole, so that
nats of both kinds add up.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from typing import Any

import numpy as np

from gatjax.diagnosis import extend, search
from gatjax.diagnosis.aliases import covered
from gatjax.diagnosis.bank import CAUSES, OTHERS, of_drive
from gatjax.diagnosis.case import along, mapped
from gatjax.diagnosis.claims import BODY, LATER, Claim, Stance
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.floor import carried, channels, claims, scene
from gatjax.diagnosis.floor.claims import FloorClaim
from gatjax.diagnosis.floor.replaying import Replaying
from gatjax.diagnosis.hypotheses import Hypothesis, Numbers
from gatjax.diagnosis.joint import Joint
from gatjax.diagnosis.loads import Tree
from gatjax.sim.world import add_causes, fields_applied

PROPOSED = 1.0  # nats of a joint's own fit: a claim below is not replayed
MOST = 14  # claims that are replayed
PAIR = 2  # joints: a slipping foot looks like larger groups, short of all
LOUD = 2.0  # times the scatter within tolerances: a joint that leaves less is explained


class StandingJudge(Replaying):
    """Finds what explains joints, inertial unit and feet together best."""

    most = 2
    worth = LATER

    def apart(self, joints: Collection[int]) -> bool:
        """Whether joints are of limbs that touch nothing; of soles there are none."""
        return bool(joints) and self.standing.free.issuperset(joints)

    def claims(self) -> list[Claim]:
        """Claims about free limbs, and all that the whole robot was simulated with.

        Best first.
        """
        if not self.scene.rows:
            self.scene = scene.resimulated(self.scene, self.tell)
        every = super().claims()
        proposed = [
            claim for claim in every
            if claim.hypothesis.cause not in ("", carried.Load.cause)
            and claim.gain > PROPOSED and not self.apart(claim.fits)
            and (len(claim.where) <= PAIR or len(claim.where) == len(self.joints))
        ][:MOST]  # fmt: skip
        found = self.replays(proposed)
        limbs = {self.joints[k].name for k in self.standing.free}
        if not self.stances:
            self.stances = claims.claims(self.scene, self.tell)
        found += [_claim(one) for one in self.stances if one.where not in limbs]
        found += [claim for claim in every if self.apart(claim.fits)]
        new = (claim for claim in found if not self._told(claim))
        return sorted(new, key=lambda claim: -claim.gain)

    def _told(self, claim: Claim) -> bool:
        """Whether a claim repeats a cause that is known, at joints or of the floor."""
        same = [
            known for known in self.accepted
            if claim.hypothesis.cause in covered(known.hypothesis, len(self.joints))
        ]  # fmt: skip
        places = {each for known in same for each in extend.places(self, known)}
        return bool(same) and not places.isdisjoint(extend.places(self, claim))

    def explained(
        self, index: int, bank: tuple[Hypothesis, ...] = CAUSES + OTHERS
    ) -> list[Fit]:
        """Fits of a free limb's joint; of others, good enough to propose a cause."""
        if self.apart((index,)):
            return super().explained(index, bank)
        bank = of_drive(self.joints[index], bank)
        return search.proposals(self.joints[index], self.known[index], bank)

    def visibility(self, claim: Claim) -> float:
        """RMS change over the scatter from tolerances; the largest channel's."""
        if self.apart(claim.fits):
            return super().visibility(claim)
        if claim.stance is not None:
            return claim.stance.visibility
        return scene.visibility(self.scene, self.outcome(claim))

    def signals(self) -> list[dict[str, Any]]:
        """Misfits of inertial unit and feet, means over CORRELATED seconds.

        Returns:
            `signals` of diagnosis.json: rows that end with the RMS of what is left,
            by the nominal robot, within tolerances, and with the cause.
        """
        seen, before, after = self.scene.seen, self.nominal, self.scene.known
        rows = []
        for k in range(len(self.joints) - len(self.standing.free), len(seen.names)):
            noise = float(seen.noise[k])
            rows.append(
                {"name": seen.names[k], "noise": noise,
                 "measured_rms": float(np.std(seen.measured[k])),
                 "unit": channels.UNITS[seen.names[k].partition(".")[0]],
                 "nominal_rms": float(np.sqrt(np.mean(np.square(before.rest[k])))),
                 "tolerance_rms": noise * float(before.level[k]),
                 "extended_rms": noise * float(after.level[k])}
            )  # fmt: skip
        return rows

    def tolerates(self, index: int) -> bool:
        """Whether the whole robot within its tolerances may move a joint like that."""
        if self.apart((index,)):
            return False
        place = self.scene.seen.names.index(self.joints[index].name)
        return bool(self.scene.known.level[place] < LOUD)

    def accept(self, claim: Claim) -> Claim:
        """Take a claim for known, and weigh the loads of the robot that it makes.

        What the drive of a free limb does wrong changes nothing of what bears it.
        """
        free = self.apart(claim.fits)
        if free:
            claim = super().accept(claim)  # at the size that it settles at
        if not free or claim.hypothesis.cause in BODY:
            self.place(claim)
        if claim.stance is not None:
            return self._restood(claim)
        return claim if free else super().accept(claim)

    def _restood(self, claim: Claim) -> Claim:
        """Take a claim about floor, feet or inertial unit for known."""
        self.accepted.append(claim)
        changed = [row for each in self.accepted if each.stance is not None
                   for row in self.effects(each)]  # fmt: skip
        model = fields_applied(add_causes(self.bare, changed))
        tree = Tree(model, model.actuator_trnid[:, 0])
        base = self.standing._replace(tree=tree)
        self.case = along(
            dataclasses.replace(self.case, base=base), self.joints, self.known
        )
        self.joints, self.found = self.altered(self.case), {}
        self.known = mapped(self._again, range(len(self.joints)))
        return claim

    def evidence(self, without: int | None = None) -> float:
        """Nats of what is known, of the whole robot and of its free limbs' joints."""
        free = self.standing.free - {without}
        return self.scene.known.evidence + sum(self._evidence(k) for k in free)

    def current(self, claim: Claim) -> Claim:
        """The claim; the whole robot has settled its size, but for a free limb's."""
        return super().current(claim) if self.apart(claim.fits) else claim

    def _converged(self, claim: Claim) -> Claim:
        """The claim; the whole robot has settled its size, but for a free limb's."""
        return super()._converged(claim) if self.apart(claim.fits) else claim

    def _settled(self, claim: Claim, prior: list[Fit]) -> Claim:
        """The newest claim on its loads; the whole robot has settled its size."""
        if self.apart(claim.fits):
            return super()._settled(claim, prior)
        self.case = along(self.case, self.joints, self.known)
        self.joints = self.altered(self.case)
        self.known = mapped(self._again, range(len(self.joints)))
        return claim


def _claim(found: FloorClaim) -> Claim:
    """A claim about the floor as one among those about joints."""
    stance = Stance(found.where, found.values, found.low, found.high, found.visibility)
    hypothesis = Hypothesis(
        found.cause, "", put=_unchanged, starts=(), steps=(), low=(), high=(),
        values=lambda joint, x: found.values,
    )  # fmt: skip
    return Claim(hypothesis, np.zeros(0), (), {}, found.gain, stance=stance)


def _unchanged(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
    """Joints stay as they are."""
