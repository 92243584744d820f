"""Hidden-effect cases: measured robots with an effect that a solver has to name.

They judge the diagnosis, so nothing here shares physics with `sim`, `effects` or the
solver: rigid bodies in MuJoCo C or DART with servo, gear and bristle friction written
out, and a one-joint plant with exact sticking and tooth contact. What the files mean is
in docs/files.md (Bench of the diagnosis).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from gatjax.data.recording import write_recording
from gatjax.runs import check_same, read_json, write_json
from gatjax.surrogate.hidden.answers import answer, document
from gatjax.surrogate.hidden.design import MIX, Case, plan
from gatjax.surrogate.hidden.measure import recording
from gatjax.surrogate.hidden.places import LEAST
from gatjax.surrogate.hidden.robots import ROBOTS, robot
from gatjax.surrogate.hidden.study import Result, run

__all__ = ["MIX", "ROBOTS", "write_cases"]

SCHEMA = "hidden-effects.asked/1"
JOINTS_A_BATCH = 900  # driven joints of all lanes together; bounds the memory
LANES = 14  # of a usual case


def write_cases(
    folder: Path,
    count: int,
    seed: int,
    mix: Mapping[str, float] | None = None,
    robots: Sequence[str] | None = None,
    causes: Sequence[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
    least: float = LEAST,
) -> None:
    """Writes cases with their answers.

    Args:
        folder: gets models/, cases/, answers.json, and asked.json with the choices
            below; cases that it has from the same choices stay as they are.
        count: number of cases.
        seed: of the set; a case depends on it, its index and the choices below only.
        mix: share of each kind (single, null, pair, outside); None: `MIX`.
        robots: they take turns; None: all that hang or are bolted.
        causes: for singles and pairs; None: the whole catalogue.
        progress: called with the number of cases done and of all.
        least: visibility that effects aim at.

    Raises:
        ValueError: an unknown kind, robot or cause, or the folder has other cases.
    """
    robots = robots or [name for name in ROBOTS if not robot(name).floating]
    mix = mix or MIX
    cases = [plan(seed, i, mix, robots, causes, least) for i in range(count)]
    asked = {
        "cases": count, "seed": seed, "mix": dict(mix), "robots": list(robots),
        "causes": causes and list(causes), "least_visibility": least,
    }  # fmt: skip
    (folder / "models").mkdir(parents=True, exist_ok=True)
    entries = _made(folder, asked)
    names = {entry["id"] for entry in entries}
    for name in sorted({case.robot.name for case in cases}):
        text = robot(name).xml
        (folder / "models" / f"{name}.xml").write_text(text, encoding="utf-8")

    def done(case: Case, result: Result) -> None:
        _write(folder / "cases" / case.name, case, result)
        entries.append(answer(case, result))
        write_json(folder / "answers.json", document(entries))
        if progress:
            progress(len(entries), count)

    for batch in _batches([case for case in cases if case.name not in names]):
        run(batch, done)


def _made(folder: Path, asked: dict[str, Any]) -> list[dict]:
    """Answers of the cases that a folder has; refuses other cases than asked for."""
    answers, note = folder / "answers.json", folder / "asked.json"
    asked = {"schema": SCHEMA, **asked}
    if note.exists():
        check_same(read_json(note), asked, folder)
    elif answers.exists():
        raise ValueError(f"{folder}: has cases of unknown origin; choose another")
    write_json(note, asked)
    return read_json(answers)["cases"] if answers.exists() else []


def _batches(cases: Sequence[Case]) -> Iterator[list[Case]]:
    """Cases of one robot and engine together, as many as the memory allows."""
    groups: dict[tuple[str, str], list[Case]] = {}
    for case in cases:
        groups.setdefault((case.robot.name, case.engine), []).append(case)
    for group in groups.values():
        size = max(1, JOINTS_A_BATCH // (LANES * len(group[0].robot.joints)))
        for first in range(0, len(group), size):
            yield group[first : first + size]


def _write(folder: Path, case: Case, result: Result) -> None:
    """Writes the files of one case."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.parquet"):
        old.unlink()
    logs = list(result.fits)
    files = {"fit": logs} if case.one_file else {}
    if not case.one_file:
        files = {f"fit_{number}": [log] for number, log in enumerate(logs)}
    for name, parts in {**files, "held": [result.held]}.items():
        data = recording(case.robot, parts, case.rate)
        write_recording(folder / f"{name}.parquet", data)
    name = case.robot.name
    facts = {"id": case.name, "robot": name, "model": f"models/{name}.xml"}
    text = json.dumps(facts, indent=1)
    (folder / "case.json").write_text(text, encoding="utf-8")
