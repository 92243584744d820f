"""A standing robot made ready: an ensemble of full simulations, and joint loads."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import mujoco
import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis.case import measured
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.floor import pushes, tolerances, weights
from gatjax.diagnosis.floor.channels import TILT, Channels
from gatjax.diagnosis.floor.limbs import along_limbs, free
from gatjax.diagnosis.floor.played import Rows, replayed, world_of
from gatjax.diagnosis.floor.tolerances import Draw
from gatjax.diagnosis.floor.weights import Trace
from gatjax.diagnosis.hypotheses import numbers
from gatjax.diagnosis.joint import STEP, Joint
from gatjax.diagnosis.loads import COARSE, Loads, Tree
from gatjax.diagnosis.measure import fallen
from gatjax.diagnosis.motion import FINE, LEAD, Motion, grid_time, smoothed
from gatjax.diagnosis.noise import noise_of
from gatjax.diagnosis.tolerances import USUAL, Tolerances
from gatjax.sim.world import World, dividing

LEAST = 2.0  # s: a shorter run is left out
BEFORE = 0.3  # s before a fall that are left out: it has begun
LEANING = 0.8  # rad of roll or pitch: the robot has fallen
SMOOTHED = 0.15  # of the noise variance: what smoothing leaves of it
FOLLOWED = 2  # rounds until a traced joint moves as its fit does


class Ensemble(NamedTuple):
    """Robots within their tolerances, the nominal one first, at one time step."""

    world: World
    robots: list[Draw]  # S
    rows: list[Rows]  # of each run, S worlds


class Standing(NamedTuple):
    """What is known of a standing robot before any cause is weighed."""

    model: mujoco.MjModel
    tree: Tree
    runs: list[JointRun]
    channels: list[Channels]  # of each run
    ensembles: list[Ensemble]
    allowed: Tolerances
    free: frozenset[int]  # joints of limbs that touch nothing
    follows: bool = False  # the motion is simulated: tolerances do not change it
    assumed: tuple[()] = ()  # of the joints, besides the model

    def weigh(
        self, known: list[Joint], fits: list[Fit]
    ) -> tuple[list[Motion], list[Loads]]:
        """Motions and loads of all runs for the single-joint engine.

        Args:
            known: joints as the engine simulates them, on loads found before.
            fits: what is known about each; joints with a hypothesis are made to move
                as they say, and what they leave counts as unexplained by them. Joints
                of free limbs move as measured.

        Returns:
            One motion and one load for each run, for `gatjax.diagnosis.assembly.build`.
        """
        time = grid_time(self.runs, STEP)[::FINE]
        followed = _followed(known, fits)
        limbs = measured(self.runs, known, fits, LEAD) if self.free else []
        motions, loads = [], []
        for number, run in enumerate(self.runs):
            wanted = {
                k: angle[:, number] for k, (angle, _) in followed.items()
                if k not in self.free
            }  # fmt: skip
            trace = _traced(self.tree, run, time, wanted)
            stamps = run.time - run.time[0]
            seen = [np.interp(stamps, time, q) for q in trace.motion.position.T]
            for joint, (_, readings) in followed.items():
                seen[joint] = readings[number, : len(stamps)]
            rest = run.angle - np.stack(seen, -1)
            left = smoothed(run, rest, time[::COARSE]).position
            answers = [moment.answer for moment in trace.moments]
            felt = pushes.felt(answers, left, scatter(self, number))
            moved, load = trace.motion, _loads(self, number, trace, felt)
            if limbs:
                own = sorted(self.free)
                moved, load = along_limbs(self.tree, own, limbs[number], trace, load)
            motions.append(moved)
            loads.append(load)
        return motions, loads


def prepare(
    model: mujoco.MjModel,
    runs: list[JointRun],
    channels: list[Channels],
    period: float,
    tell: Callable[[str, float], None],
    seed: int = 0,
    allowed: Tolerances = USUAL,
) -> Standing:
    """Simulate robots within their tolerances along the commands of the runs.

    Args:
        model: with position servos, its base floating.
        runs: trajectories of all actuated joints.
        channels: what else was logged (`channels.cut`), one set for each run.
        period: control period of the logs, s.
        tell: is called with a stage and the share of it that is done.
        seed: of the draws.
        allowed: how far the numbers of the model may be off.
    """
    runs, channels = upright(model, runs, channels, period)
    found = []
    for number, step in enumerate(tolerances.STEPS):
        tell("stand", number / len(tolerances.STEPS))
        world = tolerances.timed(world_of(model, period, dividing(period, step)))
        count = tolerances.DRAWS // len(tolerances.STEPS)
        robots = tolerances.draws(model, allowed, count, seed + number)
        values = [tolerances.values_of(world, robot) for robot in robots]
        zero = np.stack([robot.zero for robot in robots])
        found.append(
            _stood(Ensemble(world, robots, replayed(world, runs, values, -zero)))
        )
    tree = Tree(model, model.actuator_trnid[:, 0])
    return Standing(model, tree, runs, channels, found, allowed, free(tree, runs))


def upright(
    model: mujoco.MjModel, runs: list[JointRun], channels: list[Channels], period: float
) -> tuple[list[JointRun], list[Channels]]:
    """What runs and channels say before the robot, or its nominal model, falls.

    Raises:
        ValueError: no run of LEAST seconds is left.
    """
    step = dividing(period, tolerances.STEPS[0])
    world = tolerances.timed(world_of(model, period, step))
    left = []
    for row, run, logged in zip(
        replayed(world, runs, [world.values]), runs, channels, strict=True
    ):
        stamps = run.time - run.time[0]
        down = np.interp(stamps, row.time, fallen(row.up[0]) * 1.0) > 0.0
        for name in set(TILT) & set(logged):
            down |= np.logical_or.accumulate(np.abs(logged[name]) > LEANING)
        end = stamps[down][0] - BEFORE if down.any() else stamps[-1]
        kept = stamps <= end
        if end >= LEAST:
            left.append(
                (run.part(kept), {name: each[kept] for name, each in logged.items()})
            )
    if not left:
        raise ValueError(
            f"the robot or its model falls within {LEAST:g} s in every log; log a "
            f"motion at which both keep standing, or hang the robot (orientation.roll "
            f"and .pitch count as fallen beyond {LEANING:g} rad: are they in degrees?)"
        )
    return [run for run, _ in left], [logged for _, logged in left]


def _stood(ensemble: Ensemble) -> Ensemble:
    """The ensemble without robots that fell or diverged; the nominal one stays."""
    down = np.any([fallen(row.up).any(1) for row in ensemble.rows], axis=0)
    kept = np.flatnonzero(~down | (np.arange(len(down)) == 0))
    rows = [
        Rows(row.time, row.command, *(part[kept] for part in row[2:]))
        for row in ensemble.rows
    ]
    return Ensemble(ensemble.world, [ensemble.robots[k] for k in kept], rows)


def _followed(
    known: list[Joint], fits: list[Fit]
) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Angle [M, R] and readings [R, N] rad of joints that have a hypothesis."""
    out = {}
    for joint, fit in zip(known, fits, strict=True):
        if fit.hypothesis is not None:
            drive = numbers(joint, fit.hypothesis, fit.x)
            outcome = joint.outcome([drive], fit.hypothesis.geared, moving=True)
            out[joint.index] = outcome.angle[::FINE, :, 0], outcome.readings[..., 0]
    return out


