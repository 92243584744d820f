"""Does a simulator foresee which candidates fall, if its numbers are in doubt?

    python experiments/table1/doubted.py DIR/dart_0 DIR/dart_1    # run folders

The candidates of `explained` walk again: in the world that they were found in, in
worlds whose bodies are off by what the diagnosis tolerates, in worlds off by more (5 %
of each mass, 5 mm) with another grip, and on the stand-in robot. It prints how many of
their walks fall, and Spearman's rank correlation with the robot's.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

import jax
import mujoco
import numpy as np
from scipy.stats import spearmanr

from gatjax.diagnosis.loads import perturbed
from gatjax.diagnosis.tolerances import USUAL
from gatjax.grounding.learn import grounded, read_grounding
from gatjax.runs import read_policy
from gatjax.sim.backend import pairs, prepare, use_compile_cache
from gatjax.sim.stored import read_world
from gatjax.sim.world import World
from gatjax.surrogate import make_robot
from gatjax.task import Task

WORLDS, EACH, WALKS, FIRST_SEED = 8, 5, 20, 900
WIDE = USUAL._replace(mass=0.05, com=0.005)
GRIP = (0.6, 1.2)  # of the simulator's friction


def fallen(world: World, policies: np.ndarray, count: int, seed: int) -> np.ndarray:
    """How many of so many walks of each policy fall."""
    keys = jax.random.split(jax.random.key(seed), count)
    found = pairs(prepare(world, "native").outcome, world.values, policies, keys)
    return np.isfinite(found.fell_at).sum(1)


def within(world: World, draw: np.random.Generator) -> mujoco.MjModel:
    """Bodies drawn from their usual tolerances."""
    return perturbed(world.model, USUAL, draw)


def beyond(world: World, draw: np.random.Generator) -> mujoco.MjModel:
    """Bodies off by more, and another grip."""
    model = perturbed(world.model, WIDE, draw)
    model.geom_friction[:, 0] *= draw.uniform(*GRIP)
    return model


def walked(folder: Path, draw: np.random.Generator) -> dict[str, np.ndarray]:
    """Falls of each candidate after the first generation, by where it walked."""
    files = sorted(folder.glob("policies/explained_0_[1-9]_rechecked.json"))
    policies = np.stack([read_policy(file) for file in files])
    world, _ = read_world(folder / "extended.json", Task())
    world = grounded(world, read_grounding(folder / "grounding" / "explained_0"))
    found = {"its world": fallen(world, policies, WORLDS * EACH, 77)}
    for name, drawn in (("bodies", within), ("more, and grip", beyond)):
        doubted = (
            dataclasses.replace(world, model=drawn(world, draw)) for _ in range(WORLDS)
        )
        falls = [fallen(w, policies, EACH, 100 + k) for k, w in enumerate(doubted)]
        found[name] = np.sum(falls, axis=0)
    seeds = [FIRST_SEED + number for number in range(WALKS)] * len(files)
    robot = make_robot(folder.name.split("_")[0])
    _, outcome = robot.walk(np.repeat(policies, WALKS, axis=0), seeds, Task())
    fell = np.isfinite(outcome.fell_at).reshape(len(files), WALKS)
    return found | {"robot": fell.sum(1)}


def main() -> None:
    """Walk the candidates of all runs everywhere."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", type=Path, nargs="+", help="run folders of run.py")
    use_compile_cache()
    draw, every = np.random.default_rng(0), []
    for folder in parser.parse_args().runs:
        every.append(walked(folder, draw))
        for name, falls in every[-1].items():
            walks = WALKS if name == "robot" else WORLDS * EACH
            print(f"{folder.name} {name:<16} {falls} of {walks} fall", flush=True)
    whole = {name: np.concatenate([row[name] for row in every]) for name in every[0]}
    for name, falls in whole.items():
        rank = spearmanr(falls, whole["robot"])
        print(f"{name:<16} {falls.sum()} fall; rank correlation {rank.statistic:.2f}")


if __name__ == "__main__":
    main()
