"""Recordings: what goes out comes back, and what cannot be trusted is refused."""

import errno
import os
import resource

import numpy as np
import pyarrow as pa
import pytest
import yaml
from pyarrow import parquet

from gatjax.data.recording import (
    Recording,
    check_recording,
    read_recording,
    write_recording,
)
from gatjax.data.trajectories import (
    at_rate,
    split_by_trajectory,
    to_arrays,
    to_recording,
)
from gatjax.records import FORCE_SENSORS, JOINTS, Base, Reading, Trajectory

ENDINGS = (".parquet", ".csv")


def example(rows=6):
    random = np.random.default_rng(0)
    names = (
        "command.LKneePitch",
        "position.LKneePitch",
        "gyro.x",
        "force.LFootRearLeft",
    )
    half = rows // 2
    return Recording(
        name="example",
        time=np.concatenate([np.arange(half), np.arange(rows - half)]) * 0.02,
        trajectory=np.repeat([0, 4], [half, rows - half]),
        columns={name: random.normal(size=rows) for name in names},
        metadata={"robot": "nao", "base": "floating", "rate_hz": 50.0, "floor": "wood"},
    )


def assert_same(found, expected):
    np.testing.assert_array_equal(found.time, expected.time)
    np.testing.assert_array_equal(found.trajectory, expected.trajectory)
    assert found.trajectory.dtype == np.int64
    assert list(found.columns) == list(expected.columns)
    for name, values in expected.columns.items():
        np.testing.assert_array_equal(found.columns[name], values)
    assert found.metadata == expected.metadata


def changed(column, row, value):
    recording = example()
    target = {"time": recording.time, **recording.columns}[column]
    target[row] = value
    return recording


def renamed(old, new):
    recording = example()
    columns = {new if k == old else k: v for k, v in recording.columns.items()}
    return recording._replace(columns=columns)


def refusal(recording, joints=JOINTS):
    with pytest.raises(ValueError) as caught:
        check_recording(recording, joints)
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith(recording.name)
    return line


def read_refusal(path):
    with pytest.raises(ValueError) as caught:
        read_recording(path)
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith(str(path))
    return line


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_round_trip_changes_no_bit(tmp_path, ending):
    path = tmp_path / f"robot_0{ending}"
    write_recording(path, example())
    found = read_recording(path)
    assert_same(found, example())
    assert found.name == str(path)
    check_recording(found, JOINTS)


def test_writing_leaves_only_the_files_that_were_asked_for(tmp_path):
    write_recording(tmp_path / "a.parquet", example())
    write_recording(tmp_path / "b.csv", example())
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["a.parquet", "b.csv", "b.json"]


def test_trajectory_and_metadata_may_be_left_out(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time,command.A,position.A\n0,1,2\n0.5,1,2\n")
    found = read_recording(path)
    np.testing.assert_array_equal(found.trajectory, [0, 0])
    assert found.metadata == {}
    check_recording(found, ["A"])


def test_metadata_of_other_parquet_writers_is_left_out(tmp_path):
    path = tmp_path / "log.parquet"
    table = pa.table({"time": [0.0]}).replace_schema_metadata(
        {"pandas": "{}", "robot": "nao"}
    )
    parquet.write_table(table, path)
    assert read_recording(path).metadata == {"robot": "nao"}


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", ["time", "position.LKneePitch", "gyro.x"])
def test_values_that_are_no_numbers_are_refused(column, value):
    line = refusal(changed(column, 2, value))
    assert f"row 3, column '{column}': {value} is not a number (1 such rows); " in line
    needed = "cut these rows out of the log"
    spare = f"list the column under drop in --map if it is not needed, or {needed}"
    assert line.endswith(f"; {spare if column == 'gyro.x' else needed}")


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_missing_value_survives_the_file_and_is_refused(tmp_path, ending):
    path = tmp_path / f"log{ending}"
    write_recording(path, changed("position.LKneePitch", 4, np.nan))
    assert "row 5, column 'position.LKneePitch'" in refusal(read_recording(path))


def test_an_empty_cell_is_refused(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time,command.A,position.A\n0,1,2\n0.5,1,\n")
    assert "row 2, column 'position.A'" in refusal(read_recording(path), ["A"])


@pytest.mark.parametrize("again", [0.02, 0.01])
def test_time_that_does_not_increase_is_refused(again):
    line = refusal(changed("time", 2, again))
    assert f"row 3, column 'time': {again} s after 0.02 s (row 2)" in line
    assert "trajectory 0" in line


def test_time_may_start_again_in_the_next_trajectory_even_interleaved():
    order = [0, 3, 1, 4, 2, 5]
    recording = example()
    check_recording(
        recording._replace(
            time=recording.time[order], trajectory=recording.trajectory[order]
        ),
        JOINTS,
    )


def test_time_that_runs_back_is_found_between_other_trajectories():
    recording = example()._replace(
        time=np.array([0.0, 5.0, 0.02, 6.0, 0.01, 4.0]),
        trajectory=np.array([0, 1, 0, 1, 0, 1]),
    )
    line = refusal(recording)
    assert "row 5, column 'time': 0.01 s after 0.02 s (row 3) in trajectory 0" in line


def test_a_joint_that_the_model_lacks_is_refused_with_close_names():
    line = refusal(renamed("position.LKneePitch", "position.LKneePich"))
    assert "column 'position.LKneePich': the model has no joint 'LKneePich'" in line
    assert "close: LKneePitch" in line
    assert "with --map, or list its columns under drop there if it does not" in line
    assert line.endswith(", ".join(JOINTS))


def test_an_unknown_column_is_refused():
    line = refusal(renamed("gyro.x", "imu_0"))
    assert "column 'imu_0' is unknown; translate it with --map" in line


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            "position.LKneePitch",
            "position.RKneePitch",
            "command.LKneePitch without position.LKneePitch",
        ),
        (
            "command.LKneePitch",
            "velocity.LKneePitch",
            "position.LKneePitch without command.LKneePitch",
        ),
    ],
)
def test_a_command_needs_its_position_and_a_position_its_command(old, new, says):
    assert says in refusal(renamed(old, new))


