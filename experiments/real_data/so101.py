"""SO-101: six joints, four motions that nothing was fitted to, and `mujoco.sysid`.

Fitted to chirps, steps, slow and mixed motions; compared half a second ahead and over
whole logs of four others, beside the model that GAT learns from the same fit data. Two
more of its motions are in data/ for whoever wants them, and unused here.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from anchor import fitted
from logs import parts
from pictures import Panel, draw

from gatjax.cli import main as gatjax
from gatjax.data.recording import Recording, read_recording, write_recording
from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import measure
from gatjax.diagnosis.given import control_period, cut
from gatjax.diagnosis.start import Start, read_start
from gatjax.grounding.network import Network
from gatjax.robot import model as robot_model
from gatjax.runs import read_json
from gatjax.sim.world import World

HERE = Path(__file__).parent
MODEL = HERE / "models/so101.xml"
HALVES = (
    ("chirp_sweep", "friction_gravity", "large_amplitude"),
    ("step_response", "multisine", "static_holding"),
)
HELD_OUT = ("pick_place", "figure_eight", "prbs_excitation", "backlash_detection")
STEP = 5e-4  # s, of the physics
INKED = {"nominal": "nominal", "sysid": "mujoco.sysid", "extended": "gatjax"}
SHOWN = (  # in the picture: held-out log, joint, from and to s
    ("pick_place", "Pitch", 0.0, 30.0), ("pick_place", "Elbow", 0.0, 30.0),
    ("pick_place", "Jaw", 0.0, 30.0), ("figure_eight", "Rotation", 0.0, 30.0),
    ("backlash_detection", "Elbow", 60.0, 90.0), ("prbs_excitation", "Jaw", 0.0, 15.0),
)  # fmt: skip
FREE = {"large_amplitude": 95.0}  # s, until the arm leans on something: see `logs`
# Servos of which others measured one, a zero that hands calibrated.
TOLERANCES = HERE / "models/so101.tolerances.json"


def logs(names: tuple[str, ...]) -> list[Recording]:
    """Recordings of motions, as far as the arm moves freely.

    From 100 to 110 s of one fit motion Pitch, Elbow and Wrist_Pitch stand still at
    once while the commands go on and their torques rise, to 1.7 N m at Pitch: there is
    something in the way, which no model of the arm has. Nobody gets that part.
    """
    every = [read_recording(HERE / f"data/so101/{name}.parquet") for name in names]
    return [
        parts(log, [(log.time[0], FREE.get(name, np.inf))])
        for name, log in zip(names, every, strict=True)
    ]


def diagnosed(names: tuple[str, ...], out: Path) -> Path:
    """Diagnose motions; the folder."""
    if not (out / "diagnosis.json").is_file():
        out.mkdir(parents=True, exist_ok=True)
        files = [str(out.parent / f"logs/{name}.parquet") for name in names]
        (out.parent / "logs").mkdir(exist_ok=True)
        for file, log in zip(files, logs(names), strict=True):
            write_recording(file, log)
        given = ["--model", str(MODEL), "--data", *files, "--out", str(out)]
        given += ["--tolerances", str(TOLERANCES)]
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
    forward = measure.learn(seen, 0)
    begun = [run._replace(within=True) for run in unseen]  # where the arm was seen
    played = {name: measure.whole_log(each, begun) for name, each in worlds.items()}
    draw(_panels(begun, played, joints), 3, out / "so101.png")
    played["learned"] = measure.learned_log(forward, begun)
    errors = {
        "half_second": _ahead(worlds, forward, unseen, period),
        "whole_log": measure.log_errors(begun, played),
        "whole_log_from_rest": measure.log_errors(unseen, {
            name: measure.whole_log(each, unseen) for name, each in worlds.items()
        }),
    }  # fmt: skip
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


def _ahead(
    worlds: dict[str, World], forward: Network, unseen: list[JointRun], period: float
) -> dict[str, measure.Errors]:
    """Errors on held-out runs, half a second ahead."""
    pieces = measure.windows(unseen, period)
    if pieces is None:
        raise SystemExit("the held-out logs have no half second without a gap")
    ahead = {name: measure.windowed(each, pieces, period)
             for name, each in worlds.items()}  # fmt: skip
    ahead["learned"] = measure.learned_windows(forward, pieces, period)
    return {
        name: measure.window_errors(pieces, angles, 0.5, period)
        for name, angles in ahead.items()
    }


def _panels(
    unseen: list[JointRun], played: dict[str, list[np.ndarray]], joints: Sequence[str]
) -> list[Panel]:
    """The picture's panels; whole logs are played open loop."""
    out = []
    for name, joint, begin, end in SHOWN:
        log, column = HELD_OUT.index(name), list(joints).index(joint)
        run = unseen[log]
        time = run.time - run.time[0]
        rows = (time >= begin) & (time <= end)
        lines = {"command": run.command, "measured": run.angle}
        lines |= {INKED[kind]: angles[log] for kind, angles in played.items()}
        degrees = {kind: np.rad2deg(v[rows, column]) for kind, v in lines.items()}
        out.append(Panel(f"{joint}, {name}", time[rows], degrees))
    return out
