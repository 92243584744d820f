"""MCAP files and rosbag2 folders, as their own libraries write them."""

import re

import numpy as np
import pytest
import ros_logs as logs

from gatjax.data import readers, spill

WRITERS = {"robot.mcap": logs.write_mcap, "robot_bag": logs.write_bag}


def read(path):
    return readers.read(path, lambda share: None)


@pytest.fixture(scope="module", params=WRITERS)
def log(request, tmp_path_factory):
    """The same messages in each format."""
    path = tmp_path_factory.mktemp("ros") / request.param
    return WRITERS[request.param](path, logs.messages())


@pytest.mark.parametrize("kept", [7, 1 << 16])
def test_signals_keep_their_own_clocks_and_values(log, kept, monkeypatch):
    monkeypatch.setattr(spill, "LARGE", kept)
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
    assert f"{len(logs.SEEN)} messages of /chat (std_msgs/String) left out" in notes


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
    share = (goal.time - goal.time[0]) / 1.5
    assert share[-1] == pytest.approx(1.0, abs=1e-5) and len(share) == 1501
    begun = np.interp(0.1, logs.SEEN, logs.angles(logs.SEEN)[0])
    np.testing.assert_allclose(goal.values, begun + share * (0.5 - begun), atol=1e-5)
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


@pytest.mark.parametrize(("text", "line"), [("", "empty"), ("hi", "no MCAP file")])
def test_what_is_no_mcap_file_is_not_to_be_recovered(tmp_path, text, line):
    file = tmp_path / "log.mcap"
    file.write_text(text)
    with pytest.raises(ValueError, match=rf"log\.mcap: {line}$"):
        read(file)


def test_a_bag_without_its_database_is_refused(tmp_path):
    bag = logs.write_bag(tmp_path / "bag", logs.messages())
    for file in bag.glob("*.db3"):
        file.write_bytes(file.read_bytes()[:4096])
    with pytest.raises(ValueError, match=re.escape(str(bag))):
        read(bag)


def test_a_log_of_unknown_messages_says_what_it_has(tmp_path):
    chat = [each for each in logs.messages() if each[0] == "/chat"]
    with pytest.raises(
        ValueError, match=r"no messages of JointState.*/chat \(std_msgs/String\)"
    ):
        read(logs.write_mcap(tmp_path / "chat.mcap", chat))


def state(time, effort=(), stamp=None):
    """Joint states of both joints."""
    stamp = logs.START + time if stamp is None else stamp
    value = {
        "header": logs.header(stamp), "name": list(logs.JOINTS),
        "position": logs.angles(time), "velocity": [], "effort": effort,
    }  # fmt: skip
    return "/joint_states", "sensor_msgs/msg/JointState", time, value


def numbers(topic, time, values):
    """An array of numbers."""
    said = {"layout": {"dim": [], "data_offset": 0}, "data": values}
    return topic, "std_msgs/msg/Float64MultiArray", time, said


def path(topic, time, points, speeds=None, stamp=0.0):
    """A trajectory of points (s, two angles), stamped "now" unless told."""
    said = [
        {"positions": list(angles), "velocities": [] if speeds is None else speeds[k],
         "accelerations": [], "effort": [],
         "time_from_start": {"sec": int(after), "nanosec": round(after % 1 * 1e9)}}
        for k, (after, *angles) in enumerate(points)
    ]  # fmt: skip
    said = {"header": logs.header(stamp), "joint_names": list(logs.JOINTS),
            "points": said}  # fmt: skip
    return topic, "trajectory_msgs/msg/JointTrajectory", time, said


SEEN = [state(time) for time in logs.SEEN]


def written(where, *more, seen=SEEN):
    """The source of a log of joint states and more."""
    every = sorted([*seen, *more], key=lambda each: each[2])
    return read(logs.write_mcap(where / "log.mcap", every))


def test_a_trajectory_is_a_command_whatever_its_topic_is_called(tmp_path):
    sent = [path("/a_first/joint_trajectory", t, [(0.0, t, -t)]) for t in logs.SENT]
    skin = [numbers("/tactile/pressure", t, [3.0, 4.0]) for t in logs.SENT]
    source = written(tmp_path, *sent, *skin)
    topic = "/a_first/joint_trajectory/position.hip"
    assert source.draft["command.hip"] == {"from": topic}
    assert source.draft["position.hip"] == {"from": "/joint_states/position.hip"}
    assert any("/tactile/pressure: taken for no commands" in n for n in source.notes)


