"""Does a search find the same when the worse half of its policies drops out early?

    python experiments/race/run.py --out DIR

Searches of 40 policies x 8 rollouts x 6 generations (whole), with a race after 2 of the
8 (race), and with as many rollouts as the race has, 5, for all policies (fewer); in the
plain simulator and in one where two of five walks fall. What each search ends with (the
mean policy) walks 100 more times in its world. It writes DIR/results.json after every
search and goes on from there, DIR/race.png, and compares with expected.json.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

from gatjax import search
from gatjax.benchmark.expected import compare
from gatjax.benchmark.tables import table
from gatjax.benchmark.transfer import mean
from gatjax.runs import read_json, write_json
from gatjax.settings import SearchSettings
from gatjax.sim.backend import costs, pairs, prepare
from gatjax.sim.lighter import lighter
from gatjax.sim.world import World, add_causes, nominal
from gatjax.walk.parameters import HIGH, LOW, STEP, THETA0

SEED, FRESH = 20270, 100  # walks that a search's result is measured by
SIZE = {"population": 40, "generations": 6}
ARMS = {
    "whole": SearchSettings(**SIZE, rollouts=8),
    "race": SearchSettings(**SIZE, rollouts=8, race=2),
    "fewer": SearchSettings(**SIZE, rollouts=5),
}
ROUGH = (
    ("command_noise", ["all"], {"deviation": 0.03}),
    ("gravity_tilt", ["all"], {"pitch": 0.08}),
)
COLOURS = {"whole": "#0072B2", "race": "#D55E00", "fewer": "#999999"}


def searched(world: World, settings: SearchSettings, number: int) -> dict[str, Any]:
    """Search once in a world, and walk what was found in it with fresh noise."""
    backend = prepare(world, "native")
    space = search.Space(theta0=THETA0, step=STEP, low=LOW, high=HIGH)
    step = search.host_generation(space, settings, costs(backend))
    key, fresh = jax.random.split(jax.random.key(SEED + number))
    state, begun = search.start(space, settings, key), time.perf_counter()
    for generation in range(settings.generations):
        state, info = step(state, world.values, generation)
    seconds = time.perf_counter() - begun
    keys = jax.random.split(fresh, FRESH)
    result = pairs(backend.outcome, world.values, np.asarray(info.mean_policy)[None],
                   keys)  # fmt: skip
    return {
        "cost": float(result.cost.mean()),
        "cm_s": 100.0 * float(result.velocity.mean()),
        "falls": float(np.isfinite(result.fell_at).mean()),
        "walks": settings.walks * settings.generations,
        "seconds": seconds,
    }


def summed(found: dict[str, dict[str, dict]]) -> dict[str, Any]:
    """Sum up one world: every arm, and its paired differences to `whole`."""
    numbers = [n for n, arms in found.items() if len(arms) == len(ARMS)]
    told = {}
    for arm in ARMS:
        rows = [found[number][arm] for number in numbers]
        base = [found[number]["whole"] for number in numbers]
        told[arm] = {
            name: float(np.mean([row[name] for row in rows]))
            for name in ("cost", "cm_s", "falls")
        }
        for name in ("cost", "cm_s", "falls"):
            apart = [a[name] - b[name] for a, b in zip(rows, base, strict=True)]
            told[arm][f"{name}_more"] = list(map(float, mean(apart)))
        told[arm]["time"] = float(
            sum(row["seconds"] for row in rows) / sum(row["seconds"] for row in base)
        )
    return told | {"searches": len(numbers)}


def shown(results: dict[str, Any]) -> str:
    """All worlds as a table."""
    lines = []
    for world, told in results.items():
        for arm in ARMS:
            row = told[arm]
            lines.append((
                world, arm, f"{row['cm_s']:.2f}", _apart(row["cm_s_more"]),
                f"{100.0 * row['falls']:.1f}", _apart(row["falls_more"], 100.0),
                f"{row['time']:.2f}",
            ))  # fmt: skip
    heads = ("world", "search", "cm/s", "more than whole", "falls %", "more", "time")
    return table(heads, lines)


def _apart(interval: list[float], scale: float = 1.0) -> str:
    """A paired difference with its interval."""
    value, low, high = (scale * number for number in interval)
    return f"{value:+.2f} ({low:.2f} to {high:.2f})"


def drawn(raw: dict[str, Any], file: Path) -> None:
    """Cost of what every search ended with, searches with one seed joined."""
    figure = Figure((4.6 * len(raw), 4.0), layout="constrained")
    for axes, (name, found) in zip(
        figure.subplots(1, len(raw), squeeze=False)[0], raw.items(), strict=True
    ):
        for arms in found.values():
            if len(arms) == len(ARMS):
                line = [arms[arm]["cost"] for arm in ARMS]
                axes.plot(range(len(ARMS)), line, color="#cccccc", lw=0.8, zorder=1)
        for place, arm in enumerate(ARMS):
            line = [arms[arm]["cost"] for arms in found.values() if arm in arms]
            axes.plot([place] * len(line), line, "o", ms=5, color=COLOURS[arm])
        axes.set_xticks(range(len(ARMS)), list(ARMS))
        axes.set(title=name, ylabel="cost of the mean policy on 100 fresh walks")
    figure.savefig(file, dpi=110)


def main() -> None:
    """Search, compare, write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--searches", type=int, default=8, help="of each arm and world")
    told = parser.parse_args()
    told.out.mkdir(parents=True, exist_ok=True)
    file = told.out / "results.json"
    raw = read_json(file)["raw"] if file.exists() else {}
    worlds = {"plain": nominal(), "rough": add_causes(nominal(), ROUGH)}
    results = {}
    for number in map(str, range(told.searches)):
        for name, world in worlds.items():
            found = raw.setdefault(name, {}).setdefault(number, {})
            for arm, settings in ARMS.items():
                if arm not in found:
                    print(f"{name}, search {number}: {arm}", flush=True)
                    found[arm] = searched(lighter(world), settings, int(number))
                    write_json(file, {"raw": raw})
        results = {name: summed(found) for name, found in raw.items()}
        write_json(file, {"raw": raw, **results})
    drawn(raw, told.out / "race.png")
    print(f"\n{shown(results)}\n\n{file}, {told.out / 'race.png'}")
    expected = Path(__file__).parent / "expected.json"
    against = compare(results, expected)
    print(f"\n{against.table}")
    if against.off:
        raise SystemExit(f"not as in expected.json: {', '.join(against.off)}")


if __name__ == "__main__":
    main()
