"""The YAML map: names, units, signs, offsets, and what it refuses."""

import numpy as np
import pytest

from gatjax.data.mapping import UNITS, read_map, resolve, to_si
from gatjax.data.recording import check_recording, read_recording


def write_map(folder, text):
    path = folder / "map.yaml"
    path.write_text(text)
    return path


def refusal(folder, text):
    with pytest.raises(ValueError) as caught:
        read_map(write_map(folder, text))
    line = str(caught.value)
    assert "\n" not in line
    assert "map.yaml" in line
    return line


def column(folder, entry, raw, name="position.LKneePitch"):
    column_map = read_map(write_map(folder, f"columns:\n  {name}: {entry}\n"))
    entry = resolve(column_map, ["raw"], "log.csv")[name]
    return to_si(entry, np.array(raw))


@pytest.mark.parametrize(
    ("name", "unit", "raw", "si"),
    [
        ("position.LKneePitch", "deg", 180.0, np.pi),
        ("time", "ms", 20.0, 0.02),
        ("velocity.LKneePitch", "rpm", 60.0, 2.0 * np.pi),
        ("accelerometer.z", "g", 1.0, 9.80665),
        ("force.LFootFrontLeft", "kg", 2.0, 19.6133),
        ("current.LKneePitch", "mA", 250.0, 0.25),
        ("torque.LKneePitch", "N cm", 30.0, 0.3),
        ("base.x", "mm", 5.0, 0.005),
        ("torque.LKneePitch", "N·m", 2.0, 2.0),
        ("torque.LKneePitch", "N*m", 2.0, 2.0),
        ("temperature.LKneePitch", "°C", 40.0, 40.0),
        ("temperature.LKneePitch", "deg C", 40.0, 40.0),
        ("accelerometer.z", "m/s²", 9.8, 9.8),
        ("velocity.LKneePitch", "°/s", 180.0, np.pi),
    ],
)
def test_units_become_si(tmp_path, name, unit, raw, si):
    found = column(tmp_path, f"{{from: raw, unit: {unit}}}", [raw], name)
    np.testing.assert_allclose(found, [si], rtol=1e-12)


def test_the_first_unit_of_every_quantity_is_the_si_one():
    assert [next(iter(units.values())) for units in UNITS.values()] == [1.0] * len(
        UNITS
    )


def test_sign_and_offset_act_in_the_unit_of_the_log(tmp_path):
    found = column(tmp_path, "{from: raw, unit: deg, sign: -1, offset: 10.0}", [30.0])
    np.testing.assert_allclose(found, np.deg2rad([-20.0]), rtol=1e-12)


def test_a_scale_is_for_joints_without_a_unit(tmp_path):
    entry = "{from: raw, unit: deg, sign: -1, scale: 0.5, offset: 10.0}"
    np.testing.assert_allclose(column(tmp_path, entry, [30.0]), np.deg2rad([-5.0]))


def test_a_bare_name_only_renames(tmp_path):
    np.testing.assert_array_equal(column(tmp_path, "raw", [0.5, 1.0]), [0.5, 1.0])


def test_an_exponent_without_a_point_is_a_number(tmp_path):
    # YAML 1.1 reads 1e-3 as text
    np.testing.assert_allclose(
        column(tmp_path, "{from: raw, offset: 1e-3}", [0.0]), [0.001], rtol=1e-12
    )


def test_a_star_stands_for_every_joint_and_a_spelled_entry_goes_first(tmp_path):
    path = write_map(
        tmp_path,
        "columns:\n"
        "  position.*: {from: pos_*, unit: deg}\n"
        "  position.LKneePitch: {from: pos_LKneePitch, unit: rad}\n"
        "drop: [pos_status]\n",
    )
    names = ["time", "pos_LKneePitch", "pos_LHipPitch", "pos_status"]
    found = resolve(read_map(path), names, "log.csv")
    assert {key: entry.source for key, entry in found.items()} == {
        "position.LKneePitch": "pos_LKneePitch",
        "time": "time",
        "position.LHipPitch": "pos_LHipPitch",
    }
    assert found["position.LKneePitch"].factor == 1.0
    assert found["position.LHipPitch"].factor == pytest.approx(np.pi / 180.0)