def test_a_recording_without_joints_is_refused():
    recording = example()
    columns = {"gyro.x": recording.columns["gyro.x"]}
    line = refusal(recording._replace(columns=columns))
    assert "no command.<joint> and position.<joint> columns" in line


@pytest.mark.parametrize("column", ["command.LKneePitch", "position.LKneePitch"])
def test_degrees_are_refused(column):
    assert_degrees(column, column.replace("LKneePitch", "*"))


@pytest.mark.parametrize("column", ["orientation.roll", "orientation.pitch"])
def test_a_robot_that_leans_by_degrees_is_refused(column):
    assert_degrees(column, "orientation.*")


def assert_degrees(column: str, named: str) -> None:
    """A column from 0 to 40 is refused, and a map says what it is."""
    recording = example(rows=40)
    recording.columns[column] = np.linspace(0.0, 40.0, 40)
    line = refusal(recording)
    row = 5 if named == "orientation.*" else 8
    assert f"row {row}, column '{column}'" in line
    assert "looks like degrees" in line
    told = line.split("say so in a --map file: ")[1]
    assert yaml.safe_load(told[1:-1])["columns"] == {named: {"unit": "deg"}}


def test_one_glitch_is_not_called_degrees():
    recording = example(rows=40)
    recording.columns["position.LKneePitch"][3] = 10.0
    check_recording(recording, JOINTS)


def test_no_rows_are_refused(tmp_path):
    recording = example()
    empty = Recording(
        name="empty",
        time=recording.time[:0],
        trajectory=recording.trajectory[:0],
        columns={k: v[:0] for k, v in recording.columns.items()},
        metadata={},
    )
    assert refusal(empty) == "empty: no rows"
    for ending in ENDINGS:
        write_recording(tmp_path / f"log{ending}", empty)
        assert read_refusal(tmp_path / f"log{ending}").endswith("no rows")


@pytest.mark.parametrize("ending", ENDINGS)
def test_an_empty_file_is_refused(tmp_path, ending):
    path = tmp_path / f"log{ending}"
    path.touch()
    assert read_refusal(path).endswith("the file is empty")


def test_a_truncated_parquet_file_is_refused(tmp_path):
    path = tmp_path / "log.parquet"
    write_recording(path, example())
    path.write_bytes(path.read_bytes()[:-20])
    assert "not a readable .parquet file" in read_refusal(path)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("time,gyro.x\n0,1\n1\n", "not a readable .csv file"),
        ("stamp,gyro.x\n0,1\n", "no column 'time'; translate names with --map; it has"),
        ("time,gyro.x,gyro.x\n0,1,2\n", "column gyro.x is there twice"),
        ("time,gyro.x\n0,1\n1,ERR\n", "row 2, column 'gyro.x': 'ERR' is not a number"),
        ("time,gyro.x\n2024-01-01,1\n", "column 'time' holds date32"),
        (
            "time,trajectory\n0,0\n0,0.5\n",
            "row 2, column 'trajectory': 0.5 is not a wh",
        ),
    ],
)
def test_a_csv_file_that_makes_no_sense_is_refused(tmp_path, text, says):
    path = tmp_path / "log.csv"
    path.write_text(text)
    assert says in read_refusal(path)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('{"rate_hz": "fast"}', "metadata rate_hz is 'fast'"),
        ('{"rate_hz": 0}', "metadata rate_hz is 0"),
        ('{"base": "flying"}', "metadata base is 'flying'; it is fixed or floating"),
        ('{"base": ', "not JSON"),
        ("[]", "expected {key: value}"),
    ],
)
def test_wrong_metadata_is_refused(tmp_path, text, says):
    (tmp_path / "log.csv").write_text("time,gyro.x\n0,1\n")
    (tmp_path / "log.json").write_text(text)
    with pytest.raises(ValueError) as caught:
        read_recording(tmp_path / "log.csv")
    assert says in str(caught.value)


