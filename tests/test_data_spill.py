"""Columns that are longer than what is kept in memory."""

import mmap

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from gatjax.cli import main
from gatjax.data import spill
from gatjax.data.recording import read_recording
from gatjax.data.spill import Column, mapped, release

NUMBERS = np.random.default_rng(0).normal(size=1000)


@pytest.fixture
def small(monkeypatch):
    """Next to nothing is kept in memory."""
    monkeypatch.setattr(spill, "LARGE", 64)
    monkeypatch.setattr(spill, "BLOCK", 50)


def in_file(array):
    """Whether an array is a view of a file."""
    while isinstance(array, np.ndarray):
        array = array.base
    return isinstance(array, mmap.mmap)


@pytest.mark.parametrize("piece", [7, 64, 65, 1000])
def test_a_long_column_lies_in_a_file_and_is_what_came(small, piece):
    column = Column()
    for first in range(0, 1000, piece):
        column.add(NUMBERS[first : first + piece])
    whole = column.whole()
    assert in_file(whole)
    np.testing.assert_array_equal(whole, NUMBERS)
    part = whole[10:20]
    release(part, NUMBERS)
    np.testing.assert_array_equal(part, NUMBERS[10:20])


def test_a_short_column_stays_in_memory():
    column = Column()
    assert len(column.whole()) == 0
    column.add(NUMBERS)
    assert not in_file(column.whole())


def test_what_is_computed_of_a_long_column_lies_in_a_file_too(small):
    out = mapped(lambda part: 2.0 * part, NUMBERS)
    assert in_file(out)
    np.testing.assert_array_equal(out, 2.0 * NUMBERS)


def test_a_log_is_the_same_recording_whatever_is_kept_in_memory(tmp_path, monkeypatch):
    time = np.arange(2000) * 0.01
    seen, sent = np.degrees(np.sin(time)), np.degrees(np.sin(time + 0.1))
    table = {"time": time, "run": np.repeat([2, 5], 1000), "q": seen, "goal": sent}
    parquet.write_table(pa.table(table), tmp_path / "log.parquet", row_group_size=300)
    (tmp_path / "map.yaml").write_text(
        "columns: {position.a: {from: q, unit: deg},"
        " command.a: {from: goal, unit: deg}}"
    )
    found = []
    for kept in (1 << 20, 64):
        monkeypatch.setattr(spill, "LARGE", kept)
        out = tmp_path / f"{kept}.parquet"
        given = [str(tmp_path / "log.parquet"), "--map", str(tmp_path / "map.yaml")]
        assert main(["import", *given, "--out", str(out)]) == 0
        found.append(read_recording(out))
    one, other = found
    np.testing.assert_array_equal(one.trajectory, np.repeat([0, 1], 1000))
    for name, values in one.columns.items():
        np.testing.assert_array_equal(other.columns[name], values)
    np.testing.assert_allclose(one.columns["position.a"], np.sin(time))
