"""What a diagnosis found, as lines of text for a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

FEW = 3  # smallest effects that are told
MANY = 4  # values of a cause that are told in one row
HEADINGS = ("cause", "where", "value", "90 % interval", "probability", "could also be")


def named_lines(causes: Sequence[Mapping[str, Any]]) -> list[str]:
    """A table of the named causes, one line for each parameter; none without causes."""
    if not causes:
        return []
    rows: list[Sequence[str]] = [HEADINGS]
    for cause in _together(causes):
        head = (str(cause["cause"]), ", ".join(cause["where"]))
        tail = (f"{cause['probability']:.2f}", ", ".join(cause["equivalent"]) or "-")
        for name, entry in cause["parameters"].items():
            unit = "" if entry["unit"] == "1" else f" {entry['unit']}"
            sizes = entry["values"] if "values" in entry else [entry["value"]]
            told = dict.fromkeys(f"{one:.3g}" for one in sizes)
            value = f"{name} {' to '.join(told)}{unit}"
            ends = f"{entry['low']:.3g} to {entry['high']:.3g}"
            if entry["low"] == entry["high"]:
                ends = ""  # says which variant, was not measured
            rows.append((*head, value, ends, *tail))
            head, tail = ("", ""), ("", "")
    return aligned(rows)


def _together(causes: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The causes; one that has many values in one row, with the least and the largest.

    The intervals reach from the lowest end to the highest; diagnosis.json has each.
    """
    laws: dict[tuple, list[Mapping[str, Any]]] = {}
    for cause in causes:
        laws.setdefault((cause["cause"], cause.get("variant")), []).append(cause)
    rows: list[Mapping[str, Any]] = []
    for group in laws.values():
        if len(group) < MANY:
            rows += group
            continue
        sizes = {name: [c["parameters"][name] for c in group]
                 for name in group[0]["parameters"]}  # fmt: skip
        parameters = {
            name: {
                "values": [f(each["value"] for each in some) for f in (min, max)],
                "low": min(each["low"] for each in some),
                "high": max(each["high"] for each in some), "unit": some[0]["unit"],
            }
            for name, some in sizes.items()
        }  # fmt: skip
        where = [place for cause in group for place in cause["where"]]
        rows.append({
            **group[0], "parameters": parameters,
            "where": [*where[:3], f"{len(where) - 3} more"],
            "probability": min(cause["probability"] for cause in group),
        })  # fmt: skip
    return rows


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows of cells as lines, columns under each other."""
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    return [
        "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def unseen_lines(found: Mapping[str, Any]) -> list[str]:
    """What may be there although nothing was found: sizes that would have shown."""
    rows = found["smallest_effects"]
    if found["verdict"] != "none" or not rows:
        return []
    some = "; ".join(_least(row) for row in rows[:FEW])
    return [
        f"unseen     smaller faults may be there; to be named it takes about {some}"
    ]


def _least(row: Mapping[str, Any]) -> str:
    unit = "" if row["unit"] == "1" else f" {row['unit']}"
    name = str(row["cause"]).replace("_", " ")
    place = ", ".join(row["where"])
    return f"{name} {row['value']:.2g}{unit} ({row['parameter']}) at {place}"


def gain_lines(gain: Mapping[str, Any] | None, held: bool) -> list[str]:
    """What the extended simulation gains on held-out logs, if there are any."""
    if gain is None and held:
        return ["gain       not measured: a robot falls at the start of the held-out"]
    if gain is None:
        return ["gain       not measured: give logs of another motion as --held-out"]
    before, after = gain["before"], gain["after"]
    share = 1.0 - after / before if before > 0.0 else 0.0
    lines = [
        f"gain       held-out error {_degrees(before)} -> {_degrees(after)} deg rms, "
        f"{_less(share)} (95 % interval: {_less(gain['low'])} to "
        f"{_less(gain['high'])})"
    ]
    alone = gain.get("without_calibration")
    if alone is not None:
        lines.append(
            f"           {_degrees(alone)} deg with the causes alone, "
            f"without the numbers fitted again beside them"
        )
    learned = gain.get("learned_ceiling")
    if learned is not None:
        floor = _degrees(gain["noise_floor"])
        lines.append(
            f"           a learned model reaches {_degrees(learned)} deg"
            f"{', worse than the nominal one' if learned > before else ''}; noise is "
            f"{floor} deg"
        )
    if not gain.get("promoted", True):
        lines.append(
            "           no gain is proven: keep the old simulation, or record more"
        )
    return lines


def _less(share: float) -> str:
    """How much less of an error there is, or more."""
    return f"{abs(share):.0%} {'less' if share >= 0.0 else 'more'}"


def closeness_lines(file: Path) -> list[str]:
    """Where it says what a simulation leaves, if it does."""
    if not file.is_file():
        return []
    return [
        f"how close  {file}: what it leaves of the angles; with --world and "
        f"--tolerances a later diagnosis names what changed beyond that"
    ]


def fallback_lines(offer: Mapping[str, Any] | None, out: Path) -> list[str]:
    """What a learned correction gains where no cause explains a joint."""
    if offer is None:
        return []
    if offer["world"] is None:
        return ["fallback   none: a learned correction predicts unseen rows no better"]
    place = f"{out / offer['world']}: use it as --world"
    if "after" not in offer:
        return [f"fallback   a learned correction on top; {place}"]
    before, after = offer["before"], offer["after"]
    return [
        f"fallback   a learned correction on top: {_degrees(before)} -> "
        f"{_degrees(after)} deg rms (95 % interval: {_less(offer['low'])} to "
        f"{_less(offer['high'])})",
        f"           {place}",
    ]


def next_lines(advice: Mapping[str, Any] | None) -> list[str]:
    """The motion that would settle more, and how to get it."""
    if advice is None:
        return []
    return [
        f"next       {advice['why']}",
        f"           its targets: {advice['command']}",
    ]


def _degrees(angle: float) -> str:
    """An angle in rad as degrees."""
    return f"{math.degrees(angle):.3g}"
