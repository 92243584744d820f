"""What logs hold besides angles: speeds and torques. Shown, never fitted.

Firmware filters speeds, and torques come from currents: how they scale is the
robot's own. That the extended world comes nearer to them is a test it was not made for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gatjax.data.recording import Recording
from gatjax.data.sampling import noise_of
from gatjax.data.trajectories import cut_columns
from gatjax.diagnosis.measure import Replayed

UNITS = {"velocity": "rad/s", "torque": "N m"}


def signals(
    played: Mapping[str, Sequence[Replayed]], files: Sequence[Recording],
    joints: Sequence[str],
) -> list[dict[str, Any]]:  # fmt: skip
    """RMS of measured minus simulated speed and torque over whole logs, open loop.

    Args:
        played: all trajectories of the files, in order, by the worlds `nominal` and
            `extended`.
        files: the recordings.
        joints: of the model.

    Returns:
        Rows of `signals` of diagnosis.json, of the columns that all files have.
    """
    names = [
        f"{family}.{joint}"
        for family in UNITS
        for joint in joints
        if all(f"{family}.{joint}" in log.columns for log in files)
    ]
    if not names:
        return []
    told = [part for log in files for part in cut_columns(log, names)]

    def row(name: str) -> dict[str, Any]:
        family, _, joint = name.partition(".")
        at = list(joints).index(joint)
        left = {
            f"{key}_rms": float(np.sqrt(np.mean(np.square(np.concatenate([
                part[name] - getattr(run, family)[:, at]
                for part, run in zip(told, every, strict=True)
            ])))))
            for key, every in played.items()
        }  # fmt: skip
        noise = noise_of([part[name] for part in told])
        varies = float(np.std(np.concatenate([part[name] for part in told])))
        about = {"name": name, "unit": UNITS[family], "noise": noise,
                 "measured_rms": varies}  # fmt: skip
        return about | {"tolerance_rms": None} | left

    return [row(name) for name in names]
