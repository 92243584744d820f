"""What a force does to a joint's linear servo: to first order, no simulation is needed.

Laws that a little change of a number turns upside down (rounded targets, ripple along
the angle) have too many starts to simulate them all.
"""

from __future__ import annotations

import numpy as np

from gatjax.diagnosis.joint import STEP, Joint

MEMORY = 0.35  # s that an answer lasts


def answer(joint: Joint, force: np.ndarray) -> np.ndarray:
    """Angle [K] rad after each `STEP` of a force [K] N m, from rest."""
    drive = joint.nominal
    inertia = float(np.mean(joint.grid.inertia)) + drive["armature"]
    resist = drive["kv"] + drive["damping"]
    pull, steer = drive.get("pull", 0.0), drive.get("steer", 0.0)
    h, q, v, out = STEP, 0.0, 0.0, []
    for own in force:
        push = own - drive["kp"] * q
        v = (inertia * v + h * push) / (inertia + h * (resist + h * drive["kp"]))
        off = q
        q += h * (v - pull * off)
        v -= h * steer * off
        out.append(q)
    return np.array(out)
