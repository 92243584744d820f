"""Table 1 at the paper's size in parts, each on a machine that is good at it.

    python experiments/table1/parts.py ground --out DIR     # CPU: logs and groundings
    python experiments/table1/parts.py search --out DIR     # GPU: one call a generation
    python experiments/table1/parts.py walk --out DIR       # CPU: walks on the robot

The same options for all three. DIR goes with them from machine to machine; searches
need no DIR/ROBOT_TRIAL/recordings, walks only the last checkpoint of each search. These
are the stages of run.py: the numbers are the same, what is done is not done again, and
walk writes DIR/results/ROBOT_TRIAL.json and DIR/table.md as it does, and
DIR/generations.png: how many walks fall, and how fast they are in the simulator.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from run import METHODS, tell

from gatjax import loop
from gatjax.benchmark.trials import opened, with_methods
from gatjax.cli.progress import shown
from gatjax.loop.candidates import KINDS
from gatjax.loop.explain import EXPLAINED
from gatjax.loop.setting import Setting, total_work
from gatjax.loop.stages import begin, by_entry, entries, job_of, search
from gatjax.runs import Progress, read_table
from gatjax.settings import PAPER, LoopSettings
from gatjax.sim.backend import use_compile_cache
from gatjax.sim.world import nominal
from gatjax.surrogate import make_robot
from gatjax.task import task_at
from gatjax.walk.parameters import THETA0

INKS = ("black", "#E69F00", "#009E73", "#0072B2", "#D55E00", "#CC79A7", "#56B4E9")
"""Okabe and Ito's palette, which readers with any colour vision can tell apart."""


def asked() -> argparse.Namespace:
    """What the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("--out", type=Path, required=True, help="folder for the runs")
    parser.add_argument("--robot", default="stiff")
    parser.add_argument("--trials", type=int, nargs="+", default=list(range(10)))
    known = [*METHODS, EXPLAINED]
    parser.add_argument("--methods", nargs="+", default=METHODS, choices=known)
    parser.add_argument("--candidates", nargs="+", default=["best"], choices=KINDS)
    parser.add_argument("--backend", default="mjx", help="that searches")
    parser.add_argument("--impl", default="warp", help="of mjx: jax or warp")
    return parser.parse_args()


def ground(settings: list[Setting]) -> None:
    """Walk theta0, collect logs, learn every grounding."""
    begin(settings)
    for setting, entry in entries(settings):
        job_of(setting, entry, 0, THETA0)


def find(settings: list[Setting]) -> None:
    """Search in all trials of a method at once, and measure what was found there."""
    for alike in by_entry(entries(settings)):
        search(alike, 0, [THETA0] * len(alike))


def walk(settings: list[Setting]) -> None:
    """Do what is left of the loop: walks on the robot."""
    folders, each = zip(*((s.folder, s.settings) for s in settings), strict=True)
    loop.run_all(folders, each, settings[0].robot, settings[0].progress)


def drawn(
    folders: Sequence[Path], methods: Sequence[str], kind: str, file: Path
) -> None:
    """Falls on the robot and speed in the simulator, generation by generation."""
    rows = [row for folder in folders for row in read_table(folder / "metrics.csv")]
    figure = Figure((9.0, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    for method, colour in zip(methods, cycle(INKS), strict=False):
        mine = [r for r in rows if r["method"] == method and r["candidate"] == kind]
        numbers = sorted({row["generation"] for row in mine})
        each = [[r for r in mine if r["generation"] == number] for number in numbers]
        falls = [
            sum(r["robot_falls"] for r in some) / sum(r["robot_rollouts"] for r in some)
            for some in each
        ]
        speeds = [np.mean([r["simulator_velocity_m_s"] for r in some]) for some in each]
        style = {"color": colour, "marker": ".", "label": method}
        left.plot(numbers, 100 * np.array(falls), **style)
        right.plot(numbers, 100 * np.array(speeds), **style)
    left.set(xlabel="generation", ylabel="walks on the robot that fall, %")
    right.set(xlabel="generation", ylabel="speed in the simulator, cm/s")
    known = left.get_legend_handles_labels()
    figure.legend(*known, loc="outside lower center", ncols=len(methods), frameon=False)
    figure.savefig(file, dpi=110)


PARTS = {"ground": ground, "search": find, "walk": walk}


def settings_of(told: argparse.Namespace, progress: Progress) -> list[Setting]:
    """What the stages of every trial share."""
    task, robot = task_at(PAPER.rate_hz), make_robot(told.robot)
    found = []
    for trial in told.trials:
        settings = _trial(told, trial)
        folder = opened(told.out, f"{told.robot}_{trial}", settings)
        found.append(Setting(folder, settings, task, nominal(task), robot, progress))
    return found


def _trial(told: argparse.Namespace, trial: int) -> LoopSettings:
    return dataclasses.replace(
        with_methods(PAPER, told.methods), robot=told.robot, seed=trial,
        candidates=tuple(told.candidates), backend=told.backend, impl=told.impl,
    )  # fmt: skip


def main() -> None:
    """Do one part for all trials."""
    told = asked()
    use_compile_cache()
    with shown(sum(total_work(_trial(told, trial)) for trial in told.trials)) as bar:
        settings = settings_of(told, bar)
        PARTS[told.part](settings)
    if told.part == "walk":
        folders = [setting.folder for setting in settings]
        found = dict(zip(told.trials, folders, strict=True))
        text = tell(told.out, told.robot, found, told.methods)
        kind = told.candidates[0]
        drawn(folders, told.methods, kind, told.out / "generations.png")
        print(f"{text}\n{told.out / 'table.md'}")


if __name__ == "__main__":
    try:
        main()
    except (ValueError, OSError) as wrong:
        raise SystemExit(f"parts.py: {wrong}") from None
