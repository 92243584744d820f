"""A judge that replays claims with the whole robot, and finds the sizes that suit it.

A joint's own fit takes what the other leg does for its own doing: what a claim is worth
is what the extended robot, simulated as a whole, explains of all channels.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import extend
from gatjax.diagnosis.case import Case
from gatjax.diagnosis.claims import PLACE, PRICE, Claim, Stance
from gatjax.diagnosis.drops import ODDS, held
from gatjax.diagnosis.floor import scene
from gatjax.diagnosis.floor.claims import AXES, FloorClaim
from gatjax.diagnosis.floor.observed import Weighed, gained, weighed_rest
from gatjax.diagnosis.floor.scene import Robot
from gatjax.diagnosis.floor.standing import Standing
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.start import turn
from gatjax.effects.catalogue import CATALOGUE
from gatjax.sim.world import World, add_causes

REFINED = 3  # best of the claims whose size is looked for
ROUNDS = 2  # of it
SIZES = (0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0)  # that are tried, to first order
LADDER = 400  # coordinates to choose from


class Replaying(Judge):
    """Replays claims with the whole robot as far as it is known."""

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
        self.stances: list[FloorClaim] = []  # beside it; none: not looked for yet

    def place(self, claim: Claim) -> None:
        """Take a claim for known of the whole robot."""
        robot, rows = self.robot(claim), self.effects(claim)
        self.scene = scene.beside(self.scene, robot, self.outcome(claim))
        self.rows, self.outcomes, self.stances = [*self.rows, *rows], {}, []

    def replays(self, some: list[Claim]) -> list[Claim]:
        """Claims with the nats that they are worth to the whole robot, worst first.

        The best of them are at the size that suits it best.
        """
        found = sorted(self._each(some, self._replayed, 0.0), key=_gain)
        found[-REFINED:] = self._each(found[-REFINED:], self._refined, 0.5)
        return found

    def _each(
        self, some: list[Claim], change: Callable[[Claim], Claim], share: float
    ) -> list[Claim]:
        """Change some claims; half of the stage, which is done to a share before."""
        changed = []
        for number, claim in enumerate(some):
            self.tell("whole", share + 0.5 * number / len(some))
            changed.append(change(claim))
        return changed

    def _replayed(self, claim: Claim) -> Claim:
        """The claim with the nats that it is worth to the whole robot and its limbs."""
        best = self.outcome(claim)
        free = self.standing.free & set(claim.fits)
        own = sum(self.score(k, claim.fits[k]) for k in free)
        places = 1 if len(claim.where) == len(self.joints) else len(claim.where)
        lost = sum(mask.sum() for runs in (claim.lost or {}).values() for mask in runs)
        price = PRICE * len(claim.own) + ODDS * float(lost) + PLACE * places
        gain = gained(self.scene.known, best) + own - price
        return claim._replace(gain=gain)

    def _refined(self, claim: Claim) -> Claim:
        """The claim at the size that suits the whole robot best.

        A joint's own fit takes what the other leg does for its own doing.
        """
        if len(claim.own) != 1:
            return claim
        for _ in range(ROUNDS):
            now = self.outcome(claim)
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

    def outcome(self, claim: Claim) -> Weighed:
        """How well the robot of a claim meets the logs; each is simulated once."""
        name = claim.hypothesis.law
        key = (*name, claim.place(), tuple(claim.own), claim.body)
        if key not in self.outcomes:
            self.outcomes[key] = self._simulated(claim)
        return self.outcomes[key]

    def _simulated(self, claim: Claim) -> Weighed:
        """How well the robot with one claim more meets the logs."""
        return scene.replayed(self.scene, self.robot(claim))

    def robot(self, claim: Claim) -> Robot:
        """The robot as far as it is known, and one claim more."""
        robot = self.scene.robot
        if claim.lost:
            runs = [_received(run, claim.lost, k) for k, run in enumerate(robot.runs)]
            return robot._replace(runs=runs)
        if (unit := _unit(claim)) is not None:
            values = unit.values
            return robot._replace(askew=np.array([values[each] for each in AXES]))
        return robot._replace(world=self._world(self.effects(claim)))

    def effects(self, claim: Claim) -> list[tuple]:
        """Rows of the world that a claim changes."""
        aside = claim.lost or _unit(claim) is not None
        return [] if aside else extend.effects(self, claim)

    def _world(self, more: list[tuple]) -> World:
        """A world with more effects than are known, in the order of `start.CHAIN`."""
        every = sorted([*self.rows, *more], key=lambda row: turn({"cause": row[0]}))
        return add_causes(self.bare, every)


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


def _gain(claim: Claim) -> float:
    return claim.gain
