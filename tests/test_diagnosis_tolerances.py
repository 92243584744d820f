"""The user's file of tolerances."""

import json

import pytest

from gatjax.diagnosis.tolerances import USUAL, read_tolerances


def written(folder, **told):
    path = folder / "tolerances.json"
    path.write_text(json.dumps(told))
    return path


def test_what_the_file_does_not_name_is_as_usual(tmp_path):
    found = read_tolerances(written(tmp_path, mass=0.1, kp=0))
    assert (found.mass, found.kp) == (0.1, 0.0)
    assert found._replace(mass=USUAL.mass, kp=USUAL.kp) == USUAL


@pytest.mark.parametrize(
    ("told", "word"),
    [
        ({"weight": 0.1}, "weight"),
        ({"mass": -0.1}, "mass"),
        ({"mass": "ten"}, "mass"),
        ({"mass": True}, "mass"),
        ({"schema": "gatjax.world/1"}, "schema"),
    ],
)
def test_a_file_that_makes_no_sense_is_refused_in_one_line(tmp_path, told, word):
    with pytest.raises(ValueError, match=word) as refused:
        read_tolerances(written(tmp_path, **told))
    assert "\n" not in str(refused.value)


def test_a_file_that_is_not_there_is_said_in_one_line(tmp_path):
    with pytest.raises(
        FileNotFoundError, match=r"no.json does not exist; docs/diagnosis"
    ):
        read_tolerances(tmp_path / "no.json")
