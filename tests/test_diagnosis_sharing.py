"""What joints say together: a value that they share costs less than one each."""

import numpy as np
import pytest

from gatjax.diagnosis import fit as fits
from gatjax.diagnosis import sharing
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis
from gatjax.diagnosis.joint import Joint

NOISE, ROWS, STEP = 1e-3, 2000, 0.02  # rad, readings, s between them
SLOPE = 0.01  # rad that a reading moves with the cause's coordinate
LAW = Hypothesis(
    "lag", "", lambda *_: None, ((0.0,),), (0.1,), (-4.0,), (4.0,), lambda *_: {}
)
SMALL, LARGE = 1.0, 2.0  # kinds of motors


def joint(motor=SMALL):
    names = "kp", "kv", "damping", "friction", "armature", "limit"
    return Joint(
        "knee", 0, dict.fromkeys(names, motor), None, 0,
        time=np.arange(ROWS)[None] * STEP, measured=np.zeros((1, ROWS)),
        valid=np.ones((1, ROWS), bool), noise=NOISE,
    )  # fmt: skip


def fit(value, rms=2.0 * NOISE, law=LAW):
    """The best fit of a joint that depends on its cause's coordinate linearly."""
    rng = np.random.default_rng(3)
    slope = SLOPE * rng.choice([-1.0, 1.0], ROWS)
    left = rng.normal(size=ROWS)
    left -= slope * (slope @ left) / (slope @ slope)
    left *= rms / np.sqrt(np.mean(np.square(left)))
    slopes = np.column_stack([np.zeros((ROWS, COUNT)), slope])
    prior = np.append(np.ones(COUNT), fits.FAINT)
    square = slopes.T @ slopes / fits.spread(joint()) ** 2 + np.diag(prior)
    x = np.append(np.zeros(COUNT), value)
    return Fit(law, x, float(ROWS), left, slopes, square, 1.0, True)


def nats(values, motors=None):
    motors = motors or [SMALL] * len(values)
    known = {k: fit(value) for k, value in enumerate(values)}
    return sharing.nats([joint(motor) for motor in motors], known)


def test_joints_that_agree_say_more_than_those_that_do_not():
    agreeing, near, apart = (
        nats([1.0] * 4),
        nats([1.0, 1.003] * 2),
        nats([1.0, 2.0] * 2),
    )
    assert agreeing > near > apart
    assert nats([1.0, 2.0, 3.0, 0.0]) == pytest.approx(
        nats([0.5, 2.5, 3.5, 0.0]), abs=2
    )


def test_motors_of_one_kind_may_share_what_others_do_not():
    values, motors = [1.0, 1.0, 3.0, 3.0], [SMALL, SMALL, LARGE, LARGE]
    assert nats(values, motors) > nats(values, [SMALL, LARGE] * 2)


@pytest.mark.parametrize("far", [0.0, 0.03, 0.5, -0.5])
def test_what_a_given_value_costs_is_what_its_misfit_says(far):
    mine = fit(1.0)
    moved = mine.residual + mine.slopes[:, -1] * far
    before = fits.evidence(joint(), mine)
    after = fits.evidence(joint(), mine._replace(residual=moved))
    lost = sharing._lost(joint(), mine, mine.x[-1:] + far)
    assert lost == pytest.approx(before - after, rel=1e-3, abs=1e-6)


@pytest.mark.parametrize("count, heard", [(5, False), (4, True)])
def test_the_worst_of_many_joints_is_not_heard(count, heard):
    joints = [joint() for _ in range(count)]
    known = {k: fit(1.0, 2.0 * NOISE, None) for k in range(count - 1)}
    right = sharing.nats(joints, known | {count - 1: fit(1.0, 2.0 * NOISE, None)})
    wrong = sharing.nats(joints, known | {count - 1: fit(1.0, 90.0 * NOISE, None)})
    assert (wrong < right - 100.0) is heard
    if not heard:
        assert wrong == pytest.approx(right)


def test_a_cause_of_the_whole_robot_is_not_divided():
    joints = [joint(motor) for motor in (SMALL, LARGE, SMALL)]
    every = (0, 1, 2)
    assert sharing.divisions(joints, every, "gravity_tilt") == [[every]]
    ways = [[every], [(0, 2), (1,)], [(0,), (1,), (2,)]]
    assert sharing.divisions(joints, every, "armature") == ways
