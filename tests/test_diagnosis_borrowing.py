"""What explains one joint of a robot is tried at the others."""

import dataclasses

import numpy as np
import pytest
from test_diagnosis_everywhere import (
    DELAY,
    FRICTION,
    LEG,
    ODD,
    OFFSET,
    crooked,
    judged,
    late,
    rubbing,
)  # fmt: skip

from gatjax.diagnosis import agreed, borrowing, sharing
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.bank import CAUSES, of_drive
from gatjax.diagnosis.case import LED_ASTRAY
from gatjax.diagnosis.claims import LATER
from gatjax.diagnosis.coordinates import limit_of
from gatjax.diagnosis.fit import parts_of, put_together
from gatjax.diagnosis.hypotheses import COUNT
from gatjax.diagnosis.option import Option

EVERY = range(len(LEG.joints))
LATE, RUB = (
    next(h for h in CAUSES if h.law == (cause, ""))
    for cause in ("command_delay", "coulomb_friction")
)


@pytest.fixture(scope="module")
def judge(tmp_path_factory):
    return judged(tmp_path_factory.mktemp("leg"), late, rubbing)


def truth(judge, index, delay=DELAY):
    share = FRICTION[index] / limit_of(judge.joints[index])
    return [(LATE, np.log([delay])), (RUB, np.log([share]))]


def at(judge, index, parts):
    (found,) = fits.start(judge.joints[index], [put_together(np.zeros(COUNT), parts)])
    return found


def fitted(judge):
    """Fits of all joints with both causes, from their true values."""
    every = (at(judge, k, truth(judge, k)) for k in EVERY)
    pairs = zip(judge.joints, every, strict=True)
    return {k: fits.improve(j, [f], 8)[0] for k, (j, f) in enumerate(pairs)}


@pytest.fixture(scope="module")
def right(judge):
    return fitted(judge)


def test_each_set_of_causes_gets_a_fit_from_the_best_of_its_lenders(judge):
    wrong, right = truth(judge, 0, 0.15), truth(judge, 0)
    joint, none = judge.joints[0], np.zeros(COUNT)
    both, far = borrowing.borrowed(joint, [none], [[wrong, right], [wrong[:1]]])
    assert both.cost <= at(judge, 0, right).cost < 0.1 * at(judge, 0, wrong).cost
    assert [part.law for part, _ in parts_of(far)] == [LATE.law]
    assert far.cost < at(judge, 0, wrong[:1]).cost


def test_tolerances_to_begin_with_are_all_tried(judge, monkeypatch):
    monkeypatch.setattr(borrowing, "EARLY", 0)
    monkeypatch.setattr(borrowing, "ROUNDS", 0)
    bad, good = np.full(COUNT, -3.0), np.zeros(COUNT)  # whatever sign load shapes have
    costs = []
    for places in ([bad], [bad, good], [good, bad]):
        (found,) = borrowing.borrowed(judge.joints[0], places, [[truth(judge, 0)]])
        costs.append(found.cost)
    assert max(costs[1:]) < costs[0]


def test_a_cause_that_one_joint_has_found_is_tried_at_all_others(judge, right):
    known = {k: judge.known[k] for k in EVERY}
    lender = right[0]
    option = Option(RUB, {0: 500.0}, {0: lender})
    borrowing.spread(judge, known, [option])
    assert option.fits[0] is lender and option.gains[0] == 500.0
    assert option.fits.keys() == set(EVERY)
    for k in set(EVERY) - {0}:
        more = sharing.alone(judge.joints[k], option.fits[k])
        more -= sharing.alone(judge.joints[k], known[k])
        assert option.gains[k] == pytest.approx(more) and more > 50.0
        assert parts_of(option.fits[k])[-1][0].law == RUB.law  # the cause comes last


def test_a_fit_is_lent_only_where_it_is_better(judge, right):
    known = {k: judge.known[k] for k in EVERY}
    mine = {k: at(judge, k, truth(judge, k, 0.15)) for k in (0, 1)}
    gains = {0: 1.0, 1: 1e5, 2: 300.0}
    option = Option(RUB, dict(gains), mine | {2: right[2]})
    borrowing.spread(judge, known, [option])
    assert option.gains[0] > 50.0 and option.fits[0].cost < mine[0].cost
    assert option.gains[1] == gains[1] and option.fits[1] is mine[1]


def test_what_one_odd_joint_wants_promises_less_than_what_all_want():
    odd = Option(LATE, {0: 9000.0, 1: 10.0}, {})
    common = Option(RUB, dict.fromkeys(EVERY, 100.0), {})
    assert borrowing._promise(odd, 6) < borrowing._promise(common, 6)
    assert borrowing._promise(odd, 4) > borrowing._promise(common, 4)


