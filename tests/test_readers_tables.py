"""CSV and Parquet tables, wide and long."""

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv, parquet

from gatjax.data import readers
from gatjax.data.readers import tables
from gatjax.data.recording import Recording, write_recording

TIME = np.arange(300) * 0.01


def read(path, **named):
    return readers.read(path, lambda share: None, readers.Given(**named))


def write(table, path):
    """A table in the format of its ending."""
    with_ending = {".csv": csv.write_csv, ".parquet": parquet.write_table}
    with_ending[path.suffix](pa.table(table), path)
    return path


@pytest.fixture(params=[".csv", ".parquet"])
def ending(request, monkeypatch):
    """Read in many pieces."""
    monkeypatch.setattr(tables, "PIECE", 6400)
    return request.param


def test_columns_of_a_recording_are_found_by_their_names(tmp_path, ending):
    table = {
        "time": np.tile(TIME, 2), "trajectory": np.repeat([4, 7], 300),
        "position.elbow": np.arange(600), "command.elbow": np.arange(600) * 0.5,
        "note": ["ok"] * 600, "room": np.full(600, 21.5),
    }  # fmt: skip
    source = read(write(table, tmp_path / f"log{ending}"))
    assert source.kind == "wide table"
    assert "column 'note' left out" in source.notes[0]
    made = readers.assemble(source).recording
    assert set(made.columns) == {"position.elbow", "command.elbow"}
    np.testing.assert_array_equal(made.columns["command.elbow"], np.arange(600) * 0.5)
    assert made.trajectory.tolist() == [0] * 300 + [1] * 300


def test_rows_of_a_long_table_are_signals_of_each_joint(tmp_path, ending):
    who = np.tile(["hüfte", "knee"], 300)
    table = {
        "time": np.repeat(TIME, 2) + np.tile([0.0, 0.001], 300), "joint": who,
        "position": np.where(who == "knee", 1.0, 2.0),
        "target": np.where(who == "knee", np.nan, 3.0),
    }  # fmt: skip
    source = read(write(table, tmp_path / f"log{ending}"))
    run = source.runs[0]
    assert source.kind == "long table"
    assert set(run) == {"position.hüfte", "position.knee", "target.hüfte"}
    np.testing.assert_allclose(run["position.knee"].time, TIME + 0.001)
    assert set(run["position.knee"].values) == {1.0}
    assert len(run["target.hüfte"].values) == 300


def test_a_column_that_turns_out_to_have_fractions(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "PIECE", 400)
    path = tmp_path / "log.csv"
    rows = [f"{k},{0 if k < 250 else 0.25}" for k in range(300)]
    path.write_text("\n".join(["time,position.a", *rows]))
    values = read(path).runs[0]["position.a"].values
    assert values[-1] == 0.25
    assert len(values) == 300


def test_interleaved_runs_are_taken_apart(tmp_path):
    table = {"time": np.repeat(TIME, 2), "run": np.tile([0, 1], 300),
             "position.a": np.tile([5.0, 6.0], 300)}  # fmt: skip
    runs = read(write(table, tmp_path / "log.parquet")).runs
    assert [set(run["position.a"].values) for run in runs] == [{5.0}, {6.0}]


def test_text_among_the_numbers_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "PIECE", 400)
    path = tmp_path / "log.csv"
    rows = [f"{k},{'late' if k == 280 else k}" for k in range(300)]
    path.write_text("\n".join(["time,position.a", *rows]))
    with pytest.raises(ValueError, match=r"log\.csv.*'?late"):
        read(path)


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", "time,b\n"])
def test_a_table_without_time_or_rows_is_refused(tmp_path, text):
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"log\.csv"):
        read(path)


def test_empty_cells_are_no_samples_so_every_signal_has_its_own_stamps(
    tmp_path, ending
):
    odd = np.arange(300) % 2 == 1
    table = {"time": TIME, "command.a": np.where(odd, np.nan, TIME),
             "position.a": np.where(odd, 2.0 * TIME, np.nan)}  # fmt: skip
    columns = {name: pa.array(v, from_pandas=True) for name, v in table.items()}
    source = read(write(columns, tmp_path / f"log{ending}"))
    np.testing.assert_allclose(source.runs[0]["command.a"].time, TIME[~odd])
    assert "150 of 300 rows have no number in command.a, position.a" in source.notes[0]
    made = readers.assemble(source).recording
    np.testing.assert_allclose(made.time, TIME[odd])
    np.testing.assert_allclose(made.columns["command.a"], TIME[odd] - 0.01)
    np.testing.assert_allclose(made.columns["position.a"], 2.0 * TIME[odd])


