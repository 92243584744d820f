"""Marks and scores of diagnoses against known answers."""

import math
from pathlib import Path

import numpy as np
import pytest

from gatjax.benchmark import scores, tables
from gatjax.benchmark.cases import Case
from gatjax.benchmark.marks import gain_share, mark, same_place
from gatjax.benchmark.solve import Answer
from gatjax.cli.blind import write
from gatjax.runs import read_json

JOINTS = ("hip", "knee")
ACCEPTED = {
    "command_delay": ["command_delay", "measurement_delay"],
    "damping_error": ["damping_error", "viscous_friction"],
}


def effect(cause, where=("knee",), value=0.5, parameter="torque"):
    parameters = {parameter: {"value": value, "unit": ""}}
    return {
        "cause": cause,
        "where": list(where),
        "parameters": parameters,
        "main_parameter": parameter,
    }


def case(kind="single", effects=(), d=4.0, gain=0.5):
    truth = {
        "kind": kind,
        "robot": "leg",
        "engine": "dart",
        "causes": list(effects),
        "accepted": {
            e["cause"]: ACCEPTED.get(e["cause"], [e["cause"]]) for e in effects
        },
        "d": None if kind == "null" else d,
        "in_main_score": kind == "null" or d >= 0.8,
        "oracle": {"gain": gain},
    }
    return Case(f"{kind}_{d}", Path("m.xml"), (), (), JOINTS, truth)


def said(cause, where=("knee",), value=0.5, parameter="torque", probability=0.9):
    spread = {"value": value, "low": value - 0.1, "high": value + 0.1, "unit": ""}
    return {
        "cause": cause,
        "where": list(where),
        "parameters": {parameter: spread},
        "probability": probability,
        "equivalent": [],
    }


def answer(verdict, *causes, gain=None):
    return Answer({"verdict": verdict, "causes": list(causes), "gain": gain}, 2.0, "")


def scored(marks):
    return {score.name: score for score in scores.summary(marks)}


FRICTION = effect("coulomb_friction")


def test_the_right_cause_at_the_right_joint():
    one = mark(case(effects=[FRICTION]), answer("named", said("coulomb_friction")))
    assert (one.exact, one.right, one.joint, one.utility) == (True, True, True, 1.0)
    assert one.error == 0.0 and one.covered == 1.0


def test_the_right_cause_at_another_joint_is_right_but_not_placed():
    there = said("coulomb_friction", where=("hip",))
    one = mark(case(effects=[FRICTION]), answer("named", there))
    assert (one.right, one.joint, one.located) == (True, False, False)
    wrong = mark(case(effects=[FRICTION]), answer("named", said("dead_band")))
    assert (wrong.right, wrong.joint, wrong.located) == (False, False, True)
    told = scored([one, wrong])
    assert told["joint right where the cause is"].value == 0.0
    assert told["joint right where one is named"].value == 0.5


def test_a_name_of_the_same_class_is_right_but_not_exact():
    true = effect("command_delay", value=0.02, parameter="delay")
    named = said("measurement_delay", value=0.03, parameter="delay")
    one = mark(case(effects=[true]), answer("named", named))
    assert (one.exact, one.right) == (False, True)
    assert one.error == pytest.approx(0.5)


def test_classes_with_other_parameters_have_no_error():
    true = effect("damping_error", value=3.0, parameter="scale")
    one = mark(case(effects=[true]), answer("named", said("viscous_friction")))
    assert one.right and math.isnan(one.error) and math.isnan(one.covered)


def test_the_error_of_a_scale_is_relative_to_its_distance_from_one():
    true = effect("gain_error", value=1.2, parameter="scale")
    named = said("gain_error", value=1.25, parameter="scale")
    one = mark(case(effects=[true]), answer("named", named))
    assert one.error == pytest.approx(0.25)


def test_wrong_names_cost_two_and_doubt_costs_nothing():
    wrong = said("dead_band")
    given = case(effects=[FRICTION])
    assert mark(given, answer("named", wrong)).utility == -2.0
    doubt = mark(given, answer("ambiguous", said("coulomb_friction")))
    assert (doubt.right, doubt.utility) == (True, 0.0)
    assert mark(given, answer("none")).utility == 0.0
    further = answer("named", said("coulomb_friction"), wrong)
    assert mark(given, further).utility == -2.0


def test_no_answer_is_neither_right_nor_an_alarm():
    one = mark(case("null"), Answer(None, 3.0, "boom"))
    assert (one.verdict, one.utility, one.note) == ("failed", 0.0, "boom")
    quiet = mark(case("null"), answer("none"))
    alarms = scored([one, quiet])["false alarms"]
    assert (alarms.value, alarms.count) == (0.0, 1)
    assert scored([one])["no answer"].value == 1.0
    (row,) = scores.groups([one, quiet], "robot")
    assert (row["alarms"].value, row["alarms"].count) == (0.0, 1)


@pytest.mark.parametrize("verdict", ["named", "ambiguous", "unknown"])
def test_everything_but_none_is_a_false_alarm(verdict):
    one = mark(case("null"), answer(verdict))
    assert scored([one])["false alarms"].value == 1.0


def test_what_stands_beside_unknown_is_no_name():
    one = mark(case(effects=[FRICTION]), answer("unknown", said("coulomb_friction")))
    assert (one.first, one.right, one.beside) == ("", False, (0.9, True))


