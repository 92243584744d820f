"""A diagnosis case: the model, the runs and every joint made ready for simulation."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple, Protocol, runtime_checkable

import mujoco
import numpy as np

from gatjax import processors
from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import assembly, search
from gatjax.diagnosis import loads as weights
from gatjax.diagnosis import motion as motions
from gatjax.diagnosis.fit import Fit, evidence
from gatjax.diagnosis.hypotheses import numbers
from gatjax.diagnosis.joint import STEP, Assumed, Joint
from gatjax.diagnosis.tolerances import USUAL, Tolerances
from gatjax.robot.model import joint_names

PASSES, RESTS = 3, 3.0  # over the loads of the fitted motion; nats that end them
LED_ASTRAY = 5.0  # times the noise that a fit leaves: loads along its motion are worse


@runtime_checkable
class Base(Protocol):
    """How loads of the joints are weighed: along what was measured, or simulated."""

    @property
    def tree(self) -> weights.Tree:
        """Its model and joints."""
        ...

    @property
    def allowed(self) -> Tolerances:
        """How far its nominal numbers may be off."""
        ...

    @property
    def follows(self) -> bool:
        """Whether fits of the tolerances alone change the loads."""
        ...

    @property
    def assumed(self) -> Sequence[Assumed]:
        """What is known of each joint besides the model; () if nothing is."""
        ...

    def weigh(
        self, known: list[Joint], fits: list[Fit]
    ) -> tuple[list[motions.Motion], list[weights.Loads]]:
        """Motion and loads of each run, beside fits of the joints if there are any."""
        ...


class Held(NamedTuple):
    """A robot whose base is fixed: loads along the measured motion of all joints."""

    tree: weights.Tree
    runs: list[JointRun]
    others: list[mujoco.MjModel]  # drawn from the tolerances of bodies and mounting
    allowed: Tolerances = USUAL
    follows: bool = True
    assumed: Sequence[Assumed] = ()

    def weigh(
        self, known: list[Joint], fits: list[Fit]
    ) -> tuple[list[motions.Motion], list[weights.Loads]]:
        """Loads by inverse dynamics."""
        lead = motions.lead_of(self.tree.model)
        moved = measured(self.runs, known, fits, lead)
        return moved, [weights.weigh(self.tree, each, self.others) for each in moved]


def held(
    model: mujoco.MjModel, runs: list[JointRun], seed: int,
    allowed: Tolerances = USUAL, assumed: Sequence[Assumed] = (),
) -> Held:  # fmt: skip
    """A robot with servos or motors on hinges, its base fixed.

    `assumed` says what is known of each joint besides the model; nothing if left out.
    """
    draw = np.random.default_rng(seed)
    others = [weights.perturbed(model, allowed, draw) for _ in range(weights.DRAWS)]
    tree = weights.Tree(model, model.actuator_trnid[:, 0])
    return Held(tree, runs, others, allowed, assumed=assumed)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Case:
    """What a diagnosis starts from; `healthy` are the fits of tolerances alone."""

    base: Base
    runs: list[JointRun]
    joints: list[Joint]
    motions: list[motions.Motion]
    loads: list[weights.Loads]
    healthy: list[Fit]
    pulled: dict[int, float] = dataclasses.field(default_factory=dict)
    # joints drawn to their measured motion, 1/s
    aside: dict[int, tuple[int, ...]] = dataclasses.field(default_factory=dict)
    # runs of a joint that do not count, since nothing explains them

    @property
    def tree(self) -> weights.Tree:
        """The model's actuated joints."""
        return self.base.tree

    @property
    def model(self) -> mujoco.MjModel:
        """The nominal robot."""
        return self.base.tree.model

    @property
    def supply(self) -> float:
        """Largest sum of all servo torques in the runs, N m."""
        total = assembly.supply_load(self.model, self.tree, self.motions, self.loads)
        return max(float(series.max()) for series in total)

    @property
    def evidence(self) -> float:
        """Nats of the tolerances alone, all joints together."""
        pairs = zip(self.joints, self.healthy, strict=True)
        return sum(evidence(joint, fit) for joint, fit in pairs)

    def commands(self, joint: int) -> list[np.ndarray]:
        """Commands of a joint, per run [N] rad."""
        return [run.command[:, joint] for run in self.runs]

    def moved_by(self, joint: int) -> list[int]:
        """Joints whose bodies a joint moves, itself first."""
        parents, dofs = self.model.body_parentid, self.tree.moves[:, joint] != 0.0
        turned, found = set(self.model.dof_bodyid[dofs]), []
        for other, body in enumerate(self.tree.body):
            while body and body not in turned:
                body = parents[body]
            if body:
                found.append(other)
        return sorted(found, key=lambda other: other != joint)

    def bearers(self, body: int) -> list[int]:
        """Joints that move the body of a joint."""
        return [k for k in range(len(self.joints)) if body in self.moved_by(k)]

    def carrying(self, joint: Joint, other: int) -> Joint:
        """A joint of this case whose body terms belong to the body of another joint."""
        if joint.index == other:
            return joint
        time = motions.grid_time(self.runs, STEP, -self.motions[0].time[0])
        few = self.motions[0].time[:: weights.COARSE]
        grid = joint.grid
        first, last = weights.TERMS, weights.TERMS + len(weights.BODY_TERMS)
        parts = {}
        for kind, field in enumerate(weights.Load._fields):
            name = f"{field}_terms"
            columns = [
                motions.spread(time, few, load.bodies[kind, :, joint.index, other])
                for load in self.loads
            ]
            parts[name] = getattr(grid, name).copy()
            parts[name][..., first:last] = np.stack(columns, 1)
        changed = grid._replace(**parts)
        return joint._replace(grid=changed, link=self.joints[other].link)


