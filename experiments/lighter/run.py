"""Does a search on the lighter robot find what it finds on the whole one?

    python experiments/lighter/run.py --out DIR

150 policies x 20 rollouts walk on the whole robot, on the one without the joints that
the walk never moves (light), on the whole one with policies that differ by a millionth
of a search step (nudged: what a walk's chaos alone does), and on the whole one with
other starts and noise (fresh: how far a generation's costs say anything). Once in the
plain simulator, once where two of five walks fall, once where GAT grounds it with walks
of a stand-in robot. It writes DIR/results.json and DIR/lighter.png, and compares with
expected.json.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from matplotlib.figure import Figure

from gatjax import loop
from gatjax.benchmark.expected import compare
from gatjax.data.trajectories import to_recording
from gatjax.grounding.learn import grounded
from gatjax.ranking import policy_costs
from gatjax.records import Outcome
from gatjax.runs import write_json
from gatjax.settings import ROBOT_LOG, SIMULATOR_LOG, seeds
from gatjax.sim.backend import pairs
from gatjax.sim.lighter import lighter
from gatjax.sim.native import Native
from gatjax.sim.world import World, add_causes, nominal
from gatjax.surrogate import make_robot
from gatjax.walk.parameters import HIGH, LOW, STEP, THETA0

POLICIES, ROLLOUTS = 150, 20
SEED = 20261
SPREAD = 1.0  # search steps: a search begins with 0.5 and may go to 1.5
NUDGE = 1e-6  # search steps
LOGS = 30  # walks of robot and simulator that GAT learns from
ROBOT = "stiff"
BEST = 15  # policies: those that a search learns most from
ROUGH = (
    ("command_noise", ["all"], {"deviation": 0.03}),
    ("gravity_tilt", ["all"], {"pitch": 0.08}),
)


class Case(NamedTuple):
    """All walks of all policies in one world, on one model."""

    outcome: Outcome  # [N, R]
    seconds: float


def walked(world: World, policies: np.ndarray, seed: int = SEED) -> Case:
    """Walk policies [N, 15] in a world, each with the same keys."""
    native, keys = Native(world), jax.random.split(jax.random.key(seed), ROLLOUTS)
    pairs(native.outcome, world.values, policies, keys[:1])  # compile
    begun = time.perf_counter()
    outcome = pairs(native.outcome, world.values, policies, keys)
    return Case(outcome, time.perf_counter() - begun)


def with_gat(world: World) -> World:
    """Ground a world with walks of a stand-in robot."""

    def log(robot: Any, slot: int) -> Any:
        drawn = seeds(slot, 0, LOGS)
        walk, _ = robot.walk(np.tile(THETA0, (LOGS, 1)), drawn, world.task)
        return to_recording(walk, robot.name, world.rate_hz, {})

    seen = log(make_robot(ROBOT), ROBOT_LOG), log(loop.Simulator(world), SIMULATOR_LOG)
    return grounded(world, loop.learn_grounding(world, "gat", *seen, SEED))


def compared(one: Case, other: Case) -> dict[str, Any]:
    """How much two sets of the same walks differ."""
    fell = [np.isfinite(each.outcome.fell_at) for each in (one, other)]
    stood = ~fell[0] & ~fell[1]
    off = (other.outcome.velocity - one.outcome.velocity)[stood]
    costs = [np.asarray(policy_costs(each.outcome.cost)) for each in (one, other)]
    ranks = [np.argsort(np.argsort(cost)) for cost in costs]
    kept = np.intersect1d(*(np.argsort(cost)[:BEST] for cost in costs))
    return {
        "falls": float(fell[0].mean()), "falls_there": float(fell[1].mean()),
        "verdicts_alike": float((fell[0] == fell[1]).mean()),
        "velocity_mm_s": float(1e3 * off.mean()),
        "velocity_rms_mm_s": float(1e3 * np.sqrt(np.mean(off**2))),
        "rank_correlation": float(np.corrcoef(*ranks)[0, 1]),
        "best_kept": len(kept) / BEST,
        "time": other.seconds / one.seconds,
    }  # fmt: skip


def drawn(cases: dict[str, tuple[Case, Case]], file: Path) -> None:
    """Costs of all policies on both models, world by world."""
    figure = Figure((4.6 * len(cases), 4.4), layout="constrained")
    for axes, (name, (full, light)) in zip(
        figure.subplots(1, len(cases), squeeze=False)[0], cases.items(), strict=True
    ):
        costs = [np.asarray(policy_costs(each.outcome.cost)) for each in (full, light)]
        axes.plot(*costs, "o", ms=3, color="#0072B2")
        ends = [min(map(np.min, costs)), max(map(np.max, costs))]
        axes.plot(ends, ends, lw=0.8, color="black")
        axes.set(title=name, xlabel="cost on the whole robot",
                 ylabel="cost on the lighter one")  # fmt: skip
    figure.savefig(file, dpi=110)


def main() -> None:
    """Walk, compare, write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True)
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    steps = np.random.default_rng(SEED).normal(size=(2, POLICIES, len(THETA0)))
    policies = np.clip(THETA0 + SPREAD * STEP * steps[0], LOW, HIGH)
    nudged = np.clip(policies + NUDGE * STEP * steps[1], LOW, HIGH)
    results, cases = {}, {}
    for name, world in {
        "plain": nominal(), "rough": add_causes(nominal(), ROUGH),
        "grounded": with_gat(nominal()),
    }.items():  # fmt: skip
        print(f"{name}: 4 x {POLICIES * ROLLOUTS} walks", flush=True)
        full = walked(world, policies)
        cases[name] = full, walked(lighter(world), policies)
        results[name] = {
            "light": compared(full, cases[name][1]),
            "nudged": compared(full, walked(world, nudged)),
            "fresh": compared(full, walked(world, policies, SEED + 1)),
        }
    write_json(out / "results.json", results)
    drawn(cases, out / "lighter.png")
    told = compare(results, Path(__file__).parent / "expected.json")
    print(f"\n{told.table}\n\n{out / 'results.json'}, {out / 'lighter.png'}")
    if told.off:
        raise SystemExit(f"not as in expected.json: {', '.join(told.off)}")


if __name__ == "__main__":
    main()
