"""The demo over several seeds, each with a robot body of its own, and one table.

    python experiments/demo_seeds/run.py --out DIR [--seeds 1 2 3 4 5]

A seed that is finished is not run again; a seed that was stopped goes on.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from gatjax.cli import main as gatjax
from gatjax.runs import read_table, write_json


def finished(folder: Path) -> Path | None:
    """Return the run folder in `folder` that has its report, if there is one."""
    reports = sorted(folder.glob("*/report.html"))
    return reports[0].parent if reports else None


def run_seed(out: Path, seed: int) -> Path:
    """Run the demo with one seed and body, or go on with it."""
    folder = out / f"seed_{seed}"
    if finished(folder) is None:
        chosen = ["--seed", str(seed), "--body-seed", str(seed)]
        again = ["--resume"] if list(folder.glob("*/config.json")) else chosen
        if gatjax(["run", "--out", str(folder), *again]) != 0:
            raise SystemExit(f"seed {seed} failed; mend it and call this again")
    run = finished(folder)
    if run is None:
        raise SystemExit(f"seed {seed} left no report in {folder}")
    return run


def summary(run: Path) -> dict[str, dict[str, Any]]:
    """What one run says about each method, in the terms of the paper's Table 1."""
    rows = read_table(run / "metrics.csv")
    theta0 = next(row for row in rows if row["method"] == "theta0")
    base = theta0["robot_velocity_m_s"]
    methods = json.loads((run / "config.json").read_text())["methods"]
    found = {"theta0": {"velocity": base, "falls": theta0["robot_falls"]}}
    for method in methods:
        mine = [row for row in rows if row["method"] == method]
        tried = [r for r in mine if r["candidate"] != "chosen" and r["generation"] > 0]
        chosen = [row for row in mine if row["candidate"] == "chosen"]
        last = max(row["generation"] for row in tried)
        ends = [row for row in tried if row["generation"] == last]
        entry: dict[str, Any] = {
            "falls": sum(row["robot_falls"] for row in tried),
            "walks": sum(row["robot_rollouts"] for row in tried),
            "last_falls": sum(row["robot_falls"] for row in ends),
            "last_walks": sum(row["robot_rollouts"] for row in ends),
            "gain": None,
        }
        if chosen:
            entry["generation"] = chosen[0]["generation"]
            entry["confirmed_falls"] = chosen[0]["robot_falls"]
            entry["gain"] = chosen[0]["robot_velocity_m_s"] / base - 1.0
        found[method] = entry
    return found


def table(seeds: dict[int, dict]) -> str:
    """One line a method: gain of the winners on fresh walks, failures, falls."""
    lines = [
        f"{'method':<10} {'gain of stable winners':>23} {'failures':>9} "
        f"{'generation':>11} {'falls after gen 0':>18} {'in the last gen':>16}"
    ]
    first = next(iter(seeds.values()))
    for method in (name for name in first if name != "theta0"):
        each = [found[method] for found in seeds.values()]
        stable = [
            e for e in each if (e["gain"] or 0.0) > 0.0 and not e["confirmed_falls"]
        ]
        gains = 100.0 * np.array([entry["gain"] for entry in stable])
        spread = f"{gains.min():+.1f} to {gains.max():+.1f}" if stable else ""
        mean = f"{gains.mean():+.1f} %" if stable else "none"
        number = (
            np.mean([entry["generation"] for entry in stable]) if stable else np.nan
        )
        falls, walks, last, ends = (
            sum(entry[name] for entry in each)
            for name in ("falls", "walks", "last_falls", "last_walks")
        )
        lines.append(
            f"{method:<10} {f'{mean} ({spread})':>23} "
            f"{f'{len(each) - len(stable)} of {len(each)}':>9} {number:>11.1f} "
            f"{f'{falls} of {walks}':>18} {f'{last} of {ends}':>16}"
        )
    return "\n".join(lines)


def main() -> None:
    """Run the seeds and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for the runs")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5])
    arguments = parser.parse_args()
    found = {seed: summary(run_seed(arguments.out, seed)) for seed in arguments.seeds}
    write_json(arguments.out / "results.json", {"seeds": found})
    print(table(found))


if __name__ == "__main__":
    main()
