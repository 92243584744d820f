"""`gatjax import` as a user runs it."""

import numpy as np
import pyarrow as pa
import pytest
import ros_logs as logs
from pyarrow import parquet

from gatjax.cli import main
from gatjax.data.recording import Recording, read_recording
from gatjax.report.recording import _busiest, draw_recording


@pytest.fixture
def brought(tmp_path, capsys):
    """Runs the verb; returns its exit code, output and error, and the recording."""

    def run(*arguments):
        out = tmp_path / "out" / "log.parquet"
        code = main(["import", *map(str, arguments), "--out", str(out)])
        said = capsys.readouterr()
        return code, said.out, said.err, out

    return run


def test_a_bag_becomes_a_recording_a_draft_and_a_picture(tmp_path, brought):
    log = logs.write_mcap(tmp_path / "walk.mcap", logs.messages())
    code, said, _, out = brought(log)
    assert code == 0
    assert "/joint_states/position.hip" in said
    assert "100 Hz" in said
    assert "50 Hz, held until the next one" in said
    recording = read_recording(out)
    np.testing.assert_array_equal(
        recording.columns["position.hip"], logs.angles(logs.SEEN)[0]
    )
    assert out.with_suffix(".png").read_bytes()[:4] == b"\x89PNG"
    draft = out.with_suffix(".map.yaml")
    corrected = draft.read_text().replace(
        "data.0, unit: rad, sign: 1", "data.0, unit: rad, sign: -1"
    )
    draft.write_text(corrected)
    code, said, _, _ = brought(log, "--map", draft)
    assert code == 0
    turned = read_recording(out).columns["command.hip"]
    np.testing.assert_array_equal(turned, -recording.columns["command.hip"])
    code, said, _, _ = brought(log)
    assert "was corrected and stays" in said
    assert draft.read_text() == corrected


def test_a_draft_that_nobody_corrected_makes_room_for_that_of_other_logs(
    tmp_path, brought
):
    for name in "ab":
        table = {"time": logs.SEEN, f"position.{name}": logs.SEEN,
                 f"command.{name}": logs.SEEN}  # fmt: skip
        parquet.write_table(pa.table(table), tmp_path / f"{name}.parquet")
    _, _, _, out = brought(tmp_path / "a.parquet")
    draft = out.with_suffix(".map.yaml")
    assert "position.a" in draft.read_text()
    assert "# time: {unit: s}" in draft.read_text()
    code, said, _, _ = brought(tmp_path / "b.parquet")
    assert code == 0 and "stays" not in said
    assert "position.b" in draft.read_text() and "position.a" not in draft.read_text()


def test_signals_are_listed_of_the_first_logs_only(tmp_path, brought):
    files = []
    for number in range(6):
        files.append(tmp_path / f"{number}.parquet")
        table = {"time": logs.SEEN, "position.a": logs.SEEN, "command.a": logs.SEEN}
        parquet.write_table(pa.table(table), files[-1])
    _, said, _, _ = brought(*files)
    assert all(f"{file}: wide table, 1 run, 2 signals" in said for file in files)
    assert said.count("  position.a ") == 4


def test_a_long_log_is_drawn_from_close_by_where_it_moves(tmp_path):
    time = np.arange(3000) * 0.01
    moving = np.where((time > 17.0) & (time < 22.0), np.sin(10.0 * time), 0.0)
    log = Recording("log", time, np.zeros(3000, int), {"position.a": moving}, {})
    assert 16.0 <= _busiest(time, log, ["a"], 1) <= 17.1
    draw_recording(log, tmp_path / "log.png")
    assert (tmp_path / "log.png").read_bytes()[:4] == b"\x89PNG"


def test_what_only_one_log_has_is_left_out_and_told(tmp_path, brought):
    seen = {"time": logs.SEEN, "position.a": logs.SEEN, "command.a": logs.SEEN}
    for name, more in (("one", {}), ("two", {"velocity.a": logs.SEEN})):
        parquet.write_table(pa.table(seen | more), tmp_path / f"{name}.parquet")
    code, said, _, out = brought(tmp_path / "one.parquet", tmp_path / "two.parquet")
    assert code == 0
    assert "left out, not in every log: velocity.a" in said
    assert set(read_recording(out).columns) == {"position.a", "command.a"}


def test_logs_of_one_robot_become_one_recording(tmp_path, brought):
    log = logs.write_mcap(tmp_path / "walk.mcap", logs.messages())
    bag = logs.write_bag(tmp_path / "walk_bag", logs.messages())
    code, _, _, out = brought(log, bag)
    assert code == 0
    assert np.unique(read_recording(out).trajectory).tolist() == [0, 1]


@pytest.mark.parametrize(("table", "line"), [
    ({"position.a": np.sin(logs.SEEN)}, "position.a without command.a"),
    ({"position.a": np.sin(logs.SEEN), "command.a": 57.0 * np.sin(logs.SEEN)},
     "looks like degrees"),
    ({"x": logs.SEEN}, "no position of any joint"),
])  # fmt: skip
def test_what_cannot_be_used_is_one_line(tmp_path, brought, table, line):
    path = tmp_path / "log.parquet"
    parquet.write_table(pa.table({"time": logs.SEEN} | table), path)
    code, _, error, out = brought(path)
    assert code == 1
    assert line in error
    assert not out.exists()


