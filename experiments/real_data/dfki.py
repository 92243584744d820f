"""DFKI: a pendulum that is told its torque, with one load and with another.

Swing-ups push the pendulum along all the time; people then push it down from upright,
and on its falls the drive brakes, too: only both tell a load from friction. What the
first two runs say of the drive is known when the third one is diagnosed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from logs import parts, swings

from gatjax.cli import main as gatjax
from gatjax.data.recording import read_recording, write_recording
from gatjax.runs import read_json, write_json

HERE = Path(__file__).parent
MODEL = HERE / "models/dfki.xml"
USUAL = {"schema": "gatjax.tolerances/1"}
DRIVE = USUAL | {  # what the light load has told of it is sure
    "kp": 0.0, "kv": 0.0, "limit": 0.0,
    "friction": 0.0, "armature": 0.0,
}  # fmt: skip
LIGHT = ("energy_shaping", "sac")
HEAVY = ("energy_shaping_1kg",)


def swung(names: tuple[str, ...], out: Path) -> list[str]:
    """Write the parts of runs that nobody holds the pendulum in; their files."""
    files = []
    for name in names:
        log = read_recording(HERE / f"data/dfki/{name}.parquet")
        file = out / f"{name}.parquet"
        write_recording(file, parts(log, swings(log, "motor")))
        files.append(str(file))
    return files


def diagnosed(
    start: list[str], names: tuple[str, ...], out: Path, allowed: dict[str, Any]
) -> dict[str, Any]:
    """Diagnose runs from a model or a world, with tolerances that differ."""
    if not (out / "diagnosis.json").is_file():
        logs = out.parent / "logs"
        logs.mkdir(parents=True, exist_ok=True)
        given = ["--data", *swung(names, logs), "--out", str(out)]
        write_json(logs / f"{out.name}.json", allowed)
        given += ["--tolerances", f"{logs}/{out.name}.json"]
        if code := gatjax(["diagnose", *start, *given]):
            raise SystemExit(code)
    return read_json(out / "diagnosis.json")


def compared(out: Path) -> dict[str, Any]:
    """What is wrong with the drive, and what hangs on it in the third run."""
    first = diagnosed(["--model", str(MODEL)], LIGHT, out / "light", USUAL)
    known = ["--world", str(out / "light/world.json")]
    then = diagnosed(known, HEAVY, out / "heavy", DRIVE)
    loads = [row["parameters"]["mass"]
             for row in then["causes"] if row["cause"] == "payload"]  # fmt: skip
    return {
        "mass_change_kg": loads[0]["value"] if loads else None,
        "interval_kg": [loads[0]["low"], loads[0]["high"]] if loads else None,
        "causes": [row["cause"] for row in first["causes"]],
        "heavy": [row["cause"] for row in then["causes"]],
    }
