"""Walks of a run, recorded once."""

from types import SimpleNamespace

import numpy as np
import pytest

from gatjax.data.recording import Recording, write_recording
from gatjax.loop.collect import _asked, collect
from gatjax.loop.setting import Setting
from gatjax.motions.menu import MENU
from gatjax.runs import Progress
from gatjax.settings import LoopSettings
from gatjax.sim.world import nominal
from gatjax.surrogate import make_robot
from gatjax.surrogate.start import playing
from gatjax.task import Task, task_at


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


@pytest.mark.parametrize("rate_hz", [50.0, 83.3, 100.0])
def test_motions_are_asked_for_at_a_rate_that_robots_know(rate_hz, tmp_path):
    robot = make_robot("stiff", workers=1).hung()
    task, quiet = task_at(rate_hz), Progress(lambda text: None, lambda units: None)
    settings = LoopSettings(rate_hz=rate_hz)
    trial = Setting(tmp_path, settings, task, nominal(task), robot, quiet)
    asked = _asked([trial], robot, next(iter(MENU)), 14.0)
    assert asked.rate_hz == rate_hz
    assert playing(100, asked.rate_hz).control_period == task.control_period
