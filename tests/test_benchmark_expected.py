import pytest

from gatjax.benchmark.expected import SCHEMA, compare
from gatjax.runs import write_json

RESULTS = {
    "arm": {"error": {"mrad": 8.4}, "causes": ["backlash"], "count": 3},
    "axis": {"test_mm": None},
}


@pytest.fixture
def file(tmp_path):
    def write(**figures):
        named = {name.replace("__", "."): row for name, row in figures.items()}
        write_json(tmp_path / "expected.json", {"schema": SCHEMA, "figures": named})
        return tmp_path / "expected.json"

    return write


def test_figures_may_be_off_by_their_tolerance_and_no_more(file):
    near = file(arm__error__mrad={"value": 8.0, "within": 0.5})
    assert compare(RESULTS, near).off == []
    far = file(arm__error__mrad={"value": 8.0, "within": 0.3})
    assert compare(RESULTS, far).off == ["arm.error.mrad"]


def test_what_is_no_number_has_to_be_the_same(file):
    assert compare(RESULTS, file(arm__causes={"value": ["backlash"]})).off == []
    other = compare(RESULTS, file(arm__causes={"value": ["backlash", "tilt"]}))
    assert other.off == ["arm.causes"]
    assert "| backlash, tilt |" in other.table and "| off |" in other.table


def test_a_figure_that_lacks_is_off_and_a_part_that_was_not_run_is_said_so(file):
    told = compare(
        RESULTS,
        file(
            axis__test_mm={"value": 5.1, "within": 1.0},
            arm__gone={"value": 1},
            leg__error={"value": 1},
        ),
    )
    assert told.off == ["axis.test_mm", "arm.gone"]
    assert "5.1 ± 1" in told.table
    (row,) = [line for line in told.table.splitlines() if "leg.error" in line]
    assert "not run" in row and "off" not in row


def test_another_file_is_refused(tmp_path):
    write_json(tmp_path / "expected.json", {"schema": "gatjax.tolerances/1"})
    with pytest.raises(ValueError, match=SCHEMA):
        compare(RESULTS, tmp_path / "expected.json")


def test_what_others_reached_stands_beside_a_figure(file):
    row = {"value": 8.4, "within": 1.0, "anchors": {"M1": 9.5, "M3": 9}, "reach": "8"}
    told = compare(RESULTS, file(arm__error__mrad=row, arm__count={"value": 3}))
    head, _, first, second = (
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in told.table.splitlines()
    )
    assert head[4:] == ["others", "asked for"]
    assert first[4:] == ["M1 9.5, M3 9", "8"] and second[4:] == ["", ""]
    assert "others" not in compare(RESULTS, file(arm__count={"value": 3})).table
