"""NPZ, PACE .pt, BAM JSON, SAGE folders and LeRobot datasets."""

import gzip
import json
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from gatjax.data import readers
from gatjax.data.readers import drafts, torch_file

PACE = Path(__file__).parent / "data" / "logs" / "pace.pt"
TIME = np.linspace(0.0, 1.0, 51)


def read(path):
    return readers.read(path, lambda share: None)


def columns(path):
    return readers.assemble(read(path)).recording.columns


def test_tensors_of_pytorch_come_out_as_they_went_in():
    found, time = columns(PACE), np.linspace(0.0, 1.0, 51)
    for name, expected in {
        "position.joint_0": np.sin(time), "position.joint_1": np.cos(time),
        "command.joint_0": 2.0 * np.cos(time), "command.joint_1": -2.0 * time,
    }.items():  # fmt: skip
        np.testing.assert_allclose(found[name], expected, atol=2e-7)


class Evil:
    """Runs code where it is unpickled."""

    def __init__(self, target):
        self.target = target

    def __reduce__(self):
        return Path.touch, (self.target,)


def test_code_in_a_pickle_is_refused_and_not_run(tmp_path):
    path, target = tmp_path / "evil.pt", tmp_path / "touched"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("evil/data.pkl", pickle.dumps({"time": Evil(target)}))
    with pytest.raises(ValueError, match=r"asks for pathlib\.Path\.touch|pathlib"):
        read(path)
    assert not target.exists()


@pytest.mark.parametrize(("kept", "line"), [
    (80, "beyond its numbers"), (77, "cut off"),
])  # fmt: skip
def test_a_tensor_beyond_its_storage_is_refused(tmp_path, kept, line):
    path = tmp_path / "short.pt"
    with zipfile.ZipFile(PACE) as whole, zipfile.ZipFile(path, "w") as archive:
        for name in whole.namelist():
            content = whole.read(name)
            short = content[:kept] if "/data/" in name else content
            archive.writestr(name, short)
    with pytest.raises(ValueError, match=line):
        read(path)


@pytest.mark.parametrize(("offset", "shape", "stride", "storage"), [
    (99, (100,), (-1,), np.zeros(100)), (-1, (2,), (1,), np.zeros(100)),
    (9900, (2, 100), (-99, 1), np.zeros(100)), (0, (100,), (1,), np.zeros((100, 0))),
])  # fmt: skip
def test_a_tensor_before_its_storage_is_refused(offset, shape, stride, storage):
    with pytest.raises(pickle.UnpicklingError, match="before its numbers"):
        torch_file._rebuilt(storage, offset, shape, stride)


def test_a_file_that_is_no_archive_is_refused(tmp_path):
    path = tmp_path / "old.pt"
    path.write_bytes(pickle.dumps({}))
    with pytest.raises(ValueError, match=r"not a \.pt file"):
        read(path)


def test_arrays_keep_names_of_joints(tmp_path):
    path = tmp_path / "log.npz"
    angles = np.stack([np.sin(TIME), np.cos(TIME)], 1)
    np.savez(path, t=TIME, q=angles, q_des=angles + 0.1, joint_names=["a", "b"], gain=3)
    source = read(path)
    np.testing.assert_array_equal(source.runs[0]["q.b"].values, np.cos(TIME))
    np.testing.assert_array_equal(columns(path)["command.a"], np.sin(TIME) + 0.1)
    assert "gain ()" in source.notes[0]


@pytest.mark.parametrize(("names", "joint"), [(["knee"], "knee"), (None, "0")])
def test_arrays_of_one_joint_may_have_one_axis(tmp_path, names, joint):
    path = tmp_path / "log.npz"
    more = {} if names is None else {"joints": names}
    np.savez(path, time=TIME, position=np.sin(TIME), command=np.cos(TIME), **more)
    (place,) = [c for c in columns(path) if c.startswith("position.")]
    assert place.endswith(joint)
    np.testing.assert_array_equal(columns(path)[place], np.sin(TIME))


def test_objects_in_an_npz_are_refused(tmp_path):
    path = tmp_path / "log.npz"
    np.savez(path, t=TIME, q=np.array([{"a": 1}], dtype=object))
    with pytest.raises(ValueError, match="allow_pickle"):
        read(path)


@pytest.fixture
def bam(tmp_path):
    """Writes a BAM log of given rows."""

    def write(rows):
        path = tmp_path / "run.json"
        facts = {"mass": 0.5, "length": 0.1, "kp": 100, "motor": "xl330"}
        path.write_text(json.dumps(facts | {"entries": rows}))
        return path

    return write


