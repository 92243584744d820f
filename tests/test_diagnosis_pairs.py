"""Two causes at one joint, of which what explains most alone is neither."""

from types import SimpleNamespace

import numpy as np
import pytest

from gatjax.diagnosis import exchange, findings, pairs, verdict
from gatjax.diagnosis.claims import Claim
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis, combined
from gatjax.diagnosis.joint import NOTHING
from gatjax.diagnosis.judge import Judge

LAW = ""  # a claim without a name
NOISE = 1e-3
THREE = {  # one after the other, where two explain as much
    "": {"payload": 120.0, "tilt": 70.0},
    "payload": {"gain": 200.0}, "gain": {"payload": 100.0},
    "gain+payload": {"friction": 80.0},
    "tilt": {"friction": 300.0}, "friction": {"tilt": 250.0},
}  # fmt: skip


def fit(rms):
    empty = np.zeros((1, 1))
    residual = np.full(4, rms * NOISE)
    return Fit(None, np.zeros(1), 0.0, residual, empty, np.eye(1), 1e-2, False)


def claim(cause, gain=100.0, fits=None):
    fits = fits or {0: fit(1.0)}
    none = Hypothesis(cause, "", lambda *_: None, (), (), (), (), lambda *_: {})
    return Claim(none, np.zeros(1), tuple(fits), fits, gain)


class Scripted(Judge):
    """A judge of one joint that finds what a script says beside what is known."""

    def __init__(self, script, right, names=()):
        self.script, self.right, self.names = script, right, list(names)
        self.case = SimpleNamespace(pulled={}, aside={})
        self.joints = [SimpleNamespace(noise=NOISE)]
        self.accepted = [claim(name) for name in names]
        self.known = [fit(1.0)]

    def fork(self):
        return Scripted(self.script, self.right, self.names)

    def claims(self):
        found = self.script.get("+".join(sorted(self.names)), {})
        return [claim(name, gain) for name, gain in found.items()]

    def accept(self, claim):
        self.names.append(claim.hypothesis.cause)
        self.accepted.append(claim)
        return claim

    def refitted(self, claim):
        return claim

    def evidence(self):
        return 0.0


@pytest.fixture
def told(monkeypatch):
    """The verdict on a script, in which only the causes `right` explain the joint."""
    for module in (verdict, exchange, pairs):
        monkeypatch.setattr(module, "worth_naming", lambda judge, claim: True)
        monkeypatch.setattr(
            module, "whole", lambda judge, claim: bool(claim.hypothesis.cause)
        )

    def beside(judge, first, joint):
        others = judge.script.get(first.hypothesis.cause, {LAW: 0.0})
        return first._replace(gain=first.gain + max(others.values()))

    monkeypatch.setattr(pairs, "_beside", beside)
    monkeypatch.setattr(pairs, "explained", lambda judge, claim: 0.5)
    for module in (verdict, exchange):
        monkeypatch.setattr(
            module, "adequate", lambda judge, index: set(judge.names) == judge.right
        )

    def run(script, right):
        found = verdict.decide(Scripted(script, set(right)))
        causes = [cause.claim.hypothesis.cause for cause in found.causes]
        return found.verdict, sorted(causes)

    return run


def test_two_small_causes_beat_an_unnamed_law(told):
    script = {
        "": {LAW: 300.0, "payload": 230.0, "scale": 60.0, "offset": 25.0},
        "payload": {"ripple": 40.0},
        "scale": {"offset": 270.0},
        "offset": {"scale": 310.0},
    }
    assert told(script, {"scale", "offset"}) == ("named", ["offset", "scale"])


def test_two_causes_that_explain_less_than_an_unnamed_law_are_not_told(told):
    script = {
        "": {LAW: 300.0, "scale": 60.0, "offset": 25.0},
        "scale": {"offset": 200.0}, "offset": {"scale": 240.0},
    }  # fmt: skip
    assert told(script, {"scale", "offset"}) == ("unknown", [])


