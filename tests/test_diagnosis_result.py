"""Candidates of diagnosis.json: what was weighed for each cause, and what is left."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_diagnosis_plant import joint, wave

from gatjax.diagnosis import drops
from gatjax.diagnosis.bank import CAUSES, OTHERS
from gatjax.diagnosis.claims import Claim, Stance
from gatjax.diagnosis.experiment import sides
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, TOLERANCES
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.result import (
    calibration_rows,
    candidates,
    cause_rows,
)
from gatjax.diagnosis.sentence import sentence
from gatjax.diagnosis.verdict import Cause, Verdict

FIT = Fit(
    None, np.zeros(1), 0.0, np.full(4, 0.002), np.zeros((4, 1)), np.eye(1), 1e-2, True
)  # fmt: skip


class Bare(Judge):
    """A judge of one joint that knows nothing of it."""

    def __init__(self, most):
        self.joints, self.case, self.most = [joint(wave)], None, most


def claim(cause, gain, own=()):
    hypothesis = next(h for h in CAUSES + OTHERS if cause in (h.cause, h.variant))
    own = np.array(own or hypothesis.starts[0])
    return Claim(hypothesis, own, (0,), {0: FIT}, gain)


DRY = claim("coulomb_friction", 60.0, (np.log(0.1),))
DELAY = claim("command_delay", 12.0, (np.log(0.02),))
LAG = claim("first_order_lag", 9.0)
SPRING = claim("parallel spring", 7.0)


def verdict(causes, last=(), law=None, most=3):
    return Verdict("named", causes, [], law, list(last), Bare(most))


def test_a_candidate_has_its_numbers_and_the_step_it_was_weighed_in():
    causes = [Cause(DRY, 0.96, [(LAG, 0.03)], []), Cause(DELAY, 0.7, [], [])]
    first, rival, second = candidates(verdict(causes))
    assert first == {
        "cause": "coulomb_friction", "variant": "", "where": ["elbow"],
        "parameters": {"torque": {"value": pytest.approx(0.5), "unit": "N*m"}},
        "log_evidence": 60.0, "probability": 0.96, "rms": pytest.approx(0.002),
        "step": 1,
    }  # fmt: skip
    assert (rival["cause"], rival["step"]) == ("first_order_lag", 1)
    assert (second["cause"], second["step"]) == ("command_delay", 2)


def test_lost_commands_are_told_with_what_so_few_bursts_leave_open():
    lost = np.arange(600) % 100 < 20  # six bursts, a fifth
    said = verdict([Cause(claim_of(lost), 0.96, [], [])])
    said.judge.case = SimpleNamespace(commands=lambda k: [np.arange(600.0)])
    told = cause_rows(said, 0)[0]["parameters"]
    share = told["probability"]
    assert share["value"] == pytest.approx(0.2, abs=0.02)
    assert 0.05 < share["low"] < 0.12 and 0.3 < share["high"] < 0.5
    assert told["burst"]["value"] == 20.0


def claim_of(lost):
    """A claim that the joint lost commands."""
    return Claim(drops.LOST, np.zeros(0), (0,), {0: FIT}, 50.0)._replace(
        lost={0: [lost]}
    )


def test_a_cause_with_several_values_is_one_candidate_of_no_one_size():
    rivals = [(LAG._replace(fits={}), 0.03)]
    causes = [Cause(DRY, 0.96, rivals, []), Cause(DRY, 0.96, rivals, [])]
    first, rival = candidates(verdict(causes))
    assert first["log_evidence"] == 2 * DRY.gain and first["where"] == ["elbow"] * 2
    assert first["parameters"] == {} and first["rms"] is None
    assert rival["cause"] == "first_order_lag" and rival["rms"] is None


def test_a_share_that_joints_have_in_common_is_told_in_newton_metres_of_each():
    said = verdict([Cause(DRY._replace(where=(0, 1, 2)), 0.96, [], [])])
    strong = said.judge.joints[0]
    limit = 0.2 * strong.nominal["limit"]
    weak = strong._replace(name="wrist", nominal=strong.nominal | {"limit": limit})
    said.judge.joints = [strong, weak, strong._replace(name="shoulder")]
    whole, small = cause_rows(said, 0)
    assert (whole["where"], small["where"]) == (["elbow", "shoulder"], ["wrist"])
    assert whole["parameters"]["torque"]["value"] == pytest.approx(0.5)
    assert small["parameters"]["torque"]["value"] == pytest.approx(0.1)
    assert candidates(said)[0]["parameters"] == {}  # no one value


def test_the_zero_that_a_servo_sees_is_calibrated_and_a_motor_has_none():
    said = verdict([])
    servo = said.judge.joints[0]
    motor = servo._replace(name="wheel", nominal=servo.nominal | {"hold": 0.0})
    x = np.zeros(COUNT)
    x[TOLERANCES.index("zero_in")] = 2.0
    said.judge.joints, said.judge.known = [servo, motor], [FIT._replace(x=x)] * 2
    rows = [r for r in calibration_rows(said) if "encoder zero" in r["parameter"]]
    assert [(row["where"], row["parameter"]) for row in rows] == [
        ("elbow", "encoder zero"), ("elbow", "encoder zero, seen by the servo"),
        ("wheel", "encoder zero"),
    ]  # fmt: skip
    assert rows[1]["fitted"] == pytest.approx(2.0 * rows[1]["tolerance"])


def test_a_rival_that_cannot_stand_beside_the_others_is_not_compared():
    geared = DRY.hypothesis._replace(cause="joint_elasticity", geared=True)
    gap = DRY._replace(hypothesis=geared._replace(cause="backlash"))
    late = DELAY._replace(where=(0, 1, 2))  # at most joints
    causes = [Cause(late, 0.7, [], []), Cause(gap, 0.9, [], [])]
    elastic = LAG._replace(hypothesis=geared)
    first, second, names = sides(verdict(causes), [late, elastic])
    assert [claim.hypothesis.cause for claim in first] == ["backlash", "command_delay"]
    assert [claim.hypothesis.cause for claim in second] == ["backlash"]
    assert names == ("command_delay", "no command_delay")
    _, second, names = sides(verdict(causes), [late, LAG])
    assert second[-1] is LAG and names == ("command_delay", "first_order_lag")
    alone = sides(verdict(causes[:1]), [DELAY])
    assert alone.second == [] and alone.names[1] == "the nominal model"


def test_what_was_weighed_beside_the_named_causes_is_there_too():
    named = [Cause(DRY, 0.96, [], [])]
    rows = candidates(verdict(named, [LAG, SPRING]))
    told = [(row["cause"], row["step"], row["probability"]) for row in rows]
    assert told == [
        ("coulomb_friction", 1, 0.96), ("first_order_lag", 2, None),
        ("parallel spring", 2, None),
    ]  # fmt: skip
    assert rows[2]["variant"] == "not in the catalogue" and not rows[2]["parameters"]
    rows = candidates(verdict(named, [LAG, SPRING], law=SPRING))
    assert [row["cause"] for row in rows[1:]] == ["parallel spring", "first_order_lag"]
    many = candidates(verdict([], [LAG] * 99))
    assert len(many) == 99 and {row["step"] for row in many} == {1}


def test_nothing_is_weighed_after_the_last_cause_that_may_be_named():
    stance = Stance("ground", {"mu": 0.3}, 0.2, 0.4, 2.0)
    slip = DELAY._replace(
        hypothesis=DELAY.hypothesis._replace(cause="ground_friction"),
        where=(), fits={}, stance=stance,
    )  # fmt: skip
    rows = candidates(
        verdict([Cause(slip, 0.9, [(LAG, 0.1)], [])], [slip, LAG], most=1)
    )
    assert [row["cause"] for row in rows] == ["ground_friction", "first_order_lag"]
    assert rows[0]["where"] == ["ground"] and rows[0]["rms"] is None
    assert rows[0]["parameters"] == {"mu": {"value": 0.3, "unit": "1"}}


def row(cause, borne_out, probability=0.9):
    size = {"value": 0.1, "unit": "rad"}
    return {
        "cause": cause, "variant": "", "where": ["elbow"],
        "parameters": {"width": size},
        "equivalent": [], "borne_out": borne_out, "probability": probability,
    }  # fmt: skip


SURE, DOUBTFUL = "backlash of 0.1 rad (width) at elbow", "stiction of 0.1 rad (width)"


@pytest.mark.parametrize("rows, left, said", [
    ([row("backlash", True)], [0], f"The simulation lacks {SURE}; besides, something"),
    ([row("backlash", True), row("stiction", False)], [0],
     f"The simulation lacks {SURE}; {DOUBTFUL} at elbow would fit, but does not"),
    ([row("stiction", False)], [0], f"S{DOUBTFUL[1:]} at elbow would fit, but"),
    ([row("backlash", True, 0.5)], [0], f"The simulation may lack {SURE}; besides, so"),
    ([row("stiction", None), row("backlash", None, 0.6)], [0],
     f"lacks {DOUBTFUL} at elbow; it may lack {SURE}; besides, something"),
    ([], [0], "Something at elbow is wrong that no cause"),
    ([row("backlash", True), row("stiction", False)], [],
     f"lacks {SURE} and {DOUBTFUL} at elbow, but the held-out logs do not bear out s"),
    ([row("backlash", True)], [], "but the logs leave a doubt."),
])  # fmt: skip
def test_the_sentence_tells_what_held_out_logs_bear_out(rows, left, said):
    word = "unknown" if left else "ambiguous"
    text = sentence(verdict([])._replace(verdict=word, unexplained=left), rows, [])
    assert said in text and text[0].isupper() and text.endswith(".")


def test_the_sentence_names_few_joints_and_claims_no_more_than_it_knows():
    many = row("backlash", True) | {
        "where": list("abcdef"), "equivalent": ["joint_elasticity"], "probability": 0.3
    }  # fmt: skip
    text = sentence(
        verdict([])._replace(verdict="ambiguous", unexplained=[]), [many], []
    )
    assert "may lack backlash of" in text
    assert "at a, b, c, d and others (or joint elasticity), but" in text


def test_the_sentence_tells_a_cause_once_with_the_sizes_it_has():
    other = row("backlash", True) | {
        "where": ["wrist"], "parameters": {"width": {"value": 0.03, "unit": "rad"}}
    }  # fmt: skip
    rows = [row("backlash", True), row("stiction", True), other]
    text = sentence(verdict([])._replace(verdict="named", unexplained=[]), rows, [])
    assert "lacks backlash of 0.03 to 0.1 rad (width) at elbow, wrist and sti" in text


def test_the_sentence_tells_the_number_beside_the_main_one_that_may_be_the_larger():
    both = {"torque": {"value": -0.2, "unit": "N*m"},
            "viscous": {"value": -70.0, "unit": "N*m*s/rad"}}  # fmt: skip
    one = row("asymmetric_friction", True) | {"parameters": both}
    text = sentence(verdict([])._replace(verdict="named", unexplained=[]), [one], [])
    assert "of -0.2 N m (torque) and -70 N m s/rad (viscous) at elbow." in text
