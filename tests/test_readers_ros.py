"""MCAP files and rosbag2 folders, as their own libraries write them."""

import re

import numpy as np
import pytest
import ros_logs as logs

from gatjax.data import readers

WRITERS = {"robot.mcap": logs.write_mcap, "robot_bag": logs.write_bag}


def read(path):
    return readers.read(path, lambda share: None)


@pytest.fixture(scope="module", params=WRITERS)
def log(request, tmp_path_factory):
    """The same messages in each format."""
    path = tmp_path_factory.mktemp("ros") / request.param
    return WRITERS[request.param](path, logs.messages())


def test_signals_keep_their_own_clocks_and_values(log):
    run = read(log).runs[0]
    angle = run["/joint_states/position.Knöchel"]
    np.testing.assert_array_equal(angle.values, logs.angles(logs.SEEN)[1])
    np.testing.assert_allclose(np.diff(angle.time), np.diff(logs.SEEN), atol=1e-6)
    asked = run["/arm/commands/data.1"]
    np.testing.assert_array_equal(asked.values, logs.commands(logs.SENT)[1])
    assert angle.time[0] - asked.time[0] == pytest.approx(logs.SEEN[0], abs=1e-6)
    np.testing.assert_array_equal(run["/imu/gyro.z"].values, 0.3)


def test_a_recording_holds_the_command_in_force(log):
    made = readers.assemble(read(log))
    columns = made.recording.columns
    for number, joint in enumerate(logs.JOINTS):
        at = np.searchsorted(logs.SENT, logs.SEEN, side="right") - 1
        expected = logs.commands(logs.SENT[at])[number]
        np.testing.assert_array_equal(columns[f"command.{joint}"], expected)
        measured = logs.angles(logs.SEEN)[number]
        np.testing.assert_array_equal(columns[f"position.{joint}"], measured)
    assert {"gyro.z", "accelerometer.x", "torque.hip", "velocity.hip"} <= set(columns)
    assert any("50 Hz, held until the next one" in note for note in made.notes)


def test_what_is_not_read_is_told(log):
    notes = " ".join(read(log).notes)
    assert f"{len(logs.SEEN)} messages of /chat (String) left out" in notes


@pytest.mark.parametrize("name", WRITERS)
def test_clocks_that_are_far_apart_are_brought_together(tmp_path, name):
    source = read(WRITERS[name](tmp_path / name, logs.messages(offset=1000.0)))
    run = source.runs[0]
    apart = (
        run["/joint_states/position.hip"].time[0] - run["/arm/commands/data.0"].time[0]
    )
    assert apart == pytest.approx(logs.SEEN[0], abs=1e-5)
    assert "1000 s before they were logged" in source.notes[0]


def test_trajectories_are_commands_ahead_of_time(tmp_path):
    point = {
        "positions": [0.5, -0.5], "velocities": [], "accelerations": [], "effort": [],
        "time_from_start": {"sec": 1, "nanosec": 500_000_000},
    }  # fmt: skip
    sent = {"header": logs.header(0.0), "joint_names": list(logs.JOINTS),
            "points": [point]}  # fmt: skip
    kind = "trajectory_msgs/msg/JointTrajectory"
    every = sorted(
        [("/arm/goal", kind, 0.1, sent), *logs.messages()], key=lambda each: each[2]
    )
    source = read(logs.write_mcap(tmp_path / "goal.mcap", every))
    goal = source.runs[0]["/arm/goal/position.hip"]
    assert goal.time.tolist() == pytest.approx([1.6], abs=1e-5)
    assert goal.values.tolist() == [0.5]
    assert source.draft["command.hip"] == {"from": "/arm/goal/position.hip"}


def test_joints_of_several_drivers_share_a_topic(tmp_path):
    def state(time, joint):
        value = {"header": logs.header(logs.START + time), "name": [joint],
                 "position": [time], "velocity": [], "effort": []}  # fmt: skip
        return "/joint_states", "sensor_msgs/msg/JointState", time, value

    both = [state(0.1 * k, "ab"[k % 2]) for k in range(10)]
    run = read(logs.write_mcap(tmp_path / "two.mcap", both)).runs[0]
    assert run["/joint_states/position.a"].values == pytest.approx(0.2 * np.arange(5))
    assert "/joint_states/velocity.a" not in run


def test_a_file_that_was_cut_off_is_refused_with_its_place(tmp_path):
    whole = logs.write_mcap(tmp_path / "whole.mcap", logs.messages()).read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(
        ValueError, match=rf"broken after \d+ of {len(whole) // 2} bytes"
    ):
        read(path)


def test_a_bag_without_its_database_is_refused(tmp_path):
    bag = logs.write_bag(tmp_path / "bag", logs.messages())
    for file in bag.glob("*.db3"):
        file.write_bytes(file.read_bytes()[:4096])
    with pytest.raises(ValueError, match=re.escape(str(bag))):
        read(bag)


def test_a_log_of_unknown_messages_says_what_it_has(tmp_path):
    chat = [each for each in logs.messages() if each[0] == "/chat"]
    with pytest.raises(
        ValueError, match=r"no messages of JointState.*/chat \(String\)"
    ):
        read(logs.write_mcap(tmp_path / "chat.mcap", chat))
