"""The torques that walks bear out: the least with which they are still predicted."""

import numpy as np
import pytest

from gatjax.data.trajectories import split_by_trajectory, to_recording
from gatjax.grounding import prediction
from gatjax.loop import Simulator
from gatjax.loop.bound import BOUND, LOOSE, PARTS, WORSE, _least, bounded, motors
from gatjax.loop.ground import HELD_OUT, WINDOWS, measured, parted
from gatjax.records import JOINTS
from gatjax.robot.nao import LEG_PITCH, WALKING_JOINTS, motor_of
from gatjax.sim.backend import prepare
from gatjax.sim.world import add_cause, nominal
from gatjax.task import Task, task_at
from gatjax.walk.parameters import THETA0

TASK, SEED, COUNT = Task(duration=2.5), 4, 5
PITCH = [joint for joint in JOINTS if motor_of(joint) is LEG_PITCH]


@pytest.fixture(scope="module")
def walks():
    """Walks with theta0 in the nominal simulator."""
    robot = Simulator(nominal(TASK))
    trajectory, _ = robot.walk(np.tile(THETA0, (COUNT, 1)), range(COUNT), TASK)
    return to_recording(trajectory, robot.name, 50.0, {})


@pytest.fixture(scope="module")
def found(walks):
    return bounded(nominal(TASK), walks, SEED)


@pytest.mark.parametrize(("cause", "where", "values", "rate"), [
    ("measurement_delay", ["all"], {"delay": 0.03}, 50.0),
    ("measurement_delay", ["LKneePitch", "RHipPitch"], {"delay": 0.01}, 50.0),
    ("command_delay", ["all"], {"delay": 0.08}, 100.0),
])  # fmt: skip
def test_a_world_predicts_its_own_walks(cause, where, values, rate):
    """What was before the first sample that is known has to be told of late ones."""
    task = task_at(rate, duration=2.5)
    ideal = nominal(task)
    world = add_cause(ideal, cause, where, values)
    robot = Simulator(world)
    trajectory, _ = robot.walk(np.tile(THETA0, (3, 1)), range(3), task)
    log = to_recording(trajectory, robot.name, rate, {})
    soon = []
    for own in (world, ideal):
        windows = prediction.cut(own, log, np.unique(log.trajectory), 24, SEED)
        backend, step = prepare(own, "native"), task.control_period
        found = prediction.errors(backend, own.values, windows, step)
        first = [found[joint, round(step, 6)] for joint in WALKING_JOINTS]
        soon.append(
            (max(first), prediction.error_soon(backend, own.values, windows, step))
        )
    (one, ahead), (_, worse) = soon
    assert ahead < 0.3 * worse
    assert np.rad2deg(one) < 0.4 and np.rad2deg(ahead) < 0.1


def limits(world):
    return {tuple(row["where"]): row["values"]["limit"] for row in world.causes}


def test_each_kind_of_motor_that_walks_is_bounded(found):
    assert {(row["cause"], row["role"]) for row in found.causes} == {(BOUND, "bound")}
    joints = [joint for row in found.causes for joint in row["where"]]
    assert sorted(joints) == sorted(WALKING_JOINTS)
    strongest = {tuple(where): most for where, most in motors(nominal(TASK))}
    assert all(limit < 0.9 * strongest[row] for row, limit in limits(found).items())


def test_a_bound_is_the_least_that_predicts_the_walks(found, walks):
    world = nominal(TASK)
    seen, _ = split_by_trajectory(walks.trajectory, HELD_OUT, SEED)
    windows = prediction.cut(world, measured(walks), seen, WINDOWS, SEED)

    def error(limit):
        tried = add_cause(world, BOUND, PITCH, limit)
        start = windows.warm, windows.qpos, windows.qvel
        found = prepare(tried, "native").replay(tried.values, windows.command, *start)
        ahead = windows.angle[:, -found.shape[1] :]
        joints = [JOINTS.index(joint) for joint in WALKING_JOINTS]
        wrong = (np.asarray(found) - ahead)[:, :10, joints]  # 0.2 s
        return np.linalg.norm(np.sqrt(np.mean(wrong**2, axis=(0, 1))))

    ((where, limit),) = [
        row for row in limits(found).items() if set(row[0]) <= {*PITCH}
    ]
    part = dict((tuple(each), most) for each, most in motors(world))[where] / PARTS
    assert error(limit) <= WORSE * error(100.0) < error(limit - part)


def test_walks_that_only_test_predictions_do_not_count(found, walks):
    _, held = split_by_trajectory(walks.trajectory, HELD_OUT, SEED)
    spoilt = walks._replace(columns={k: v.copy() for k, v in walks.columns.items()})
    rows = np.isin(walks.trajectory, held)
    assert rows.any()
    for joint in WALKING_JOINTS:
        spoilt.columns[f"position.{joint}"][rows] += 0.3
    assert limits(bounded(nominal(TASK), spoilt, SEED)) == limits(found)


def test_where_the_torso_truly_was_does_not_count(found, walks):
    spoilt = walks._replace(columns={k: v.copy() for k, v in walks.columns.items()})
    spoilt.columns["base.z"] += 0.05
    assert limits(bounded(nominal(TASK), spoilt, SEED)) == limits(found)


def test_a_simulation_that_diverges_bears_nothing_out(walks, monkeypatch):
    monkeypatch.setattr(prediction, "error_soon", lambda *_: np.inf)
    with pytest.raises(ValueError, match="diverges within a fifth of a second"):
        bounded(nominal(TASK), walks, SEED)


def test_a_motor_that_no_bound_suits_has_none(walks, monkeypatch):
    errors = iter([1.0])  # without bounds; worse with any
    monkeypatch.setattr(prediction, "error_soon", lambda *_: next(errors, 2.0))
    assert bounded(nominal(TASK), walks, SEED).causes == nominal(TASK).causes


@pytest.mark.parametrize(
    ("least", "found"), [(3.2, 3.5), (0.1, 0.5), (9.9, 10.0), (10.1, LOOSE)]
)
def test_the_least_limit_is_found_in_parts_of_the_most(least, found):
    assert _least(10.0, lambda limit: limit >= least) == pytest.approx(found)


@pytest.mark.parametrize("seed", range(10))
def test_what_tests_predictions_is_long_enough_for_it(walks, seed):
    ids = np.repeat(np.arange(20), np.where(np.arange(20) < 5, 100, 20))
    recording = walks._replace(time=0.02 * np.arange(len(ids)), trajectory=ids)
    seen, held_out = parted(recording, 0.02, seed)
    assert len(held_out) == 1 and held_out[0] < 5
    assert sorted([*seen, *held_out]) == list(range(20))


@pytest.mark.parametrize("long", [0, 1])
def test_a_robot_that_falls_early_is_told(walks, long):
    ids = np.repeat(np.arange(20), np.where(np.arange(20) < long, 100, 20))
    recording = walks._replace(time=0.02 * np.arange(len(ids)), trajectory=ids)
    with pytest.raises(ValueError, match=rf"{long} of 20 walks last longer than .* s"):
        parted(recording, 0.02, 0)


def test_long_walks_are_parted_as_ever(walks):
    seen, held_out = parted(walks, TASK.control_period, SEED)
    before = split_by_trajectory(walks.trajectory, HELD_OUT, SEED)
    assert (seen.tolist(), held_out.tolist()) == tuple(part.tolist() for part in before)
