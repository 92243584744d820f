"""The judge of a standing robot: every claim is replayed by the whole robot.

Two feet on the ground close a chain, so what one joint of a leg does looks like a small
fault of all others. A joint's own fit only proposes: its claim counts what the whole
extended robot explains of all channels, in the same nats as a claim about the floor.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import extend, search
from gatjax.diagnosis.aliases import covered
from gatjax.diagnosis.bank import CAUSES, OTHERS, of_drive
from gatjax.diagnosis.case import Case, along, mapped
from gatjax.diagnosis.claims import LATER, PLACE, PRICE, Claim, Stance
from gatjax.diagnosis.drops import ODDS, held
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.floor import carried, channels, claims, scene
from gatjax.diagnosis.floor.claims import AXES, FloorClaim
from gatjax.diagnosis.floor.observed import Weighed, gained, weighed_rest
from gatjax.diagnosis.floor.scene import Robot
from gatjax.diagnosis.floor.standing import Standing
from gatjax.diagnosis.hypotheses import Hypothesis, Numbers
from gatjax.diagnosis.joint import Joint
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.loads import Tree
from gatjax.diagnosis.start import turn
from gatjax.effects.catalogue import CATALOGUE
from gatjax.sim.world import World, add_causes, fields_applied

PROPOSED = 1.0  # nats of a joint's own fit: a claim below is not replayed
MOST = 14  # claims that are replayed
PAIR = 2  # joints: a slipping foot looks like larger groups, short of all
REFINED = 3  # best of them whose size is looked for
ROUNDS = 2  # of it
SIZES = (0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0)  # that are tried, to first order
LADDER = 400  # coordinates to choose from
LOUD = 2.0  # times the scatter within tolerances: a joint that leaves less is explained


class StandingJudge(Judge):
    """Finds what explains joints, inertial unit and feet together best."""

    most = 2
    worth = LATER
    apart = False  # two feet on the ground close a chain

    def __init__(
        self, case: Case, standing: Standing, tell: Callable[[str, float], None]
    ) -> None:
        """Start from the tolerances of a case whose base is the standing robot."""
        super().__init__(case, tell)
        self.standing = standing
        self.scene = scene.prepare(standing, tell)
        self.nominal = self.scene.known
        self.bare = self.scene.robot.world
        self.rows: list[tuple] = []  # of the causes that are known
        self.outcomes: dict[tuple, Weighed] = {}

    def claims(self) -> list[Claim]:
        """All claims that the whole robot was simulated with, best first."""
        if not self.scene.rows:
            self.scene = scene.resimulated(self.scene, self.tell)
        proposed = [
            claim for claim in super().claims()
            if claim.hypothesis.cause not in ("", carried.Load.cause)
            and claim.gain > PROPOSED
            and (len(claim.where) <= PAIR or len(claim.where) == len(self.joints))
        ][:MOST]  # fmt: skip
        found = sorted(self._each(proposed, self._replayed, 0.0), key=_worst_first)
        found[-REFINED:] = self._each(found[-REFINED:], self._refined, 0.5)
        found += [_claim(one) for one in claims.claims(self.scene, self.tell)]
        new = (claim for claim in found if not self._told(claim))
        return sorted(new, key=lambda claim: -claim.gain)

    def _told(self, claim: Claim) -> bool:
        """Whether a claim repeats a cause that is known, at joints or of the floor."""
        places = set(extend.places(self, claim))
        return any(
            claim.hypothesis.cause in covered(known.hypothesis, len(self.joints))
            and places & set(extend.places(self, known))
            for known in self.accepted
        )

    def _each(
        self, some: list[Claim], change: Callable[[Claim], Claim], share: float
    ) -> list[Claim]:
        """Change some claims; half of the stage, which is done to a share before."""
        changed = []
        for number, claim in enumerate(some):
            self.tell("whole", share + 0.5 * number / len(some))
            changed.append(change(claim))
        return changed

    def explained(
        self, index: int, bank: tuple[Hypothesis, ...] = CAUSES + OTHERS
    ) -> list[Fit]:
        """Fits that are good enough to propose a cause."""
        bank = of_drive(self.joints[index], bank)
        return search.proposals(self.joints[index], self.known[index], bank)

    def _replayed(self, claim: Claim) -> Claim:
        """The claim with the nats that it is worth to the whole robot."""
        best = self._outcome(claim)
        places = 1 if len(claim.where) == len(self.joints) else len(claim.where)
        lost = sum(mask.sum() for runs in (claim.lost or {}).values() for mask in runs)
        price = PRICE * len(claim.own) + ODDS * float(lost) + PLACE * places
        gain = gained(self.scene.known, best) - price
        return claim._replace(gain=gain)

    def _refined(self, claim: Claim) -> Claim:
        """The claim at the size that suits the whole robot best.

        A joint's own fit takes what the other leg does for its own doing.
        """
        if len(claim.own) != 1:
            return claim
        for _ in range(ROUNDS):
            now = self._outcome(claim)
            change = now.rest - self.scene.known.rest
            tried = {
                size: weighed_rest(self.scene.seen, now.rest + (size - 1.0) * change)
                for size in SIZES
            }
            best = max(tried, key=lambda size: tried[size].evidence)
            if best == 1.0:
                break
            far = self._resized(claim, best)
            tries = [far, 0.5 * (far + claim.own)]  # it may be less than linear
            others = [self._replayed(claim._replace(own=own)) for own in tries]
            other = max(others, key=lambda one: one.gain)
            if other.gain <= claim.gain:
                break
            claim = other
        return claim

    def _resized(self, claim: Claim, size: float) -> np.ndarray:
        """The coordinate [1] at which a cause is so many times as large as it is."""
        hypothesis, joint = claim.hypothesis, self.joints[claim.where[0]]
        entry = CATALOGUE[hypothesis.cause]
        ladder = np.linspace(hypothesis.low[0], hypothesis.high[0], LADDER)

        def severity(x: float) -> float:
            values = hypothesis.values(joint, np.array([x]))
            return entry.severity(values[entry.main.name])

        wanted = size * severity(float(claim.own[0]))
        apart = [abs(severity(float(x)) - wanted) for x in ladder]
        return ladder[[int(np.argmin(apart))]]

    def _outcome(self, claim: Claim) -> Weighed:
        """How well the robot of a claim meets the logs; each is simulated once."""
        name = claim.hypothesis.law
        key = (*name, claim.place(), tuple(claim.own), claim.body)
        if key not in self.outcomes:
            self.outcomes[key] = self._simulated(claim)
        return self.outcomes[key]

    def _simulated(self, claim: Claim) -> Weighed:
        """How well the robot with one claim more meets the logs."""
        return scene.replayed(self.scene, self._robot(claim))

    def _robot(self, claim: Claim) -> Robot:
        """The robot as far as it is known, and one claim more."""
        robot = self.scene.robot
        if claim.lost:
            runs = [_received(run, claim.lost, k) for k, run in enumerate(robot.runs)]
            return robot._replace(runs=runs)
        if (unit := _unit(claim)) is not None:
            values = unit.values
            return robot._replace(askew=np.array([values[each] for each in AXES]))
        return robot._replace(world=self._world(self._effects(claim)))

    def _effects(self, claim: Claim) -> list[tuple]:
        """Rows of the world that a claim changes."""
        aside = claim.lost or _unit(claim) is not None
        return [] if aside else extend.effects(self, claim)

    def _world(self, more: list[tuple]) -> World:
        """A world with more effects than are known, in the order of `start.CHAIN`."""
        every = sorted([*self.rows, *more], key=lambda row: turn({"cause": row[0]}))
        return add_causes(self.bare, every)

    def visibility(self, claim: Claim) -> float:
        """RMS change over the scatter from tolerances; the largest channel's."""
        if claim.stance is not None:
            return claim.stance.visibility
        return scene.visibility(self.scene, self._outcome(claim))

    def signals(self) -> list[dict[str, Any]]:
        """Misfits of inertial unit and feet, means over CORRELATED seconds.

        Returns:
            `signals` of diagnosis.json: rows that end with the RMS of what is left,
            by the nominal robot, within tolerances, and with the cause.
        """
        seen, before, after = self.scene.seen, self.nominal, self.scene.known
        rows = []
        for k in range(len(self.joints), len(seen.names)):
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
        return bool(self.scene.known.level[index] < LOUD)

    def accept(self, claim: Claim) -> Claim:
        """Take a claim for known, and weigh the loads of the robot that it makes."""
        robot, rows = self._robot(claim), self._effects(claim)
        self.scene = scene.beside(self.scene, robot, self._outcome(claim))
        self.rows, self.outcomes = [*self.rows, *rows], {}
        if claim.stance is None:
            return super().accept(claim)
        self.accepted.append(claim)
        changed = [row for each in self.accepted if each.stance is not None
                   for row in self._effects(each)]  # fmt: skip
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
        """Nats of what is known, of the whole robot: none of its joints moves alone."""
        return self.scene.known.evidence

    def current(self, claim: Claim) -> Claim:
        """The claim; the whole robot has settled its size."""
        return claim

    def _converged(self, claim: Claim) -> Claim:
        """The claim; the whole robot has settled its size."""
        return claim

    def _settled(self, claim: Claim, prior: list[Fit]) -> Claim:
        """The newest claim on its loads; the whole robot has settled its size."""
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


def _unit(claim: Claim) -> Stance | None:
    """What a claim says of the inertial unit, if it is about that."""
    stance = claim.stance
    return stance if stance is not None and stance.where == "imu" else None


def _received(
    run: JointRun, lost: dict[int, list[np.ndarray]], number: int
) -> JointRun:
    """A run, by its number, with the commands that came through."""
    command = run.command.copy()
    for joint, masks in lost.items():
        command[:, joint] = held(command[:, joint], masks[number])
    return run._replace(command=command)


def _worst_first(claim: Claim) -> float:
    return claim.gain


def _unchanged(drive: Numbers, joint: Joint, x: np.ndarray) -> None:
    """Joints stay as they are."""
