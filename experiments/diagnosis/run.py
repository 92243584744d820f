"""Score the diagnosis on fresh cases.

    python experiments/diagnosis/run.py --out DIR --seed 44000 --cases 40

makes 40 cases of each kind (seeds 44001 to 44004) and diagnoses them. Ctrl-C keeps what
is solved, and the same command goes on. It writes marks/44000.json and prints its
scores; fresh.md and its picture are those of FRESH, 40 of each kind; scores.md and its
pictures are those of SAMPLE, the seeds of one method: no file differs that
`gatjax.diagnosis`, the cases or the marks import. So a large sample can be made on
several days and machines. A seed must be fresh: no case of it was looked at while the
method was made, and the method stays as it is until the last one is solved.
"""

from __future__ import annotations

import argparse
import math
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import grimp

from gatjax.benchmark import figures, tables
from gatjax.benchmark.cases import read_cases
from gatjax.benchmark.marks import Mark, mark
from gatjax.benchmark.solve import GATJAX, WALL, answer
from gatjax.cli import main as gatjax
from gatjax.runs import read_json, write_json, write_whole

HERE = Path(__file__).parent
KINDS = ("single", "pair", "null", "outside")
ROBOTS = ("arm_servo", "arm_two", "leg_six", "quad_hung")
STOPPED = (-2, -15, 130)  # exit codes of what Ctrl-C ended
SAMPLE = range(48000, 54000, 1000)  # seeds that scores.md is about
FAINT = (56001,)  # effects from d 0.3 on, beside these in detection.png
FRESH = 57000  # the newest seed with 40 of each kind: fresh.md
LEAST = "3"  # visibility d that effects aim at
METHOD = (  # and whatever these import
    "gatjax.diagnosis.diagnose", "gatjax.diagnosis.suitable", "gatjax.data.checks",
    "gatjax.benchmark.marks", "gatjax.surrogate.hidden.answers",
)  # fmt: skip


def git(*words: str) -> str:
    """What git says here."""
    command = ["git", "-C", str(HERE.parents[1]), *words]
    return subprocess.run(
        command, capture_output=True, text=True, check=True
    ).stdout.strip()


@cache
def parts() -> tuple[str, ...]:
    """Files that decide what a diagnosis says and how it is marked."""
    graph = grimp.build_graph("gatjax")
    names = {*METHOD}.union(*map(graph.find_upstream_modules, METHOD))
    paths = [name.replace(".", "/") for name in names]
    files = [path + end for path in paths for end in (".py", "/__init__.py")]
    return (*sorted(files), "gatjax/surrogate/hidden")


def method(commit: str) -> str:
    """The method of a commit: its files and their contents."""
    return git("ls-tree", "-r", commit, "--", *parts())


def frozen(out: Path) -> str:
    """The commit that is measured: the one that a folder began with, and no change."""
    if changed := git("status", "--porcelain", "--", *parts()):
        raise SystemExit(f"commit these first: {changed}")
    commit, file = git("rev-parse", "HEAD"), out / "commit.json"
    if not file.is_file():
        out.mkdir(parents=True, exist_ok=True)
        write_json(file, {"commit": commit})
    first = read_json(file)["commit"]
    if method(first) != method("HEAD"):
        raise SystemExit(f"{out} was begun at {first}; check that out to go on")
    return first


def solve(out: Path, kind: str, seed: int, cases: int) -> int:
    """Make cases of one kind, and solve those that are not solved yet; exit code."""
    wanted = ["--cases", str(cases), "--seed", str(seed), "--least-visibility", LEAST]
    chosen = ["--kinds", kind, "--robots", *ROBOTS]
    return gatjax(["bench", "diagnose", "--out", str(out / kind), *wanted, *chosen])


def keep(out: Path, seed: int, commit: str) -> Path:
    """Write the marks of all cases up to the first one that is not solved; the file."""
    marks = []
    for kind in KINDS:
        made = (out / kind / "set/answers.json").is_file()
        cases = read_cases(out / kind / "set") if made else []
        for case in cases:
            folder = out / kind / "diagnoses" / case.name
            stopped = not (folder / WALL).is_file()
            stopped = stopped or read_json(folder / WALL)["code"] in STOPPED
            if stopped and not (folder / GATJAX.answer).is_file():
                break
            marks.append(mark(case, answer(GATJAX, case, out / kind / "diagnoses")))
    rows = [
        {k: None if v != v else v for k, v in each._asdict().items()} for each in marks
    ]
    facts = {"commit": commit, "seed": seed, "marks": rows}
    file = HERE / "marks" / f"{seed}.json"
    write_json(file, facts)
    return file


def kept(file: Path) -> list[Mark]:
    """The marks of a file; what was not a number is null there."""
    marks = []
    for row in read_json(file)["marks"]:
        numbers = {k: math.nan for k, v in row.items() if v is None and k != "beside"}
        beside = row["beside"] and tuple(row["beside"])
        marks.append(Mark(**{**row, **numbers, "beside": beside}))
    return marks


def draw() -> None:
    """Write the scores of SAMPLE and FRESH, and their pictures."""
    files = [HERE / "marks" / f"{seed}.json" for seed in SAMPLE]
    if len({method(read_json(file)["commit"]) for file in files}) > 1:
        raise SystemExit("the seeds of SAMPLE were not measured with one method")
    every: list[Any] = [row for file in files for row in kept(file)]
    text = tables.document({"gatjax": every})
    write_whole({HERE / "scores.md": text.encode()})
    figures.draw_confusion([m for m in every if m.main], HERE / "confusion.png")
    faint = [row for seed in FAINT for row in kept(HERE / "marks" / f"{seed}.json")]
    figures.draw_detection({"gatjax": [*every, *faint]}, HERE / "detection.png")
    fresh = kept(HERE / "marks" / f"{FRESH}.json")
    write_whole({HERE / "fresh.md": tables.document({"gatjax": fresh}).encode()})
    figures.draw_confusion([m for m in fresh if m.main], HERE / "fresh.png")


def main() -> None:
    """Solve, keep the marks, draw them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="cases and diagnoses")
    parser.add_argument("--seed", type=int, required=True, help="fresh, 1000 apart")
    parser.add_argument("--cases", type=int, default=40, help="of each kind")
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS)
    given = parser.parse_args()
    commit = frozen(given.out)
    for number, kind in enumerate(KINDS, start=1):
        if kind not in given.kinds:
            continue
        if solve(given.out, kind, given.seed + number, given.cases) != 0:
            break  # Ctrl-C: what is solved counts
    file = keep(given.out, given.seed, commit)
    print(tables.document({"gatjax": kept(file)}))
    if given.seed in (*SAMPLE, FRESH):
        draw()


if __name__ == "__main__":
    main()