def test_two_causes_that_need_a_drawn_joint_are_no_better_than_a_law_that_does_not(
    told, monkeypatch
):
    script = {
        "": {LAW: 300.0, "scale": 60.0, "offset": 25.0},
        "scale": {"offset": 270.0}, "offset": {"scale": 310.0},
    }  # fmt: skip
    accept = Scripted.accept

    def drawn(judge, claim):
        judge.case.pulled[0] = 10.0
        return accept(judge, claim)

    monkeypatch.setattr(Scripted, "accept", drawn)
    assert told(script, {"scale", "offset"}) == ("unknown", [])
    monkeypatch.setattr(verdict, "ROUGH", 0.5)  # the law leaves as much as the noise
    assert told(script, {"scale", "offset"}) == ("named", ["offset", "scale"])


def test_two_causes_that_leave_most_of_a_misfit_are_not_looked_into(told, monkeypatch):
    script = {
        "": {LAW: 300.0, "scale": 60.0, "offset": 25.0},
        "scale": {"offset": 270.0}, "offset": {"scale": 310.0},
    }  # fmt: skip
    assert told(script, {"scale", "offset"}) == ("named", ["offset", "scale"])
    monkeypatch.setattr(pairs, "explained", lambda judge, claim: 0.3)
    assert told(script, {"scale", "offset"}) == ("unknown", [])


def test_a_first_cause_that_explains_too_little_gives_way_to_two_others(told):
    script = {
        "": {"armature": 130.0, "elastic": 110.0, "delay": 70.0},
        "elastic": {"delay": 150.0},
        "delay": {"elastic": 190.0},
    }
    assert told(script, {"elastic", "delay"}) == ("named", ["delay", "elastic"])
    assert told(script, {"nothing"}) == ("unknown", ["armature"])


def test_two_causes_that_explain_as_much_replace_three(told):
    right = {"tilt", "friction"}
    assert told(THREE, right) == ("named", ["friction", "tilt"])
    three = ["friction", "gain", "payload"]
    assert told(THREE, set(three)) == ("named", three)


def test_two_causes_replace_three_that_explain_the_joint_as_well(told, monkeypatch):
    for module in (verdict, exchange):
        monkeypatch.setattr(module, "adequate", lambda judge, index: True)
    assert told(THREE, set()) == ("named", ["friction", "tilt"])


def test_a_law_beside_a_cause_that_gave_way_is_forgotten(told):
    script = {
        "": {"armature": 130.0, "elastic": 110.0, "delay": 70.0},
        "armature": {LAW: 40.0},
        "elastic": {"delay": 150.0},
        "delay": {"elastic": 190.0},
    }
    assert told(script, {"elastic", "delay"}) == ("named", ["delay", "elastic"])


def test_a_cause_that_comes_and_goes_ends(told, monkeypatch):
    dropped = lambda judge, causes, fresh: (fresh, causes[1:])  # noqa: E731
    monkeypatch.setattr(verdict, "exchanged", dropped)
    script = {
        "": {"payload": 120.0, "tilt": 70.0}, "tilt": {"payload": 90.0},
        "payload": {"tilt": 200.0}, "payload+tilt": {},
    }  # fmt: skip
    assert told(script, {"payload"})[1] != []


def test_a_cause_of_the_floor_is_no_cause_of_joints(told):
    floor = claim("tilt")._replace(fits={}, where=())
    cause = verdict.Cause(floor, 1.0, [], [])
    judge = Scripted({}, set())
    before = [exchange.Before(judge, [])]
    assert exchange.instead(judge, [cause], before) == (judge, [cause])


def test_sizes_are_those_beside_what_was_accepted_later():
    first, second = (claim(n).hypothesis._replace(low=(0.0,)) for n in "ab")
    both = combined(first, second)
    x = np.append(np.zeros(COUNT), [2.0, 5.0])
    known = fit(1.0)._replace(
        hypothesis=both, x=x, information=np.diag(np.arange(1.0, COUNT + 3.0))
    )
    judge = Scripted({}, set(), "ab")
    judge.known = [known]
    old = claim("a")._replace(hypothesis=first)
    now = judge.current(old)
    assert now.own == 2.0 and judge.current(old._replace(hypothesis=second)).own == 5.0
    assert now.covariance > judge.current(old._replace(hypothesis=second)).covariance