def _traced(
    tree: Tree, run: JointRun, time: np.ndarray, wanted: dict[int, np.ndarray]
) -> Trace:
    """A trace whose joints in `wanted` move along angles [M] rad."""
    trace = weights.trace(tree, run, time)
    if not wanted:
        return trace
    added = np.zeros_like(trace.motion.position)
    gain = tree.model.actuator_gainprm[:, 0]
    for _ in range(FOLLOWED):
        for joint, angle in wanted.items():
            stiff = 1.0 + np.maximum(trace.load.slope[:, joint], 0.0) / gain[joint]
            added[:, joint] += stiff * (angle - trace.motion.position[:, joint])
        trace = weights.trace(tree, run, time, added)
    return trace


def scatter(standing: Standing, run: int) -> np.ndarray:
    """Covariance [J, J] rad^2 of joint angles within tolerances and smoothed noise."""
    parts = []
    for ensemble in standing.ensembles:
        change = ensemble.rows[run].angle[1:] - ensemble.rows[run].angle[:1]
        parts.append(change - change.mean(1, keepdims=True))
    flat = np.concatenate(parts).reshape(-1, parts[0].shape[-1])
    noise = np.square(noise_of([standing.runs[run]]))
    return flat.T @ flat / len(flat) + SMOOTHED * np.diag(noise)


def _loads(standing: Standing, run: int, trace: Trace, felt: np.ndarray) -> Loads:
    """Nominal loads with the pushes felt, and how they change."""
    time = trace.motion.time
    pushed = [np.interp(time, time[::COARSE], series) for series in felt.T]
    load = trace.load._replace(rest=trace.load.rest + np.stack(pushed, -1))
    drawn = [
        weights.drawn(one.rows[run], trace, one.robots, standing.tree)
        for one in standing.ensembles
    ]
    rest = np.concatenate(drawn, -1)
    bodies, gravity = weights.bodies(standing.tree, trace.moments)
    still = np.zeros_like(load.rest)  # what turns is not parted from the floor's push
    draws = np.stack([rest, np.zeros_like(rest)])
    return Loads(load, still, draws, bodies, gravity)