def test_a_mapped_log_reads_like_the_native_one(tmp_path):
    native = tmp_path / "native.csv"
    native.write_text("time,command.LKneePitch,position.LKneePitch\n0.02,1.0,0.5\n")
    foreign = tmp_path / "foreign.csv"
    degrees = np.rad2deg([1.0, -0.5])
    foreign.write_text(
        f"stamp,target,knee,comment\n20,{float(degrees[0])!r},{float(degrees[1])!r},x\n"
    )
    path = write_map(
        tmp_path,
        "columns:\n"
        "  time: {from: stamp, unit: ms}\n"
        "  command.LKneePitch: {from: target, unit: deg}\n"
        "  position.LKneePitch: {from: knee, unit: deg, sign: -1}\n"
        "drop: [comment]\n"
        "metadata: {robot: nao, rate_hz: 50, day: 2024-05-01}\n",
    )
    expected = read_recording(native)
    found = read_recording(foreign, read_map(path))
    check_recording(found, ["LKneePitch"])
    np.testing.assert_allclose(found.time, expected.time, rtol=1e-15)
    assert found.columns.keys() == expected.columns.keys()
    for name, values in expected.columns.items():
        np.testing.assert_allclose(found.columns[name], values, rtol=1e-15)
    assert found.metadata["rate_hz"] == 50.0
    assert found.metadata["robot"] == "nao"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("column: {}", "unknown key column; known are columns, drop, metadata"),
        ("columns: {position.A: {form: a}}", "unknown key form; known are from, unit"),
        (
            "columns: {position.A: {unit: kg}}",
            "unit 'kg' is unknown for angle; choose ",
        ),
        ("columns: {position.A: {sign: 2}}", "sign is 2; it must be 1 or -1"),
        ("columns: {position.A: {scale: 0}}", "scale is 0; it must be more than 0"),
        (
            "columns: {position.A: {offset: two}}",
            "offset is 'two'; it must be a number",
        ),
        ("columns: {position.A: {offset: .nan}}", "it must be a number"),
        ("columns: {angle.A: {from: a}}", "angle.A: a recording has no such column"),
        ("columns: {position.A: {from: 3}}", "put the column name in quotes"),
        ("columns: {position.*: {from: a}}", "one star in the column needs one star"),
        ("columns: {position.A: a, position.A: b}", "'position.A' is given twice"),
        ("columns: [a]", "must be key: value lists"),
        ("drop: a", "'drop' must be a list"),
        ("columns: {", "not YAML"),
        ("- a", "expected the keys columns, drop, metadata"),
    ],
)
def test_a_wrong_map_is_refused(tmp_path, text, says):
    assert says in refusal(tmp_path, text)


def test_an_unknown_unit_lists_the_known_ones(tmp_path):
    line = refusal(tmp_path, "columns: {time: {unit: minutes}}")
    assert line.endswith("choose from s, ms, us, ns")


def test_a_missing_map_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such map"):
        read_map(tmp_path / "map.yaml")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "columns: {position.A: knee_angl}",
            "no column 'knee_angl'; close: knee_angle",
        ),
        ("columns: {position.*: q_*}", "no column 'q_*'"),
        ("columns: {time: knee_angle}", "both 'knee_angle' and 'time'"),
    ],
)
def test_a_map_that_does_not_fit_the_log_is_refused(tmp_path, text, says):
    column_map = read_map(write_map(tmp_path, text))
    with pytest.raises(ValueError) as caught:
        resolve(column_map, ["time", "knee_angle"], "log.csv")
    assert says in str(caught.value)
    assert "log.csv" in str(caught.value)
