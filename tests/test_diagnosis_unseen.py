"""A cause is doubted where it does not predict another motion."""

from types import SimpleNamespace

import numpy as np
import pytest

from gatjax.diagnosis.claims import Claim
from gatjax.diagnosis.hypotheses import Hypothesis
from gatjax.diagnosis.measure import Errors
from gatjax.diagnosis.unseen import UNSURE, Seen, borne_out
from gatjax.diagnosis.verdict import Cause, Verdict, doubted, word

NOISE = 1e-3


def told(cause, where=(0,), left=()):
    """A verdict of one cause, in a robot of two joints."""
    joints = [SimpleNamespace(index=k, noise=NOISE) for k in range(2)]
    hypothesis = Hypothesis(cause, "", lambda *_: None, (), (), (), (), lambda *_: {})
    claim = Claim(hypothesis, np.zeros(0), where, dict.fromkeys(where), 100.0)
    judge = SimpleNamespace(joints=joints)
    return Verdict("", [Cause(claim, 1.0, [], [])], list(left), None, [], judge)


def errors(*rms):
    return Errors(np.tile(np.square(rms), (50, 1)), np.arange(50) // 10)


def judged(verdict, before, after, ahead=None, drawn=None):
    return borne_out(verdict, Seen((before, after), lambda: ahead, drawn or {}))


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


def test_whole_logs_do_not_refute_a_drawn_joint_that_shows_nothing_while_drawn():
    """Teeth that bounce: chance decides whole logs, whatever the law."""
    before, worse = errors(10.0 * NOISE, NOISE), errors(20.0 * NOISE, NOISE)
    drawn = {0: (errors(1.8 * NOISE), errors(1.5 * NOISE))}
    found = judged(told("backlash"), before, worse, None, drawn)
    assert found.verdict == "named" and found.causes[0].borne_out is None


def test_lost_commands_predict_nothing_of_another_motion():
    worse = errors(20.0 * NOISE, 20.0 * NOISE)
    verdict = judged(told("dropped_commands"), errors(10.0 * NOISE, NOISE), worse)
    assert verdict.verdict == "named" and verdict.causes[0].borne_out is None


def test_an_unknown_verdict_stays_unknown():
    worse = errors(20.0 * NOISE, 20.0 * NOISE)
    verdict = judged(told("payload", left=(1,)), errors(NOISE, NOISE), worse)
    assert verdict.verdict == "unknown" and not verdict.causes[0].borne_out


@pytest.mark.parametrize(("rms", "noisy", "expected"), [
    (4.0, 1.0, "named"),  # 16 % of the power
    (5.0, 1.0, "unknown"),
    (1.0, 0.2, "unknown"),  # within reach of the noise, but so was the nominal model
])  # fmt: skip
def test_a_joint_is_explained_if_its_motion_is_predicted(rms, noisy, expected):
    before = errors(10.0 * noisy * NOISE, NOISE)
    verdict = judged(told("backlash", left=(0,)), before, errors(rms * NOISE, NOISE))
    assert verdict.verdict == expected
    assert verdict.unexplained == ([] if expected == "named" else [0])


def test_a_law_without_a_name_stays_unexplained():
    verdict = told("backlash", left=(0,))
    verdict = verdict._replace(law=verdict.causes[0].claim)
    verdict = judged(verdict, errors(10.0 * NOISE, NOISE), errors(NOISE, NOISE))
    assert verdict.verdict == "unknown"


def test_a_joint_without_a_cause_stays_unexplained():
    verdict = told("backlash", left=(1,))
    before = errors(10.0 * NOISE, 10.0 * NOISE)
    verdict = judged(verdict, before, errors(NOISE, NOISE))
    assert verdict.unexplained == [1]
    assert verdict.verdict == "named"  # the cause of the other joint is sure


@pytest.mark.parametrize(("left", "chances", "expected"), [
    ((), (), "none"), ((1,), (), "unknown"), ((), (0.9, 0.9), "named"),
    ((1,), (0.9, 0.9), "named"), ((1,), (0.9, 0.7), "ambiguous"),
    ((1,), (0.7, 0.7), "unknown"), ((0,), (0.9, 0.9), "unknown"),
])  # fmt: skip
def test_the_word_for_causes_beside_what_is_unexplained(left, chances, expected):
    cause = told("backlash").causes[0]
    causes = [cause._replace(probability=chance) for chance in chances]
    assert word(causes, list(left)) == expected


def test_a_cause_with_values_at_many_joints_is_no_guess_where_one_is_unexplained():
    first = told("backlash", (0,), (0,)).causes[0]
    more = [first._replace(claim=first.claim._replace(where=(k,))) for k in (1, 2, 3)]
    assert word([first, *more], [0]) == "named"
    alone = [cause._replace(rivals=[]) for cause in (first, *more)]
    assert word(alone, [0]) == "ambiguous"


@pytest.mark.parametrize(("left", "where", "probability"), [
    ((), (0,), 1.0), ((0,), (0,), 0.5), ((1,), (0,), 1.0), ((0,), (0, 1, 2, 3), 1.0),
])  # fmt: skip
def test_a_cause_that_leaves_its_own_joint_unexplained_is_a_guess(
    left, where, probability
):
    (cause,) = doubted(told("backlash", where, left)).causes
    assert cause.probability == probability
