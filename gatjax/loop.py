"""Grounded simulation learning: collect, ground, search, evaluate, repeat.

Every stage leaves files in the run folder and is skipped if they are there, so a run that
was stopped goes on where it was. Nothing here knows which robot it works on: a robot is
an object with `name`, `constants()` and `walk(policies [N, 15], seeds [N], task)`.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import jax
import numpy as np

from gatjax import checkpoints, runs, search
from gatjax.data.recording import Recording, read_recording, write_recording
from gatjax.data.trajectories import split_by_trajectory, to_arrays, to_recording
from gatjax.grounding import learn as grounders
from gatjax.grounding import prediction
from gatjax.records import Outcome, Trajectory
from gatjax.robot.nao import WALKING_JOINTS
from gatjax.settings import LoopSettings
from gatjax.sim.backend import Backend, costs, default_backend, pairs, prepare
from gatjax.sim.poses import write_walk
from gatjax.sim.world import World, nominal, write_world
from gatjax.task import Task, task_at
from gatjax.walk.parameters import HIGH, LOW, STEP, THETA0

Array = Any
HELD_OUT = 0.2  # share of the robot's trajectories that only test predictions
WINDOWS = 200
STABILITY_ROLLOUTS = 20
EVALUATION_SEED = 100_000  # first seed of robot evaluations; collections start at 0


class Robot(Protocol):
    """What the loop needs of a robot."""

    name: str

    def constants(self) -> dict[str, Any]:
        """Facts about the robot for robot.json."""
        ...

    def walk(
        self, policies: Array, seeds: Sequence[int], task: Task
    ) -> tuple[Trajectory, Outcome]:
        """Walk policies [N, 15], one run each."""
        ...


class Progress(NamedTuple):
    """Where the loop says what it does: `stage(text)`, `work(units done)`."""

    stage: Callable[[str], None]
    work: Callable[[float], None]


class Setting(NamedTuple):
    """What all stages of one run share."""

    folder: Path
    settings: LoopSettings
    task: Task
    world: World
    robot: Robot
    progress: Progress


SIMULATOR_UNIT, ROBOT_UNIT = 1.0, 12.0  # relative cost of one run, for the time left


def total_work(settings: LoopSettings) -> float:
    """Work units of a whole run, for the time left."""
    one = settings.search
    searched = one.population * one.rollouts * one.generations
    evaluated = (2 * one.generations + 1) * settings.evaluations
    methods, rounds = len(settings.methods), settings.iterations
    collected = settings.robot_trajectories * (1 + (rounds - 1) * methods)
    return (
        SIMULATOR_UNIT * methods * rounds * searched
        + ROBOT_UNIT * (collected + methods * rounds * evaluated)
    )


def run_key(settings: LoopSettings, *facts: int) -> Array:
    """Derive a random key from the run's seed and facts, not from call order."""
    key = jax.random.key(settings.seed)
    for fact in facts:
        key = jax.random.fold_in(key, fact)
    return key


def run(
    folder: Path, settings: LoopSettings, robot: Robot, progress: Progress
) -> None:
    """Run the loop in an open run folder; call again to go on after a stop."""
    task = task_at(settings.rate_hz)
    for method in settings.methods:
        grounders.check_method(method)
    setting = Setting(folder, settings, task, nominal(task), robot, progress)
    runs.write_json(folder / "robot.json", {"name": robot.name, **robot.constants()})
    runs.write_policy(folder / "policies", "theta0", THETA0, {"by": "hand-tuned walk"})
    evaluate(setting, [Candidate("theta0", 0, 0, "best", THETA0)], 2)
    show(setting, "theta0_robot", THETA0, "theta0, robot")
    for method in settings.methods:
        theta = THETA0
        for iteration in range(settings.iterations):
            theta = improve(setting, method, iteration, theta)
        show(setting, f"{method}_best_robot", theta, f"best walk of {method}, robot")