def entry(time, on=True):
    return {"timestamp": time, "position": np.sin(time), "goal_position": time,
            "speed": 0.0, "torque_enable": on}  # fmt: skip


def test_the_gain_of_a_servo_is_its_stiffness_and_none_without_torque(bam):
    source = read(bam([entry(0.01 * k, on=k < 70) for k in range(100)]))
    made = readers.assemble(source)
    stiff = made.recording.columns["stiffness.servo"]  # of the XL330's usual gain, 400
    assert stiff[:70] == pytest.approx(0.25) and not stiff[70:].any()
    assert made.recording.metadata["kp"] == 100
    assert "off in 30 rows, the first of them row 71" in made.notes[0]
    assert "a stiffness of 1 is a P gain of 400" in made.notes[1]
    assert "scale: 0.0025" in drafts.text([source])


def test_a_log_without_a_gain_knows_at_least_when_the_torque_was_off(bam):
    path = bam([entry(0.01 * k, on=k < 70) for k in range(100)])
    tree = json.loads(path.read_text())
    path.write_text(json.dumps({k: v for k, v in tree.items() if k != "kp"}))
    stiff = readers.assemble(read(path)).recording.columns["stiffness.servo"]
    assert (stiff[:70] == 1.0).all() and not stiff[70:].any()


def test_logs_with_and_without_known_gains_are_not_mixed(bam):
    made = readers.assemble(read(bam([entry(0.01 * k) for k in range(9)]))).recording
    bare = {k: v for k, v in made.columns.items() if k != "stiffness.servo"}
    with pytest.raises(ValueError, match=r"has stiffness\.servo, which not all"):
        readers.joined([made, made._replace(columns=bare)], "both")


def test_a_number_that_is_missing_is_told_with_its_row(bam):
    rows = [entry(0.01 * k) for k in range(5)]
    rows[3]["position"] = None
    with pytest.raises(ValueError, match="entry 4 has no number 'position'"):
        read(bam(rows))


def test_vectors_of_a_motion_become_joints(tmp_path):
    angles = np.stack([np.sin(TIME), np.cos(TIME)], 1)
    stamps = 1e6 * TIME + 5.0  # microseconds

    def rows(kind, *vectors):
        for k, stamp in enumerate(stamps):
            cells = ",".join(f'"{json.dumps(list(vector[k]))}"' for vector in vectors)
            yield f"{kind},{stamp},{cells}\n"

    control = "type,timestamp,positions\n" + "".join(rows("CONTROL", angles + 0.1))
    (tmp_path / "control.csv").write_text(control)
    state = "type,timestamp,positions,velocities\n"
    state += "".join(rows("STATE_MOTOR", angles, 0.0 * angles))
    with gzip.open(tmp_path / "state_motor.csv.gz", "wt") as file:
        file.write(state)
    (tmp_path / "joint_list.txt").write_text("pan\ntilt\n")
    made = readers.assemble(read(tmp_path)).recording
    np.testing.assert_allclose(np.diff(made.time), np.diff(TIME), atol=1e-9)
    np.testing.assert_array_equal(made.columns["position.tilt"], np.cos(TIME))
    np.testing.assert_array_equal(made.columns["command.pan"], np.sin(TIME) + 0.1)
    (tmp_path / "control.csv").write_text(control.replace("[0.1, 1.1]", "[0.1; 1.1]"))
    with pytest.raises(ValueError, match=r"row 1, column 'positions'.*no list"):
        read(tmp_path)


@pytest.fixture
def lerobot(tmp_path):
    """A dataset of two episodes, laid out as LeRobot version 3 does."""
    names = {"motors": ["pan.pos", "grip.pos"]}
    features = {key: {"dtype": "float32", "shape": [2], "names": names}
                for key in ("action", "observation.state")}  # fmt: skip
    info = {"codebase_version": "v3.0", "robot_type": "so101", "features": features}
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text(json.dumps(info))
    state = np.stack([np.tile(TIME, 2), -np.tile(TIME, 2)], 1).astype(np.float32)
    table = pa.table({
        "timestamp": pa.array(np.tile(TIME, 2), pa.float32()),
        "episode_index": np.repeat([0, 1], len(TIME)),
        "action": pa.FixedSizeListArray.from_arrays((2.0 * state).ravel(), 2),
        "observation.state": pa.FixedSizeListArray.from_arrays(state.ravel(), 2),
        "task_index": np.zeros(2 * len(TIME), int),
    })  # fmt: skip
    folder = tmp_path / "data" / "chunk-000"
    folder.mkdir(parents=True)
    parquet.write_table(table, folder / "file-000.parquet")
    return tmp_path


