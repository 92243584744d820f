"""Score the diagnosis on fresh cases, and pool the marks of all sessions.

    python experiments/diagnosis/run.py --out DIR --seed 43000 --cases 40

makes 40 cases of each kind (seeds 43001 to 43004), diagnoses them, and goes on where it
was stopped. It writes marks/43000.json, and scores.md over all files in marks/. A seed
must be fresh: no case of it was looked at while the method was made.
"""

from __future__ import annotations

import argparse
import math
import subprocess
from pathlib import Path
from typing import Any

from gatjax.benchmark import figures, tables
from gatjax.benchmark.marks import Mark
from gatjax.cli import main as gatjax
from gatjax.runs import read_json, write_json, write_whole

HERE = Path(__file__).parent
KINDS = ("single", "pair", "null", "outside")
ROBOTS = ("arm_servo", "arm_two", "leg_six", "quad_hung")
LEAST = "3"  # visibility d that effects aim at


def solved(out: Path, kind: str, seed: int, cases: int) -> list[dict[str, Any]]:
    """Marks of one kind of cases; solves those that are not solved yet."""
    wanted = ["--cases", str(cases), "--seed", str(seed), "--least-visibility", LEAST]
    chosen = ["--kinds", kind, "--robots", *ROBOTS]
    command = ["bench", "diagnose", "--out", str(out / kind), *wanted, *chosen]
    if gatjax(command) != 0:
        raise SystemExit(f"{kind} cases failed; mend it and call this again")
    return read_json(out / kind / "scores.json")["solvers"]["gatjax"]["cases"]


def pooled(folder: Path) -> list[Mark]:
    """All marks of a folder's files; what was not a number is null there."""
    rows = [row for file in sorted(folder.glob("*.json"))
            for row in read_json(file)["marks"]]  # fmt: skip
    marks = []
    for row in rows:
        numbers = {k: math.nan for k, v in row.items() if v is None and k != "beside"}
        beside = row["beside"] and tuple(row["beside"])
        marks.append(Mark(**{**row, **numbers, "beside": beside}))
    return marks


def main() -> None:
    """Solve, keep the marks, pool them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="cases and diagnoses")
    parser.add_argument("--seed", type=int, required=True, help="fresh, 1000 apart")
    parser.add_argument("--cases", type=int, default=40, help="of each kind")
    given = parser.parse_args()
    git = ["git", "rev-parse", "HEAD"]
    commit = subprocess.run(git, capture_output=True, text=True, cwd=HERE, check=True)
    marks = []
    for number, kind in enumerate(KINDS, start=1):
        marks += solved(given.out, kind, given.seed + number, given.cases)
    facts = {"commit": commit.stdout.strip(), "seed": given.seed, "marks": marks}
    write_json(HERE / "marks" / f"{given.seed}.json", facts)
    every = pooled(HERE / "marks")
    text = tables.document({"gatjax": every})
    write_whole({HERE / "scores.md": text.encode()})
    figures.draw_confusion([m for m in every if m.main], HERE / "confusion.png")
    figures.draw_detection({"gatjax": every}, HERE / "detection.png")
    print(text)


if __name__ == "__main__":
    main()
