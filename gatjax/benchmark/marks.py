"""Mark one answer against the truth of its case, by the rules of docs/files.md.

A cause counts as named under the verdicts `named` and `ambiguous`; what is listed
beside `unknown` is kept apart (`beside`) and counts neither for nor against.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from gatjax.benchmark.cases import Case
from gatjax.benchmark.solve import Answer

CONFIDENT = 0.8  # probability from which a wrong name is a confident one
WORTH = 0.1  # gain of the oracle from which a gain can be compared
NAMING = ("named", "ambiguous")
RIGHT, WRONG = 1.0, -2.0  # utility; everything unsure is 0


class Mark(NamedTuple):
    """How good one answer is; nan where a number does not apply."""

    case: str
    kind: str  # single, null, pair, outside
    robot: str
    engine: str
    truth: str  # cause, "none", "a + b", or "outside"
    visibility: float  # d; nan on healthy cases
    main: bool  # counts in the main score
    verdict: str  # "failed" where there was no answer
    first: str  # cause named first, "" without
    exact: bool  # the first cause has the true name
    right: bool  # it has, or an accepted one
    joint: bool  # right, and at exactly the true joints
    matched: int  # true causes that were named
    placed: int  # of these, at the true joints
    spurious: int  # named causes that are not there
    probability: float  # of the first cause
    beside: tuple[float, bool] | None  # named beside "unknown": probability, right
    error: float  # relative, of its scored parameter
    covered: float  # 1: the interval covers the truth
    share: float  # held-out gain over the oracle's
    seconds: float
    utility: float
    note: str  # what the solver said when it failed
    located: bool = False  # the first cause is at exactly the joints of a true one
    surest: float = math.nan  # largest probability of a named cause that is not there


def mark(case: Case, answer: Answer) -> Mark:
    """Mark an answer."""
    truth, said = case.truth, answer.said or {}
    verdict = str(said.get("verdict", "failed"))
    listed, there = said.get("causes", []), truth["causes"]
    named = listed if verdict in NAMING else []
    pairs = matching(case, there, named)
    first = named[0] if named else None
    hit = next((t for t, n in pairs if n is first), None) if first else None
    error, covered = _size(hit, first)
    placed = sum(same_place(t["where"], n["where"], case.joints) for t, n in pairs)
    located = first is not None and any(
        same_place(t["where"], first["where"], case.joints) for t in there
    )
    true = [n for _, n in pairs]
    wrong = [float(n["probability"]) for n in named if n not in true]
    return Mark(
        case=case.name,
        kind=truth["kind"],
        robot=truth["robot"],
        engine=truth["engine"],
        truth=_label(truth),
        visibility=math.nan if truth["d"] is None else float(truth["d"]),
        main=bool(truth["in_main_score"]),
        verdict=verdict,
        first=first["cause"] if first else "",
        exact=hit is not None and first is not None and first["cause"] == hit["cause"],
        right=hit is not None,
        joint=hit is not None
        and first is not None
        and same_place(hit["where"], first["where"], case.joints),
        located=located,
        surest=max(wrong, default=math.nan),
        matched=len(pairs),
        placed=placed,
        spurious=len(named) - len(pairs),
        probability=float(first["probability"]) if first else math.nan,
        beside=(float(listed[0]["probability"]), bool(matching(case, there, listed)))
        if listed and not named
        else None,
        error=error,
        covered=covered,
        share=gain_share(truth["oracle"], said.get("gain")),
        seconds=answer.seconds,
        utility=_utility(truth["kind"], verdict, len(there), len(pairs), len(named)),
        note=answer.error,
    )


def matching(
    case: Case, there: Sequence[dict[str, Any]], named: Sequence[dict[str, Any]]
) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Pairs of true and named causes of one class: most pairs, then most joints."""
    accepted = case.truth["accepted"]
    best: list[tuple[dict[str, Any], dict[str, Any]]] = []
    rank = (0, 0, 0)
    size = min(len(there), len(named))
    for chosen in itertools.permutations(range(len(there)), size):
        for places in itertools.combinations(range(len(named)), size):
            found = [
                (there[t], named[n])
                for t, n in zip(chosen, places, strict=True)
                if named[n]["cause"] in accepted[there[t]["cause"]]
            ]
            placed = sum(
                same_place(t["where"], n["where"], case.joints) for t, n in found
            )
            leads = sum(n is named[0] for _, n in found)
            if (len(found), leads, placed) > rank:
                best, rank = found, (len(found), leads, placed)
    return best


def same_place(one: Sequence[str], other: Sequence[str], joints: Sequence[str]) -> bool:
    """Whether two lists of joints mean the same; all joints by name are "all"."""
    sets = [set(joints) if list(names) == ["all"] else set(names)
            for names in (one, other)]  # fmt: skip
    return sets[0] == sets[1]


def gain_share(oracle: Mapping[str, float], gain: Mapping[str, Any] | None) -> float:
    """Held-out gain over that of the oracle; nan where the oracle gains little."""
    if gain is None or oracle["gain"] < WORTH or gain["before"] <= 0.0:
        return math.nan
    return (1.0 - gain["after"] / gain["before"]) / oracle["gain"]


def _size(
    hit: dict[str, Any] | None, first: dict[str, Any] | None
) -> tuple[float, float]:
    """Relative error of the scored parameter, and whether the interval covers it.

    Only where the named cause has the parameter of the true one.
    """
    if hit is None or first is None:
        return math.nan, math.nan
    name = hit["main_parameter"]
    entry = first["parameters"].get(name)
    if entry is None:
        return math.nan, math.nan
    true = hit["parameters"][name]["value"]
    size = abs(true - 1.0) if name == "scale" else abs(true)
    return (
        abs(entry["value"] - true) / max(size, 1e-12),
        float(entry["low"] <= true <= entry["high"]),
    )


def _label(truth: dict[str, Any]) -> str:
    """The truth in a few words."""
    if truth["kind"] == "outside":
        return "outside"
    return " + ".join(cause["cause"] for cause in truth["causes"]) or "none"


def _utility(kind: str, verdict: str, there: int, matched: int, named: int) -> float:
    """Right +1, a name that is wrong -2, unsure or incomplete 0."""
    if verdict == "named":
        if matched < named:
            return WRONG
        return RIGHT if matched == there else 0.0
    sure = {"null": "none", "outside": "unknown"}.get(kind)
    return RIGHT if verdict == sure else 0.0