def improve(setting: Setting, method: str, iteration: int, theta: Array) -> Array:
    """One iteration of one method; return the best walk on the robot (or `theta`)."""
    tag = "" if iteration == 0 else f"_{method}"
    robot_log = collect(setting, f"robot_{iteration}{tag}", theta, iteration)
    sim_log = collect(setting, f"simulator_{iteration}{tag}", theta, iteration)
    grounding = ground(setting, method, iteration, theta, robot_log, sim_log)
    candidates = optimise(setting, method, iteration, theta, grounding)
    evaluate(setting, candidates, 1)
    return best_on_robot(setting, candidates, theta)


# collect


def collect(setting: Setting, name: str, theta: Array, iteration: int) -> Recording:
    """Record walks of robot or simulator, once."""
    path = setting.folder / "recordings" / f"{name}.parquet"
    if not path.exists():
        setting.progress.stage(f"collect {name.split('_')[0]} runs")
        make = robot_runs if name.startswith("robot") else simulator_runs
        trajectory = make(setting, theta, iteration)
        rate = 1.0 / setting.task.control_period
        source = setting.robot.name if name.startswith("robot") else "simulator"
        notes = {"iteration": iteration, "seed": setting.settings.seed}
        write_recording(path, to_recording(trajectory, source, rate, notes))
    return read_recording(path)


def robot_runs(setting: Setting, theta: Array, iteration: int) -> Trajectory:
    """Walks of the robot with one policy."""
    count = setting.settings.robot_trajectories
    first = 1000 * (setting.settings.seed + 1) + 100 * iteration
    policies = np.tile(theta, (count, 1))
    trajectory, _ = setting.robot.walk(policies, range(first, first + count), setting.task)
    setting.progress.work(ROBOT_UNIT * count)
    return trajectory


def simulator_runs(setting: Setting, theta: Array, iteration: int) -> Trajectory:
    """Walks of the nominal simulator with one policy."""
    count = setting.settings.simulator_trajectories
    keys = jax.random.split(run_key(setting.settings, 1, iteration), count)
    backend = prepare(setting.world, "native")
    return backend.rollout(setting.world.values, np.tile(theta, (count, 1)), keys)[0]


# ground


def ground(
    setting: Setting, method: str, iteration: int, theta: Array,
    robot_log: Recording, sim_log: Recording,
) -> grounders.Grounding:  # fmt: skip
    """Learn the grounding, choose alpha, measure what it predicts; once."""
    folder = setting.folder / "grounding" / f"{method}_{iteration}"
    if (folder / "grounder.json").exists():
        return grounders.read_grounding(folder)
    setting.progress.stage(f"{method}: learn the grounding")
    seed, world = setting.settings.seed, setting.world
    seen, held_out = split_by_trajectory(robot_log.trajectory, HELD_OUT, seed)
    step = setting.task.control_period
    backend = prepare(world, "native")
    train = prediction.cut(world, robot_log, seen, WINDOWS, seed)
    nominal_error = prediction.errors(backend, world.values, train, step)
    robot = [r for r in to_arrays(robot_log, WALKING_JOINTS) if r.trajectory in seen]
    grounding = grounders.learn(
        method, robot, to_arrays(sim_log, WALKING_JOINTS),
        np.array([nominal_error[joint, step] for joint in WALKING_JOINTS]), seed,
    )  # fmt: skip
    setting.progress.stage(f"{method}: choose alpha")
    grounding = stable(setting, grounding, theta)
    test = prediction.cut(world, robot_log, held_out, WINDOWS, seed + 1)
    grounded = grounders.grounded(world, grounding)
    before = prediction.errors(backend, world.values, test, step)
    after = prediction.errors(prepare(grounded), grounded.values, test, step)
    rows = [
        {
            "method": method, "iteration": iteration, "joint": joint,
            "horizon_s": horizon, "before_rad": before[joint, horizon],
            "after_rad": after[joint, horizon],
        }
        for joint, horizon in before
    ]  # fmt: skip
    runs.add_rows(setting.folder / "prediction.csv", rows)
    grounders.write_grounding(folder, grounding)
    made_by = {"method": method, "iteration": iteration}
    write_world(folder / "world.json", world, made_by, ".")
    return grounding


