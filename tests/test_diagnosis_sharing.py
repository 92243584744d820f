"""What joints say together: a value that they share costs less than one each."""

import numpy as np
import pytest

from gatjax.diagnosis import fit as fits
from gatjax.diagnosis import sharing
from gatjax.diagnosis.claims import PLACE, occam, uncertainty
from gatjax.diagnosis.fit import Fit, put_together
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis
from gatjax.diagnosis.joint import Joint

NOISE, ROWS, STEP = 1e-3, 2000, 0.02  # rad, readings, s between them
SLOPE = 0.01  # rad that a reading moves with a cause's coordinate
SMALL, LARGE = 1.0, 2.0  # kinds of motors


def law(name):
    return Hypothesis(
        name, "", lambda *_: None, ((0.0,),), (0.1,), (-4.0,), (4.0,), lambda *_: {}
    )


def joint(motor=SMALL):
    names = "kp", "kv", "damping", "friction", "armature", "limit"
    return Joint(
        "knee", 0, dict.fromkeys(names, motor), None, 0,
        time=np.arange(ROWS)[None] * STEP, measured=np.zeros((1, ROWS)),
        valid=np.ones((1, ROWS), bool), noise=NOISE,
    )  # fmt: skip


def fit(*values, rms=2.0 * NOISE, names=("lag", "delay"), alike=0.0, tolerated=True):
    """The best fit of a joint that depends on its causes' coordinates linearly.

    Args:
        values: of the causes' coordinates.
        rms: that it leaves, rad.
        names: of the causes.
        alike: correlation of the causes' slopes with each other's (its square).
        tolerated: whether a tolerance does what they have in common.
    """
    rng, count = np.random.default_rng(3), len(values)
    own = rng.normal(size=(ROWS, count + 1))
    slopes = np.zeros((ROWS, COUNT + count))
    slopes[:, 0] = SLOPE * tolerated * own[:, -1]
    slopes[:, COUNT:] = SLOPE * (
        alike * own[:, -1:] + np.sqrt(1.0 - alike**2) * own[:, :count]
    )
    left = rng.normal(size=ROWS)
    left -= slopes @ np.linalg.lstsq(slopes, left, rcond=None)[0]
    left *= rms / np.sqrt(np.mean(np.square(left)))
    owner, x = put_together(
        np.zeros(COUNT),
        [(law(n), np.array([v])) for n, v in zip(names, values, strict=False)],
    )
    prior = np.append(np.full(COUNT, 1e-3), np.full(count, fits.FAINT))
    square = slopes.T @ slopes / fits.spread(joint()) ** 2 + np.diag(prior)
    return Fit(owner, x, float(ROWS), left, slopes, square, 1.0, True)


def nats(*known, motors=None):
    joints = [joint(motor) for motor in motors or [SMALL] * len(known)]
    return sharing.nats(joints, dict(enumerate(known)))


def test_each_value_costs_its_share_of_the_prior_and_each_joint_its_place():
    known = [fit(1.0)] * 4
    said = 4 * fits.evidence(joint(), known[0])
    shared = occam(law("lag"), np.array([1.0]), uncertainty(known, 1))
    assert nats(*known) == pytest.approx(said - shared - 4 * PLACE)
    alone = occam(law("lag"), np.array([1.0]), uncertainty(known[:1], 1))
    single = fits.evidence(joint(), known[0]) - alone - PLACE
    assert nats(known[0]) == pytest.approx(single)
    apart = [fit(value) for value in (1.0, 3.0, -1.0, -3.0)]
    assert nats(*apart) == pytest.approx(4 * single, abs=0.5)


def test_joints_that_nearly_agree_share_their_value_at_a_cost():
    agreeing, near = nats(*[fit(1.0)] * 4), nats(*[fit(1.0), fit(1.02)] * 2)
    assert agreeing > near > nats(*[fit(1.0), fit(2.0)] * 2)


def test_motors_of_one_kind_may_share_what_others_do_not():
    known = [fit(value) for value in (1.0, 1.0, 3.0, 3.0)]
    motors = [SMALL, SMALL, LARGE, LARGE]
    assert nats(*known, motors=motors) > nats(*known, motors=motors[1:] + motors[:1])


