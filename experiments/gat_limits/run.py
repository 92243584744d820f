"""Where does GAT fail? Little data, another walk, a wrong alpha, a foot on the floor.

    python experiments/gat_limits/run.py --out DIR [--robot stiff]

GAT is learned from walks with theta0 of a stand-in robot and predicts walks that it has
not seen, half a second ahead: from more or fewer trajectories, for walks further and
further from theta0, with more or less of its correction, and of the leg that stands on
the floor beside the one that swings. It writes DIR/results.json and DIR/gat_limits.png.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from gatjax import loop
from gatjax.benchmark.tables import table
from gatjax.data.recording import Recording
from gatjax.data.trajectories import to_recording
from gatjax.grounding import prediction
from gatjax.grounding.learn import Grounding, grounded, with_alpha
from gatjax.records import FORCE_SENSORS
from gatjax.robot.nao import WALKING, WALKING_JOINTS
from gatjax.runs import write_json
from gatjax.settings import EVALUATION, ROBOT_LOG, SIMULATOR_LOG, seeds
from gatjax.sim.backend import prepare, use_compile_cache
from gatjax.sim.world import World, nominal
from gatjax.surrogate import make_robot
from gatjax.walk.parameters import HIGH, LOW, STEP, THETA0

SIZES = (4, 8, 15, 30, 50)  # trajectories of the robot
SEEDS = (0, 1, 2)
ALPHAS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25)
FAR = (0.0, 0.5, 1.0, 1.5)  # search steps, standard deviation of each parameter
UNSEEN, WINDOWS = 12, 240  # trajectories and pieces of them that are predicted
LEG = ("HipRoll", "HipPitch", "KneePitch", "AnklePitch", "AnkleRoll")
STANDS = 10.0  # N on a foot that stands


def walked(robot: Any, thetas: np.ndarray, drawn: Any, world: World) -> Recording:
    """Record walks."""
    walk, _ = robot.walk(thetas, drawn, world.task)
    return to_recording(walk, robot.name, 50.0, {})


def errors(world: World, log: Recording) -> tuple[np.ndarray, prediction.Windows]:
    """Errors [W, T, 13] rad of a world on pieces of a log, and the pieces."""
    ids = np.unique(log.trajectory)
    windows = prediction.cut(world, log, ids, WINDOWS, 7)
    start = windows.warm, windows.qpos, windows.qvel
    found = prepare(world).replay(world.values, windows.command, *start)
    apart = np.asarray(found) - windows.angle[:, prediction.WARM + 1 :]
    return apart[..., WALKING], windows


def ahead(world: World, log: Recording) -> float:
    """RMS error half a second ahead, degrees, over all walking joints."""
    apart, _ = errors(world, log)
    return float(np.rad2deg(np.sqrt(np.mean(apart[:, -1] ** 2))))


def some(log: Recording, count: int) -> Recording:
    """The first trajectories of a recording."""
    kept = log.trajectory < count
    columns = {name: values[kept] for name, values in log.columns.items()}
    return log._replace(
        time=log.time[kept], trajectory=log.trajectory[kept], columns=columns
    )


def on_the_floor(world: World, log: Recording) -> dict[str, float]:
    """RMS error in the first tick of legs that stand and legs that swing, degrees."""
    apart, windows = errors(world, log)
    first, found = apart[:, 0], {"stands": [], "swings": []}
    for side in "LR":
        names = [name for name in FORCE_SENSORS if name.startswith(side)]
        load = sum(log.columns[f"force.{name}"] for name in names)[windows.row]
        joints = [
            k for k, name in enumerate(WALKING_JOINTS)
            if name[0] == side and name[1:] in LEG
        ]  # fmt: skip
        legs = first[:, joints]
        found["stands"].append(legs[load > STANDS].ravel())
        found["swings"].append(legs[load < 1.0].ravel())
    return {
        name: float(np.rad2deg(np.sqrt(np.mean(np.concatenate(part) ** 2))))
        for name, part in found.items()
    }


def measured(robot: Any, world: World) -> dict[str, Any]:
    """All four measurements."""
    count = max(SIZES)
    same = np.tile(THETA0, (count, 1))
    log = walked(robot, same, seeds(ROBOT_LOG, 0, count), world)
    ideal = walked(loop.Simulator(world), same, seeds(SIMULATOR_LOG, 0, count), world)
    fresh = seeds(EVALUATION, 0, UNSEEN)
    unseen = walked(robot, same[:UNSEEN], fresh, world)

    def learned(size: int, seed: int) -> Grounding:
        return loop.learn_grounding(world, "gat", some(log, size), some(ideal, size),
                                    seed)  # fmt: skip

    results: dict[str, Any] = {"nominal": ahead(world, unseen), "data": {}}
    for size in SIZES:
        results["data"][str(size)] = [
            ahead(grounded(world, learned(size, seed)), unseen) for seed in SEEDS
        ]
        print(f"{size} trajectories: {results['data'][str(size)]} deg", flush=True)
    best = learned(count, 0)
    results["alpha"] = {
        str(alpha): ahead(grounded(world, with_alpha(best, alpha)), unseen)
        for alpha in ALPHAS
    }
    results["far"] = {}
    direction = np.random.default_rng(5).normal(size=(UNSEEN, len(THETA0)))
    for far in FAR:
        thetas = np.clip(THETA0 + far * STEP * direction, LOW, HIGH)
        other = walked(robot, thetas, fresh, world)
        results["far"][str(far)] = {
            "nominal": ahead(world, other), "gat": ahead(grounded(world, best), other)
        }  # fmt: skip
    results["contact"] = {
        "nominal": on_the_floor(world, unseen),
        "gat": on_the_floor(grounded(world, best), unseen),
    }
    return results


def drawn(results: dict[str, Any], file: Path) -> None:
    """One picture a measurement."""
    figure = Figure((13.0, 3.6), layout="constrained")
    data, alpha, far, contact = figure.subplots(1, 4)
    sizes = [int(size) for size in results["data"]]
    each = np.array(list(results["data"].values()))
    data.plot(sizes, each, "o", color="#0072B2")
    data.plot(sizes, each.mean(1), color="#0072B2", label="GAT")
    data.axhline(results["nominal"], color="#D55E00", label="no grounding")
    data.set(xlabel="trajectories learned from", ylabel="error 0.5 s ahead, deg")
    alpha.plot([float(a) for a in results["alpha"]], list(results["alpha"].values()),
               "o-", color="#0072B2")  # fmt: skip
    alpha.set(xlabel="alpha, share of the correction")
    steps = [float(far) for far in results["far"]]
    for name, colour in (("nominal", "#D55E00"), ("gat", "#0072B2")):
        far.plot(steps, [row[name] for row in results["far"].values()], "o-",
                 color=colour)  # fmt: skip
    far.set(xlabel="search steps away from theta0")
    for place, (name, colour) in enumerate(
        (("nominal", "#D55E00"), ("gat", "#0072B2"))
    ):
        row = results["contact"][name]
        contact.bar(np.arange(2) + 0.4 * place, list(row.values()), 0.4, color=colour)
    contact.set_xticks(np.arange(2) + 0.2, list(results["contact"]["gat"]))
    contact.set(ylabel="error one tick ahead, deg", xlabel="the leg")
    data.legend()
    for axes in (data, far, contact):
        axes.set_ylim(bottom=0.0)
    alpha.set_yscale("log")
    figure.savefig(file, dpi=110)


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--robot", default="stiff", help="dart or stiff")
    told = parser.parse_args()
    told.out.mkdir(parents=True, exist_ok=True)
    use_compile_cache()
    results = {"robot": told.robot, **measured(make_robot(told.robot), nominal())}
    write_json(told.out / "results.json", results)
    drawn(results, told.out / "gat_limits.png")
    rows = [("no grounding", f"{results['nominal']:.2f}")]
    rows += [(f"GAT, {size} trajectories", f"{np.mean(each):.2f}")
             for size, each in results["data"].items()]  # fmt: skip
    rows += [(f"alpha {a}", f"{e:.2f}") for a, e in results["alpha"].items()]
    rows += [(f"{name}, {far} steps away", f"{error:.2f}")
             for far, row in results["far"].items()
             for name, error in row.items()]  # fmt: skip
    rows += [(f"{name}, one tick, leg that {leg}", f"{error:.3f}")
             for name, row in results["contact"].items()
             for leg, error in row.items()]  # fmt: skip
    print(f"{table(('what', 'error, deg'), rows)}\n{told.out / 'gat_limits.png'}")


if __name__ == "__main__":
    main()