def test_a_joint_of_a_cause_of_many_may_have_a_cause_of_its_own(monkeypatch):
    monkeypatch.setattr(Judge, "visibility", lambda judge, claim: 1.0)
    judge = Scripted({}, set())
    judge.case.healthy = [fit(9.0)] * 3
    judge.known, judge.joints = (
        [fit(3.0)] * 3,
        [SimpleNamespace(noise=NOISE, assumed=NOTHING)] * 3,
    )
    second = claim("delay", fits={0: fit(2.0)})  # explains 0.65 of the rest
    judge.accepted = [claim("payload", fits={0: fit(3.0)})]
    assert not findings.worth_naming(judge, second)
    judge.accepted = [claim("payload", fits=dict.fromkeys(range(3), fit(3.0)))]
    assert findings.worth_naming(judge, second)


def test_one_of_several_joints_may_have_a_cause_of_its_own_besides():
    judge = Scripted({}, set())
    judge.known = [fit(8.0), fit(8.0), fit(50.0)]
    judge.joints = [SimpleNamespace(noise=NOISE, assumed=NOTHING)] * 3
    left = {0: fit(1.0), 1: fit(1.0), 2: fit(49.0)}
    assert findings.whole(judge, claim("gain", fits=left))
    assert not findings.whole(judge, claim("gain", fits={1: left[1], 2: left[2]}))
    worse = left | {1: fit(10.0)}
    assert not findings.whole(judge, claim("gain", fits=worse))


@pytest.mark.parametrize(
    ("left", "more", "named"),
    [(2.5, 30.0, ["torque", "viscous"]), (2.5, 5.0, ["soft", "speed"]),
     (1.2, 30.0, ["soft", "speed"])],
)  # fmt: skip
def test_two_causes_that_leave_a_little_give_way_to_two_that_explain_more(
    told, monkeypatch, left, more, named
):
    """A torque limit with viscous friction is near a speed limit of a soft motor."""
    monkeypatch.setattr(verdict, "adequate", lambda judge, index: True)
    monkeypatch.setattr(exchange, "adequate", lambda judge, index: True)
    monkeypatch.setattr(
        Scripted, "evidence",
        lambda judge: more if set(judge.names) == {"torque", "viscous"} else 0.0,
    )  # fmt: skip
    plain = Scripted.__init__

    def begun(self, *given):
        plain(self, *given)
        self.known = [fit(left)]

    monkeypatch.setattr(Scripted, "__init__", begun)
    script = {
        "": {"speed": 120.0, "torque": 70.0}, "speed": {"soft": 80.0},
        "soft": {"speed": 110.0}, "torque": {"viscous": 300.0},
        "viscous": {"torque": 250.0},
    }  # fmt: skip
    assert told(script, {"any"})[1] == named


@pytest.mark.parametrize(("left", "more", "lossy"), [
    (3.0, 5.0, True),
    (3.0, -5.0, False),  # another cause explains more
    (1.5, 5.0, False),  # that one leaves no room for losses
])  # fmt: skip
def test_losses_are_tried_beside_a_first_cause(monkeypatch, left, more, lossy):
    judge = Scripted({}, set())
    other, losses = fit(left), fit(1.0)
    judge.case = None
    judge.score = lambda index, found, joint: 40.0
    monkeypatch.setattr(pairs, "changed", lambda case, claim, index, joint: joint)
    monkeypatch.setattr(pairs, "of_drive", lambda joint, bank: bank)
    monkeypatch.setattr(pairs.search, "proposals", lambda *_: [other])
    monkeypatch.setattr(pairs.lost, "second", lambda *_: (40.0 + more, losses))
    found = pairs._beside(judge, claim("gain"), 0)
    assert found.fits[0] is (losses if lossy else other)
    assert found.gain == (45.0 if lossy else 40.0)
