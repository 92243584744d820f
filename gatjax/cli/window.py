"""A walk in MuJoCo's own window."""

from __future__ import annotations

import os
import sys
import time
from typing import Any

import mujoco
import mujoco.viewer
import numpy as np


def play(model: mujoco.MjModel, qpos: np.ndarray, period: float) -> None:
    """Show states [T, nq], one each `period` s, again and again until closed."""
    shown = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform.startswith("linux") and not shown:
        raise RuntimeError("no display for --live; leave it out and write .html")
    data: Any = mujoco.MjData(model)
    with mujoco.viewer.launch_passive(model, data) as window:
        frame = 0
        while window.is_running():
            data.qpos[:] = qpos[frame % len(qpos)]
            mujoco.mj_kinematics(model, data)
            window.sync()
            time.sleep(period)
            frame += 1