@pytest.mark.parametrize("far", [0.0, 0.03, 0.5, -0.5])
@pytest.mark.parametrize("alike", [0.0, 0.9])
def test_what_a_given_value_costs_is_what_its_misfit_says(far, alike):
    mine = fit(1.0, alike=alike)
    step = np.zeros(COUNT + 1)
    step[-1] = far
    rest = slice(0, -1)  # tolerances take over what they can
    step[rest] = -np.linalg.solve(
        mine.information[rest, rest], mine.information[rest, -1] * far
    )
    moved = mine._replace(residual=mine.residual + mine.slopes @ step)
    given = sharing._Held(mine).given(joint(), mine.x[-1:] + far)
    assert given.fit.x == pytest.approx(mine.x + step)
    lost = fits.evidence(joint(), mine) - fits.evidence(joint(), moved)
    assert given.lost(joint()) == pytest.approx(lost, rel=0.02, abs=1e-4)


def test_values_of_two_causes_cost_what_their_misfit_together_says():
    mine, far = fit(1.0, 2.0, alike=0.9, tolerated=False), np.array([0.2, -0.1])
    step = np.append(np.zeros(COUNT), far)
    moved = mine._replace(residual=mine.residual + mine.slopes @ step)
    given = sharing._Held(mine).given(joint(), mine.x[-1:] + far[1])
    given = given._replace(fit=fits.with_last(given.fit, "lag"))
    given = given.given(joint(), np.array([1.0 + far[0]]))
    lost = fits.evidence(joint(), mine) - fits.evidence(joint(), moved)
    assert given.lost(joint()) == pytest.approx(lost, rel=0.02)


def test_two_causes_that_stand_for_each_other_do_not_both_share_a_value_for_nothing():
    def known(*values):  # little but their sum is to be seen
        return fit(*values, alike=0.9999, tolerated=False)

    unseen = nats(*[known(1.0, 2.0), known(2.0, 1.0)] * 2)
    assert unseen > nats(*[known(1.0, 1.0), known(2.0, 2.0)] * 2) + 3.0


def test_how_sure_a_value_is_is_told_beside_all_other_causes():
    mine = fit(1.0, 2.0, alike=0.9, tolerated=False)
    prices = [
        occam(law(name), np.array([value]), uncertainty([mine], 1, COUNT + n))
        for n, (name, value) in enumerate([("lag", 1.0), ("delay", 2.0)])
    ]
    said = fits.evidence(joint(), mine) - sum(prices) - 2 * PLACE
    assert nats(mine) == pytest.approx(said)


def test_causes_may_stand_in_another_order_at_another_joint():
    turned = fit(3.0, 1.0, names=("delay", "lag"))
    assert nats(fit(1.0, 3.0), turned) == pytest.approx(nats(*[fit(1.0, 3.0)] * 2))


@pytest.mark.parametrize("count, heard", [(5, False), (4, True)])
def test_the_worst_of_many_joints_is_not_heard(count, heard):
    rest = [fit(1.0)] * (count - 1)
    right = nats(*rest, fit(1.0))
    wrong = nats(*rest, fit(3.0, rms=90.0 * NOISE))
    assert (wrong < right - 100.0) is heard
    if not heard:
        assert wrong == pytest.approx(right) == nats(*rest)


@pytest.mark.parametrize("count, odd_decides", [(6, False), (4, True)])
def test_what_helps_one_odd_joint_most_gains_less_than_what_helps_all(
    count, odd_decides
):
    joints = [joint() for _ in range(count)]
    plain = {k: fit(rms=9.0 * NOISE) for k in range(count - 1)}
    plain[count - 1] = fit(rms=12.0 * NOISE)

    def gain(theirs, odds):
        after = {k: fit(1.0, rms=theirs * NOISE) for k in range(count)}
        after[count - 1] = fit(1.0, rms=odds * NOISE)
        return sharing.gained(joints, plain, after)

    imitator, cause = gain(8.0, 0.9), gain(6.5, 11.9)
    assert (imitator > cause) is odd_decides


def test_a_cause_of_the_whole_robot_is_not_divided():
    joints = [joint(motor) for motor in (SMALL, LARGE, SMALL)]
    every = (0, 1, 2)
    assert sharing.divisions(joints, every, "gravity_tilt") == [[every]]
    ways = [[every], [(0, 2), (1,)], [(0,), (1,), (2,)]]
    assert sharing.divisions(joints, every, "armature") == ways
