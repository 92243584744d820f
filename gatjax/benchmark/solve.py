"""Run a solver on many cases, each in a process of its own, as from outside."""

from __future__ import annotations

import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any, NamedTuple

from gatjax import processors
from gatjax.benchmark.cases import Case
from gatjax.runs import read_json, write_json

WALL = "wall.json"  # seconds of the process, its exit code and last line
PATIENCE = 5.0  # s that a stopped solver has to go


class Solver(NamedTuple):
    """A program that is called with --model --data --held-out --out."""

    name: str
    command: tuple[str, ...]
    answer: str  # file in --out that says it is done


GATJAX = Solver(
    "gatjax", (sys.executable, "-m", "gatjax.cli", "diagnose"), "diagnosis.json"
)
BASELINES = Solver(
    "baselines", (sys.executable, "-m", "gatjax.benchmark.baselines"), "baselines.json"
)


class Answer(NamedTuple):
    """What a solver said of a case; `said` is None where it failed."""

    said: dict[str, Any] | None
    seconds: float  # of the process; nan if unknown
    error: str  # its last line where it failed


def solve(
    solver: Solver,
    cases: Sequence[Case],
    out: Path,
    seed: int,
    jobs: int,
    tell: Callable[[Case, float], None],
) -> None:
    """Run a solver on the cases that have no answer yet.

    Args:
        solver: what to run.
        cases: to solve.
        out: gets a folder for each case, with what the solver wrote, its text in
            log.txt and wall.json.
        seed: passed on.
        jobs: processes at a time.
        tell: called with each case when it is done, and its seconds.

    Raises:
        KeyboardInterrupt: Ctrl-C; the processes are stopped, what is done is kept.
    """
    running: set[subprocess.Popen[bytes]] = set()
    stopped = threading.Event()
    free: queue.SimpleQueue[set[int]] = queue.SimpleQueue()
    for share in processors.shares(jobs) or [set()] * jobs:
        free.put(share)

    def one(case: Case) -> float:
        if stopped.is_set():
            return 0.0
        folder = out / case.name
        folder.mkdir(parents=True, exist_ok=True)
        begun = time.monotonic()
        with open(folder / "log.txt", "wb") as log:
            process = subprocess.Popen(
                command(solver, case, folder, seed), stdout=log, stderr=log
            )
            running.add(process)
            share = free.get()
            if share and process.poll() is None:  # before it counts them
                os.sched_setaffinity(process.pid, share)
            code = process.wait()
            free.put(share)
            running.discard(process)
        seconds = round(time.monotonic() - begun, 2)
        lines = (folder / "log.txt").read_text(errors="replace").split("\n")
        last = next((line for line in reversed(lines) if line.strip()), "")
        done = {"seconds": seconds, "code": code, "line": last}
        write_json(folder / WALL, done)
        return seconds

    open_cases = [c for c in cases if not (out / c.name / solver.answer).is_file()]
    with ThreadPoolExecutor(jobs) as pool:
        begun = {pool.submit(one, case): case for case in open_cases}
        try:
            for future in _finished(begun):
                tell(begun[future], future.result())
        except BaseException:
            stopped.set()
            for future in begun:
                future.cancel()
            for process in list(running):
                _stop(process)
            raise


def command(solver: Solver, case: Case, folder: Path, seed: int) -> list[str]:
    """The command line of a solver for a case."""
    files = ["--data", *map(str, case.fit)]
    if case.held:
        files += ["--held-out", *map(str, case.held)]
    rest = [*files, "--out", str(folder), "--seed", str(seed)]
    return [*solver.command, "--model", str(case.model), *rest]


def answer(solver: Solver, case: Case, out: Path) -> Answer:
    """Read what a solver left of a case."""
    folder = out / case.name
    wall = read_json(folder / WALL) if (folder / WALL).is_file() else {}
    file = folder / solver.answer
    said = read_json(file) if file.is_file() else None
    error = "" if said is not None else str(wall.get("line", "was not run"))
    return Answer(said, float(wall.get("seconds", "nan")), error)


def _finished(begun: dict[Future[float], Case]) -> Iterator[Future[float]]:
    """Futures as they finish, with a pause often enough for Ctrl-C to come through."""
    left = set(begun)
    while left:
        done, left = wait(left, timeout=1.0, return_when=FIRST_COMPLETED)
        yield from done


def _stop(process: subprocess.Popen[bytes]) -> None:
    """End a process that this module started."""
    process.terminate()
    try:
        process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