@pytest.mark.parametrize(("topic", "count", "unit", "note"), [
    ("/effort_controller/commands", 2, "N m", "commands in N m of hip, Knöchel, the o"),
    ("/position/commands", 2, "rad", "commands in rad of hip, Knöchel, the order"),
    ("/velocity/commands", 2, None, "no commands that gatjax reads"),
    ("/wrist/commands", 1, None, "as many as 1 for 2 joints: not used"),
    ("/tactile", 2, None, "its name does not say so"),
])  # fmt: skip
def test_numbers_without_names_are_commands_only_if_their_topic_says_so(
    tmp_path, topic, count, unit, note
):
    sent = [numbers(topic, time, [time] * count) for time in logs.SENT]
    source = written(tmp_path, *sent)
    assert note in " ".join(source.notes)
    found = source.draft.get("command.Knöchel")
    assert found == (unit and {"from": f"{topic}/data.1", "unit": unit})


def test_a_byte_that_flipped_is_noticed(tmp_path):
    whole = bytearray(logs.write_mcap(tmp_path / "a.mcap", SEEN).read_bytes())
    whole[len(whole) // 3] ^= 1
    (tmp_path / "a.mcap").write_bytes(whole)
    with pytest.raises(ValueError, match=r"a\.mcap: broken after \d+ of"):
        read(tmp_path / "a.mcap")


def test_a_signal_without_a_number_is_left_out_and_told(tmp_path):
    nothing = [np.nan, np.nan]
    source = written(tmp_path, seen=[state(t, nothing) for t in logs.SEEN])
    assert "torque.hip" not in source.draft
    assert any("effort.hip left out, none of it" in note for note in source.notes)


def test_a_path_is_commanded_between_its_points_and_ends_where_the_next_begins(
    tmp_path,
):
    first = path("/goal", 0.0, [(0.0, 0.0, 0.0), (1.0, 1.0, 0.0), (2.0, 1.0, 1.0)])
    still = [[0.0, 0.0]] * 2
    second = path("/goal", 0.5, [(0.0, 0.5, 0.0), (1.0, 0.0, 0.0)], still)
    source = written(tmp_path, first, second)
    stream = source.runs[0]["/goal/position.hip"]
    time = stream.time - stream.time[0]
    cubic = 0.5 * (1.0 - 3.0 * (time - 0.5) ** 2 + 2.0 * (time - 0.5) ** 3)
    expected = np.where(time < 0.5 - 1e-6, time, cubic)
    np.testing.assert_allclose(stream.values, expected, atol=1e-5)
    assert time[-1] == pytest.approx(1.5, abs=1e-5) and len(time) == 1501
    assert any("are joined as a ros2_control controller does" in n
               for n in source.notes)  # fmt: skip


def test_arrays_that_differ_in_length_cost_no_more_than_themselves(tmp_path):
    odd = [numbers("/commands", t, [t] * (2 + (t > 1.0))) for t in logs.SENT]
    source = written(tmp_path, *odd)
    assert "position.hip" in source.draft and "command.hip" not in source.draft
    assert any("/commands/data left out, its messages differ" in n
               for n in source.notes)  # fmt: skip


def test_a_type_of_the_same_name_of_another_package_is_not_read(tmp_path):
    schema = "float64 value"
    with (tmp_path / "log.mcap").open("wb") as file:
        writer = logs.McapWriter(file)
        kind = writer.register_msgdef("my_msgs/msg/Imu", schema)
        writer.write_message("/imu", kind, {"value": 1.0}, 1, 1)
        writer.finish()
    with pytest.raises(ValueError, match=r"it has /imu \(my_msgs/Imu\)"):
        read(tmp_path / "log.mcap")


def test_every_clock_is_brought_to_that_of_the_joint_states(tmp_path):
    simulated = [state(t, stamp=100.0 + t) for t in logs.SEEN]
    goals = [path("/goal", t, [(0.0, t, t)]) for t in logs.SENT]
    later = path("/plan", 1.0, [(0.0, 0.0, 0.0)], stamp=106.0)
    turned = [("/imu", "sensor_msgs/msg/Imu", t, logs.imu(t, logs.START - 7.0))
              for t in logs.SEEN]  # fmt: skip
    source = written(tmp_path, *goals, *turned, later, seen=simulated)
    run = source.runs[0]
    begins = {name: run[name].time[0] for name in (
        "/joint_states/position.hip", "/goal/position.hip", "/imu/gyro.z",
        "/plan/position.hip")}  # fmt: skip
    seen = begins["/joint_states/position.hip"]
    assert seen - begins["/goal/position.hip"] == pytest.approx(0.013, abs=1e-4)
    assert begins["/imu/gyro.z"] - seen == pytest.approx(0.0, abs=1e-4)
    assert begins["/plan/position.hip"] - seen == pytest.approx(5.987, abs=1e-4)
    assert sum("moved by" in note for note in source.notes) == 2


def test_a_path_goes_to_its_first_point_from_where_the_commands_are(tmp_path):
    sent = [path("/goal", 0.0, [(0.0, 0.0, 0.0), (2.0, 2.0, 0.0)]),
            path("/goal", 0.5, [(1.0, -0.5, 0.0)]),
            path("/goal", 1.6, [(0.2, 0.5, 0.0)], [[0.0, 0.0]])]  # fmt: skip
    stream = written(tmp_path, *sent).runs[0]["/goal/position.hip"]
    time = stream.time - stream.time[0]
    share = (time - 1.6) / 0.2
    cubic = 1.0 * (3.0 * share**2 - 2.0 * share**3) - 0.5
    expected = np.select(
        [time < 0.5 - 1e-6, time < 1.5 - 1e-6, time < 1.6 - 1e-6],
        [time, 0.5 - (time - 0.5), np.full_like(time, -0.5)], cubic,
    )  # fmt: skip
    np.testing.assert_allclose(stream.values, expected, atol=1e-5)
    assert time[-1] == pytest.approx(1.8, abs=1e-5)
    assert len(time) == 500 + 1001 + 201


def test_cubics_go_on_with_the_speed_of_the_path_before(tmp_path):
    sent = [path("/goal", 0.0, [(0.0, 0.0, 0.0), (2.0, 2.0, 0.0)]),
            path("/goal", 1.0, [(1.0, 2.0, 0.0)], [[1.0, 0.0]])]  # fmt: skip
    stream = written(tmp_path, *sent).runs[0]["/goal/position.hip"]
    time = stream.time - stream.time[0]
    np.testing.assert_allclose(stream.values, time, atol=1e-5)
    assert len(time) == 2001


def sent_to(joints, time, points, stamp=0.0):
    """A trajectory of some joints, in their order."""
    topic, kind, time, said = path("/goal", time, points, None, stamp)
    return topic, kind, time, said | {"joint_names": list(joints)}


def test_a_path_ends_the_one_before_whatever_joints_it_names(tmp_path):
    other = logs.JOINTS[::-1]
    sent = [sent_to(logs.JOINTS, 0.0, [(0.0, 0.0, 0.0), (2.0, 2.0, 4.0)]),
            sent_to(other, 0.5, [(0.0, 1.0, 0.5), (1.0, 1.0, -0.5)]),
            sent_to(other[:1], 1.0, [(0.0, 1.0), (0.5, 0.0)])]  # fmt: skip
    run = written(tmp_path, *sent).runs[0]
    hip, ankle = (run[f"/goal/position.{name}"] for name in logs.JOINTS)
    assert hip.time.tolist() == ankle.time.tolist()
    at = np.searchsorted(hip.time - hip.time[0], [0.25, 0.75, 1.25, 1.6])
    assert hip.values[at[:3]] == pytest.approx([0.25, 0.25, 0.0], abs=0.011)
    assert ankle.values[at[:3]] == pytest.approx([0.5, 1.0, 0.5], abs=0.021)
    assert hip.values[-1] == pytest.approx(0.0, abs=1e-9)


def test_rows_between_the_points_of_a_path_are_told_where_it_is(tmp_path):
    sent = path("/goal", 0.0, [(0.0, 0.0, 0.0), (2.0, 2.0, 0.0)])
    source = written(tmp_path, sent)
    recording = readers.assemble(source).recording
    lag = recording.time - recording.columns["command.hip"]
    lag = lag[recording.columns["command.hip"] < 1.999]
    assert len(lag) > 50 and np.ptp(lag) < 0.0011  # a row holds it for 1 ms
    assert np.abs(lag).max() < 0.0011


def test_of_two_topics_with_the_same_joints_the_other_is_told(tmp_path):
    other = [("/leader/joint_states", *state(t + 0.001)[1:]) for t in logs.SEEN]
    source = written(tmp_path, *other)
    note = next(n for n in source.notes if "as well" in n)
    assert "/leader/joint_states has position.hip, position.Knöchel as well" in note
    assert "taken from /joint_states" in note
    assert source.draft["position.hip"] == {"from": "/joint_states/position.hip"}


def test_samples_before_the_first_reading_or_stamp_are_left_out(tmp_path):
    blind = state(-0.03)
    blind[3]["position"] = [float("nan")] * len(logs.JOINTS)
    early = state(-0.05)
    early[3]["header"] = logs.header(0.0)
    source = written(tmp_path, early, blind)
    stream = source.runs[0]["/joint_states/position.hip"]
    assert len(stream.time) == len(logs.SEEN) and np.isfinite(stream.values).all()
    assert any("1 messages before the first with a stamp" in n for n in source.notes)
    assert any("hip: 1 samples left out, no numbers" in n for n in source.notes)


def test_a_path_that_never_began_leaves_nothing(tmp_path):
    first = path("/goal", 0.0, [(0.0, 0.0, 0.0), (2.0, 2.0, 0.0)])
    late = path("/goal", 0.3, [(0.0, 9.0, 9.0)], stamp=logs.START + 1.5)
    last = path("/goal", 0.5, [(1.0, 1.5, 0.0)])
    stream = written(tmp_path, first, late, last).runs[0]["/goal/position.hip"]
    np.testing.assert_allclose(stream.values, stream.time - stream.time[0], atol=1e-5)


def test_a_path_without_a_point_or_of_another_clock(tmp_path):
    nothing = path("/goal", 0.1, [])
    nothing[3]["joint_names"] = []
    later = path("/goal", 0.5, [(0.0, 0.0, 0.0), (1.0, 1.0, 0.0)], stamp=50.0)
    source = written(tmp_path, nothing, later)
    run = source.runs[0]
    seen, goal = run["/joint_states/position.hip"], run["/goal/position.hip"]
    assert goal.time[0] - seen.time[0] == pytest.approx(0.487, abs=1e-3)
    assert any("moved by" in note for note in source.notes)


def test_a_joint_without_a_command_goes_from_where_it_is(tmp_path):
    hip, ankle = logs.JOINTS
    first = sent_to([hip], 0.3, [(0.0, 1.0), (0.5, 2.0)])
    then = sent_to([ankle], 1.0, [(0.5, 1.0)])
    run = written(tmp_path, first, then).runs[0]
    stream = run[f"/goal/position.{ankle}"]
    begun = np.interp(1.0, logs.SEEN, logs.angles(logs.SEEN)[1])
    share = (stream.time - stream.time[0]) / 0.5
    np.testing.assert_allclose(stream.values, begun + share * (1.0 - begun), atol=1e-5)
    assert stream.time[-1] - run[f"/goal/position.{hip}"].time[0] == pytest.approx(1.2)


def test_goals_that_never_reach_a_point_are_ramps_begun_anew(tmp_path):
    every = np.arange(0.1, 1.1, 0.1)
    sent = [path("/goal", float(t), [(1.0, 1.0, 1.0)]) for t in every]
    stream = written(tmp_path, *sent).runs[0]["/goal/position.hip"]
    begun = np.interp(0.1, logs.SEEN, logs.angles(logs.SEEN)[0])
    at = np.interp(every - 0.1, stream.time - stream.time[0], stream.values)
    np.testing.assert_allclose(
        1.0 - at, (1.0 - begun) * 0.9 ** np.arange(len(every)), atol=1e-5
    )


def test_speeds_of_a_joint_do_not_ask_for_those_of_another(tmp_path):
    hip, ankle = logs.JOINTS
    *head, said = sent_to([hip], 0.2, [(0.0, 0.0), (1.0, 1.0)])
    for point in said["points"]:
        point["velocities"] = [1.0]
    then = sent_to([ankle], 0.5, [(0.0, 0.3)])
    run = written(tmp_path, (*head, said), then).runs[0]
    stream = run[f"/goal/position.{hip}"]
    rising = stream.time - stream.time[0] < 0.3 - 1e-6
    np.testing.assert_allclose(
        stream.values[rising], (stream.time - stream.time[0])[rising], atol=1e-5
    )
    assert run[f"/goal/position.{ankle}"].values.tolist() == [0.3]


@pytest.mark.parametrize("apart", [-30.0, -5.0, 5.0])
def test_goals_without_a_stamp_are_of_the_clock_of_the_log(tmp_path, apart):
    states = [state(t, stamp=logs.START + t + apart) for t in logs.SEEN]
    goal = path("/goal", 0.5, [(0.0, 0.0, 0.0), (1.0, 1.0, 0.0)])
    source = written(tmp_path, goal, seen=states)
    seen, asked = (source.runs[0][f"/{name}/position.hip"].time[0]
                   for name in ("joint_states", "goal"))  # fmt: skip
    assert asked - seen == pytest.approx(0.487, abs=1e-3)
    assert any("moved by" in note for note in source.notes)


def test_a_joint_that_never_had_a_command_is_left_out(tmp_path):
    """Unseen, and its first goal is ended by another one before its point."""
    _, ankle = logs.JOINTS
    first, then = (sent_to([name], at, [(after, 1.0)]) for name, at, after in
                   (("elbow", 0.2, 1.0), (ankle, 0.7, 0.5)))  # fmt: skip
    source = written(tmp_path, first, then)
    assert "/goal/position.elbow" not in source.runs[0]
    assert any("position.elbow left out" in note for note in source.notes)
