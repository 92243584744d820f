"""Where the torso is, from gyro, joints and soles: against where it truly was."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gatjax.data.trajectories import to_recording
from gatjax.grounding import posture
from gatjax.loop import Simulator
from gatjax.loop.ground import measured
from gatjax.records import FORCE_SENSORS, JOINTS
from gatjax.robot.nao import MODEL_FILE
from gatjax.sim.world import nominal
from gatjax.task import Task
from gatjax.walk.parameters import THETA0

TASK, COUNT = Task(duration=4.0), 3
WORLD = nominal(TASK)
DEGREE = np.deg2rad(1.0)


@pytest.fixture(scope="module")
def walks():
    """Walks with theta0 in the nominal simulator, the second one cut short."""
    robot = Simulator(WORLD)
    trajectory, _ = robot.walk(np.tile(THETA0, (COUNT, 1)), range(COUNT), TASK)
    alive = np.array(trajectory.alive)
    alive[1, 120:] = False
    return to_recording(trajectory._replace(alive=alive), robot.name, 50.0, {})


def poses(log):
    angle = np.stack([log.columns[f"position.{joint}"] for joint in JOINTS], -1)
    log = measured(log)
    return posture.torso_poses(WORLD.model, log, angle, TASK.control_period)


def tilt(quaternion):
    """Pitch and roll [N, 2] rad of quaternions w x y z."""
    turn = Rotation.from_quat(quaternion[:, [1, 2, 3, 0]])
    return turn.as_euler("ZYX")[:, 1:]


def true(log, *names):
    return np.stack([log.columns[f"base.{name}"] for name in names], axis=-1)


def off(log):
    """RMS error [2] rad in pitch and roll."""
    wrong = tilt(poses(log)[:, 3:]) - tilt(true(log, "qw", "qx", "qy", "qz"))
    return np.sqrt(np.mean(wrong**2, axis=0))


def changed(log, **columns):
    return log._replace(columns=log.columns | columns)


def test_gyro_and_soles_tell_how_the_torso_is_turned(walks):
    upright = np.sqrt(np.mean(tilt(true(walks, "qw", "qx", "qy", "qz")) ** 2, axis=0))
    assert (off(walks) < 0.6 * DEGREE).all()
    assert (off(walks) < 0.5 * upright).all()


def test_the_gyro_may_have_a_bias(walks):
    biased = {f"gyro.{axis}": walks.columns[f"gyro.{axis}"] + 0.02 for axis in "xy"}
    assert (off(changed(walks, **biased)) < DEGREE).all()


def test_what_the_robot_says_of_its_attitude_counts(walks):
    pitch, roll = tilt(true(walks, "qw", "qx", "qy", "qz")).T
    told = {"orientation.pitch": pitch + 0.01, "orientation.roll": roll - 0.02}
    assert off(changed(walks, **told)) == pytest.approx([0.01, 0.02], abs=1e-6)


def test_soles_that_carry_do_not_slip(walks):
    """Where each walk goes, and that the torso is as high as it was."""
    found, known = poses(walks), true(walks, "x", "y", "z")
    assert np.abs(found[:, 2] - known[:, 2]).max() < 0.01
    for run in np.unique(walks.trajectory):
        rows = np.flatnonzero(walks.trajectory == run)[[0, -1]]
        went, goes = known[rows[1]] - known[rows[0]], found[rows[1]] - found[rows[0]]
        distance = np.linalg.norm(went[:2])
        assert distance > 0.1
        assert np.linalg.norm(goes[:2] - went[:2]) < 0.15 * distance


def test_a_trajectory_does_not_depend_on_the_others(walks):
    rows = walks.trajectory == 1
    alone = walks._replace(
        time=walks.time[rows],
        trajectory=walks.trajectory[rows],
        columns={name: values[rows] for name, values in walks.columns.items()},
    )
    together = poses(walks)[rows]
    together[:, :2] -= together[0, :2]
    np.testing.assert_allclose(poses(alone), together, atol=1e-9)


def test_trajectories_may_interleave(walks):
    order = np.argsort(walks.time, kind="stable")
    mixed = walks._replace(
        time=walks.time[order],
        trajectory=walks.trajectory[order],
        columns={name: values[order] for name, values in walks.columns.items()},
    )
    apart, together = poses(walks)[order], poses(mixed)
    np.testing.assert_array_equal(together[:, 2:], apart[:, 2:])
    np.testing.assert_allclose(together[:, :2], apart[:, :2], atol=1e-12)


def test_without_a_gyro_the_torso_is_upright_and_stays(walks):
    still = {k: v for k, v in walks.columns.items() if not k.startswith("gyro.")}
    found = poses(walks._replace(columns=still))
    np.testing.assert_array_equal(found[:, :2], 0.0)
    np.testing.assert_array_equal(found[:, 3:], np.eye(4)[[0]].repeat(len(found), 0))


def test_a_column_that_never_changes_says_nothing(walks):
    """Servers that do not know the torso fill it with zeros."""
    still = np.zeros(len(walks.time))
    told = {"orientation.pitch": still, "orientation.roll": still}
    np.testing.assert_array_equal(poses(changed(walks, **told)), poses(walks))


def test_the_gyro_tells_where_a_robot_heads_that_knows_its_attitude(walks):
    pitch, roll = tilt(true(walks, "qw", "qx", "qy", "qz")).T
    log = changed(walks, **{"orientation.pitch": pitch, "orientation.roll": roll})

    def turned(quaternion):
        """How far the heading [N, 2] turned since 1 s before, rad."""
        turn = Rotation.from_quat(quaternion[:, [1, 2, 3, 0]]).as_euler("ZYX")[:, 0]
        rows = [np.flatnonzero(walks.trajectory == run) for run in range(COUNT)]
        return np.concatenate([turn[each[50:]] - turn[each[:-50]] for each in rows])

    known = turned(true(walks, "qw", "qx", "qy", "qz"))
    found = turned(poses(log)[:, 3:])
    assert np.std(known) > 2 * np.std(found - known)


def test_feet_without_spheres_are_refused(walks):
    spec = mujoco.MjSpec.from_file(str(MODEL_FILE))
    for name in FORCE_SENSORS[:4]:
        spec.geom(name).type = mujoco.mjtGeom.mjGEOM_BOX
        spec.geom(name).size = [0.01, 0.01, 0.01]
    angle = np.zeros((2, len(JOINTS)))
    with pytest.raises(ValueError, match="no spheres that touch the floor"):
        posture.soles_of(spec.compile(), angle)


def test_hands_that_touch_things_are_no_feet(walks):
    spec = mujoco.MjSpec.from_file(str(MODEL_FILE))
    spec.body("torso").add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.05, 0, 0], contype=1, conaffinity=1
    )
    angle = np.zeros((2, len(JOINTS)))
    found, known = (posture.soles_of(m, angle) for m in (spec.compile(), WORLD.model))
    for ours, theirs in zip(found, known, strict=True):
        np.testing.assert_array_equal(ours, theirs)
