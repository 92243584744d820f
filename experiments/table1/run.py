"""The paper's Table 1: do walks learned in the simulator transfer to a robot?

    python experiments/table1/run.py --out DIR                  # reduced, 2 cores
    python experiments/table1/run.py --out DIR --size paper     # one GPU

Trials of every method, simulator to `dart` and simulator to `stiff`. A trial has logs,
networks, searches and walks with seeds of its own; the robot is the same in all of
them, as in the paper. What is finished is not run again, what was stopped goes on, and
more trials, robots and methods can be asked for later. It writes
DIR/results/ROBOT_TRIAL.json and, over all that are there, DIR/table.md.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from gatjax import loop, runs
from gatjax.benchmark.transfer import Found, document, read_trials, trial_of
from gatjax.cli.progress import shown
from gatjax.report import build_report
from gatjax.settings import LoopSettings, SearchSettings
from gatjax.sim.backend import use_compile_cache
from gatjax.surrogate import make_robot

PAPER = LoopSettings(candidates=("best",), evaluations=10)
REDUCED = dataclasses.replace(
    PAPER,
    robot_trajectories=30,
    simulator_trajectories=30,
    evaluations=5,
    search=SearchSettings(population=40, rollouts=4, generations=6),
)
SIZES = {"reduced": REDUCED, "paper": PAPER}
METHODS = ("none", "envelope", "guided", "gat")
EXPLAINED = "explained"


def run_trial(out: Path, settings: LoopSettings) -> dict[str, Found]:
    """Run one trial, or go on with it, or with more methods in it."""
    name = f"{settings.robot}_{settings.seed}"
    settings = loop.resolved(settings)
    if (out / name / "config.json").exists():
        same = dataclasses.asdict(settings)
        before = runs.read_json(out / name / "config.json")
        same |= {"methods": before["methods"], "explain": before["explain"]}
        runs.check_same(before, same | {"candidates": list(same["candidates"])},
                        out / name)  # fmt: skip
        folder = runs.resume_run(out / name).path
        runs.write_json(folder / "config.json", dataclasses.asdict(settings))
    else:
        folder = runs.open_run(out, settings, name).path
    robot = make_robot(settings.robot, settings.body_seed)
    with shown(loop.total_work(settings)) as progress:
        loop.run(folder, settings, robot, progress)
    build_report(folder)
    found = trial_of(folder)
    rows = {method: each._asdict() for method, each in found.items()}
    facts = {"robot": settings.robot, "trial": settings.seed, "methods": rows}
    runs.write_json(out / "results" / f"{name}.json", facts)
    return found


def main() -> None:
    """Run trial after trial and write the table after each of them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for the runs")
    parser.add_argument("--size", choices=SIZES, default="reduced")
    parser.add_argument("--robots", nargs="+", default=["dart", "stiff"])
    parser.add_argument("--trials", type=int, nargs="+", default=list(range(10)))
    parser.add_argument(
        "--methods",
        nargs="+",
        default=[*METHODS, EXPLAINED],
        help="of gatjax run, explained (GAT after diagnosis), oracle",
    )
    parser.add_argument("--backend", default="auto", help="native, mjx or auto")
    parser.add_argument("--impl", default="jax", help="of mjx: jax or warp")
    asked = parser.parse_args()
    use_compile_cache()
    (asked.out / "results").mkdir(parents=True, exist_ok=True)
    for trial in asked.trials:
        for robot in asked.robots:
            print(f"trial {trial} on {robot}", flush=True)
            settings = dataclasses.replace(
                SIZES[asked.size], robot=robot, seed=trial, backend=asked.backend,
                impl=asked.impl, explain=EXPLAINED in asked.methods,
                methods=tuple(name for name in asked.methods if name != EXPLAINED),
            )  # fmt: skip
            run_trial(asked.out, settings)
            text = document(read_trials(asked.out / "results"))
            (asked.out / "table.md").write_text(text, encoding="utf-8")
    print(f"{text}\n{asked.out / 'table.md'}")


if __name__ == "__main__":
    main()