def test_a_header_alone_is_no_log(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time,command.a,position.a\n")
    with pytest.raises(ValueError, match=r"log.csv: no rows below the names of col"):
        read(path)


def test_a_map_names_the_stamps_and_the_runs(tmp_path):
    table = {"stamp_ms": 1e3 * TIME, "lap": np.repeat([3, 8], 150), "q": TIME}
    path = write(table, tmp_path / "log.csv")
    with pytest.raises(ValueError, match=r"no column of time.*stamp_ms, lap, q"):
        read(path)
    runs = read(path, time="stamp_ms", run="lap").runs
    assert [set(run) for run in runs] == [{"q"}, {"q"}]
    assert runs[1]["q"].time[0] == 1500.0
    with pytest.raises(ValueError, match="no column 'round'; it has stamp_ms, lap, q"):
        read(path, time="stamp_ms", run="round")


def test_a_column_that_is_there_twice_is_refused(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time,position.a,position.a\n0,1,2\n1,1,2\n")
    with pytest.raises(ValueError, match=r"column position\.a is there twice"):
        read(path)


def test_a_recording_of_ours_keeps_what_it_says_of_itself(tmp_path, ending):
    columns = {"command.a": TIME, "position.a": TIME}
    facts = {"command_unit": "N m", "base": "fixed", "robot": "crane"}
    log = Recording("log", TIME, np.zeros(300, int), columns, facts)
    path = tmp_path / f"log{ending}"
    write_recording(path, log)
    assert readers.assemble(read(path)).recording.metadata == facts


def test_a_json_of_another_program_beside_a_csv_is_told(tmp_path):
    path = write({"time": TIME, "position.a": TIME}, tmp_path / "log.csv")
    path.with_suffix(".json").write_text("[1, 2")
    assert read(path).notes[0].endswith("not used")


def test_one_text_among_numbers_is_told_with_its_row(tmp_path):
    path = tmp_path / "log.csv"
    rows = [f"{k},{'late' if k == 250 else k}" for k in range(300)]
    path.write_text("\n".join(["time,position.a", *rows]))
    with pytest.raises(ValueError, match=r"row 251, column 'position\.a': 'late' is"):
        read(path)


def test_dates_codes_and_semicolons_are_what_other_programs_write(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("Time;q\n2026-11-20T10:00:00.5;1\n2026-11-20T10:00:01;2\n")
    run = read(path).runs[0]
    np.testing.assert_allclose(np.diff(run["q"].time), 0.5)
    path.write_text("Time;q\n0,00;1,5\n0,01;2\n")
    run = read(path).runs[0]
    np.testing.assert_allclose(run["q"].values, [1.5, 2.0])
    np.testing.assert_allclose(run["q"].time, [0.0, 0.01])
    coded = {"time": TIME, "position": TIME,
             "joint": pa.array(["a", "b"] * 150).dictionary_encode()}  # fmt: skip
    source = read(write(coded, tmp_path / "coded.parquet"))
    assert set(source.runs[0]) == {"position.a", "position.b"}


def test_joints_may_be_numbers_and_names(tmp_path):
    who = ["1", "2", "left"] * 100
    table = {"time": np.repeat(TIME[:100], 3), "joint": who, "position": TIME}
    run = read(write(table, tmp_path / "log.parquet")).runs[0]
    assert set(run) == {"position.1", "position.2", "position.left"}


@pytest.mark.parametrize("cell", ["", "nan"])
def test_a_row_without_a_stamp_is_told(tmp_path, cell):
    path = tmp_path / "log.csv"
    path.write_text(f"time,position.a\n0,1\n{cell},2\n2,3\n")
    with pytest.raises(ValueError, match="row 2, column 'time': nan is not a number"):
        read(path)


def lines(path, header, *rows):
    """A CSV file of these lines."""
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_truth_is_a_number(tmp_path, ending):
    table = {"time": TIME, "position.a": TIME, "command.a": TIME, "on": TIME > 1.0}
    run = read(write(table, tmp_path / f"log{ending}")).runs[0]
    np.testing.assert_array_equal(run["on"].values, TIME > 1.0)
    np.testing.assert_array_equal(run["position.a"].values, TIME)


@pytest.mark.parametrize("late", ["wave", "7.5", ""])
def test_what_a_column_holds_may_show_late(tmp_path, monkeypatch, late):
    monkeypatch.setattr(tables, "PIECE", 1000)
    rows = [f"{t:.2f},{t:.2f},{t:.2f},{late if t > 2.0 else ''}" for t in TIME]
    path = lines(tmp_path / "log.csv", "time,position.a,command.a,event", *rows)
    source = read(path)
    run = source.runs[0]
    assert ("event" in run) is (late == "7.5")
    if late == "7.5":
        assert run["event"].time[0] == pytest.approx(2.01)
        assert set(run["event"].values) == {7.5}
    else:
        assert "event" in " ".join(source.notes)
    assert len(run["position.a"].time) == len(TIME)


def test_a_column_that_is_dropped_is_not_read(tmp_path):
    rows = [
        f"{t:.2f},{t:.2f},{t:.2f},{'E1' if t > 2.0 else int(100 * t) % 7}" for t in TIME
    ]
    path = lines(tmp_path / "log.csv", "time,position.a,command.a,status", *rows)
    with pytest.raises(ValueError, match=r"'E1' is not a number.*under drop in --map"):
        read(path)
    source = read(path, skips=lambda name: name in ("status", "time"))
    assert list(source.runs[0]) == ["position.a", "command.a"]


def test_a_run_without_a_number_is_left_out(tmp_path, ending):
    gone = np.where(np.arange(300) < 50, np.nan, TIME)
    table = {"time": TIME, "trajectory": np.repeat([0, 1], [50, 250]),
             "position.a": gone, "command.a": gone}  # fmt: skip
    source = read(write(table, tmp_path / f"log{ending}"))
    assert len(source.runs) == 1 and "run 0 left out" in " ".join(source.notes)
    assert len(readers.assemble(source).recording.time) == 250


@pytest.mark.parametrize(("mark", "word"), [(";", ""), (",", "N/A")])
def test_numbers_that_come_late_are_numbers(tmp_path, monkeypatch, mark, word):
    monkeypatch.setattr(tables, "PIECE", 1000)
    said = [f"{t:.2f}" if t > 2.0 else word for t in TIME]
    rows = [mark.join([f"{t:.2f}"] * 3 + [s]) for t, s in zip(TIME, said, strict=True)]
    rows = [row.replace(".", ",") for row in rows] if mark == ";" else rows
    names = mark.join(["time", "position.a", "command.a", "heat"])
    run = read(lines(tmp_path / "log.csv", names, *rows)).runs[0]
    np.testing.assert_allclose(run["heat"].values, TIME[TIME > 2.0], atol=5e-3)


def test_what_parts_a_table_can_be_dropped(tmp_path, ending):
    table = {
        "time": TIME,
        "signal": np.where(TIME > 1.0, "ok", "warn"),
        "run": np.arange(300) // 50 % 2,
        "position.a": TIME,
        "command.a": TIME,
    }
    log = write(table, tmp_path / f"log{ending}")
    (run,) = read(log, skips=lambda name: name in ("signal", "run")).runs
    assert list(run) == ["position.a", "command.a"]
    assert len(read(log, skips=lambda name: name == "signal").runs) == 2


def test_a_column_without_a_text_is_left_out_and_told(tmp_path, ending):
    nothing = pa.array([None] * 300, pa.string())
    table = {"time": TIME, "position.a": TIME, "note": nothing}
    source = read(write(table, tmp_path / f"log{ending}"))
    assert list(source.runs[0]) == ["position.a"]
    assert "note" in " ".join(source.notes)


def test_decimal_commas_of_a_joint_that_starts_late(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "PIECE", 1000)
    said = [("2,50" if t > 1.5 else "", "tired" if t > 2.0 else "") for t in TIME]
    clock = [f"{t:.2f}".replace(".", ",") for t in TIME]
    rows = [";".join([at, at, *own]) for at, own in zip(clock, said, strict=True)]
    path = lines(tmp_path / "log.csv", "time;position.a;position.b;note", *rows)
    run = read(path).runs[0]
    assert list(run) == ["position.a", "position.b"]
    assert set(run["position.b"].values) == {2.5}
    assert len(run["position.b"].time) == (TIME > 1.5).sum()


def test_decimal_commas_after_a_row_of_whole_numbers(tmp_path):
    rows = [f"{t:.2f};{t:.3f}".replace(".", ",") for t in TIME]
    path = lines(tmp_path / "log.csv", "time;position.a", "0;0", *rows[1:])
    np.testing.assert_allclose(read(path).runs[0]["position.a"].values, TIME)


def test_names_may_have_a_space_before_them(tmp_path):
    path = lines(tmp_path / "log.csv", "time; position.a", *[f"{t};{t}" for t in TIME])
    assert list(read(path).runs[0]) == ["position.a"]


def test_stamps_that_are_text_are_told(tmp_path):
    path = lines(tmp_path / "log.csv", "time,position.a", "at once,0", "later,1")
    with pytest.raises(ValueError, match="'time' holds text, such as 'at once'"):
        read(path)
