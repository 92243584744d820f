"""CSV and Parquet tables, wide and long."""

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv, parquet

from gatjax.data import readers
from gatjax.data.readers import tables

TIME = np.arange(300) * 0.01


def read(path):
    return readers.read(path, lambda share: None)


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