def test_a_missing_file_lists_what_is_there(tmp_path):
    write_recording(tmp_path / "robot_0.parquet", example())
    with pytest.raises(FileNotFoundError, match=r"there are: robot_0\.parquet"):
        read_recording(tmp_path / "robot_1.parquet")


def test_another_ending_is_refused(tmp_path):
    for act in (read_recording, lambda path: write_recording(path, example())):
        with pytest.raises(ValueError, match=r"ends in \.parquet or \.csv"):
            act(tmp_path / "log.pkl")


def test_columns_of_different_length_are_not_written(tmp_path):
    recording = example()
    recording.columns["gyro.x"] = np.zeros(2)
    with pytest.raises(ValueError, match=r"column 'gyro\.x' has 2 rows, time has 6"):
        write_recording(tmp_path / "log.csv", recording)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_write_that_breaks_off_leaves_the_old_file_whole(tmp_path, ending):
    path = tmp_path / f"log{ending}"
    write_recording(path, example())
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limit[1]))  # bytes a file
    try:
        with pytest.raises(OSError) as caught:
            write_recording(path, example(rows=2000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert "nothing was changed" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_a_full_disk_leaves_nothing_and_says_so(tmp_path, monkeypatch):
    def full(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left on device"):
        write_recording(tmp_path / "log.csv", example())
    assert list(tmp_path.iterdir()) == []


def batch(runs=3, ticks=4):
    random = np.random.default_rng(1)
    joints = len(JOINTS)
    alive = np.ones((runs, ticks), bool)
    alive[1, 2:] = False
    return Trajectory(
        time=np.tile(np.arange(ticks) * 0.02, (runs, 1)),
        command=random.normal(size=(runs, ticks, joints)),
        reading=Reading(
            angle=random.normal(size=(runs, ticks, joints)),
            gyro=random.normal(size=(runs, ticks, 3)),
            accelerometer=random.normal(size=(runs, ticks, 3)),
            force=random.normal(size=(runs, ticks, len(FORCE_SENSORS))),
        ),
        base=Base(
            position=random.normal(size=(runs, ticks, 3)),
            quaternion=random.normal(size=(runs, ticks, 4)),
        ),
        alive=alive,
    )


def test_a_trajectory_batch_comes_back_from_its_file_without_the_fall(tmp_path):
    runs = batch()
    recording = to_recording(runs, "nao", 50.0, {"seed": 3})
    check_recording(recording, JOINTS)
    write_recording(tmp_path / "log.parquet", recording)
    found = read_recording(tmp_path / "log.parquet")
    assert_same(found, recording)
    arrays = to_arrays(found, JOINTS)
    assert [run.trajectory for run in arrays] == [0, 1, 2]
    for index, length in enumerate([4, 2, 4]):
        np.testing.assert_array_equal(arrays[index].time, runs.time[index, :length])
        np.testing.assert_array_equal(
            arrays[index].command, runs.command[index, :length]
        )
        np.testing.assert_array_equal(
            arrays[index].angle, runs.reading.angle[index, :length]
        )


def test_sensor_columns_carry_their_channel():
    runs = batch()
    columns = to_recording(runs, "nao", 50.0, {}).columns
    kept = runs.alive
    for name, values in {
        "gyro.z": runs.reading.gyro[..., 2],
        "accelerometer.y": runs.reading.accelerometer[..., 1],
        "force.RFootRearRight": runs.reading.force[..., 7],
        "base.x": runs.base.position[..., 0],
        "base.qw": runs.base.quaternion[..., 0],
    }.items():
        np.testing.assert_array_equal(columns[name], values[kept])


def test_metadata_of_a_batch_is_that_of_the_schema():
    found = to_recording(batch(), "nao", 50.0, {"seed": 3}).metadata
    assert found == {"robot": "nao", "base": "floating", "rate_hz": 50.0, "seed": "3"}


def test_a_batch_without_a_living_row_is_refused():
    runs = batch()
    with pytest.raises(ValueError, match="no trajectory has a row before its fall"):
        to_recording(
            runs._replace(alive=np.zeros_like(runs.alive)), "nao", 50.0, {"seed": 3}
        )


def timed(time, trajectory=None):
    time = np.asarray(time, float)
    ids = np.zeros(len(time), int) if trajectory is None else np.asarray(trajectory)
    columns = {f"{kind}.HeadYaw": 10.0 * time for kind in ("command", "position")}
    return Recording("log.csv", time, ids, columns, {})


@pytest.mark.parametrize(
    ("step", "says"),
    [
        (0.01, "a row every 10 ms, the control period is 20 ms; choose the --rate-hz"),
        (0.0212, "a row every 21.2 ms"),
        (0.0188, "resample it to 50 Hz"),
        (20.0, "a row every 20 s looks like milliseconds; use a map"),
    ],
)
def test_a_log_of_another_rate_is_refused_with_both_numbers(step, says):
    with pytest.raises(ValueError, match=r"log\.csv") as caught:
        at_rate(timed(np.arange(50) * step), 0.02)
    assert says in str(caught.value)


def test_a_log_that_jitters_around_its_rate_comes_back_as_it_is():
    jitter = np.random.default_rng(0).uniform(-0.004, 0.004, 50)
    recording = timed(np.arange(50) * 0.0205 + jitter)
    assert at_rate(recording, 0.02) == (recording, 0)
    assert at_rate(timed([3.0]), 0.02)[1] == 0


def test_no_run_spans_a_gap():
    """Two runs, their rows mixed; one lost a row, one has two rows 4 ms apart."""
    first = np.delete(np.arange(30) * 0.02, 10)
    second = np.insert(np.arange(30) * 0.02, 21, 0.404)
    order = np.random.default_rng(0).permutation(60)
    time, ids = np.concatenate([first, second]), np.repeat([3, 7], [29, 31])
    mixed = np.argsort(np.argsort(time[order], kind="stable"))
    order = order[np.argsort(mixed)]
    recording, gaps = at_rate(timed(time[order], ids[order]), 0.02)
    assert gaps == 2
    runs = to_arrays(recording, ["HeadYaw"])
    assert [len(run.time) for run in runs] == [10, 19, 21, 10]
    for run in runs:
        assert (np.abs(np.diff(run.time) - 0.02) <= 0.01).all()
        np.testing.assert_array_equal(run.angle[:, 0], 10.0 * run.time)
    np.testing.assert_array_equal(runs[1].time, first[10:])


def test_arrays_follow_the_order_of_the_joints_asked_for():
    runs = batch()
    recording = to_recording(runs, "nao", 50.0, {})
    joints = ("RKneePitch", "HeadYaw")
    order = [JOINTS.index(joint) for joint in joints]
    np.testing.assert_array_equal(
        to_arrays(recording, joints)[0].command, runs.command[0][:, order]
    )


def test_arrays_name_the_joints_that_are_not_recorded():
    with pytest.raises(ValueError) as caught:
        to_arrays(example(), ["LKneePitch", "HeadYaw", "HeadPitch"])
    assert str(caught.value) == (
        "example: no command and position of HeadYaw, HeadPitch; a joint of the model "
        "needs both: log it, or remove its actuator from the model"
    )


def test_a_split_keeps_trajectories_whole_and_apart():
    train, held_out = split_by_trajectory(np.repeat(np.arange(10) * 3, 7), 0.3, seed=5)
    assert (train.size, held_out.size) == (7, 3)
    assert set(train) | set(held_out) == set(range(0, 30, 3))


def test_a_split_follows_the_seed_and_not_the_order_of_rows():
    ids = np.repeat(np.arange(20), 3)
    first = split_by_trajectory(ids, 0.25, seed=1)
    again = split_by_trajectory(ids[::-1], 0.25, seed=1)
    other = split_by_trajectory(ids, 0.25, seed=2)
    np.testing.assert_array_equal(first[0], again[0])
    np.testing.assert_array_equal(first[1], again[1])
    assert not np.array_equal(first[1], other[1])


@pytest.mark.parametrize("share", [0.01, 0.99])
def test_both_sides_of_a_split_have_a_trajectory(share):
    train, held_out = split_by_trajectory([4, 9], share, seed=0)
    assert train.size == held_out.size == 1


@pytest.mark.parametrize(
    ("ids", "share", "says"),
    [([0, 1], 0.0, "held_out_share is 0.0"), ([3, 3], 0.5, "1 trajectory can not")],
)
def test_a_split_that_holds_nothing_out_is_refused(ids, share, says):
    with pytest.raises(ValueError, match=says):
        split_by_trajectory(ids, share, seed=0)