def stable(
    setting: Setting, grounding: grounders.Grounding, theta: Array
) -> grounders.Grounding:
    """Choose the largest alpha with which the walk does not fall in the simulator."""
    world = grounders.grounded(setting.world, grounding)
    backend = prepare(world, "native")
    keys = jax.random.split(run_key(setting.settings, 2), STABILITY_ROLLOUTS)

    def falls(candidate: grounders.Grounding) -> int:
        values = grounders.grounded(setting.world, candidate).values
        result = pairs(backend.outcome, values, theta[None], keys)
        return int(np.isfinite(result.fell_at).sum() + (~result.ok).sum())

    return grounders.largest_stable_alpha(grounding, falls)


# search


class Candidate(NamedTuple):
    """A walk to be tried on the robot."""

    method: str
    iteration: int
    generation: int
    kind: str  # best or mean
    policy: Array  # [15]

    @property
    def key(self) -> dict[str, Any]:
        """Key columns of the tables."""
        return {
            "method": self.method, "iteration": self.iteration,
            "generation": self.generation, "candidate": self.kind,
        }  # fmt: skip


def optimise(
    setting: Setting, method: str, iteration: int, theta: Array,
    grounding: grounders.Grounding,
) -> list[Candidate]:  # fmt: skip
    """Search in the grounded simulator, one checkpoint a generation."""
    settings = setting.settings.search
    world = grounders.grounded(setting.world, grounding)
    space = search.Space(theta0=np.clip(theta, LOW, HIGH), step=STEP, low=LOW, high=HIGH)
    folder = setting.folder / "checkpoints" / f"{method}_{iteration}"
    state = search.start(space, settings, run_key(setting.settings, 3, iteration))
    done = checkpoints.latest(folder)
    if done is not None:
        state = checkpoints.restore(folder, state, done)
    candidates = found(setting, method, iteration, -1 if done is None else done)
    step = None
    for number in range(0 if done is None else done + 1, settings.generations):
        step = step or generation(setting.settings, world, space)
        setting.progress.stage(f"{method}: generation {number + 1} of {settings.generations}")
        begun = time.perf_counter()
        state, info = step(state, world.values, np.int32(number))
        info = jax.tree.map(np.asarray, info)
        pair = [
            Candidate(method, iteration, number, "best", info.best_policy),
            Candidate(method, iteration, number, "mean", info.mean_policy),
        ]
        record(setting, pair, info, time.perf_counter() - begun)
        checkpoints.save(folder, number, state)
        candidates += pair
        setting.progress.work(SIMULATOR_UNIT * settings.population * settings.rollouts)
    verify(setting, world, candidates)
    return candidates


def generation(
    settings: LoopSettings, world: World, space: search.Space
) -> search.Generation:
    """Return one generation: a single compiled call on mjx."""
    name = default_backend() if settings.backend == "auto" else settings.backend
    backend = prepare(world, name, settings.impl)
    if backend.compiled:
        return jax.jit(search.generation(space, settings.search, costs(backend)))
    return search.host_generation(space, settings.search, costs(backend))


def record(setting: Setting, pair: list[Candidate], info: Any, seconds: float) -> None:
    """Write the candidates of one generation."""
    for candidate in pair:
        runs.write_policy(
            setting.folder / "policies", policy_name(candidate), candidate.policy,
            candidate.key,
        )  # fmt: skip
    facts = {"sigma": float(info.sigma), "seconds": seconds}
    rows = [candidate.key | facts for candidate in pair]
    rows[0]["simulator_cost"] = float(info.best_cost)
    runs.add_rows(setting.folder / "metrics.csv", rows)


def policy_name(candidate: Candidate) -> str:
    """File name of a candidate's policy."""
    if candidate.method == "theta0":
        return "theta0"
    parts = (candidate.method, candidate.iteration, candidate.generation, candidate.kind)
    return "_".join(map(str, parts))


