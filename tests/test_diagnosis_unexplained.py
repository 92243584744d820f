"""What a misfit without a name depends on."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_diagnosis_plant import joint, wave

from gatjax.data.recording import Recording
from gatjax.data.trajectories import JointRun
from gatjax.diagnosis.case import Case
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT
from gatjax.diagnosis.joint import BOUNCING, PULLS
from gatjax.diagnosis.motion import Motion
from gatjax.diagnosis.unexplained import conditions, explore

TIME = 0.01 * np.arange(2000)
WARMTH = 5.0 * np.sin(2.0 * np.pi * 0.05 * TIME)


def case_of(angle):
    """One joint that moved so, without loads."""
    speed = np.gradient(angle, TIME)
    nothing = np.zeros((len(TIME), 1))
    load = SimpleNamespace(rest=nothing, inertia=nothing + 0.018)
    motion = Motion(TIME, angle[:, None], speed[:, None], nothing)
    one = joint(wave)._replace(valid=np.ones((1, len(TIME)), bool))
    case = Case.__new__(Case)
    vars(case).update(
        runs=[JointRun(0, TIME, angle[:, None], angle[:, None])], motions=[motion],
        loads=[SimpleNamespace(nominal=load)], joints=[one],
    )  # fmt: skip
    return case


def explored(torque, beside, rate=0.0):
    """What is said of a torque that acts on a slow joint, drawn at a rate in 1/s."""
    case = case_of(0.4 * np.sin(0.7 * TIME) + 0.2 * np.sin(1.7 * TIME))
    one = case.joints[0].drawn(rate)
    resist = one.nominal["kv"] + one.nominal["damping"]
    stiff = one.nominal["kp"] + resist * one.nominal.get("pull", 0.0)
    stiff += one.nominal.get("steer", 0.0) * 0.018
    left, none = torque / stiff, np.zeros((0, 0))
    fit = Fit(None, np.zeros(COUNT), 0.0, left, none, none, 0.0, True)
    return explore(case, one, fit, [beside])


def test_a_misfit_that_follows_the_temperature_is_told():
    found = explored(0.04 * WARMTH, {"temperature.elbow": WARMTH})
    best = found["depends_on"][0]
    assert best["variable"] == "temperature.elbow" and best["share"] > 0.95
    assert "torque at elbow = +0.0" in found["term"]
    assert "temperature.elbow" in found["term"]


@pytest.mark.parametrize("rate", [*PULLS, BOUNCING])
def test_what_draws_a_joint_is_no_part_of_its_misfit(rate):
    """A torque has its size, however little of it shows in a joint that is drawn."""
    free, drawn = (
        explored(0.04 * WARMTH, {"temperature.elbow": WARMTH}, each)["term"]
        for each in (0.0, rate)
    )
    sizes = [float(text.split("= ")[1].split(" temp")[0]) for text in (free, drawn)]
    assert sizes[1] == pytest.approx(sizes[0], rel=0.01)
    assert sizes[0] == pytest.approx(0.04, rel=0.05)


def test_without_a_thermometer_the_same_misfit_has_another_name():
    found = explored(0.04 * WARMTH, {"temperature.wrist": WARMTH})
    names = [row["variable"] for row in found["depends_on"]]
    assert names and all("temperature" not in name for name in names)


def test_a_misfit_that_depends_on_nothing_has_no_term():
    noise = np.random.default_rng(1).normal(size=len(TIME))
    found = explored(0.04 * noise, {})
    assert found == {"depends_on": [], "term": None}


@pytest.mark.parametrize("broken", [False, True])
def test_conditions_are_those_that_all_logs_have(broken):
    warm = np.linspace(30.0, 40.0, 6)
    if broken:
        warm[2] = np.nan
    columns = {"position.a": warm, "temperature.a": warm, "voltage": warm}
    ids = np.array([3, 3, 1, 1, 1, 1])
    one = Recording("a", TIME[:6], ids, columns, {})
    other = one._replace(columns={"position.a": warm, "temperature.a": warm})
    found = conditions([one, other])
    assert len(found) == 4
    if broken:
        assert found == [{}] * 4
    else:
        assert list(found[0]) == ["temperature.a"]
        np.testing.assert_allclose(found[1]["temperature.a"], [-5.0, -3.0])
