"""Signals on clocks of their own become one recording."""

import numpy as np
import pytest
import yaml

from gatjax.data import readers
from gatjax.data.mapping import column_map, read_map
from gatjax.data.readers import Source, Stream, drafts

SLOW, FAST = np.arange(0.0, 1.0, 0.1), np.arange(0.045, 1.0, 0.01)


def source(*runs, draft=None, name="log"):
    return Source(name, "test", list(runs), draft or {}, {}, [])


def run(**signals):
    return {name.replace("_", "."): Stream(*pair) for name, pair in signals.items()}


PLAIN = run(command_a=(SLOW, SLOW), position_a=(FAST, 2.0 * FAST))


def test_a_row_holds_the_last_command_and_none_before_the_first():
    late = run(command_a=(SLOW + 0.5, SLOW), position_a=(FAST, FAST))
    made = readers.assemble(source(late, draft={"position.a": {"from": "position.a"}}))
    assert made.recording.time[0] >= 0.5
    at = np.searchsorted(SLOW + 0.5, made.recording.time, side="right") - 1
    np.testing.assert_array_equal(made.recording.columns["command.a"], SLOW[at])
    assert "run 0: 46 rows before the first command left out" in " ".join(made.notes)


def test_what_is_slower_than_the_rows_is_interpolated_and_told():
    both = PLAIN | run(velocity_a=(SLOW, SLOW))
    made = readers.assemble(source(both))
    inside = made.recording.time < SLOW[-1]
    np.testing.assert_allclose(
        made.recording.columns["velocity.a"][inside], made.recording.time[inside]
    )
    assert any("velocity.a: 10 Hz, interpolated" in note for note in made.notes)


def test_a_map_gives_names_units_signs_offsets_and_the_unit_of_time():
    raw = {"motor": Stream(1e3 * FAST, 10.0 * FAST), "goal": Stream(1e3 * SLOW, SLOW)}
    told = {"columns": {
        "time": {"unit": "ms"},
        "position.a": {"from": "motor", "unit": "deg", "sign": -1, "offset": 90},
        "command.a": "goal",
    }}  # fmt: skip
    made = readers.assemble(source(raw), column_map(told, "map"))
    np.testing.assert_allclose(made.recording.time, FAST)
    expected = np.deg2rad(90.0 - 10.0 * FAST)
    np.testing.assert_allclose(made.recording.columns["position.a"], expected)


@pytest.mark.parametrize(("time", "sample"), [
    (np.array([0.0, 0.1, 0.1, 0.2]), 3), (np.array([0.0, 0.2, 0.1, 0.3]), 3),
])  # fmt: skip
def test_stamps_that_stand_or_run_back_are_refused(time, sample):
    bad = run(command_a=(SLOW, SLOW), position_a=(time, time))
    with pytest.raises(ValueError, match=f"run 0, position.a: sample {sample} is"):
        readers.assemble(source(bad))


def test_a_log_without_positions_is_refused_with_what_it_has():
    with pytest.raises(ValueError, match=r"no position of any joint.*command\.a"):
        readers.assemble(source(run(command_a=(SLOW, SLOW))))


def test_columns_that_some_runs_lack_are_left_out():
    made = readers.assemble(source(PLAIN | run(velocity_a=(FAST, FAST)), PLAIN))
    assert set(made.recording.columns) == {"command.a", "position.a"}
    assert any("velocity.a: left out" in note for note in made.notes)


def test_logs_of_one_robot_are_joined_with_runs_of_their_own():
    parts = [readers.assemble(source(PLAIN, PLAIN)).recording for _ in range(2)]
    whole = readers.joined(parts, "all")
    assert np.unique(whole.trajectory).tolist() == [0, 1, 2, 3]
    assert len(whole.time) == 4 * len(FAST)
    other = readers.assemble(
        source(run(command_b=(SLOW, SLOW), position_b=(FAST, FAST)))
    ).recording
    with pytest.raises(ValueError, match="no joint is in all"):
        readers.joined([parts[0], other], "all")


def test_a_draft_reads_back_as_the_map_that_it_drafts(tmp_path):
    draft = {
        "time": {"unit": "us"},
        "position.Knöchel links": {"from": "/state/pos: 1", "unit": "deg"},
        "command.a": {"from": "goal"},
    }
    raw = {"goal": Stream(SLOW, SLOW), "/state/pos: 1": Stream(FAST, FAST),
           "spare #2": Stream(FAST, FAST)}  # fmt: skip
    log = source(raw, draft=draft)
    path = tmp_path / "map.yaml"
    path.write_text(drafts.text([log]), encoding="utf-8")
    assert read_map(path).entries == drafts.drafted(log).entries
    assert '# not used: "spare #2"' in path.read_text(encoding="utf-8")


