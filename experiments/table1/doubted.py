"""Does a simulator foresee which candidates fall, if its numbers are in doubt?

    python experiments/table1/doubted.py DIR/dart_0 DIR/dart_1    # run folders

The candidates of `explained` walk again: in the world that they were found in, in
worlds with other bodies and another grip (those of `gatjax.loop.recheck`), and on the
stand-in robot. It prints how many of their walks fall, and Spearman's rank correlation
with the robot's.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
from scipy.stats import spearmanr

from gatjax.grounding.learn import grounded, read_grounding
from gatjax.loop.recheck import in_doubt
from gatjax.runs import read_policy
from gatjax.sim.backend import pairs, prepare, use_compile_cache
from gatjax.sim.stored import read_world
from gatjax.surrogate import make_robot
from gatjax.task import Task

WORLDS, EACH, WALKS, FIRST_SEED = 8, 5, 20, 900


def walked(folder: Path, seed: int) -> dict[str, np.ndarray]:
    """Falls of each candidate after the first generation, by where it walked."""
    files = sorted(folder.glob("policies/explained_0_[1-9]_rechecked.json"))
    policies = np.stack([read_policy(file) for file in files])
    world, _ = read_world(folder / "extended.json", Task())
    world = grounded(world, read_grounding(folder / "grounding" / "explained_0"))
    keys = jax.random.split(jax.random.key(77), WORLDS * EACH)

    def fallen(run: Callable) -> np.ndarray:
        return np.isfinite(pairs(run, world.values, policies, keys).fell_at).sum(1)

    seeds = [FIRST_SEED + number for number in range(WALKS)] * len(files)
    robot = make_robot(folder.name.split("_")[0])
    _, outcome = robot.walk(np.repeat(policies, WALKS, axis=0), seeds, Task())
    fell = np.isfinite(outcome.fell_at).reshape(len(files), WALKS)
    return {
        "its world": fallen(prepare(world).outcome),
        "in doubt": fallen(in_doubt(world, WORLDS, seed).outcome),
        "robot": fell.sum(1),
    }


def main() -> None:
    """Walk the candidates of all runs everywhere."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", type=Path, nargs="+", help="run folders of run.py")
    use_compile_cache()
    every = []
    for seed, folder in enumerate(parser.parse_args().runs):
        every.append(walked(folder, seed))
        for name, falls in every[-1].items():
            walks = WALKS if name == "robot" else WORLDS * EACH
            print(f"{folder.name} {name:<10} {falls} of {walks} fall", flush=True)
    whole = {name: np.concatenate([row[name] for row in every]) for name in every[0]}
    for name, falls in whole.items():
        rank = spearmanr(falls, whole["robot"])
        print(f"{name:<10} {falls.sum()} fall; rank correlation {rank.statistic:.2f}")


if __name__ == "__main__":
    main()
