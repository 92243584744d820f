"""BAM: an XL-330 servo with a pendulum, under its authors' protocol.

The diagnosis sees three of four gains (or three of four motions), and is repeated on
the simulation that it extended until it names nothing new. The rest it never sees:
the last simulation plays those logs open loop, whole, at 5 ms, from the first measured
position and speed; the figure is the mean absolute error in degrees.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from pictures import Panel, draw
from rounds import found, repeated

from gatjax.data.readers.assemble import joined
from gatjax.data.recording import Recording, read_recording, write_recording
from gatjax.data.trajectories import to_arrays
from gatjax.diagnosis.measure import stretched
from gatjax.diagnosis.start import Start, read_start
from gatjax.runs import write_json
from gatjax.sim.replay import replay_many
from gatjax.sim.world import World, stacked, stiffened

HERE = Path(__file__).parent
MODEL = HERE / "models/xl330.xml"
PERIOD = 0.005  # s, to which BAM resamples its logs
STEP = 5e-4  # s, of the physics
HELD_OUT: dict[str, Callable[[str], bool]] = {
    "kp200": lambda name: "kp200" in name,
    "drop": lambda name: "lift_and_drop" in name,
}
TOLERANCES = {  # a motor known by its datasheet, a load that was weighed
    "schema": "gatjax.tolerances/1", "kp": 0.1, "kv": 0.15, "limit": 0.1,
    "friction": 1.0, "armature": 0.7, "zero": float(np.deg2rad(0.5)), "late": 0.003,
    "mass": 0.003, "com": 0.0003, "inertia": 0.01, "tilt": 1e-4,
    "angle": float(np.deg2rad(1.0)),
}  # fmt: skip


def even(log: Recording) -> Recording:
    """A log of one run at every 5 ms, its channels interpolated as BAM does."""
    time = np.arange(log.time[0], log.time[-1], PERIOD)
    columns = {
        name: np.interp(time, log.time, values) for name, values in log.columns.items()
    }
    share = log.columns["stiffness.servo"]
    on = np.interp(time, log.time, (share > 0.0).astype(float)) > 0.5
    columns["stiffness.servo"] = on * share.max()
    run = np.zeros(len(time), int)
    return log._replace(time=time - time[0], trajectory=run, columns=columns)


def played(world: World, logs: list[Recording]) -> list[np.ndarray]:
    """Angles [N] of each log, played open loop as a whole, degrees."""
    world, runs = stiffened(world), [to_arrays(log, ("servo",))[0] for log in logs]
    speed = np.stack([log.columns["velocity.servo"][:1] for log in logs])
    command, share = (
        stretched(series, 0)
        for series in ([run.command for run in runs], [run.stiff for run in runs])
    )
    first = np.stack([run.angle[0] for run in runs])
    values = stacked([world.values] * len(runs))
    out = replay_many(world, values, command, first, speed, None, share)
    angle = np.rad2deg(np.asarray(out.reading.angle)[:, :, 0])
    return [row[: len(run.angle)] for row, run in zip(angle, runs, strict=True)]


def errors(world: World, logs: list[Recording]) -> list[float]:
    """Mean absolute error of each log, played open loop as a whole, degrees."""
    return [
        float(np.abs(angle - degrees(log, "position")).mean())
        for angle, log in zip(played(world, logs), logs, strict=True)
    ]


def degrees(log: Recording, channel: str) -> np.ndarray:
    """A channel [N] of a log in degrees."""
    return np.rad2deg(log.columns[f"{channel}.servo"])


def diagnosed(split: str, out: Path) -> dict[str, Any]:
    """Diagnose one split, again and again; held-out errors and causes."""
    out.mkdir(parents=True, exist_ok=True)
    logs = [even(read_recording(f)) for f in sorted((HERE / "data/bam").glob("*.par*"))]
    sets = {
        "held": [log for log in logs if HELD_OUT[split](log.name)],
        "fit": [log for log in logs if not HELD_OUT[split](log.name)],
    }
    write_recording(out / "fit.parquet", joined(sets["fit"], "fit"))
    write_json(out / "tolerances.json", TOLERANCES)
    given = ["--data", f"{out}/fit.parquet", "--tolerances", f"{out}/tolerances.json"]
    rounds, last = repeated(["--model", str(MODEL)], given, out)
    world = read_start(last).world(PERIOD, STEP)
    told = {name: errors(world, some) for name, some in sets.items()}
    held = sets["held"]
    worlds = {"nominal": Start(str(MODEL)).world(PERIOD, STEP), "gatjax": world}
    lines = {name: played(each, held) for name, each in worlds.items()}
    draw([_panel(log, k, lines) for k, log in enumerate(held)], 2, out / "held_out.png")
    return {
        "fit_deg": float(np.mean(told["fit"])),
        "held_out_deg": float(np.mean(told["held"])),
        "logs_deg": dict(zip([log.name for log in sets["held"]], told["held"],
                             strict=True)),
        "causes": [row for folder in rounds for row in found(folder)],
        "rounds": len(rounds),
    }  # fmt: skip


def _panel(log: Recording, number: int, lines: dict[str, list[np.ndarray]]) -> Panel:
    """A held-out log in the picture."""
    mine = {name: angles[number] for name, angles in lines.items()}
    told = {"command": degrees(log, "command"), "measured": degrees(log, "position")}
    return Panel(log.name.split("/")[-1], log.time, told | mine)
