"""What a standing robot logs besides its joints, measured and simulated alike."""

from __future__ import annotations

import mujoco
import numpy as np

from gatjax.data.recording import Recording
from gatjax.data.trajectories import cut_columns
from gatjax.diagnosis.floor.played import Rows

Channels = dict[str, np.ndarray]
"""Channel name -> [N] at the stamps of a run, SI; see `gatjax.data.mapping`."""
UNITS = {"gyro": "rad/s", "accelerometer": "m/s^2", "orientation": "rad", "force": "N"}
TILT = ("orientation.roll", "orientation.pitch")


def cut(recording: Recording) -> list[Channels]:
    """Channels of a recording beside the joints', one set for each trajectory.

    The order is that of `gatjax.data.trajectories.to_arrays`.
    """
    names = [c for c in recording.columns if c.partition(".")[0] in UNITS]
    return cut_columns(recording, names)


def simulated(model: mujoco.MjModel, rows: Rows, stamps: np.ndarray) -> Channels:
    """The same channels of S simulated worlds, each [S, N] at stamps [N] s.

    Orientation is that of the IMU: roll and pitch against gravity, as its filter would
    find them, and the heading of the torso; rad.
    """
    up = rows.at(stamps, rows.up)
    out = {
        "orientation.roll": np.arctan2(up[..., 1], up[..., 2]),
        "orientation.pitch": np.arctan2(-up[..., 0], np.hypot(up[..., 1], up[..., 2])),
        "orientation.yaw": rows.at(stamps, rows.heading[..., None])[..., 0],
    }
    for family, series in (("gyro", rows.gyro), ("accelerometer", rows.accelerometer)):
        sampled = rows.at(stamps, series)
        axes = zip("xyz", np.moveaxis(sampled, -1, 0), strict=False)
        out |= {f"{family}.{axis}": values for axis, values in axes}
    touch = int(mujoco.mjtSensor.mjSENS_TOUCH)
    names = [
        model.sensor(int(k)).name for k in np.flatnonzero(model.sensor_type == touch)
    ]
    force = np.moveaxis(rows.at(stamps, rows.force), -1, 0)
    return out | {f"force.{name}": f for name, f in zip(names, force, strict=True)}
