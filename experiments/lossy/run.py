"""Does a grounding belong ahead of what loses commands in a simulator, or behind it?

    python experiments/lossy/run.py --out DIR

A simulator loses a fifth of its commands, as an explained one may. A robot that does
the same and nothing else (twin), and one that is late and weak besides (gap), teach it
three groundings. Each acts ahead of the losses (gatjax's way: where it was learned) and
behind them, takes the alpha that the loop would choose, and 100 walks say how near the
robot it comes. It writes DIR/results.csv. Takes three minutes on two cores.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
from pathlib import Path
from typing import Any

import jax
import numpy as np

from gatjax.data.recording import Recording
from gatjax.data.trajectories import to_recording
from gatjax.grounding.learn import Grounding, grounded, largest_stable_alpha
from gatjax.loop import learn_grounding
from gatjax.sim.backend import pairs, prepare
from gatjax.sim.world import World, add_causes, nominal
from gatjax.task import Task
from gatjax.walk.parameters import THETA0

LOST = ("dropped_commands", ["all"], {"probability": 0.2, "burst": 2.0})
GAP = (
    ("command_delay", ["all"], {"delay": 0.02}),
    ("torque_limit", ["all"], {"limit": 4.0}),
)
METHODS = ("gat", "sgat", "guided")
LOGS, CHOOSING, WALKS = 16, 20, 100
TASK = Task(duration=3.0)


def behind(world: World) -> World:
    """The same grounded world, the grounding last of what acts on commands."""

    def moved(parts: Any) -> dict[str, Any]:
        rest = {name: part for name, part in parts.items() if name != "grounding"}
        return {**rest, "grounding": parts["grounding"]}

    values = world.values._replace(command=moved(world.values.command))
    return dataclasses.replace(world, command=moved(world.command), values=values)


def walked(run: Any, world: World, count: int, seed: int) -> Any:
    """So many walks with theta0."""
    keys = jax.random.split(jax.random.key(seed), count)
    return jax.tree.map(lambda x: x[0], pairs(run, world.values, THETA0[None], keys))


def outcome(world: World, count: int, seed: int) -> Any:
    """How so many walks end."""
    return walked(prepare(world, "native").outcome, world, count, seed)


def log_of(world: World, seed: int) -> Recording:
    """What LOGS walks log."""
    walk, _ = walked(prepare(world, "native").rollout, world, LOGS, seed)
    return to_recording(walk, "walks", 1.0 / TASK.control_period, {})


def told(where: str, world: World, grounding: Grounding | None = None) -> dict:
    """A row: how walks in a world end."""
    found = outcome(world, WALKS, 9)
    fell = np.isfinite(found.fell_at)
    alpha = "" if grounding is None else grounding.facts["alpha"]
    row = {"where": where, "alpha": alpha, "falls": int(fell.sum())}
    return row | {"speed_m_s": round(float(found.velocity[~fell].mean()), 4)}


def main() -> None:
    """Ground, choose alpha, walk, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    world, rows = add_causes(nominal(TASK), [LOST]), []
    simulator = log_of(world, 1)
    for name, more in (("twin", ()), ("gap", GAP)):
        robot = add_causes(world, more)
        walks = log_of(robot, 2)
        facts = {"robot": name, "method": ""}
        rows += [facts | told("robot", robot), facts | told("simulator", world)]
        for method in METHODS:
            learned = learn_grounding(world, method, walks, simulator, 0)
            for where, place in (("ahead", lambda each: each), ("behind", behind)):

                def falls(candidate: Grounding, place: Any = place) -> float:
                    ended = outcome(place(grounded(world, candidate)), CHOOSING, 3)
                    return float(np.isfinite(ended.fell_at).mean())

                best = largest_stable_alpha(learned, falls)
                row = told(where, place(grounded(world, best)), best)
                rows.append({"robot": name, "method": method} | row)
                print(rows[-1], flush=True)
    with (out / "results.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
