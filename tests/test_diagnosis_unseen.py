"""A cause is doubted where it does not predict another motion."""

from types import SimpleNamespace

import numpy as np
import pytest

from gatjax.diagnosis.claims import Claim
from gatjax.diagnosis.hypotheses import Hypothesis
from gatjax.diagnosis.measure import Errors
from gatjax.diagnosis.unseen import UNSURE, Seen, borne_out
from gatjax.diagnosis.verdict import Cause, Verdict

NOISE = 1e-3


def told(cause, where=(0,), left=()):
    """A verdict of one cause, in a robot of two joints."""
    joints = [SimpleNamespace(index=k, noise=NOISE) for k in range(2)]
    hypothesis = Hypothesis(cause, "", lambda *_: None, (), (), (), (), lambda *_: {})
    claim = Claim(hypothesis, np.zeros(0), where, dict.fromkeys(where), 100.0)
    word = "unknown" if left else "named"
    judge = SimpleNamespace(joints=joints)
    return Verdict(word, [Cause(claim, 1.0, [], [])], list(left), None, [], judge)


def errors(*rms):
    return Errors(np.tile(np.square(rms), (50, 1)), np.arange(50) // 10)


def judged(verdict, before, after, ahead=None, drawn=None):
    return borne_out(verdict, Seen((before, after), lambda: ahead, drawn or {}), 0)


@pytest.mark.parametrize("after, expected", [
    (NOISE, "named"),  # all that can be
    (3.5 * NOISE, "named"),  # a tenth of the power, beside tolerances
    (5.0 * NOISE, "ambiguous"),
])  # fmt: skip
def test_what_a_cause_leaves_of_another_motion(after, expected):
    verdict = judged(
        told("payload"), errors(10.0 * NOISE, NOISE), errors(after, 9.0 * NOISE)
    )
    assert verdict.verdict == expected
    (cause,) = verdict.causes
    assert cause.borne_out == (expected == "named")
    assert cause.probability == (1.0 if expected == "named" else UNSURE)


@pytest.mark.parametrize("after", [10.0, 20.0])
def test_a_cause_that_predicts_no_better_than_nothing_explains_nothing(after):
    worse = errors(after * NOISE, NOISE)
    verdict = judged(told("payload"), errors(10.0 * NOISE, NOISE), worse)
    assert verdict.verdict == "unknown" and verdict.unexplained == [0]
    assert verdict.causes[0].probability == 0.5


@pytest.mark.parametrize("after, expected", [(5.0, "ambiguous"), (10.0, "unknown")])
def test_half_a_second_ahead_may_bear_out_what_whole_logs_do_not(after, expected):
    before, worse = errors(10.0 * NOISE, NOISE), errors(20.0 * NOISE, NOISE)
    ahead = before, errors(after * NOISE, NOISE)
    assert judged(told("payload"), before, worse, ahead).verdict == expected


@pytest.mark.parametrize("after, expected", [(1.0, "named"), (9.0, "unknown")])
def test_of_a_joint_that_is_drawn_what_it_leaves_while_drawn_counts(after, expected):
    before, worse = errors(10.0 * NOISE, NOISE), errors(20.0 * NOISE, NOISE)
    drawn = {0: (errors(9.0 * NOISE), errors(after * NOISE))}
    ahead = before, errors(NOISE, NOISE)
    found = judged(told("payload"), before, worse, ahead, drawn)
    assert found.verdict == expected


def test_lost_commands_predict_nothing_of_another_motion():
    worse = errors(20.0 * NOISE, 20.0 * NOISE)
    verdict = judged(told("dropped_commands"), errors(10.0 * NOISE, NOISE), worse)
    assert verdict.verdict == "named" and verdict.causes[0].borne_out


def test_an_unknown_verdict_stays_unknown():
    worse = errors(20.0 * NOISE, 20.0 * NOISE)
    verdict = judged(told("payload", left=(1,)), errors(NOISE, NOISE), worse)
    assert verdict.verdict == "unknown" and not verdict.causes[0].borne_out
