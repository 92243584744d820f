"""signals.parquet: what the report draws, row by row."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis.gain import Predicted
from gatjax.diagnosis.verdict import Verdict
from gatjax.files import write_whole
from gatjax.sim.world import World

ASTRAY, LOUD = 0.7, 10.0  # of how much a sensor varies, times its noise


def odd_sensors(rows: Sequence[dict[str, Any]], file: str) -> list[dict[str, Any]]:
    """Warnings, as in `data_checks`, of sensors that are nothing like simulated ones.

    Another axis, sign or unit, or feet that are mixed up: no cause of the catalogue.

    Args:
        rows: `signals` of diagnosis.json.
        file: that they are of, in words.
    """
    return [
        {
            "file": file, "level": "warning", "check": "sensor",
            "text": f"{row['name']}: simulated {row['extended_rms']:.3g} {row['unit']} "
            f"rms off, where it varies by {row['measured_rms']:.3g}: look at the axis, "
            f"sign and unit of this column, and whether it is this sensor's",
        }
        for row in rows
        if min(row["extended_rms"], row["measured_rms"]) > LOUD * row["noise"]
        and row["extended_rms"] > ASTRAY * row["measured_rms"]
    ]  # fmt: skip


def grip(world: World) -> list[dict[str, Any]]:
    """A warning, as in `data_checks`, where contacts follow another law."""
    if world.contact is None:
        return []
    cone, ratio = world.contact
    text = (
        f"the feet grip the floor as {cone} friction cones with an impratio of "
        f"{ratio:g} do; the model file says otherwise. Causes, world.json and "
        f'extended.xml go by <option cone="{cone}" impratio="{ratio:g}"/>'
    )
    return [{"file": world.source, "level": "warning", "check": "contact",
             "text": text}]  # fmt: skip


def write_signals(
    path: Path, joints: tuple[str, ...], logs: list[JointRun], unseen: list[JointRun],
    pairs: dict[str, Predicted], verdict: Verdict,
) -> None:  # fmt: skip
    """Write measured, nominal and extended angles, and nominal loads, of all rows.

    Args:
        path: of the file.
        joints: names, J.
        logs: that were explained.
        unseen: held-out.
        pairs: predictions of the nominal and the extended world.
        verdict: gives the loads of the runs that were explained.
    """
    runs = [*logs, *unseen]
    nominal, extended = (
        [*chain(*pairs[name].angles())] for name in ("nominal", "extended")
    )
    columns: dict[str, np.ndarray] = {
        "time": np.concatenate([run.time for run in runs]),
        "trajectory": np.concatenate(
            [np.full(len(run.time), k) for k, run in enumerate(runs)]
        ),
        "part": np.concatenate(
            [np.full(len(run.time), int(k >= len(logs))) for k, run in enumerate(runs)]
        ),
    }
    case = verdict.judge.case
    for j, name in enumerate(joints):
        load = [
            np.interp(run.time - run.time[0], motion.time, weight.nominal.rest[:, j])
            for run, motion, weight in zip(
                case.runs, case.motions, case.loads, strict=True
            )
        ]
        load += [np.full(len(run.time), np.nan) for run in unseen]
        parts = {
            "command": [run.command[:, j] for run in runs],
            "measured": [run.angle[:, j] for run in runs],
            "nominal": [rows[:, j] for rows in nominal],
            "extended": [rows[:, j] for rows in extended],
            "load": load,
        }
        columns |= {f"{key}.{name}": np.concatenate(v) for key, v in parts.items()}
    write_whole({path: partial(parquet.write_table, pa.table(columns))})
