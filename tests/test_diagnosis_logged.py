"""Speeds and torques that a log holds beside its angles."""

import numpy as np
import pytest
from test_diagnosis_measure import COMMAND, MODEL, TIME

from gatjax.data.recording import Recording
from gatjax.data.trajectories import JointRun, to_arrays
from gatjax.diagnosis.logged import signals
from gatjax.diagnosis.measure import replayed
from gatjax.diagnosis.signals import odd_sensors
from gatjax.report.diagnosis.bars import signal_picture
from gatjax.sim.world import add_cause, nominal
from gatjax.task import Task


@pytest.fixture
def made(tmp_path):
    """Worlds, and a log of the extended one with noise on its speed and torque."""
    path = tmp_path / "arm.xml"
    path.write_text(MODEL)
    plain = nominal(Task(control_period=0.01), path)
    slow = add_cause(plain, "viscous_friction", ["a"], {"coefficient": 1.0})
    (seen,) = replayed(slow, [JointRun(0, TIME, COMMAND, 0.0 * COMMAND)])
    noise = np.random.default_rng(0).normal(size=(2, 300))
    columns = {
        "command.a": COMMAND[:, 0], "position.a": seen.angle[:, 0],
        "velocity.a": seen.velocity[:, 0] + 0.02 * noise[0],
        "torque.a": seen.torque[:, 0] + 0.05 * noise[1],
    }  # fmt: skip
    log = Recording("x.parquet", TIME, np.zeros(300, int), columns, {})
    return {"nominal": plain, "extended": slow}, log


def played(worlds, log):
    runs = 2 * to_arrays(log, ["a"])
    return {name: replayed(world, runs) for name, world in worlds.items()}


def test_what_is_left_of_speed_and_torque(made):
    worlds, log = made
    rows = signals(played(worlds, log), [log, log], ["a"])
    assert [(row["name"], row["unit"]) for row in rows] == [
        ("velocity.a", "rad/s"), ("torque.a", "N m")
    ]  # fmt: skip
    for row, noise in zip(rows, (0.02, 0.05), strict=True):
        assert row["extended_rms"] == pytest.approx(noise, rel=0.1)
        assert row["noise"] == pytest.approx(noise, rel=0.35)
        assert row["nominal_rms"] > 3.0 * noise and row["tolerance_rms"] is None
    assert "<svg" in signal_picture([*rows, rows[0] | {"noise": 0.0}])


def test_what_one_file_lacks_is_not_shown(made):
    worlds, log = made
    less = {k: v for k, v in log.columns.items() if k != "torque.a"}
    rows = signals(played(worlds, log), [log, log._replace(columns=less)], ["a"])
    assert [row["name"] for row in rows] == ["velocity.a"]


def test_sensors_that_are_nothing_like_simulated_ones_are_told():
    def row(name, left, varies):
        return {"name": name, "unit": "N", "noise": 0.5, "nominal_rms": 9.0,
                "extended_rms": left, "measured_rms": varies}  # fmt: skip

    rows = [row("force.LF", 13.9, 12.0), row("force.RF", 6.0, 12.0),
            row("force.tip", 0.9, 0.5), row("torque.arm", 9.0, 0.0)]  # fmt: skip
    (told,) = odd_sensors(rows, "a.csv, b.csv")
    assert told["level"] == "warning" and told["file"] == "a.csv, b.csv"
    assert "force.LF: simulated 13.9 N rms off, where it varies by 12" in told["text"]
