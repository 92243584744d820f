"""The user's file of tolerances."""

import json

import pytest

from gatjax.diagnosis.tolerances import USUAL, check_joints, read_tolerances, surer


def written(folder, **told):
    path = folder / "tolerances.json"
    path.write_text(json.dumps(told))
    return path


def test_what_the_file_does_not_name_is_as_usual(tmp_path):
    found = read_tolerances(written(tmp_path, mass=0.1, kp=0))
    assert (found.mass, found.kp) == (0.1, 0.0)
    assert found._replace(mass=USUAL.mass, kp=USUAL.kp) == USUAL


def test_joints_may_have_to_come_close_each_by_itself(tmp_path):
    path = written(tmp_path, mass=0.1, angle={"knee": 0.02})
    found = read_tolerances(path)
    assert [found.close(joint) for joint in ("knee", "hip")] == [0.02, 0.0]
    assert USUAL._replace(angle=0.01).close("hip") == 0.01
    check_joints(found, ("hip", "knee"), path)
    with pytest.raises(ValueError, match=r"no joint 'knee'; joints are hip, ankle"):
        check_joints(found, ("hip", "ankle"), path)
    check_joints(USUAL, ("hip",), path)
    lasting = read_tolerances(written(tmp_path, lasting={"knee": 2, "hip": 0.01}))
    assert [lasting.lasts(joint) for joint in ("knee", "hip", "toe")] == [2, 0.1, 0.1]


def test_what_was_sure_stays_sure():
    allowed = USUAL._replace(mass=0.0, kp=0.2, angle=0.0, lasting={"knee": 0.01})
    assert surer(allowed) == {"mass": 0.0}


@pytest.mark.parametrize(
    ("told", "word"),
    [
        ({"weight": 0.1}, "weight"),
        ({"mass": -0.1}, "mass"),
        ({"mass": "ten"}, "mass"),
        ({"mass": True}, "mass"),
        ({"angle": {"knee": -0.1}}, "angle of knee"),
        ({"angle": {"knee": "ten"}}, "angle of knee"),
        ({"mass": {"knee": 0.1}}, "mass"),
        ({"lasting": {"knee": None}}, "lasting of knee"),
        ({"angle": 5}, r"angle is 5 rad; .* \(5 deg are 0.0873 rad\)"),
        ({"angle": {"knee": 1}}, "angle of knee is 1 rad"),
        ({"tilt": 2}, "tilt is 2 rad"),
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


def test_a_share_that_can_not_be_one_is_refused(tmp_path):
    assert read_tolerances(written(tmp_path, kp=10)).kp == 10.0
    with pytest.raises(ValueError, match="kp is 50, a share of the model's number"):
        read_tolerances(written(tmp_path, kp=50))
