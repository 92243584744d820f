"""SO-101: six joints, four motions that nothing was fitted to, and `mujoco.sysid`.

Fitted to chirps, steps, slow and mixed motions; compared half a second ahead and over
whole logs of the rest, beside the model that GAT learns from the same fit data.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from anchor import fitted
from logs import until

from gatjax.cli import main as gatjax
from gatjax.data.recording import Recording, read_recording, write_recording
from gatjax.diagnosis import measure
from gatjax.diagnosis.diagnose import control_period, cut
from gatjax.diagnosis.start import Start, read_start
from gatjax.robot import model as robot_model
from gatjax.runs import read_json, write_json
from gatjax.sim.world import World

HERE = Path(__file__).parent
MODEL = HERE / "models/so101.xml"
HALVES = (
    ("chirp_sweep", "friction_gravity", "large_amplitude"),
    ("step_response", "multisine", "static_holding"),
)
HELD_OUT = ("pick_place", "figure_eight", "prbs_excitation", "backlash_detection")
STEP = 5e-4  # s, of the physics
FREE = {"large_amplitude": 95.0}  # s, until the arm leans on something: see `logs`
TOLERANCES = {  # servos of which others measured one, a zero that hands calibrated
    "schema": "gatjax.tolerances/1", "kp": 0.2, "kv": 0.3, "damping": 0.3,
    "friction": 0.4, "armature": 0.3, "zero": float(np.deg2rad(0.5)), "late": 0.003,
    "angle": float(np.deg2rad(0.25)),
}  # fmt: skip


def logs(names: tuple[str, ...]) -> list[Recording]:
    """Recordings of motions, as far as the arm moves freely.

    From 100 to 110 s of one fit motion Pitch, Elbow and Wrist_Pitch stand still at
    once while the commands go on and their torques rise, to 1.7 N m at Pitch: there is
    something in the way, which no model of the arm has. Nobody gets that part.
    """
    return [
        until(
            read_recording(HERE / f"data/so101/{name}.parquet"), FREE.get(name, np.inf)
        )
        for name in names
    ]


def diagnosed(names: tuple[str, ...], out: Path) -> Path:
    """Diagnose motions; the folder."""
    if not (out / "diagnosis.json").is_file():
        out.mkdir(parents=True, exist_ok=True)
        files = [str(out.parent / f"logs/{name}.parquet") for name in names]
        (out.parent / "logs").mkdir(exist_ok=True)
        for file, log in zip(files, logs(names), strict=True):
            write_recording(file, log)
        write_json(out / "tolerances.json", TOLERANCES)
        given = ["--model", str(MODEL), "--data", *files, "--out", str(out)]
        given += ["--tolerances", f"{out}/tolerances.json"]
        if code := gatjax(["diagnose", *given]):
            raise SystemExit(code)
    return out


def causes(folder: Path) -> dict[str, list[str]]:
    """Causes by joint."""
    found: dict[str, list[str]] = {}
    for row in read_json(folder / "diagnosis.json")["causes"]:
        for joint in row["where"]:
            found.setdefault(joint, []).append(row["cause"])
    return found


def compared(out: Path) -> dict[str, Any]:
    """Held-out errors of all simulations, and what two halves of the data name."""
    fit = (*HALVES[0], *HALVES[1])
    whole = diagnosed(fit, out / "all")
    halves = [diagnosed(half, out / f"half_{k}") for k, half in enumerate(HALVES)]
    joints = robot_model.joint_names(Start(str(MODEL)).model())
    seen, unseen = cut(logs(fit), joints), cut(logs(HELD_OUT), joints)
    anchor, period = fitted(MODEL, seen, out / "sysid.xml"), control_period(seen)
    worlds = {
        name: start.world(period, STEP)
        for name, start in (
            ("nominal", Start(str(MODEL))), ("sysid", Start(str(anchor))),
            ("extended", read_start(whole)),
        )
    }  # fmt: skip
    errors = _errors(worlds, seen, unseen, period)
    told = {
        horizon: {name: float(np.sqrt(e.squared.mean())) for name, e in each.items()}
        for horizon, each in errors.items()
    }
    long = told["whole_log"]
    gain = (long["nominal"] - long["extended"]) / (long["nominal"] - long["learned"])
    return {
        **{f"rmse_{horizon}_vs_sysid": each["extended"] / each["sysid"]
           for horizon, each in told.items()},
        "rmse_rad": told, "share_of_ceiling": gain, "causes": causes(whole),
        "halves": [causes(half) for half in halves],
    }  # fmt: skip


def _errors(
    worlds: dict[str, World], seen: list[Any], unseen: list[Any], period: float
) -> dict[str, dict[str, measure.Errors]]:
    """Errors on held-out runs, half a second ahead and over whole logs."""
    forward, pieces = measure.learn(seen, 0), measure.windows(unseen, period)
    if pieces is None:
        raise SystemExit("the held-out logs have no half second without a gap")
    ahead = {name: measure.windowed(each, pieces, period)
             for name, each in worlds.items()}  # fmt: skip
    ahead["learned"] = measure.learned_windows(forward, pieces, period)
    whole = {name: measure.whole_log(each, unseen) for name, each in worlds.items()}
    whole["learned"] = measure.learned_log(forward, unseen)
    return {
        "half_second": {
            name: measure.window_errors(pieces, angles, 0.5, period)
            for name, angles in ahead.items()
        },
        "whole_log": measure.log_errors(unseen, whole),
    }
