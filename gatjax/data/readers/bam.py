"""BAM JSON: one servo with a pendulum, one file a run (github.com/Rhoban/bam)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from gatjax.data.readers.source import Source, Stream

JOINT = "servo"
GAIN = "gain"  # signal: kp while the torque is on, else 0
DRAFT: dict[str, dict[str, Any]] = {
    f"command.{JOINT}": {"from": "goal_position", "unit": "rad"},
    f"position.{JOINT}": {"from": "position", "unit": "rad"},
    f"velocity.{JOINT}": {"from": "speed", "unit": "rad/s"},
    f"temperature.{JOINT}": {"from": "temp", "unit": "degC"},
    "voltage": {"from": "input_volts", "unit": "V"},
}
FACTS = ("motor", "trajectory", "mass", "length", "arm_mass", "kp", "vin")
USUAL = {"xl330": 400.0, "xm": 800.0}
"""P gains ex works that are not 32, by the begin of a servo's name (e-manuals)."""


def is_bam(tree: Any) -> bool:
    """Whether a JSON is such a log."""
    return isinstance(tree, dict) and isinstance(tree.get("entries"), list)


def read(path: Path) -> Source:
    """Read one log.

    What is commanded while the torque is off moves nothing: the gain is 0 there.

    Raises:
        ValueError: one line: another JSON, or no rows.
    """
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: not JSON: {error}") from error
    if not is_bam(tree):
        raise ValueError(f"{path}: a BAM log has a list 'entries'; this has none")
    rows, notes = tree["entries"], []
    if len(rows) < 2 or not all(isinstance(row, dict) for row in rows):
        raise ValueError(f"{path}: 'entries' is no list of two rows or more")
    time = _column(rows, "timestamp", path)
    run = {
        name: Stream(time, _column(rows, name, path))
        for name, value in rows[0].items()
        if name not in ("timestamp", "torque_enable") and not isinstance(value, str)
    }
    on = np.array([bool(row.get("torque_enable", True)) for row in rows])
    if not on.all():
        notes.append(
            f"{path}: the torque is off in {int((~on).sum())} rows, the first of them "
            f"row {int(np.argmin(on)) + 1}; the stiffness is 0 there"
        )
    draft = {column: entry for column, entry in DRAFT.items() if entry["from"] in run}
    usual = _usual(tree)
    gain = tree["kp"] if _number(tree.get("kp")) else usual
    run[GAIN] = Stream(time, float(gain) * on)
    draft[f"stiffness.{JOINT}"] = {"from": GAIN, "scale": 1.0 / usual}
    notes.append(f"a stiffness of 1 is a P gain of {usual:g}")
    facts = {name: tree[name] for name in FACTS if name in tree}
    metadata = {"robot": f"bam {tree.get('motor', '')}".strip(), "base": "fixed"}
    return Source(str(path), "BAM JSON", [run], draft, metadata | facts, notes)


def _usual(tree: dict[str, Any]) -> float:
    """P gain that counts as 1: the usual one of the servo; 32 if it is unknown."""
    motor = str(tree.get("motor", "")).lower().replace("-", "")
    gains = (gain for name, gain in USUAL.items() if motor.startswith(name))
    return next(gains, 32.0)


def _column(rows: list[dict[str, Any]], name: str, path: Path) -> np.ndarray:
    """A number of all rows."""
    try:
        return np.array([float(row[name]) for row in rows])
    except (KeyError, TypeError, ValueError) as error:
        row = next(k for k, each in enumerate(rows) if not _number(each.get(name)))
        raise ValueError(f"{path}: entry {row + 1} has no number {name!r}") from error


def _number(value: Any) -> bool:
    """Whether a JSON value is a number."""
    return isinstance(value, int | float) and not isinstance(value, bool)
