"""The smallest effects: each is one that the diagnosis would just have named."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_diagnosis_plant import joint, wave

from gatjax.diagnosis import findings, sensitivity
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.aliases import UPSIDE_DOWN
from gatjax.diagnosis.bank import CAUSES
from gatjax.diagnosis.claims import LATER, PLACE, PRICE, WORTH, Claim
from gatjax.diagnosis.coordinates import factor, positive
from gatjax.diagnosis.findings import AGAIN, SEEN, VISIBLE
from gatjax.diagnosis.hypotheses import COUNT, tolerated
from gatjax.diagnosis.joint import Joint
from gatjax.diagnosis.judge import Judge
from gatjax.effects.catalogue import CATALOGUE

LOADED, OFFSET = "of the servo's torque", "log only"
FEW = [
    h for h in CAUSES
    if h.variant in (LOADED, OFFSET)
    or h.cause in ("command_delay", "coulomb_friction", "dead_band", "encoder_scale")
]  # fmt: skip


class Alone(Judge):
    """A judge of one joint with the tolerances fitted."""

    def __init__(self, one, known):
        self.joints, self.known, self.accepted = [one], [known], []
        self.case = SimpleNamespace(joints=[one], healthy=[known], pulled={})


def logged(cause=None, own=None):
    """A joint that was measured, with a cause or without."""
    bare = joint(wave)
    drive = tolerated(bare, np.zeros(COUNT))
    if cause is not None:
        cause.put(drive, bare, own)
    noise = np.random.default_rng(0).normal(0.0, bare.noise, (1, 250))
    return bare._replace(measured=bare.simulate([drive], False)[..., 0] + noise)


def fitted(one, hypothesis, points):
    """The best fit from some starting points."""
    begun = fits.start(one, [(hypothesis, point) for point in points])
    return min(fits.improve(one, begun, 8), key=lambda fit: fit.cost)


@pytest.fixture
def judge(monkeypatch):
    monkeypatch.setattr(sensitivity, "CAUSES", FEW)
    one = logged()
    return Alone(one, fitted(one, None, [np.zeros(COUNT)]))


def found(judge):
    return {row["cause"]: row for row in sensitivity.smallest(judge)}


def test_a_cause_of_the_smallest_size_is_just_a_finding(judge):
    rows, one = found(judge), judge.joints[0]
    assert set(rows) == {h.cause for h in FEW}
    for hypothesis in FEW:
        row = rows[hypothesis.cause]
        for ladder in sensitivity._ladders(one, hypothesis):
            values = [ladder.value(one, rung) for rung in ladder.rungs]
            if not min(values) < row["value"] < max(values):
                continue
            order = np.argsort(values)
            rung = np.interp(row["value"], np.take(values, order),
                             np.take(ladder.rungs, order))  # fmt: skip
            own = ladder.own(float(rung))
            spoilt = logged(hypothesis, own)
            plain = fitted(spoilt, None, [np.zeros(COUNT)])
            begin = [np.append(x, own) for x in (np.zeros(COUNT), plain.x)]
            best = fitted(spoilt, hypothesis, begin)
            gain = fits.evidence(spoilt, best) - fits.evidence(spoilt, plain)
            gain -= PRICE + PLACE
            d = judge.visibility(Claim(hypothesis, own, (0,), {0: plain}, gain))
            assert gain > WORTH - 2.0 and d > 0.9 * SEEN, row
            assert gain < WORTH + 2.0 or d < 1.1 * SEEN, row


def test_the_smallest_stiction_is_a_finding_at_the_speed_that_shows_it_best(
    judge, monkeypatch
):
    stiction = next(h for h in CAUSES if h.cause == "stiction")
    monkeypatch.setattr(sensitivity, "CAUSES", [stiction])
    monkeypatch.setattr(Joint, "fastest", 10.0)  # rad/s; its grid has no path
    row, one, margins = found(judge)["stiction"], judge.joints[0], []
    ladders = sensitivity._ladders(one, stiction)
    speeds = [stiction.values(one, each.own(-1.0))["velocity"] for each in ladders]
    assert len(set(speeds)) == sensitivity.OTHERS and row["parameter"] == "excess"
    for ladder in ladders:
        values = [ladder.value(one, rung) for rung in ladder.rungs]
        own = ladder.own(float(np.interp(row["value"], values, ladder.rungs)))
        spoilt = logged(stiction, own)
        plain = fitted(spoilt, None, [np.zeros(COUNT)])
        best = fitted(spoilt, stiction, [np.append(plain.x, own)])
        gain = fits.evidence(spoilt, best) - fits.evidence(spoilt, plain)
        d = judge.visibility(Claim(stiction, own, (0,), {0: plain}, gain))
        margins.append(min((gain - 2 * PRICE - PLACE) / WORTH, d / SEEN))
    assert max(margins) == pytest.approx(1.0, abs=0.3)


def test_a_vector_is_looked_for_along_each_axis():
    shift = next(h for h in CAUSES if h.cause == "com_shift")
    ladders = sensitivity._ladders(joint(wave), shift)
    last = [ladder.own(ladder.rungs[-1]) for ladder in ladders]
    np.testing.assert_allclose(last, shift.high[0] * np.eye(3))
    ripple = next(h for h in CAUSES if h.cause == "torque_ripple")
    rates = {each.own(0.0)[2] for each in sensitivity._ladders(joint(wave), ripple)}
    assert len(rates) == sensitivity.OTHERS


def test_gravity_upside_down_has_no_smallest_size(judge, monkeypatch):
    over = [h for h in CAUSES if h.variant == UPSIDE_DOWN]
    monkeypatch.setattr(sensitivity, "CAUSES", [*over, FEW[0]])
    assert over and set(found(judge)) == {FEW[0].cause}


def test_more_is_asked_beside_a_named_cause_and_of_a_standing_robot(judge):
    alone = found(judge)
    claim = Claim(FEW[0], np.zeros(1), (5,), {}, 50.0)
    judge.accepted = [claim]
    beside = found(judge)
    assert findings.needed(judge, [0]) == (AGAIN, VISIBLE)
    judge.accepted, judge.worth = [], LATER
    standing = found(judge)

    def severity(cause, row):
        return abs(CATALOGUE[cause].severity(row["value"]))

    for cause, row in beside.items():
        assert severity(cause, row) > 1.2 * severity(cause, alone[cause])
    for cause in ("command_delay", "encoder_offset", "load_friction"):
        least = 1.2 * severity(cause, alone[cause])
        assert severity(cause, standing[cause]) > least
    judge.accepted = [claim] * judge.most
    assert sensitivity.smallest(judge) == []


def test_a_cause_whose_smallest_size_shows_is_told_as_at_most(judge, monkeypatch):
    coarse = positive("first_order_lag", "time_constant", "lag", 0.05, 0.5, (0.1,))
    faint = positive("dead_band", "half_width", "dead", 1e-6, 1e-5, (2e-6,))
    monkeypatch.setattr(sensitivity, "CAUSES", [coarse, faint])
    rows = sensitivity.smallest(judge)
    assert rows == [
        {"cause": "first_order_lag", "where": ["elbow"], "parameter": "time_constant",
         "value": pytest.approx(0.05), "unit": "s", "at_most": True}
    ]  # fmt: skip


def test_a_cause_that_is_named_at_a_joint_is_not_looked_for_again(judge):
    named = Claim(FEW[0], np.zeros(1), (0,), {}, 50.0)
    assert FEW[0].cause == "command_delay" and "command_delay" in found(judge)
    judge.accepted = [named]
    assert set(found(judge)) == {h.cause for h in FEW} - {"command_delay"}


@pytest.mark.parametrize(("down", "up"), [(1, 4), (4, 1), (None, 2), (2, None)])
def test_the_nearer_side_of_a_factor_counts(judge, monkeypatch, down, up):
    gain = factor("gain_error", "kp", 0.05, 5.0, (0.4,))
    monkeypatch.setattr(sensitivity, "CAUSES", [gain])

    def margins(judge, index, ladders):
        rungs = np.arange(sensitivity.LEVELS)
        return [np.where(rungs < (99 if k is None else k), -1.0, 0.0)
                for k in (down, up)]  # fmt: skip

    monkeypatch.setattr(sensitivity, "_margins", margins)
    value = sensitivity.smallest(judge)[0]["value"]
    nearer = down is not None and (up is None or down < up)
    assert (value < 1.0) == nearer


def test_the_largest_limit_that_shows_is_the_smallest_effect(judge, monkeypatch):
    monkeypatch.setattr(
        sensitivity, "CAUSES", [h for h in CAUSES if h.cause == "torque_limit"]
    )
    one = judge.joints[0]
    weaker = one._replace(name="wrist", nominal=one.nominal | {"limit": 2.0})
    stronger = one._replace(name="hip", nominal=one.nominal | {"limit": 50.0})
    monkeypatch.setattr(
        sensitivity, "_margins",
        lambda judge, index, ladders: [np.arange(8.0) - 3.0 for _ in ladders],
    )  # fmt: skip
    judge.joints = [weaker, stronger]
    assert [row["where"] for row in sensitivity.smallest(judge)] == [["hip"]]
    judge.joints = [stronger, weaker]
    assert [row["where"] for row in sensitivity.smallest(judge)] == [["hip"]]
