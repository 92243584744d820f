"""A learned correction stands in where no cause is named."""

from pathlib import Path

import numpy as np
import pytest

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import fallback, measure
from gatjax.grounding.learn import grounded, read_grounding
from gatjax.sim.stored import read_world
from gatjax.sim.world import add_cause, nominal
from gatjax.surrogate import hidden
from gatjax.task import task_at

MODEL = str(Path(hidden.__file__).parent / "arm_servo.xml")
TASK = task_at(100.0)


@pytest.fixture(scope="module")
def logs():
    """Runs of a servo that is softer than its simulation, 30 s and one of 8 s."""
    robot = add_cause(nominal(TASK, MODEL), "gain_error", ["servo"], {"scale": 0.6})
    draw, runs = np.random.default_rng(3), []
    for seconds in (15.0, 15.0, 8.0):
        time = np.arange(0.0, seconds, 0.01)
        waves = draw.uniform(0.1, 1.2, (4, 1)), draw.uniform(0.0, 6.0, (4, 1))
        command = 0.25 * np.sin(2 * np.pi * waves[0] * time + waves[1]).sum(0)[:, None]
        run = JointRun(0, time, command, command)
        runs.append(run._replace(angle=measure.whole_log(robot, [run])[0]))
    return runs[:2], runs[2:]


@pytest.fixture(scope="module")
def offered(logs, tmp_path_factory):
    out = tmp_path_factory.mktemp("diagnosis")
    return out, fallback.offer(out, nominal(TASK, MODEL), *logs, seed=0)


def test_a_correction_predicts_what_it_did_not_learn_from(offered):
    _, row = offered
    assert row["alpha"] > 0.0
    assert row["after"] < 0.3 * row["before"]
    assert row["promoted"] and row["low"] > 0.0


def test_the_offered_world_is_the_one_that_was_measured(offered, logs):
    out, row = offered
    world, folder = read_world(out / row["world"], TASK)
    again = grounded(world, read_grounding(folder))
    error = measure.whole_log(again, logs[1])[0] - logs[1][0].angle
    assert np.sqrt(np.mean(np.square(error))) == pytest.approx(row["after"], rel=1e-3)


def test_without_a_gain_nothing_is_offered(tmp_path, logs):
    world = nominal(TASK, MODEL)
    true = [
        run._replace(angle=angle)
        for run, angle in zip(logs[0], measure.whole_log(world, logs[0]), strict=True)
    ]
    row = fallback.offer(tmp_path, world, true, [], seed=0)
    assert row == {"method": "gat", "alpha": 0.0, "world": None}
    assert not list(tmp_path.iterdir())


def test_an_old_offer_is_withdrawn_and_nothing_else(tmp_path):
    folder = tmp_path / fallback.FOLDER
    folder.mkdir()
    for name in (*fallback.FILES, "mine.txt"):
        (folder / name).write_text("old")
    fallback.withdraw(tmp_path)
    assert [file.name for file in folder.iterdir()] == ["mine.txt"]