def found(setting: Setting, method: str, iteration: int, last: int) -> list[Candidate]:
    """Read the candidates of generations that are done already."""
    candidates = []
    for number in range(last + 1):
        for kind in ("best", "mean"):
            empty = Candidate(method, iteration, number, kind, THETA0)
            path = setting.folder / "policies" / f"{policy_name(empty)}.json"
            candidates.append(empty._replace(policy=runs.read_policy(path)))
    return candidates


def verify(setting: Setting, world: World, candidates: list[Candidate]) -> None:
    """Measure every candidate in the simulator it was found in, with fresh keys."""
    keys = jax.random.split(run_key(setting.settings, 4), setting.settings.search.rollouts)
    policies = np.stack([candidate.policy for candidate in candidates])
    result = pairs(prepare(world, "native").outcome, world.values, policies, keys)
    rows = [
        candidate.key
        | {
            "simulator_cost": float(search.policy_costs(result.cost[index])),
            "simulator_velocity_m_s": float(result.velocity[index].mean()),
            "simulator_falls": int(np.isfinite(result.fell_at[index]).sum()),
        }
        for index, candidate in enumerate(candidates)
    ]
    runs.add_rows(setting.folder / "metrics.csv", rows)


# evaluate


def evaluate(setting: Setting, candidates: list[Candidate], repeats: int) -> None:
    """Try candidates on the robot, `repeats` x evaluations runs each, same seeds."""
    path = setting.folder / "metrics.csv"
    rows = runs.read_table(path) if path.exists() else []
    tried = {
        (row["method"], row["iteration"], row["generation"], row["candidate"])
        for row in rows
        if row["robot_rollouts"]
    }
    candidates = [c for c in candidates if tuple(c.key.values()) not in tried]
    if not candidates:
        return
    setting.progress.stage(f"{candidates[0].method}: walk on the robot")
    count = setting.settings.evaluations * repeats
    seeds = [EVALUATION_SEED + index for index in range(count)]
    policies = np.repeat([c.policy for c in candidates], count, axis=0)
    _, result = setting.robot.walk(policies, seeds * len(candidates), setting.task)
    velocity = np.reshape(result.velocity, (len(candidates), count))
    fell_at = np.reshape(result.fell_at, (len(candidates), count))
    for index, candidate in enumerate(candidates):
        each = [
            candidate.key
            | {"seed": seed, "velocity_m_s": float(v), "fell_at_s": float(f)}
            for seed, v, f in zip(seeds, velocity[index], fell_at[index], strict=True)
        ]
        runs.add_rows(setting.folder / "evaluations.csv", each)
        summary = {
            "robot_velocity_m_s": float(velocity[index].mean()),
            "robot_falls": int(np.isfinite(fell_at[index]).sum()),
            "robot_rollouts": count,
        }
        runs.add_rows(path, [candidate.key | summary])
    setting.progress.work(ROBOT_UNIT * len(policies))


def best_on_robot(setting: Setting, candidates: list[Candidate], theta: Array) -> Array:
    """Return the fastest candidate that never fell on the robot, else `theta`."""
    rows = {
        (row["method"], row["iteration"], row["generation"], row["candidate"]): row
        for row in runs.read_table(setting.folder / "metrics.csv")
    }
    steady = [c for c in candidates if rows[tuple(c.key.values())]["robot_falls"] == 0]
    if not steady:
        return theta
    speed = [rows[tuple(c.key.values())]["robot_velocity_m_s"] for c in steady]
    return steady[int(np.argmax(speed))].policy


def show(setting: Setting, name: str, theta: Array, label: str) -> None:
    """Keep one walk on the robot for the animation, once."""
    path = setting.folder / "walks" / f"{name}.npz"
    if not path.exists():
        walk, _ = setting.robot.walk(theta[None], [EVALUATION_SEED], setting.task)
        first = jax.tree.map(lambda leaf: np.asarray(leaf)[0], walk)
        write_walk(path, setting.world.model, first, label)


def finished(settings: LoopSettings) -> LoopSettings:
    """Return settings with what `auto` stands for on this machine written out."""
    if settings.backend != "auto":
        return settings
    return dataclasses.replace(settings, backend=default_backend())
