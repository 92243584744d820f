"""`gatjax bench diagnose`: cases with hidden effects, diagnosed and scored."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gatjax.benchmark import figures, scores, tables
from gatjax.benchmark.cases import Case, make, read_cases
from gatjax.benchmark.marks import Mark, mark
from gatjax.benchmark.solve import BASELINES, GATJAX, Answer, Solver, answer, solve
from gatjax.cli.arguments import BenchDiagnose
from gatjax.cli.progress import shown
from gatjax.runs import check_same, digest, read_json, write_json, write_whole

SCHEMA = "gatjax.bench.diagnose/1"
CASES = 20  # that are made if nobody says how many


def measure(verb: BenchDiagnose) -> None:
    """Make or read cases, solve them, score the answers."""
    cases = _cases(verb)
    _check_out(verb, cases)
    print(f"{len(cases)} cases in {verb.folder or verb.out / 'set'}", flush=True)
    _solve(GATJAX, cases, verb)
    marks = {"gatjax": [mark(c, _answer(GATJAX, c, verb.out)) for c in cases]}
    if verb.baselines:
        _solve(BASELINES, cases, verb)
        marks |= _baselines(cases, verb.out)
    write(verb.out, marks)
    print((verb.out / "scores.md").read_text(encoding="utf-8"))
    names = ("scores.md", "scores.json", "confusion.png", "detection.png")
    drawn = [name for name in names if (verb.out / name).exists()]
    print(f"{verb.out}: {', '.join(drawn)}, diagnoses/<case>/report.html")


def _cases(verb: BenchDiagnose) -> list[Case]:
    """The cases that the command line means."""
    folder = verb.folder
    if folder is not None:
        usual = verb.least_visibility == BenchDiagnose.least_visibility
        if verb.causes or not usual:
            flag = "--causes" if verb.causes else "--least-visibility"
            raise ValueError(f"{flag} chooses what is made; leave it out with --folder")
        return read_cases(folder, verb.kinds, verb.robots)[: verb.cases]
    folder, count = verb.out / "set", CASES if verb.cases is None else verb.cases
    wanted = {
        "cases": count,
        "seed": verb.seed,
        "kinds": list(verb.kinds),
        "robots": list(verb.robots),
        "causes": list(verb.causes),
        "least_visibility": verb.least_visibility,
    }
    with shown(float(count)) as progress:
        progress.stage("make cases")

        def tell(done: int, total: int) -> None:
            progress.work(1.0)
            if done == total or done % 10 == 0:
                progress.stage(f"make cases: {done} of {total}")

        make(folder, wanted, tell)
    return read_cases(folder)


def _check_out(verb: BenchDiagnose, cases: Sequence[Case]) -> None:
    """Refuse to mix diagnoses of different cases or seeds in one folder."""
    file = verb.out / "config.json"
    folder = verb.folder or verb.out / "set"
    config = {"schema": SCHEMA, "folder": str(folder.resolve()), "seed": verb.seed}
    config["truth"] = {case.name: digest(case.truth) for case in cases}
    if file.exists():
        before = read_json(file)
        known = before.get("truth", {})
        config["truth"] = known | config["truth"]
        check_same({**before, "truth": config["truth"] | known}, config, verb.out)
    elif any((verb.out / "diagnoses" / case.name).exists() for case in cases):
        raise ValueError(
            f"{verb.out}: holds diagnoses of unknown cases; choose another"
        )
    write_json(file, config)


def _solve(solver: Solver, cases: Sequence[Case], verb: BenchDiagnose) -> None:
    """Run a solver on what it has not solved yet."""
    out = _place(solver, verb.out)
    left = [c for c in cases if not (out / c.name / solver.answer).is_file()]
    if not left:
        print(f"{solver.name}: all {len(cases)} cases are solved already", flush=True)
        return
    with shown(sum(map(_effort, left))) as progress:
        progress.stage(f"{solver.name}: {len(left)} of {len(cases)} cases to solve")

        def tell(case: Case, seconds: float) -> None:
            progress.work(_effort(case))
            found = answer(solver, case, out)
            said = (found.said or {}).get("verdict", "")
            said = said or ("solved" if found.said else f"no answer: {found.error}")
            progress.stage(
                f"{case.name} {case.truth['robot']}: {said} ({seconds:.0f} s)"
            )

        solve(solver, left, out, verb.seed, verb.jobs, tell)


def _effort(case: Case) -> float:
    """About how much work a case is: the start of a process, then each joint."""
    return 2.0 + len(case.joints)


def _place(solver: Solver, out: Path) -> Path:
    """Where a solver's answers lie."""
    return out / ("diagnoses" if solver is GATJAX else solver.name)


def _answer(solver: Solver, case: Case, out: Path) -> Answer:
    return answer(solver, case, _place(solver, out))


def _baselines(cases: Sequence[Case], out: Path) -> dict[str, list[Mark]]:
    """Marks of every simpler method."""
    found = [_answer(BASELINES, case, out) for case in cases]
    names = next((list(each.said["answers"]) for each in found if each.said), [])
    marks = {}
    for name in names:
        answers = [
            each._replace(
                said=each.said["answers"][name] if each.said else None,
                seconds=each.said["answers"][name]["seconds"]
                if each.said
                else math.nan,
            )
            for each in found
        ]
        marks[name] = [mark(c, a) for c, a in zip(cases, answers, strict=True)]
    return marks


def write(out: Path, marks: Mapping[str, Sequence[Mark]]) -> None:
    """Write scores.md, scores.json and the pictures.

    Args:
        out: folder.
        marks: of each solver by its name; the first one is the one in question.
    """
    own = [m for m in next(iter(marks.values())) if m.main]
    text = tables.document(marks)
    write_whole({out / "scores.md": text.encode("utf-8")})
    tree = {name: _tree(given) for name, given in marks.items()}
    write_json(out / "scores.json", _plain({"schema": SCHEMA, "solvers": tree}))
    figures.draw_confusion(own, out / "confusion.png")
    figures.draw_detection(marks, out / "detection.png")


def _tree(marks: Sequence[Mark]) -> dict[str, Any]:
    """Everything about one solver."""
    main = [m for m in marks if m.main]
    rows, columns, counts = scores.confusion(main)
    return {
        "main": [s._asdict() for s in scores.summary(main)],
        "lively": [
            s._asdict() for s in scores.summary(tables.visible(marks, tables.LIVELY))
        ],
        "visibility": scores.by_visibility(marks),
        "by": {field: scores.groups(main, field) for field in tables.FIELDS},
        "reliability": scores.reliability(main),
        "confusion": {"true": rows, "said": columns, "cases": counts.tolist()},
        "cases": [m._asdict() for m in marks],
    }


def _plain(value: Any) -> Any:
    """A tree for json: records as dicts, nan and infinity as null."""
    if hasattr(value, "_asdict"):
        return _plain(value._asdict())
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