def test_names_that_nobody_knows_lead_to_the_draft(tmp_path, brought):
    path = tmp_path / "log.parquet"
    parquet.write_table(pa.table({"time": logs.SEEN, "x": logs.SEEN}), path)
    _, _, error, out = brought(path)
    draft = out.with_suffix(".map.yaml")
    assert draft.is_file() and f"the draft is {draft}" in error


def test_no_log_is_an_error(brought):
    code, _, error, _ = brought()
    assert code == 1
    assert "no log is named" in error


@pytest.mark.parametrize(("log", "out"), [
    ("run.json", "run.csv"), ("run.csv", "run.csv"), ("run.csv", "run.parquet"),
])  # fmt: skip
def test_a_log_is_never_written_over(tmp_path, capsys, log, out):
    text = "time,position.a,command.a\n" + "".join(f"{k},{k},1\n" for k in range(9))
    path = tmp_path / log
    path.write_text(text)
    code = main(["import", str(path), "--out", str(tmp_path / out)])
    same = out == "run.csv"
    assert (code == 1 and "would be written over" in capsys.readouterr().err) is same
    assert path.read_text() == text


def test_a_file_of_a_folder_that_is_a_log_is_never_written_over(tmp_path, capsys):
    inside = tmp_path / "motion" / "control.csv"
    inside.parent.mkdir()
    inside.write_text("as it was")
    assert main(["import", str(inside.parent), "--out", str(inside)]) == 1
    said = capsys.readouterr().err
    assert f"is a file of {inside.parent} and would be written over" in said
    assert inside.read_text() == "as it was"


def test_a_map_may_name_everything(tmp_path, brought):
    table = {"stamp_ms": 1e3 * logs.SEEN, "q": np.sin(logs.SEEN),
             "goal": np.sin(logs.SEEN), "lap": np.zeros(len(logs.SEEN))}  # fmt: skip
    parquet.write_table(pa.table(table), tmp_path / "log.parquet")
    (tmp_path / "map.yaml").write_text(
        "columns: {time: {from: stamp_ms, unit: ms, scale: 2}, trajectory: lap,"
        " position.a: q, command.a: goal}"
    )
    code, said, _, out = brought(
        tmp_path / "log.parquet", "--map", tmp_path / "map.yaml"
    )
    rate = 0.5 / np.median(np.diff(logs.SEEN))
    assert code == 0 and f"{rate:.4g} Hz" in said
    np.testing.assert_allclose(read_recording(out).time, 2.0 * logs.SEEN)


def test_a_command_without_a_position_is_said_to_be_that(tmp_path, brought):
    table = {"time": logs.SEEN, "command.servo": logs.SEEN, "position.knee": logs.SEEN}
    parquet.write_table(pa.table(table), tmp_path / "log.parquet")
    code, _, error, _ = brought(tmp_path / "log.parquet")
    assert code == 1 and "command.servo without position.servo" in error


def test_what_stands_at_an_end_and_what_is_not_there_is_told(tmp_path, brought):
    wave = np.clip(np.sin(4.0 * logs.SEEN), -0.5, 1.0)
    table = {"time": logs.SEEN, "position.a": wave, "command.a": np.sin(logs.SEEN),
             "velocity.a": np.cos(logs.SEEN)}  # fmt: skip
    parquet.write_table(pa.table(table), tmp_path / "log.parquet")
    _, said, *_ = brought(tmp_path / "log.parquet")
    assert f"{np.mean(wave == -0.5):.0%} at its least" in said
    assert "at its largest" not in said
    assert "not there: torque, current, temperature, stiffness, gyro" in said


@pytest.mark.parametrize("text", [
    '{"schema": "gatjax.policy/1"}', '{"entries": [{"t": 0.0}]}', '{"mass": 0.1}', "[",
])  # fmt: skip
def test_what_is_no_recordings_metadata_is_not_written_over(tmp_path, capsys, text):
    table = {"time": logs.SEEN, "position.a": logs.SEEN, "command.a": logs.SEEN}
    parquet.write_table(pa.table(table), tmp_path / "a.parquet")
    policy = tmp_path / "walk.json"
    policy.write_text(text)
    given = ["import", str(tmp_path / "a.parquet"), "--out", str(tmp_path / "walk.csv")]
    assert main(given) == 1
    assert f"{policy} would be written over" in capsys.readouterr().err
    (tmp_path / "walk.csv").write_text("a,b\n")
    assert main(given) == 1
    assert policy.read_text() == text
    policy.unlink()
    assert main(given) == 0 and main(given) == 0  # its own


def test_a_dropped_column_may_be_anything(tmp_path, brought):
    rows = [
        f"{t:.2f},{t:.2f},{t:.2f},{'E1' if t > 1.5 else int(100 * t) % 7}"
        for t in logs.SEEN
    ]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(["time,position.a,command.a,status", *rows]))
    drop = tmp_path / "drop.yaml"
    drop.write_text("drop: [status]")
    code, _, _, out = brought(log, "--map", drop)
    assert code == 0 and "position.a" in read_recording(out).columns
