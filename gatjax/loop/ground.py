"""The grounding stage: learn, choose alpha, measure what it predicts."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gatjax import runs
from gatjax.data.recording import Recording
from gatjax.data.trajectories import (
    JointRun,
    channels,
    split_by_trajectory,
    to_arrays,
)
from gatjax.grounding import learn as grounders
from gatjax.grounding import prediction
from gatjax.grounding.grounder import Experience
from gatjax.loop.setting import Entry, Setting
from gatjax.records import Array, Signal
from gatjax.robot.nao import WALKING, WALKING_JOINTS
from gatjax.sim.actuation import actuation
from gatjax.sim.backend import Backend, default_backend, pairs, prepare
from gatjax.sim.lighter import lighter
from gatjax.sim.stored import carried, write_world
from gatjax.sim.world import Values, World
from gatjax.walk.parameters import THETA0

HELD_OUT = 0.2  # share of the robot's trajectories that only test predictions
GYRO = ("gyro.x", "gyro.y", "gyro.z")
WINDOWS = 200  # pieces of 0.5 s that predictions are measured on
STABILITY_ROLLOUTS = 20
RETRAINING = 6  # folded into the key of walks that an inverse model learns from again


def learn_grounding(
    world: World,
    method: str,
    robot: Recording,
    simulator: Recording,
    seed: int,
    theta: Array = THETA0,
    tell: Callable[[str], None] = print,
) -> grounders.Grounding:
    """Learn a grounding from whole recordings, but for the held-out trajectories.

    Args:
        world: the simulator, not grounded.
        method: one of `gatjax.grounding.learn.METHODS`.
        robot: recording of the robot.
        simulator: recording of the simulator under the same policy.
        seed: of initial weights and splits.
        theta: [15] that policy, for methods that let the simulator walk again.
        tell: shows a line about what goes on, of methods that take minutes.
    """
    seen, _ = parted(robot, world.task.control_period, seed)
    runs_of = functools.partial(to_arrays, joints=WALKING_JOINTS)

    def gyros() -> tuple[list[Array], list[Array]]:
        return channels(robot, GYRO, seen), channels(simulator, GYRO)

    def play(method: str, params: Any, number: int) -> list[JointRun]:
        count = len(np.unique(simulator.trajectory))
        key = jax.random.fold_in(jax.random.key(seed), RETRAINING)
        keys = jax.random.split(jax.random.fold_in(key, number), count)
        return played(world, grounders.Grounding(method, params, {}), theta, keys)

    experience = Experience(
        robot=[run for run in runs_of(robot) if run.trajectory in seen],
        simulator=runs_of(simulator),
        gyros=gyros,
        step_error=lambda: step_error(world, robot, simulator, seen, seed),
        play=play,
        practice=functools.partial(practice, world, theta),
        seed=seed,
        tell=tell,
    )
    grounding = grounders.learn(method, experience)
    facts = {**grounding.facts, "rate_hz": world.rate_hz}
    return grounding._replace(facts=facts)


def practice(world: World, theta: Array, view: Any, scale: float) -> Any:
    """The walk in the simulator as a Brax environment; see `Experience.practice`."""
    from gatjax.rl.env import Walk

    light = lighter(world)
    called = default_backend() == "native" and actuation(light).plain
    engine = "native" if called else "mjx"
    return Walk(light, theta, view, scale, engine)


def played(
    world: World, grounding: grounders.Grounding, theta: Array, keys: Array
) -> list[JointRun]:
    """Walk in the grounded simulator; commands are what the simulator was told.

    Raises:
        ValueError: the grounding draws: its log does not say what was told.
    """
    if grounding.method not in ("gat", "guided"):
        raise ValueError(
            f"grounding {grounding.method} draws: its log does not say what the "
            f"simulator was told"
        )
    policies = np.tile(theta, (len(keys), 1))
    better = grounders.grounded(world, grounding)
    walk, _ = prepare(better, "native").rollout(better.values, policies, keys)
    effect = grounders.METHODS[grounding.method].effect(WALKING)

    def sent(command: Array, angle: Array) -> Array:
        def told(row: tuple[Array, Array]) -> Signal:
            still = jnp.zeros_like(row[0])
            return Signal(row[0], row[1], still, still)

        def tick(state: Any, row: tuple) -> tuple:
            state, signal = effect.apply(grounding.params, state, told(row))
            return state, signal.target

        begin = effect.init(grounding.params, told((command[0], angle[0])))
        return jax.lax.scan(tick, begin, (command, angle))[1]

    told = np.asarray(jax.jit(jax.vmap(sent))(walk.command, walk.reading.angle))
    return [
        JointRun(number, walk.time[number][alive], told[number][alive][:, WALKING],
                 walk.reading.angle[number][alive][:, WALKING])
        for number, alive in enumerate(np.asarray(walk.alive))
    ]  # fmt: skip


def parted(walks: Recording, seconds: float, seed: int) -> tuple[Array, Array]:
    """Ids of trajectories to learn from, and of those that only test predictions.

    These are drawn from the ones that are long enough for it.

    Args:
        walks: of the robot.
        seconds: from row to row.
        seed: of the draw.
    """
    ids, rows = np.unique(walks.trajectory, return_counts=True)
    least = prediction.shortest(seconds)
    long = ids[rows > least]
    if len(long) < 2:
        raise ValueError(
            f"{walks.name}: {len(long)} of {len(ids)} walks last longer than "
            f"{least * seconds:.3g} s, two are needed: the robot falls too early for a "
            f"grounding"
        )
    _, held_out = split_by_trajectory(long, HELD_OUT, seed)
    return np.setdiff1d(ids, held_out), held_out


def measured(recording: Recording) -> Recording:
    """A log as its robot measured it: the torso's pose (`base.*`) is for scoring.

    Stand-ins and simulators write that down, too. Nothing is fitted to it.
    """
    columns = recording.columns.items()
    return recording._replace(
        columns={key: v for key, v in columns if not key.startswith("base.")}
    )


def step_error(
    world: World, robot: Recording, simulator: Recording, seen: Array, seed: int
) -> Array:
    """RMS one-step error [13] rad of the simulator on a robot's trajectories.

    What the replay misses on the simulator's own runs (states are estimated from
    encoders and posture) is no reality gap and is taken off.
    """
    step, backend, squares = world.task.control_period, prepare(world, "native"), []
    for log, ids in ((robot, seen), (simulator, np.unique(simulator.trajectory))):
        windows = prediction.cut(world, measured(log), ids, WINDOWS, seed)
        error = prediction.errors(backend, world.values, windows, step)
        squares.append(np.array([error[j, step] ** 2 for j in WALKING_JOINTS]))
    return np.sqrt(np.maximum(squares[0] - squares[1], 0.0))


def stable(
    world: World, grounding: grounders.Grounding, theta: Array, key: Array
) -> grounders.Grounding:
    """Choose the largest alpha with which the walk falls least in the simulator."""
    falls = _falling(world, grounding, theta, key)
    return grounders.largest_stable_alpha(grounding, falls)


def helpful(
    world: World, grounding: grounders.Grounding, robot: Recording, seed: int,
    theta: Array, key: Array,
) -> grounders.Grounding:  # fmt: skip
    """Choose how much of a correction predicts the robot best over the next 0.2 s.

    Among the shares with which the walk falls no more than with that it has. A
    simulator that a diagnosis extended may need none; of any other one the correction
    stays as it is. The trajectories are those that it was learned from: held-out ones
    stay unseen.
    """
    extended = bool(world.causes) or world.contact is not None
    if not extended or "alpha" not in grounding.facts:
        return grounding
    step = world.task.control_period
    seen, _ = parted(robot, step, seed)
    windows = prediction.cut(world, measured(robot), seen, WINDOWS, seed)
    backend = prepare(grounders.grounded(world, grounding), "native")
    most = grounding.facts["alpha"]

    def error(candidate: grounders.Grounding) -> float:
        values = grounders.grounded(world, candidate).values
        return prediction.error_soon(backend, values, windows, step)

    shares = [alpha for alpha in grounders.ALPHAS if alpha <= most]
    tried = [grounders.with_alpha(grounding, alpha) for alpha in shares]
    falls = _falling(world, grounding, theta, key)
    for candidate in sorted(tried, key=error):
        if candidate.facts["alpha"] == most:
            break
        share = falls(candidate)
        if share <= grounding.facts["falls"]:
            return candidate._replace(facts={**candidate.facts, "falls": share})
    return grounding


def _falling(
    world: World, grounding: grounders.Grounding, theta: Array, key: Array
) -> Callable[[grounders.Grounding], float]:
    """The share of walks that fall with a grounding, of one structure."""
    backend = prepare(grounders.grounded(world, grounding), "native")
    keys = jax.random.split(key, STABILITY_ROLLOUTS)

    def falls(candidate: grounders.Grounding) -> float:
        values = grounders.grounded(world, candidate).values
        return count_falls(backend, values, theta, keys) / len(keys)

    return falls


def count_falls(backend: Backend, values: Values, theta: Array, keys: Array) -> int:
    """How many walks with keys [N] end in a fall, or in numbers that are not finite."""
    result = pairs(backend.outcome, values, theta[None], keys)
    return int(np.sum(np.isfinite(result.fell_at) | ~result.ok))


def write_grounded(
    folder: Path, world: World, grounding: grounders.Grounding, made_by: dict[str, Any]
) -> None:
    """Write a grounding and the world file that uses it."""
    write_world(folder / "world.json", carried(world, folder), made_by, ".")
    grounders.write_grounding(folder, grounding)


def predictions(
    world: World, grounding: grounders.Grounding, robot: Recording, seed: int
) -> list[dict[str, Any]]:
    """Prediction error per joint before and after grounding, held-out trajectories."""
    step = world.task.control_period
    _, held_out = parted(robot, step, seed)
    windows = prediction.cut(world, robot, held_out, WINDOWS, seed + 1)
    found = []
    for candidate in (world, grounders.grounded(world, grounding)):
        backend = prepare(candidate, "native")
        found.append(prediction.errors(backend, candidate.values, windows, step))
    before, after = found
    return [
        {
            "joint": joint,
            "horizon_s": horizon,
            "before_rad": before[joint, horizon],
            "after_rad": after[joint, horizon],
        }
        for joint, horizon in before
    ]


def ground(
    setting: Setting,
    entry: Entry,
    iteration: int,
    theta: Array,
    logs: Callable[[], tuple[Recording, Recording]],
) -> grounders.Grounding:
    """Ground the entry's world in the logs of robot and simulator; once."""
    folder = setting.folder / "grounding" / f"{entry.name}_{iteration}"
    if (folder / "grounder.json").exists():
        return grounders.read_grounding(folder)
    robot, simulator = logs()
    setting.progress.stage(f"{entry.name}: ground the simulator")
    seed, world = setting.settings.seed, entry.world

    def tell(text: str) -> None:
        setting.progress.stage(f"{entry.name}: {text}")

    grounding = learn_grounding(
        world, entry.grounder, robot, simulator, seed, theta, tell
    )
    key = setting.key(2, iteration)
    grounding = stable(world, grounding, theta, key)
    grounding = helpful(world, grounding, robot, seed, theta, key)
    facts = {"method": entry.name, "iteration": iteration}
    rows = [facts | row for row in predictions(world, grounding, robot, seed)]
    runs.add_rows(setting.folder / "prediction.csv", rows)
    folder.mkdir(parents=True, exist_ok=True)
    write_grounded(folder, world, grounding, facts)
    return grounding
