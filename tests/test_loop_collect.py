"""Walks of a run, recorded once."""

from types import SimpleNamespace

import numpy as np

from gatjax.data.recording import Recording, write_recording
from gatjax.loop.collect import collect
from gatjax.task import Task


def test_walks_that_lost_frames_are_cut_where_they_did(tmp_path):
    time = 0.02 * np.arange(100)
    kept = np.arange(100) != 40  # a frame that did not come
    columns = {
        f"{kind}.HeadYaw": np.sin(time[kept]) for kind in ("command", "position")
    }
    file = tmp_path / "recordings" / "robot_0.parquet"
    file.parent.mkdir()
    metadata = {"robot": "nao", "base": "floating", "rate_hz": 50.0}
    ids = np.zeros(99, np.int64)
    write_recording(file, Recording("walk", time[kept], ids, columns, metadata))
    said = []
    setting = SimpleNamespace(
        folder=tmp_path, task=Task(), robot="nao",
        settings=SimpleNamespace(robot_trajectories=1),
        progress=SimpleNamespace(stage=said.append),
    )  # fmt: skip
    found = collect.__wrapped__(setting, "nao", "robot_0", np.zeros(15))
    assert said == ["robot_0: cut at 1 gaps in time"]
    assert np.unique(found.trajectory, return_counts=True)[1].tolist() == [40, 59]
