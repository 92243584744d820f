"""Prove the diagnosis on logs of real robots that others measured.

    python experiments/real_data/run.py --out DIR

BAM (one servo), SO-101 (an arm), EMPS (an axis), DFKI (a pendulum that is told its
torque), and wrong facts hidden in their models and logs. It writes DIR/results.json
after every part, and compares it with expected.json; Ctrl-C keeps what is done, and the
same command goes on. README.md has protocols, anchors and results.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import anchor
import bam
import dfki
import emps
import hidden
import so101

from gatjax.benchmark.expected import compare
from gatjax.runs import read_json, write_json


def of_bam(out: Path) -> dict[str, Any]:
    """One servo: an unseen gain, and an unseen motion without torque."""
    found = {split: bam.diagnosed(split, out / split) for split in bam.HELD_OUT}
    return {
        **{f"held_out_{split}_deg": each["held_out_deg"]
           for split, each in found.items()},
        "causes": found["kp200"]["causes"], "splits": found,
    }  # fmt: skip


def of_emps(out: Path) -> dict[str, Any]:
    """An axis whose records may not be carried along."""
    if not (EMPS / "DATA_EMPS.mat").is_file():
        print(f"emps: left out, {EMPS} has no DATA_EMPS.mat (nonlinearbenchmark.org)")
        return {"test_rmse_mm": None}
    return emps.compared(out, EMPS)


EMPS = Path(__file__).parents[3] / "shared/data/real/emps"
PARTS: dict[str, Callable[[Path], dict[str, Any]]] = {
    "bam": of_bam, "so101": so101.compared, "emps": of_emps, "dfki": dfki.compared,
    "hidden_truths": hidden.compared,
}  # fmt: skip


def main() -> None:
    """Do what is asked for, and keep it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="of all diagnoses")
    parser.add_argument("--parts", nargs="+", default=tuple(PARTS), choices=PARTS)
    given = parser.parse_args()
    if "so101" in given.parts:
        anchor.check()
    given.out.mkdir(parents=True, exist_ok=True)
    file = given.out / "results.json"
    for part in given.parts:
        done = read_json(file) if file.is_file() else {}
        print(f"{part}: {given.out / part}", flush=True)
        write_json(file, done | {part: PARTS[part](given.out / part)})
    done = {  # but for parts that were left out
        part: row for part, row in read_json(file).items()
        if any(value is not None for value in row.values())
    }  # fmt: skip
    told = compare(done, Path(__file__).parent / "expected.json")
    print(f"\n{told.table}\n\n{file}")
    if told.off:
        raise SystemExit(f"not as in expected.json: {', '.join(told.off)}")


if __name__ == "__main__":
    main()
