"""The sentence of a verdict, made of the rows of diagnosis.json."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gatjax.diagnosis.verdict import CERTAIN, Verdict

Row = dict[str, Any]
BESIDE = ("viscous",)  # parameters as large as the main one: it may be 0 beside them


def sentence(verdict: Verdict, rows: list[Row], aside: list[Row]) -> str:
    """A verdict in one sentence that a person understands.

    Args:
        verdict: of the diagnosis.
        rows: of `causes`.
        aside: of `left_aside`.
    """
    return "; ".join([_found(verdict, rows)[:-1], *_without(verdict, aside)]) + "."


def _found(verdict: Verdict, rows: list[Row]) -> str:
    """What is wrong."""
    fits = [row for row in rows if row["borne_out"] is not False]
    sure, likely, doubtful = (
        " and ".join(map(_phrase, _alike(some)))
        for some in (
            [row for row in fits if row["probability"] >= CERTAIN],
            [row for row in fits if row["probability"] < CERTAIN],
            [row for row in rows if row["borne_out"] is False],
        )
    )
    every = " and ".join(part for part in (sure, likely, doubtful) if part)
    names = [verdict.judge.joints[k].name for k in verdict.unexplained]
    left = ", ".join(names[:4]) + (" and others" if len(names) > 4 else "")
    if not (rows or names):
        return (
            "The simulation agrees with the logs within its tolerances, as far as "
            "these motions show it."
        )
    if verdict.verdict == "named" and not names:
        return f"The simulation lacks {every}."
    if not names:
        doubt = "the logs leave a doubt"
        if doubtful:
            borne = f"out {doubtful}" if sure or likely else "it out"
            doubt = f"the held-out logs do not bear {borne}"
        probable = all(row["probability"] > 0.5 for row in rows)
        lacks = "most likely lacks" if probable else "may lack"
        return f"The simulation {lacks} {every}, but {doubt}."
    parts = [f"the simulation lacks {sure}"] if sure else []
    if likely:
        parts.append(f"{'it' if sure else 'the simulation'} may lack {likely}")
    if doubtful:
        parts.append(f"{doubtful} would fit, but does not predict the held-out logs")
    text = f"something at {left} is wrong that no cause of the catalogue explains"
    if verdict.law is not None:
        text += f"; it looks like {verdict.law.hypothesis.variant}"
    whole = "; ".join([*parts, f"besides, {text}" if sure or likely else text])
    return f"{whole[0].upper()}{whole[1:]}."


def _without(verdict: Verdict, aside: list[Row]) -> list[str]:
    """Some words for each joint of which pieces do not count."""
    told: dict[str, list[str]] = {}
    for row in aside:
        log = f"trajectory {row['trajectory']} of {Path(row['log']).name}"
        when = f"{row['from']:.0f} to {row['to']:.0f} s of {log}"
        told.setdefault(row["joint"], []).append(when)
    return [
        f"at {joint} nothing explains {len(when)} of {len(verdict.judge.case.runs)} "
        f"pieces, left aside: {', '.join(when)}"
        for joint, when in told.items()
    ]


def _alike(rows: list[Row]) -> list[list[Row]]:
    """Rows in groups that one phrase tells: a cause with its values at some joints."""
    groups: dict[tuple, list[Row]] = {}
    for row in rows:
        key = row["cause"], row["variant"], tuple(row["equivalent"])
        groups.setdefault(key, []).append(row)
    return list(groups.values())


def _phrase(rows: list[Row]) -> str:
    """A cause in words: name, sizes, places, alternatives."""
    row = rows[0]
    main, *rest = row["parameters"]
    shown = [main, *(name for name in rest if name in BESIDE)]
    places = [place for each in rows for place in each["where"]]
    where = ", ".join(places[:4]) + (" and others" if places[4:] else "")
    where = "all joints" if where == "all" else where
    alike = " or ".join(row["equivalent"]).replace("_", " ")
    other = f" (or {alike})" if alike else ""
    words = row["cause"].replace("_", " ")
    size = " and ".join(_size(rows, name, words) for name in shown)
    return f"{words} of {size} at {where}{other}"


def _size(rows: list[Row], name: str, words: str) -> str:
    """A parameter in words: its values, unit, and name if the cause's has it not."""
    values = [row["parameters"][name] for row in rows]
    sizes = sorted(each["value"] for each in values)
    unit = "" if values[0]["unit"] == "1" else f" {values[0]['unit'].replace('*', ' ')}"
    size = " to ".join(dict.fromkeys(f"{one:.3g}" for one in (sizes[0], sizes[-1])))
    return size + unit + ("" if name in words else f" ({name})")
