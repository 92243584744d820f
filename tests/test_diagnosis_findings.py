"""What a claim needs to be named."""

from types import SimpleNamespace

import numpy as np
import pytest

from gatjax.diagnosis import findings
from gatjax.diagnosis.bank import CAUSES, OTHERS
from gatjax.diagnosis.claims import LATER, WORTH, Claim
from gatjax.diagnosis.coordinates import LESS
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT
from gatjax.diagnosis.joint import NOTHING
from gatjax.diagnosis.judge import Judge

LESSER = tuple(each for each in CAUSES if each.variant == LESS)


@pytest.mark.parametrize(
    ("accepted", "joints", "calm", "borne", "nats"),
    [
        ([], (0,), {0}, False, WORTH),  # a first cause
        ([], (), set(), True, findings.BORNE),  # of the floor: all joints are explained
        ([], (0,), {0}, True, findings.BORNE),  # of a leg that stands
        ([], (0,), set(), True, WORTH),
        ([object()], (0,), {0}, True, findings.BORNE),
        ([object()], (0,), {0}, False, findings.AGAIN),  # more where all is explained
        ([object()], (0, 1), {0}, False, LATER),
        ([object()], (1,), {0}, False, LATER),
    ],
)
def test_a_further_cause_needs_more_where_the_rest_is_noise(
    monkeypatch, accepted, joints, calm, borne, nats
):
    monkeypatch.setattr(findings, "adequate", lambda judge, index: index in calm)
    judge = object.__new__(Judge)
    judge.accepted = accepted
    judge.joints = [SimpleNamespace(assumed=NOTHING)] * 3
    judge.apart = lambda joints: not borne
    assert findings.needed(judge, joints)[0] == nats


def test_a_further_cause_needs_more_beside_one_that_was_known_before(monkeypatch):
    monkeypatch.setattr(findings, "adequate", lambda judge, index: False)
    judge = object.__new__(Judge)
    worn = NOTHING._replace(named=frozenset({"backlash"}))
    judge.accepted, judge.joints = [], [SimpleNamespace(assumed=worn)]
    assert findings.needed(judge, (0,))[0] == LATER


@pytest.mark.parametrize(
    ("bank", "gain", "calm", "worth"),
    [
        (CAUSES, 8.0, True, True),
        (OTHERS, 8.0, True, False),  # a law without a name, and nothing to explain
        (OTHERS, 8.0, False, True),
        (OTHERS, 25.0, True, True),
        (LESSER, 15.0, True, False),  # a number of the model is less than nominal
        (LESSER, 15.0, False, True),
        (LESSER, 25.0, True, True),
    ],
)
def test_a_law_without_a_name_needs_more_where_tolerances_are_enough(
    monkeypatch, bank, gain, calm, worth
):
    monkeypatch.setattr(findings, "adequate", lambda judge, index: calm)
    monkeypatch.setattr(findings, "explained", lambda judge, claim: 1.0)
    monkeypatch.setattr(Judge, "visibility", lambda judge, claim: 0.4)
    judge = object.__new__(Judge)
    judge.accepted, judge.joints = [], [SimpleNamespace(assumed=NOTHING)]
    judge.case = SimpleNamespace(pulled={})
    none = np.zeros(1)
    fit = Fit(bank[0], none, 0.0, none, none, none, 1.0, settled=True)
    assert (
        findings.worth_naming(judge, Claim(bank[0], none, (0,), {0: fit}, gain))
        is worth
    )


def test_the_size_of_a_known_cause_is_no_strained_tolerance():
    """A lag of 50 ms has the coordinate ln 0.05, whose square is 9."""
    lag = next(each for each in CAUSES if each.cause == "first_order_lag")
    x, none = np.append(np.zeros(COUNT), np.log(0.05)), np.zeros(1)
    rests = [np.full(100, level) for level in (1.5, 1.35)]
    before, after = (
        Fit(lag, x, 0.0, rest, none, none, 1.0, settled=True) for rest in rests
    )
    judge = object.__new__(Judge)
    judge.joints, judge.known = [SimpleNamespace(noise=1.0)], [before]
    claim = Claim(lag, none, (0,), {0: after}, 30.0)
    left = (1.35**2 - findings.EXPECTED) / (1.5**2 - findings.EXPECTED)
    assert findings.explained(judge, claim) == pytest.approx(1.0 - left)
    strained = before._replace(x=np.append(np.full(COUNT, 2.0), x[-1]))
    judge.known = [strained]
    assert findings.explained(judge, claim) == 1.0  # tolerances imitate something


@pytest.mark.parametrize(
    ("gain", "calm", "share", "named"),
    [
        (50.0, False, 0.9, False),  # smaller than what tolerances do
        (150.0, False, 0.9, True),  # decisive
        (150.0, True, 0.9, False),  # nothing there needs an explanation
        (150.0, False, 0.3, False),  # it does not explain much
    ],
)
def test_decisive_evidence_needs_no_visibility(monkeypatch, gain, calm, share, named):
    monkeypatch.setattr(findings, "adequate", lambda judge, index: calm)
    monkeypatch.setattr(findings, "explained", lambda judge, claim: share)
    monkeypatch.setattr(Judge, "visibility", lambda judge, claim: 0.1)
    judge = object.__new__(Judge)
    judge.accepted, judge.joints = [], [SimpleNamespace(assumed=NOTHING)]
    judge.case = SimpleNamespace(pulled={})
    hypothesis = next(each for each in CAUSES if each.cause == "load_friction")
    none = np.zeros(1)
    fit = Fit(hypothesis, none, 0.0, none, none, none, 1.0, settled=True)
    claim = Claim(hypothesis, none, (0,), {0: fit}, gain)
    assert findings.worth_naming(judge, claim) is named
