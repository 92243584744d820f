"""The paper's Table 2: grounded twice, with few walks of the robot.

    python experiments/table2/run.py --out DIR                  # reduced, 2 cores
    python experiments/table2/run.py --out DIR --size paper     # one GPU

15 walks of the robot, a search, 5 walks of the best policy of every generation; then
15 walks with the best of them, and all of it again. It writes DIR/results.json: theta0,
theta0 asked for its full speed, and what each iteration of each method found. What is
finished is not run again, what was stopped goes on.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from gatjax.benchmark.tables import table
from gatjax.benchmark.trials import run_trials, with_methods
from gatjax.cli.progress import shown
from gatjax.runs import read_json, read_table, write_json
from gatjax.settings import CONFIRMATION, DEMO, LoopSettings, seeds
from gatjax.sim.backend import use_compile_cache
from gatjax.surrogate import make_robot
from gatjax.task import Task
from gatjax.walk.parameters import THETA0

PAPER = LoopSettings(
    candidates=("best",), robot_trajectories=15, simulator_trajectories=15,
    evaluations=5, iterations=2,
)  # fmt: skip
REDUCED = dataclasses.replace(PAPER, search=DEMO.search)
SIZES = {"reduced": REDUCED, "paper": PAPER}
FULL = 1.0  # forward request, where every other walk has 0.75
CM = 100.0


def hurried(robot: Any, seed: int) -> dict[str, float]:
    """theta0 asked for its full speed, 10 walks."""
    drawn = seeds(CONFIRMATION, seed, 10)
    task = Task(forward=FULL)
    _, outcome = robot.walk(np.tile(THETA0, (len(drawn), 1)), drawn, task)
    return {
        "cm_s": CM * float(np.mean(outcome.velocity)),
        "falls": int(np.isfinite(outcome.fell_at).sum()),
    }


def found(folder: Path) -> dict[str, Any]:
    """Speeds of theta0 and of what each iteration of each method chose.

    None where no candidate stood in all of its walks.
    """
    rows = read_table(folder / "metrics.csv")
    known = {(r["method"], r["iteration"], r["generation"], r["candidate"]): r
             for r in rows}  # fmt: skip
    base = known["theta0", 0, 0, "best"]
    told: dict[str, Any] = {
        "theta0": {
            "cm_s": CM * base["robot_velocity_m_s"],
            "falls": base["robot_falls"],
        }
    }
    for row in rows:
        if row["candidate"] == "best" and row["method"] != "theta0":
            told.setdefault(f"{row['method']} theta{row['iteration'] + 1}", None)
        if row["candidate"] == "chosen":
            name = f"{row['method']} theta{row['iteration'] + 1}"
            first = known[row["method"], row["iteration"], row["generation"], "best"]
            told[name] = {
                "chosen_on_cm_s": CM * first["robot_velocity_m_s"],
                "cm_s": CM * row["robot_velocity_m_s"],
                "falls": row["robot_falls"],
            }
    return told


def shown_table(results: dict[str, dict[str, Any]]) -> str:
    """One line a robot, trial and walk: speed on fresh walks, and gain over theta0."""
    lines = []
    for run, walks in results.items():
        base = walks["theta0"]["cm_s"]
        for name, row in walks.items():
            if row is None:
                lines.append((run, name, "none stood", "", "", ""))
                continue
            picked, gain = row.get("chosen_on_cm_s"), 100.0 * (row["cm_s"] / base - 1.0)
            lines.append((
                run, name, f"{row['cm_s']:.1f}", f"{gain:+.1f}",
                f"{row['falls']} of 10", "" if picked is None else f"{picked:.1f}",
            ))  # fmt: skip
    heads = ("run", "walk", "cm/s", "gain %", "falls", "cm/s it was chosen on")
    return table(heads, lines)


def main() -> None:
    """Run, and print what came out."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for the runs")
    parser.add_argument("--size", choices=SIZES, default="reduced")
    parser.add_argument("--robots", nargs="+", default=["dart", "stiff"])
    parser.add_argument("--trials", type=int, nargs="+", default=[0])
    parser.add_argument("--methods", nargs="+", default=["gat"])
    told = parser.parse_args()
    use_compile_cache()
    file = told.out / "results.json"
    results: dict[str, dict[str, Any]] = read_json(file) if file.exists() else {}
    for name in told.robots:
        robot = make_robot(name)
        print(f"trials {told.trials} on {name}", flush=True)
        base = with_methods(SIZES[told.size], told.methods)
        each = [
            dataclasses.replace(base, robot=name, seed=trial) for trial in told.trials
        ]
        for trial, folder in zip(
            told.trials, run_trials(told.out, each, robot, shown), strict=True
        ):
            walks = found(folder)
            known, key = results.get(f"{name}_{trial}", {}), "theta0 at full request"
            first = {"theta0": walks.pop("theta0")}
            first[key] = known.get(key) or hurried(robot, trial)
            results[f"{name}_{trial}"] = first | walks
        write_json(file, results)
    print(f"{shown_table(results)}\n{file}")


if __name__ == "__main__":
    try:
        main()
    except (ValueError, OSError) as wrong:
        raise SystemExit(f"run.py: {wrong}") from None
