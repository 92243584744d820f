"""How throughput grows with robots and devices: what was measured, and a model of it.

    python benchmarks/scaling.py [BENCH.json ...]

draws docs/scaling.png from docs/scaling.csv and from what `gatjax bench --json` wrote
with several `--worlds`. A physics step of n robots takes a + b n on one device: a is
latency, b work. The line through a series minimises the error's share of each time.
"""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import nnls

DOCS = Path(__file__).parents[1] / "docs"
DEVICES = (1, 8, 100, 1000)
ROBOTS = np.geomspace(30, 100_000, 60)  # a device
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7")
Series = dict[str, list[tuple[float, float]]]  # name -> (robots, seconds a step)


def measured(files: Iterable[Path]) -> Series:
    """Series of the table and of bench files; one is an engine, a world and a model."""
    found: Series = {}
    with (DOCS / "scaling.csv").open() as table:
        for row in csv.DictReader(table):
            point = float(row["robots"]), 1e-3 * float(row["step_ms"])
            found.setdefault(row["series"], []).append(point)
    for file in files:
        told = json.loads(file.read_text())
        for row in told["rows"]:
            machine = told["machine"]
            on_cpu = "cpu" in row["device"].lower()  # else cuda:0 or the like
            device = f"{machine['cores']} cores" if on_cpu else machine["devices"][0]
            name = f"{device}, {row['backend']}, {row['world']}, {row['model']}"
            seconds = row["worlds"] / row["closed_steps_per_s"]
            found.setdefault(name, []).append((row["worlds"], seconds))
    return found


def fitted(points: list[tuple[float, float]]) -> tuple[float, float]:
    """Latency a s and work b s/robot of a series; neither is negative."""
    robots, seconds = np.array(points).T
    shares = np.column_stack([1.0 / seconds, robots / seconds])
    (a, b), _ = nnls(shares, np.ones(len(points)))
    return a, b


def main() -> None:
    """Draw, and print the model of each series of two points or more."""
    figure = Figure((11.0, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    series = measured(map(Path, sys.argv[1:]))
    known = {name: points for name, points in series.items() if len(points) > 1}
    for colour, (name, points) in zip(COLOURS, known.items(), strict=False):
        a, b = fitted(points)
        print(f"{name}: {1e3 * a:.2f} ms + {1e9 * b:.0f} ns a robot")
        robots, seconds = np.array(points).T
        left.loglog(robots, robots / seconds, "o", color=colour)
        left.loglog(ROBOTS, ROBOTS / (a + b * ROBOTS), color=colour, label=name)
        if "cores" in name:
            continue
        right.loglog(robots, robots / seconds, "o", color=colour)
        for devices in DEVICES:
            line = devices * ROBOTS / (a + b * ROBOTS)
            right.loglog(devices * ROBOTS, line, color=colour, alpha=0.6)
            end = devices * ROBOTS[-1], line[-1]
            right.annotate(f"{devices:,} x ", end, ha="right", va="bottom", fontsize=8)
    left.set_xlabel("robots on one device; points: measured, lines: n / (a + b n)")
    left.set_ylabel("physics steps a second")
    right.set_xlabel("robots on D x the GPU, on paper: D n / (a + b n)")
    left.legend(fontsize=8)
    figure.savefig(DOCS / "scaling.png", dpi=110)


if __name__ == "__main__":
    main()