def test_pairs_count_both_one_and_what_is_not_there():
    given = case("pair", [FRICTION, effect("dead_band")])
    both = mark(given, answer("named", said("dead_band"), said("coulomb_friction")))
    assert (both.matched, both.placed, both.spurious) == (2, 2, 0)
    half = mark(given, answer("named", said("dead_band"), said("payload")))
    assert (half.matched, half.spurious, half.utility) == (1, 1, -2.0)
    alone = mark(given, answer("named", said("dead_band")))
    assert (alone.matched, alone.utility) == (1, 0.0)
    found = scored([both, half, alone])
    assert found["pairs: both"].value == pytest.approx(1 / 3)
    assert found["pairs: at least one"].value == 1.0


def test_one_name_does_not_match_two_true_causes():
    given = case("pair", [FRICTION, effect("coulomb_friction", ("hip",))])
    one = mark(given, answer("named", said("coulomb_friction", ("hip",))))
    assert (one.matched, one.placed) == (1, 1)


def test_outside_cases_ask_for_unknown():
    given = case("outside")
    bold = mark(given, answer("named", said("dead_band", probability=0.8)))
    timid = mark(given, answer("ambiguous", said("dead_band", probability=0.5)))
    right = mark(given, answer("unknown"))
    found = scored([bold, timid, right])
    late = mark(given, answer("named", said("payload", probability=0.5), said("lag")))
    assert late.surest == 0.9 and math.isnan(right.surest)
    assert found["outside: unknown"].value == pytest.approx(1 / 3)
    assert found["outside: confidently misnamed"].value == pytest.approx(1 / 3)
    assert (bold.utility, timid.utility, right.utility) == (-2.0, 0.0, 1.0)


def test_all_joints_by_name_are_all():
    assert same_place(["all"], ["knee", "hip"], JOINTS)
    assert same_place(["servo"], ["all"], ("servo",))
    assert not same_place(["all"], ["knee"], JOINTS)


def test_gain_counts_only_where_the_oracle_gains():
    gain = {"before": 2.0, "after": 1.5}
    assert gain_share({"gain": 0.5}, gain) == pytest.approx(0.5)
    assert math.isnan(gain_share({"gain": 0.09}, gain))
    assert math.isnan(gain_share({"gain": 0.5}, None))


def test_rates_have_wilson_intervals():
    score = scores.rate("x", [False] * 300)
    assert score.value == 0.0 and score.high == pytest.approx(0.01264, abs=1e-5)
    assert tables.shown(scores.rate("x", [])) == "-"
    assert tables.shown(scores.rate("x", [True] * 3 + [False])).startswith("75.0 % [")


def test_brier_score_and_reliability():
    right = mark(case(effects=[FRICTION]), answer("named", said("coulomb_friction")))
    wrong = mark(case(effects=[FRICTION]), answer("named", said("dead_band")))
    found = scored([right, wrong])["Brier score of the first cause"]
    assert found.value == pytest.approx((0.1**2 + 0.9**2) / 2)
    rows = [row for row in scores.reliability([right, wrong]) if row["right"].count]
    assert [(row["low"], row["right"].value) for row in rows] == [(0.9, 0.5)]


def test_certainty_falls_into_the_last_tenth():
    sure = said("coulomb_friction", probability=1.0)
    one = mark(case(effects=[FRICTION]), answer("named", sure))
    assert scores.reliability([one])[-1]["right"].count == 1


def test_visibility_bins_hold_every_single_once():
    sizes = [0.3, 0.8, 1.5, 2.9, 3.0, 6.0, 40.0]
    marks = [mark(case(effects=[FRICTION], d=d), answer("none")) for d in sizes]
    counts = [row["detected"].count for row in scores.by_visibility(marks)]
    assert counts == [1, 1, 2, 1, 2]


def test_confusion_counts_what_was_said():
    given = case(effects=[FRICTION])
    marks = [
        mark(given, answer("named", said("coulomb_friction"))),
        mark(given, answer("named", said("dead_band"))),
        mark(case("null"), answer("none")),
        mark(case("outside"), answer("unknown")),
    ]
    rows, columns, counts = scores.confusion(marks)
    assert rows == ["coulomb_friction", "none", "outside"]
    assert columns == ["coulomb_friction", "dead_band", "none", "unknown"]
    np.testing.assert_array_equal(counts, [[1, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def test_what_logs_cannot_tell_apart_was_not_mistaken(tmp_path):
    late = case(effects=[effect("command_delay", value=0.02, parameter="delay")])
    alias = said("measurement_delay", value=0.02, parameter="delay")
    marks = [
        mark(late, answer("named", alias)),
        mark(late, answer("named", said("dead_band"))),
    ]
    assert tables._confusions(marks[:1]) == "Nothing was mistaken."
    text = tables._confusions(marks)
    assert "dead_band" in text and "1 of 2" in text and "measurement" not in text


def test_effects_too_small_to_see_are_not_in_the_main_score(tmp_path):
    shown = mark(case(effects=[FRICTION]), answer("named", said("coulomb_friction")))
    small = mark(case(effects=[FRICTION], d=0.5), answer("none"))
    write(tmp_path, {"gatjax": [shown, small], "other": [small, small]})
    main = read_json(tmp_path / "scores.json")["solvers"]["gatjax"]["main"]
    assert [s["count"] for s in main if s["name"] == "cause right, by class"] == [1]
    text = (tmp_path / "scores.md").read_text()
    assert "100.0 % [20.7, 100.0] of 1" in text and "Beside simpler methods" in text
    assert all(
        (tmp_path / f"{n}.png").stat().st_size for n in ("confusion", "detection")
    )