def test_episodes_of_a_dataset_are_runs(lerobot):
    source = read(lerobot)
    assert len(source.runs) == 2
    made = readers.assemble(source).recording
    assert made.trajectory.tolist() == [0] * 51 + [1] * 51
    angle = np.rad2deg(made.columns["position.grip"][51:])
    np.testing.assert_allclose(angle, -TIME, atol=1e-6)
    sent = np.rad2deg(made.columns["command.pan"][:51])
    np.testing.assert_allclose(sent, 2.0 * TIME, atol=1e-6)


def test_actions_belong_to_the_states_that_are_called_like_them(lerobot):
    file = lerobot / "meta" / "info.json"
    info = json.loads(file.read_text())
    info["features"]["action"]["names"] = {"motors": ["grip.pos", "pan.pos"]}
    file.write_text(json.dumps(info))
    made = readers.assemble(read(lerobot)).recording
    sent = np.rad2deg(made.columns["command.grip"][:51])  # the first of the actions
    np.testing.assert_allclose(sent, 2.0 * TIME, atol=1e-6)
    info["features"]["action"]["names"] = {"motors": ["a", "b"]}
    file.write_text(json.dumps(info))
    assert "taken in their order" in read(lerobot).notes[0]


def test_a_dataset_without_its_data_says_so(lerobot):
    for file in lerobot.rglob("*.parquet"):
        file.unlink()
    with pytest.raises(ValueError, match="download"):
        read(lerobot)


@pytest.mark.parametrize(("name", "line"), [
    ("log.bag", "ending '.bag' is not known"), ("gone.csv", "no such file"),
])  # fmt: skip
def test_other_files_are_refused_with_what_is_known(tmp_path, name, line):
    path = tmp_path / name
    if "gone" not in name:
        path.write_bytes(b"#ROSBAG V2.0")
    with pytest.raises((ValueError, FileNotFoundError), match=line):
        read(path)


def test_a_folder_of_no_log_is_refused(tmp_path):
    with pytest.raises(ValueError, match="folder of no known log"):
        read(tmp_path)


@pytest.mark.parametrize(("name", "content"), [
    ("cut.npz", b"PK\x03\x04 and no more"), ("array.npz", b"\x93NUMPY\x01\x00"),
    ("text.json", b'{"entries": "many"}'), ("list.json", b'{"entries": [1, 2]}'),
    ("cut.pt", b"PK\x03\x04"), ("cut.parquet", b"PAR1 PAR1"), ("cut.mcap", b"\x89MCAP"),
])  # fmt: skip
def test_whatever_a_parser_trips_over_is_one_line_with_the_file(
    tmp_path, name, content
):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ValueError, match=name.replace(".", r"\.")) as error:
        read(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("name", "given"), [("episode", {}), ("lap", {"run": "lap"})])
def test_arrays_are_parted_into_runs(tmp_path, name, given):
    path, lap = tmp_path / "log.npz", np.repeat([3, 1], [60, 40])
    time = np.concatenate([np.arange(60), np.arange(40)]) * 0.01
    np.savez(path, time=time, q=lap[:, None] + time[:, None], action=time[:, None],
             **{name: lap})  # fmt: skip
    source = readers.read(path, lambda share: None, readers.Given(**given))
    made = readers.assemble(source).recording
    assert made.trajectory.tolist() == [0] * 40 + [1] * 60
    assert made.columns["position.joint_0"][[0, 40]].tolist() == [1.0, 3.0]
    with pytest.raises(ValueError, match="'round' is no array of the runs' numbers"):
        readers.read(path, lambda share: None, readers.Given(run="round"))


def test_runs_that_are_known_cannot_be_named(tmp_path):
    with pytest.raises(ValueError, match="its runs are known already"):
        readers.read(tmp_path, lambda share: None, readers.Given(run="lap"))


@pytest.mark.parametrize("array", [
    np.array(5), np.zeros((100, 2)), 0.01 * np.arange(100), np.full(100, "a"),
    np.where(np.arange(100) > 50, np.nan, 1.0),
])  # fmt: skip
def test_an_array_that_numbers_no_runs_parts_nothing(tmp_path, array):
    path, time = tmp_path / "log.npz", 0.01 * np.arange(100)
    np.savez(path, time=time, q=time[:, None], trajectory=array)
    assert len(read(path).runs) == 1
    with pytest.raises(ValueError, match="'trajectory' is no array of the runs'"):
        readers.read(path, lambda share: None, readers.Given(run="trajectory"))
