"""EMPS: a ball screw axis that is told a voltage (nonlinearbenchmark.org).

The diagnosis sees the estimation record alone and names what the published model lacks.
That law is then fitted to the record in open loop, beside a force that fades: what
the named cause leaves differs from one of the record's four equal rounds to the next.
The test record was read for the first time after all this was chosen; nothing changed
since (a new DIR computes the same again). Radians and N m are metres and newtons.

Data and parameters: Janot, Gautier, Brunot, 2019 Workshop on Nonlinear System
Identification Benchmarks. They come without a licence, so the project does not carry
them: run.py says where it looks for them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pictures import Panel, draw
from scipy.io import loadmat
from scipy.optimize import least_squares

from gatjax.cli import main as gatjax
from gatjax.data.recording import Recording, write_recording
from gatjax.runs import read_json, write_json

HERE = Path(__file__).parent
MODEL = HERE / "models/emps.xml"
TOLERANCES = {"schema": "gatjax.tolerances/1", "zero": 0.0, "angle": 5e-5}  # 0.05 mm
DRIVE = 35.150651  # N/V
FREE = 20  # samples that may set the state, and are not scored
ROUNDS = 15600  # samples: two and a half of four equal rounds
STEP = 1e-3  # s
NAMES = "mass", "forward", "backward", "dry", "offset", "fading", "time"
START = np.array([95.1, 200.0, 200.0, 20.4, 0.0, 0.0, 20.0])
SCALE = np.array([5.0, 20.0, 20.0, 2.0, 0.5, 0.5, 10.0])
CONSTANT = slice(0, 5)  # of NAMES: without the force that fades


def record(file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Voltage [T] V and position [T] m of a record, 1 kHz."""
    data = loadmat(file)
    return data["vir"].ravel(), data["qm"].ravel()


def played(x: np.ndarray, volts: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Positions [T, S] m in open loop, from the state that FREE samples tell.

    Args:
        x: [7, S] NAMES of S models: kg, N s/m in either direction, N, N, N, s.
        volts: [T]
        seen: measured positions, [T] m; the first FREE of them are used.
    """
    curve = np.polyfit(STEP * np.arange(FREE), seen[:FREE], 2)
    mass, forward, backward, dry, offset, fading, time = x
    q = np.full(x.shape[1], curve[2])
    v = np.full(x.shape[1], curve[1])
    out = np.empty((len(volts), x.shape[1]))
    for k, told in enumerate(volts):
        out[k] = q
        drift = offset + fading * np.exp(-STEP * k / time)
        free = v + STEP * (DRIVE * told - drift) / mass
        slid = np.maximum(np.abs(free) - STEP * dry / mass, 0.0)
        damping = np.where(free > 0.0, forward, backward)
        v = np.sign(free) * slid / (1.0 + STEP * damping / mass)
        q = q + STEP * v
    return out


def error(x: np.ndarray, volts: np.ndarray, seen: np.ndarray, first: int = 0) -> float:
    """RMSE in mm of the samples from `first` on, but for those that are free."""
    off = (played(x[:, None], volts, seen)[:, 0] - seen)[max(first, FREE) :]
    return 1e3 * float(np.sqrt(np.mean(np.square(off))))


def fitted(
    volts: np.ndarray, seen: np.ndarray, free: slice = slice(None)
) -> np.ndarray:
    """Numbers [7] that play a record best in open loop; `free` ones are fitted."""
    units = np.eye(len(NAMES))[free] * SCALE
    moves = 1e-3 * units

    def full(z: np.ndarray) -> np.ndarray:
        return START + z @ units

    def residual(z: np.ndarray) -> np.ndarray:
        return 1e3 * (played(full(z)[:, None], volts, seen)[:, 0] - seen)

    def slopes(z: np.ndarray) -> np.ndarray:
        both = np.concatenate([full(z) + moves, full(z) - moves])
        found = 1e3 * played(both.T, volts, seen)
        return (found[:, : len(moves)] - found[:, len(moves) :]) / 2e-3

    best = least_squares(residual, np.zeros(len(moves)), slopes, max_nfev=40)
    return full(best.x)


def diagnosed(source: Path, out: Path) -> dict[str, Any]:
    """What gatjax says of the estimation record."""
    if not (out / "diagnosis.json").is_file():
        out.mkdir(parents=True, exist_ok=True)
        volts, seen = record(source / "DATA_EMPS.mat")
        columns = {"command.axis": volts, "position.axis": seen}
        facts = {"robot": "emps", "base": "fixed", "command_unit": "V"}
        time = STEP * np.arange(len(volts))
        log = Recording("emps", time, np.zeros(len(time), int), columns, facts)
        write_recording(out / "estimation.parquet", log)
        write_json(out / "given.json", TOLERANCES)
        given = ["--data", f"{out}/estimation.parquet", "--out", str(out)]
        given += ["--tolerances", f"{out}/given.json"]
        if code := gatjax(["diagnose", "--model", str(MODEL), *given]):
            raise SystemExit(code)
    return read_json(out / "diagnosis.json")


def compared(out: Path, source: Path) -> dict[str, Any]:
    """What is named, the model on the estimation record, and once on the test."""
    said = diagnosed(source, out)
    file = out / "result.json"
    if file.is_file():
        return read_json(file)
    volts, seen = record(source / "DATA_EMPS.mat")
    half = volts[:ROUNDS], seen[:ROUNDS]
    later = {  # fitted to the first rounds, RMSE of the last ones
        name: error(fitted(*half, free), volts, seen, ROUNDS)
        for name, free in (("constant", CONSTANT), ("fading", slice(None)))
    }
    model = fitted(volts, seen, slice(None) if later["fading"] < later["constant"]
                   else CONSTANT)  # fmt: skip
    test = record(source / "DATA_EMPS_PULSES.mat")
    draw([_panel("estimation record", model, volts, seen),
          _panel("test record", model, *test)], 1, out / "emps.png")  # fmt: skip
    told = {
        "causes": [
            {"cause": row["cause"], "parameters": row["parameters"]}
            for row in said["causes"]
        ],
        "model": dict(zip(NAMES, model.tolist(), strict=True)),
        "last_rounds_mm": later,
        "train_rmse_mm": error(model, volts, seen),
        "test_rmse_mm": error(model, *test),
    }
    write_json(file, told)
    return told


def _panel(title: str, x: np.ndarray, volts: np.ndarray, seen: np.ndarray) -> Panel:
    """A record played open loop, in the picture: mm."""
    lines = {"measured": seen, "gatjax": played(x[:, None], volts, seen)[:, 0]}
    time = STEP * np.arange(len(seen))
    return Panel(title, time, {name: 1e3 * q for name, q in lines.items()}, "mm")