def test_a_draft_that_knows_nothing_shows_how_it_is_done():
    text = drafts.text([source(PLAIN)])
    assert "# position.JOINT: {from: SIGNAL, unit: rad" in text
    assert yaml.safe_load(text) == {"columns": None}


def test_no_signal_is_carried_on_beyond_its_own_stamps():
    inside = (FAST > 0.2) & (FAST < 0.6)
    some = FAST[inside]
    log = run(command_a=(SLOW, SLOW), command_b=(SLOW, SLOW), position_a=(FAST, FAST),
              position_b=(some, some), velocity_a=(FAST[:40], FAST[:40]))  # fmt: skip
    made = readers.assemble(source(log))
    np.testing.assert_allclose(made.recording.time, FAST[15:57])
    told = " ".join(made.notes)
    assert "15 rows before the first position.b left out" in told
    assert "39 rows after the last position.b left out" in told
    assert "velocity.a: left out, from 0.045 to 0.435 s only" in told
    assert "velocity.a" not in made.recording.columns


def test_a_command_that_ends_long_before_the_log_is_told():
    time = np.arange(0.0, 5.0, 0.01)
    made = readers.assemble(
        source(run(command_a=(SLOW, SLOW), position_a=(time, time)))
    )
    assert "nothing in the last 4.09 s, where the last one is held" in made.notes[0]
    assert made.recording.columns["command.a"][-1] == SLOW[-1]


def test_signals_that_never_meet_are_refused_with_their_times():
    log = run(command_a=(SLOW + 7.0, SLOW), position_a=(FAST, FAST))
    with pytest.raises(ValueError, match=r"command\.a begins at 7 s, position\.a ends"):
        readers.assemble(source(log))


def test_joined_logs_say_only_what_all_of_them_say():
    parts = [
        readers.assemble(source(PLAIN)).recording._replace(metadata=facts)
        for facts in ({"robot": "x", "mass": "1.0", "base": "fixed"},
                      {"robot": "y", "mass": "2.0", "base": "fixed"})
    ]  # fmt: skip
    told = readers.joined(parts, "all").metadata
    assert told == {"robot": "x", "base": "fixed"}


def test_what_is_dropped_is_dropped_by_either_name():
    raw = {"motor": Stream(FAST, FAST), "goal": Stream(SLOW, SLOW),
           "load": Stream(FAST, FAST)}  # fmt: skip
    columns = {"position.a": "motor", "command.a": "goal", "torque.a": "load"}
    told = column_map({"columns": columns, "drop": ["torque.*"]}, "map")
    made = readers.assemble(source(raw), told)
    assert set(made.recording.columns) == {"position.a", "command.a"}


@pytest.mark.parametrize("signal", ["position.b", "torque.b"])
def test_what_pauses_is_not_made_up(signal):
    time = np.arange(0.0, 10.0, 0.01)
    some = np.append(time[(time < 4.0) | (time > 6.005)], 10.1)
    both = {name: Stream(time, time) for name in ("command.a", "position.a")}
    both |= {"command.b": Stream(time, time), "position.b": Stream(time, time)}
    made = readers.assemble(source(both | {signal: Stream(some, some)}))
    columns, rows = made.recording.columns, made.recording.time
    told = " ".join(made.notes)
    if signal == "torque.b":
        assert len(rows) == len(time) and signal not in columns
        assert "torque.b: left out, nothing for 2.02 s" in told
        return
    assert not ((rows > 4.0) & (rows < 6.0)).any()
    assert len(rows) == (some < 10.0).sum()
    assert "201 rows in pauses of position.b left out" in told


def test_a_sample_that_is_lost_and_slow_signals_are_no_pause():
    time = np.arange(0.0, 10.0, 0.01)
    some = np.delete(time, [100, 500])
    both = {name: Stream(time, time) for name in ("command.a", "position.a")}
    both |= {"command.b": Stream(time, time), "position.b": Stream(some, some),
             "torque.b": Stream(time[::50], time[::50])}  # fmt: skip
    made = readers.assemble(source(both)).recording
    assert len(made.time) == len(time) and "torque.b" in made.columns


def test_joints_that_are_never_known_at_once_are_refused():
    bursts = np.concatenate([0.1 * k + 0.001 * np.arange(3) for k in range(50)])
    both = {f"{kind}.{joint}": Stream(bursts + late, bursts)
            for kind in ("command", "position", "velocity")
            for joint, late in (("a", 0.0), ("b", 0.05))}  # fmt: skip
    with pytest.raises(ValueError, match="positions pause in turns"):
        readers.assemble(source(both))