def test_only_what_a_joint_can_have_is_lent_to_it(judge):
    joint = judge.joints[0]
    fading = next(h for h in of_drive(joint, CAUSES) if h.cause == "stiction")
    other = fading._replace(high=(fading.high[0], fading.high[1] + 2.0))
    fast = put_together(np.zeros(COUNT), [(other, np.array(other.high))])
    late = put_together(np.zeros(COUNT), truth(judge, 0))
    (slow,), both = (
        borrowing._lent(joint, fits.start(joint, [point])) for point in (fast, late)
    )
    ((law, x),) = slow
    assert law.high == fading.high and x == pytest.approx(np.array(fading.high))
    assert len(both) == 1 and len(both[0]) == 2
    told = joint._replace(nominal=joint.nominal | {"hold": 0.0})  # no servo of its own
    dead = next(h for h in CAUSES if h.cause == "dead_band")
    lent = put_together(np.zeros(COUNT), [*truth(judge, 0), (dead, np.log([0.01]))])
    assert borrowing._lent(told, fits.start(joint, [lent])) == []
    assert borrowing._lent(joint, [judge.known[0]]) == []  # it has no cause to lend


@pytest.mark.parametrize("better", [9.0, 11.0])
def test_loads_are_taken_where_they_explain_more(judge, right, monkeypatch, better):
    looked, known, nats = judge.fork(), right, [0.0]

    def along(case, *_):
        nats[0] += better if nats[0] == 0.0 else 0.0
        return dataclasses.replace(case)

    told = lambda joints, fits: 500.0 + nats[0] * (joints is not judge_joints)  # noqa: E731
    judge_joints = looked.joints
    monkeypatch.setattr(borrowing, "along", along)
    monkeypatch.setattr(borrowing.sharing, "nats", told)
    monkeypatch.setattr(borrowing, "retried", lambda judge, known: {**known})
    found = borrowing.followed(looked, known)
    assert (looked.case is judge.case) == (better < LATER)
    assert (looked.joints is judge_joints) == (better < LATER)
    assert found.keys() == known.keys()


def test_what_begins_anew_stays_where_loads_explain_no_more(judge, right, monkeypatch):
    looked, known = judge.fork(), right
    stuck = at(judge, 3, truth(judge, 3, 0.15))
    monkeypatch.setattr(borrowing, "along", lambda case, *_: case)
    found = borrowing.followed(looked, known | {3: stuck})
    assert looked.case is judge.case
    assert sharing.alone(judge.joints[3], found[3]) > (
        sharing.alone(judge.joints[3], known[3]) - 5.0
    )


def test_what_is_wrong_at_one_joint_besides_is_not_in_the_loads_of_others(tmp_path):
    judge = judged(tmp_path, late, rubbing, crooked)
    known = fitted(judge)
    every = borrowing._moving(judge, known)
    assert all(every[k] is known[k] for k in EVERY if k != ODD)
    *_, (law, own) = parts_of(every[ODD])
    values = law.values(judge.joints[ODD], own)
    assert law.cause == "encoder_offset"
    assert values["offset"] == pytest.approx(OFFSET, abs=0.02)
    assert every[ODD].rms() < LED_ASTRAY * judge.joints[ODD].noise
    stuck = at(judge, 3, truth(judge, 3, 0.15))
    every = borrowing._moving(judge, known | {3: stuck})  # two: no joint is odd
    assert every[ODD] is known[ODD] and every[3] is stuck
    few = {k: known[k] for k in (0, 1, ODD)}
    every = borrowing._moving(judge, few)
    assert every[ODD] is known[ODD] and every[4] is judge.known[4]


def test_loads_along_the_motion_of_the_causes_explain_more(judge, right):
    looked, known = judge.fork(), right
    settled = borrowing.refitted(judge, borrowing.retried(judge, known))
    found = borrowing.followed(looked, known)
    assert looked.case is not judge.case
    before = sharing.nats(judge.joints, settled)
    assert sharing.nats(looked.joints, found) > before + LATER


def test_a_joint_in_a_bad_valley_begins_anew_with_what_others_have(judge, right):
    known = right
    stuck = at(judge, 3, truth(judge, 3, 0.15))
    tried = borrowing.retried(judge, known | {3: stuck})
    best = sharing.alone(judge.joints[3], known[3])
    assert sharing.alone(judge.joints[3], tried[3]) > best - 5.0
    alone = borrowing.retried(judge, {3: stuck})
    assert alone[3] is stuck  # nobody has anything to lend


def test_joints_agree_from_what_single_ones_have(judge, right):
    known = right
    lag = next(h for h in CAUSES if h.cause == "first_order_lag")
    fit = known[0]
    more = put_together(fit.x[:COUNT], [*parts_of(fit)[::-1], (lag, np.log([0.01]))])
    three = fits.start(judge.joints[0], [more])[0]
    first = Option(LATE, {}, {0: three, 1: at(judge, 1, truth(judge, 1)[:1])})
    (only,) = agreed._had([first, Option(RUB, {}, {})])  # joint 1 lacks friction
    assert [part.law for part, _ in only] == [LATE.law, RUB.law]
    values = dict(zip(("late", "rub"), (own for _, own in only), strict=True))
    assert values["late"] == pytest.approx(parts_of(fit)[0][1])
    assert values["rub"] == pytest.approx(parts_of(fit)[1][1])
