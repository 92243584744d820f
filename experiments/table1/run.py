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
from collections.abc import Sequence
from pathlib import Path

from gatjax.benchmark.document import document
from gatjax.benchmark.transfer import Found, read_trials, trial_of
from gatjax.benchmark.trials import run_trials, with_methods
from gatjax.cli.progress import shown
from gatjax.loop import resolved
from gatjax.loop.explain import EXPLAINED
from gatjax.runs import read_json, write_json
from gatjax.settings import DEMO, PAPER
from gatjax.sim.backend import use_compile_cache
from gatjax.surrogate import make_robot

REDUCED = dataclasses.replace(
    PAPER,
    robot_trajectories=30,
    simulator_trajectories=30,
    evaluations=5,
    search=DEMO.search,
)
SIZES = {"reduced": REDUCED, "paper": PAPER}
METHODS = ["none", "envelope", "guided", "gat", "dagger", "sgat", "sensing"]


def asked() -> argparse.Namespace:
    """What the command line asks for."""
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
    parser.add_argument(
        "--candidates",
        nargs="+",
        default=["best"],
        help="of each generation: best (as in the paper), mean, rechecked",
    )
    parser.add_argument("--backend", default="auto", help="native, mjx or auto")
    parser.add_argument("--impl", default="auto", help="of mjx: jax, warp or auto")
    return parser.parse_args()


def keep(path: Path, robot: str, trial: int, found: dict[str, Found]) -> None:
    """Write what a trial found, beside what it found before by other methods."""
    before = read_json(path)["methods"] if path.exists() else {}
    methods = before | {name: each._asdict() for name, each in found.items()}
    write_json(path, {"robot": robot, "trial": trial, "methods": methods})


def tell(
    out: Path, robot: str, folders: dict[int, Path], methods: Sequence[str]
) -> str:
    """Keep what trials in their run folders found; write the table of all there are."""
    (out / "results").mkdir(parents=True, exist_ok=True)
    for trial, folder in folders.items():
        found = trial_of(folder, methods=methods)
        keep(out / "results" / f"{robot}_{trial}.json", robot, trial, found)
    text = document(read_trials(out / "results"))
    (out / "table.md").write_text(text, encoding="utf-8")
    return text


def main() -> None:
    """Run trial after trial and write the table after each of them."""
    told = asked()
    use_compile_cache()
    settings = resolved(
        dataclasses.replace(
            with_methods(SIZES[told.size], told.methods),
            candidates=tuple(told.candidates),
            backend=told.backend,
            impl=told.impl,
        )
    )
    # On mjx trials are worlds of one compiled call, so all of a robot go together.
    rounds = [told.trials] if settings.backend == "mjx" else [[t] for t in told.trials]
    for trials in rounds:
        for robot in told.robots:
            print(f"trials {trials} on {robot}", flush=True)
            each = [
                dataclasses.replace(settings, robot=robot, seed=trial)
                for trial in trials
            ]
            folders = run_trials(told.out, each, make_robot(robot), shown)
            found = dict(zip(trials, folders, strict=True))
            tell(told.out, robot, found, told.methods)
    print(f"{(told.out / 'table.md').read_text('utf-8')}\n{told.out / 'table.md'}")


if __name__ == "__main__":
    try:
        main()
    except (ValueError, OSError) as wrong:
        raise SystemExit(f"run.py: {wrong}") from None
