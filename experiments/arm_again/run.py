"""The SO-101 arm again, on motions that were chosen before anybody looked at them.

    python experiments/arm_again/run.py --out DIR

does what a user with logs of a robot does: `gatjax import` of raw folders, with the
map of their signals corrected, and `gatjax diagnose` with motions held out. Look at
DIR/said/report.html; DIR/results.json is compared with expected.json.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from gatjax.benchmark.expected import compare
from gatjax.cli import main as gatjax
from gatjax.runs import read_json, write_json, write_whole

HERE = Path(__file__).parent
MODELS = HERE.parent / "real_data/models"
FIT = ("inertia_coupling", "reaching_points", "gripper_cycles")
HELD_OUT = ("random_waypoints", "workspace_sweep")


def called(*words: str) -> None:
    """Call gatjax, and stop where it does."""
    print("\n$ gatjax", *words, flush=True)
    if code := gatjax(list(words)):
        raise SystemExit(code)


def said(out: Path) -> dict[str, Any]:
    """Import the logs and diagnose them; the numbers of the diagnosis."""
    logs = {name: str(out / f"{name}.parquet") for name in ("fit", "held_out")}
    for file, names in zip(logs.values(), (FIT, HELD_OUT), strict=True):
        raw = [str(HERE / "data" / name) for name in names]
        called("import", *raw, "--map", str(HERE / "so101.map.yaml"), "--out", file)
    called(
        "diagnose", "--model", str(MODELS / "so101.xml"),
        "--tolerances", str(MODELS / "so101.tolerances.json"),
        "--data", logs["fit"], "--held-out", logs["held_out"],
        "--out", str(out / "said"),
    )  # fmt: skip
    return read_json(out / "said/diagnosis.json")


def results(told: dict[str, Any]) -> dict[str, Any]:
    """What is compared with expected.json."""
    return {
        "arm": {
            "verdict": told["verdict"],
            "named": [_named(row) for row in told["causes"]],
            "causes": {
                _named(row): {k: v["value"] for k, v in row["parameters"].items()}
                for row in told["causes"]
            },
            "held_out_rmse_deg": {
                name: math.degrees(told["gain"][name]) for name in ("before", "after")
            },
        }
    }


def _named(row: dict[str, Any]) -> str:
    """A cause and where it is."""
    return f"{row['cause']} at {', '.join(row['where'])}"


def main() -> None:
    """Import, diagnose, compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="of all files")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    mine = results(said(out))
    write_json(out / "results.json", mine)
    told = compare(mine, HERE / "expected.json")
    write_whole({out / "results.md": (told.table + "\n").encode()})
    print(f"\n{told.table}\n\nreport     {out / 'said/report.html'}")
    if told.off:
        raise SystemExit(f"not as in expected.json: {', '.join(told.off)}")


if __name__ == "__main__":
    main()