def prepare(
    base: Base, runs: list[JointRun], tell: Callable[[str, float], None]
) -> Case:
    """Weigh what the joints carry, and fit the tolerances.

    Args:
        base: how loads are weighed.
        runs: trajectories of all actuated joints.
        tell: is called with a stage and the share of it that is done.
    """
    case = unfitted(base, runs)
    return dataclasses.replace(case, healthy=_healthy(case.joints, tell))


def unfitted(base: Base, runs: list[JointRun]) -> Case:
    """A case with loads along the measured motion, whose tolerances are not fitted."""
    moved, loads = base.weigh([], [])
    names = joint_names(base.tree.model)
    ready = assembly.build(
        base.tree.model,
        base.tree,
        names,
        runs,
        moved,
        loads,
        base.allowed,
        base.assumed,
    )
    return Case(
        base=base, runs=runs, joints=ready, motions=moved, loads=loads, healthy=[]
    )


def settled(case: Case, tell: Callable[[str, float], None]) -> Case:
    """The same case with loads along the motion that tolerances alone make of it.

    Loads along the measured motion carry its noise; those along a fitted motion carry
    what is wrong with the fit, which may hide a cause.

    Args:
        case: as prepared.
        tell: is called with a stage and the share of it that is done.
    """
    for _ in range(PASSES if case.base.follows and len(case.joints) > 1 else 0):
        before, old = case.evidence, [fit.x for fit in case.healthy]
        case = along(case, case.joints, case.healthy)
        again = _healthy(case.joints, tell, old)
        case = dataclasses.replace(case, healthy=again)
        if case.evidence - before < RESTS:
            break
    return case


def _healthy(
    ready: list[Joint], tell: Callable[[str, float], None],
    starts: list[np.ndarray] | None = None,
) -> list[Fit]:  # fmt: skip
    """Fits of the tolerances alone, joints in parallel."""

    def one(joint: Joint) -> Fit:
        return search.healthy(joint, starts[joint.index] if starts else None)

    return mapped(one, ready, lambda share: tell("tolerances", share))


def mapped(
    function: Callable,
    items: Collection,
    tell: Callable[[float], None] = lambda _: None,
) -> list:
    """Apply a function to items on all cores, in order; tell the share that is done."""
    results = []
    with ThreadPoolExecutor(processors.usable()) as pool:
        for result in pool.map(function, items):
            results.append(result)
            tell(len(results) / len(items))
    return results


def along(case: Case, known: list[Joint], fits: list[Fit]) -> Case:
    """The same case with loads along the motion that fits of its joints simulate.

    Args:
        case: with loads along another motion; its healthy fits stay as they are.
        known: the joints as the fits simulate them.
        fits: one for each joint.
    """
    moved, loads = case.base.weigh(known, fits)
    names = joint_names(case.model)
    ready = assembly.build(
        case.model, case.tree, names, case.runs, moved, loads, case.base.allowed,
        case.base.assumed,
    )  # fmt: skip
    new = dataclasses.replace(case, joints=ready, motions=moved, loads=loads)
    return pulled(left_aside(new, {}), case.pulled)


def pulled(case: Case, drawn: dict[int, float]) -> Case:
    """The same case with some of its joints drawn to their measured motion.

    Where stick and slip decide when a joint moves, two runs part for good after a small
    difference, and no law looks right.

    Args:
        case: to change.
        drawn: how strongly each joint is drawn, 1/s; those that it lacks stay as is.
    """
    rates = {k: rate for k, rate in (case.pulled | drawn).items() if rate > 0.0}
    ready = [joint.drawn(rates.get(joint.index, 0.0)) for joint in case.joints]
    return dataclasses.replace(case, joints=ready, pulled=rates)


def left_aside(case: Case, runs: dict[int, tuple[int, ...]]) -> Case:
    """The same case with these runs of some joints left aside; other joints stay."""
    every = {k: some for k, some in (case.aside | runs).items() if some}
    ready = [joint.without(every.get(joint.index, ())) for joint in case.joints]
    return dataclasses.replace(case, joints=ready, aside=every)


def measured(
    runs: list[JointRun], ready: list[Joint], fits: list[Fit], lead: float
) -> list[motions.Motion]:
    """Motions as measured, smoothed; with the fast parts of fits, if there are any.

    Args:
        runs: gives the readings.
        ready: joints as the engine simulates them.
        fits: one for each joint, or none.
        lead: s at rest before a run.
    """
    if fits:
        return _resimulated(runs, ready, fits)
    fine = motions.grid_time(runs, STEP, lead)[:: motions.FINE]
    return [motions.smoothed(run, run.angle, fine) for run in runs]


def _resimulated(
    runs: list[JointRun], ready: list[Joint], fits: list[Fit]
) -> list[motions.Motion]:
    """Motions of the fitted joints, corrected by what the fits leave.

    Those of joints that a fit leads far astray are the measured ones, smoothed.
    """
    fine = motions.grid_time(runs, STEP, STEP * ready[0].lead)[:: motions.FINE]
    angles, rests = [], []
    for joint, fit in zip(ready, fits, strict=True):
        if fit.rms() >= LED_ASTRAY * joint.noise:
            still = joint.grid.rest[:: motions.FINE]
            angles.append(np.zeros_like(still, np.float32))
            rests.append(joint.measured)
            continue
        drive = numbers(joint, fit.hypothesis, fit.x)
        outcome = joint.outcome([drive], fit.geared, moving=True)
        angles.append(outcome.angle[:: motions.FINE, :, 0])
        rests.append(joint.measured - outcome.readings[..., 0])
    fast, rest = np.stack(angles, -1), np.stack(rests, -1)
    return [
        motions.simulated(run, fine, fast[:, k], rest[k, : len(run.time)])
        for k, run in enumerate(runs)
    ]
