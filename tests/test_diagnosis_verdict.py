"""Two causes at one joint: the first one is looked for again beside the second."""

from copy import copy
from types import SimpleNamespace

import numpy as np
import pytest

from gatjax.diagnosis import exchange, experiment, verdict, weighing
from gatjax.diagnosis.aliases import again
from gatjax.diagnosis.claims import PLACE, PRICE, Claim
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis
from gatjax.diagnosis.judge import Judge

FIT = Fit(
    None, np.zeros(1), 0.0, np.zeros(1), np.zeros((1, 1)), np.eye(1), 1e-2, False
)  # fmt: skip


def claim(cause, gain=100.0):
    hypothesis = Hypothesis(
        cause, "", lambda *_: None, (), (), (), (), lambda *_: {}
    )  # fmt: skip
    return Claim(hypothesis, np.zeros(1), (0,), {0: FIT}, gain)


class Told(Judge):
    """A judge of one joint whose evidence is told, by the causes that it accepted."""

    def __init__(self, evidence, found=(), pulled=()):
        self.told, self.found, self.names = evidence, list(found), []
        self.case = SimpleNamespace(pulled=dict.fromkeys(pulled, 10.0), aside={})
        self.joints, self.accepted = [None], []

    def fork(self):
        other = copy(self)
        other.names = list(self.names)
        return other

    def accept(self, claim):
        self.names.append(claim.hypothesis.cause)
        return claim

    def refitted(self, claim):
        return claim

    def claims(self):
        return self.found

    def evidence(self):
        return self.told["+".join(self.names)]


@pytest.fixture
def named(monkeypatch):
    """Both causes, and what `exchanged` makes of them, as names."""
    for module in (verdict, exchange):
        monkeypatch.setattr(module, "worth_naming", lambda judge, claim: True)
        monkeypatch.setattr(module, "whole", lambda judge, claim: True)
    causes = [verdict.Cause(claim(n), 0.9, [], []) for n in ("gain", "elastic")]

    def run(judge, fresh, *second):
        causes[1:] = second or causes[1:]
        chosen, found = exchange.exchanged(judge, causes, fresh)
        names = [cause.claim.hypothesis.cause for cause in found]
        before = [cause.claim.hypothesis.cause for cause in causes]
        assert chosen is judge if names == before else chosen.names == names
        return names

    return run


def test_another_first_cause_takes_the_place_if_it_explains_more(named):
    told = {"elastic+friction": 20.0}
    fresh = Told(told, [claim("friction"), claim("gain", 90.0)])
    assert named(Told({"": 0.0}), fresh) == ["elastic", "friction"]


def test_the_first_cause_stays_if_the_other_one_explains_no_more(named):
    fresh = Told({"elastic+friction": -1.0}, [claim("friction")])
    assert named(Told({"": 0.0}), fresh) == ["gain", "elastic"]


def test_what_explains_as_much_is_named_with_the_first_cause(named):
    told = {"": 0.0, "elastic+friction": -2.0, "elastic+tilt": -20.0}
    near = [claim("tilt", 104.0), claim("friction", 103.0), claim("gain", 100.0)]
    causes = [weighing.Cause(claim(n), 0.9, [], ["lag"]) for n in ("gain", "elastic")]
    (first, second) = exchange.exchanged(Told(told), causes, Told(told, near))[1]
    assert second == causes[1]
    assert first.equivalent == ["friction"]  # tilt is none, on loads that it makes
    odds = np.exp(weighing.TEMPER * -2.0)
    assert first.probability == pytest.approx(1.0 / (1.0 + odds), rel=1e-3)
    better = told | {"elastic+friction": 2.0}
    (_, second) = exchange.exchanged(Told(better), causes, Told(better, near))[1]
    assert second.claim.hypothesis.cause == "friction"
    assert second.equivalent == ["gain"]
    assert second.probability == pytest.approx(1.0 / (1.0 + odds), rel=1e-3)


def test_what_explains_most_on_loads_of_its_own_takes_the_place(named):
    near = [claim("tilt", 104.0), claim("friction", 103.0)]
    told = {"": 0.0, "elastic+friction": 9.0, "elastic+tilt": -20.0}
    assert named(Told(told), Told(told, near)) == ["elastic", "friction"]
    far = [claim("tilt", 104.0), claim("friction", 90.0)]
    assert named(Told(told), Told(told, far)) == ["gain", "elastic"]


def test_what_costs_less_takes_the_place_of_what_explains_as_much(named):
    many = claim("gain")._replace(own=np.zeros(4))
    causes = [weighing.Cause(c, 0.9, [], []) for c in (many, claim("elastic"))]
    told = {"": 0.0, "elastic+friction": -1.0}
    fresh = Told(told, [claim("friction")])
    chosen, (kept, found) = exchange.exchanged(Told(told), causes, fresh)
    assert chosen.names == ["elastic", "friction"]
    assert kept.claim.hypothesis.cause == "elastic"
    assert found.claim.hypothesis.cause == "friction"
    assert found.probability > 0.9


@pytest.mark.parametrize(("gain", "where", "told"), [
    (99.0, (0,), False),  # another one explains as much of a joint that has a cause
    (99.0, (1,), True),  # of a joint that has none: it is told with the other one
    (101.0, (1,), False),  # what is no finding explains more there
    (90.0, (0,), True),
])  # fmt: skip
def test_what_ties_is_told_where_nothing_was(gain, where, told):
    at = {"where": where, "fits": dict.fromkeys(where, FIT)}
    best, rival = claim("gain")._replace(**at), claim("tilt", gain)._replace(**at)
    third = claim("payload", gain)._replace(**at)
    claims = sorted([best, rival, third], key=lambda c: -c.gain)
    causes = [weighing.Cause(claim("elastic"), 1.0, [], [])]
    judge = Told({})
    judge.joints = [None, None]
    assert weighing.worth_telling(judge, best, claims, causes) is told


@pytest.mark.parametrize(("there", "told"), [(1.0, True), (104.0, False)])
def test_what_explains_other_joints_is_no_rival(there, told):
    """A cause of all joints takes nothing from one's own that it does not explain."""
    best, every = claim("gain"), dict.fromkeys(range(4), FIT)
    wide = claim("tilt", 500.0)._replace(where=(0, 1, 2, 3), fits=every)
    causes = [weighing.Cause(claim("elastic")._replace(fits=every), 1.0, [], [])]
    judge = Told({})
    judge.joints = [None] * 4
    judge.score = lambda index, fit: there if index == 0 else 200.0
    assert weighing.worth_telling(judge, best, [wide, best], causes) is told
    assert (weighing.weighed(judge, best, [wide, best]).probability > 0.9) is told


def test_a_rival_at_more_joints_pays_for_its_value_and_place():
    """As the cause has that it is compared with."""
    best, every = claim("gain"), dict.fromkeys(range(3), FIT)
    wide = claim("tilt", 500.0)._replace(where=(0, 1, 2), fits=every, own=np.zeros(2))
    judge = Told({})
    judge.joints = [None] * 4
    judge.score = lambda index, fit: 103.0
    rivals = weighing.weighed(judge, best, [wide, best]).rivals
    assert rivals[0][0].gain == pytest.approx(103.0 - 2.0 * PRICE - PLACE)


def test_other_places_of_a_cause_are_no_rivals_to_telling_it():
    every = dict.fromkeys((0, 1, 2), FIT)
    some = dict.fromkeys((0, 1), FIT)
    best = claim("gain")._replace(where=(0, 1, 2), fits=every)
    others = [
        claim(name, 99.5)._replace(where=(0, 1), fits=some) for name in ("gain", "gain")
    ]
    causes = [weighing.Cause(claim("elastic"), 1.0, [], [])]
    judge = Told({})
    judge.joints = [None] * 4
    assert weighing.weighed(judge, best, [best, *others]).probability < 0.5
    assert weighing.worth_telling(judge, best, [best, *others], causes)
    others = [c._replace(hypothesis=claim("tilt").hypothesis) for c in others]
    assert not weighing.worth_telling(judge, best, [best, *others], causes)


def test_what_other_joints_have_is_nothing_in_a_causes_place(named):
    causes = [weighing.Cause(claim(n), 0.9, [], []) for n in ("gain", "elastic")]
    told = {"": 0.0, "elastic+friction": 50.0}
    far = claim("friction", 200.0)._replace(where=(1,), fits={1: FIT})
    judge, fresh = Told(told), Told(told, [far, claim("gain")])
    fresh.joints = judge.joints = [None, None]
    chosen, found = exchange.exchanged(judge, causes, fresh)
    assert chosen is judge
    assert [cause.equivalent for cause in found] == [[], []]


def test_of_causes_that_free_a_drawn_joint_the_one_that_explains_most_is_told(named):
    told = {"": 90.0, "elastic+tilt": -20.0, "elastic+friction": 50.0}
    near = [claim("tilt", 104.0), claim("friction", 103.0)]
    causes = [weighing.Cause(claim(n), 0.9, [], []) for n in ("gain", "elastic")]
    judge, fresh = Told(told, pulled=[0]), Told(told, near)
    (_, found) = exchange.exchanged(judge, causes, fresh)[1]
    assert found.claim.hypothesis.cause == "friction"
    assert found.probability > 0.99 and found.equivalent == []


def test_what_is_not_worth_naming_makes_the_first_cause_no_less_likely(
    named, monkeypatch
):
    monkeypatch.setattr(
        exchange, "worth_naming", lambda judge, claim: claim.hypothesis.cause == "gain"
    )
    causes = [weighing.Cause(claim(n), 0.9, [], []) for n in ("gain", "elastic")]
    near = [claim("tilt", 130.0), claim("gain", 100.0)]
    (first, _) = exchange.exchanged(Told({}), causes, Told({}, near))[1]
    assert first.probability > 0.99 and first.equivalent == []


def test_aliases_are_as_likely_as_all_of_them_together(named):
    names = "command_delay", "elastic"
    causes = [weighing.Cause(claim(n), 0.9, [], []) for n in names]
    near = [claim("measurement_delay", 102.0), claim("command_delay", 101.0)]
    (first, _) = exchange.exchanged(Told({}), causes, Told({}, near))[1]
    assert first.claim.hypothesis.cause == "command_delay"
    assert first.equivalent == ["measurement_delay"]
    assert first.probability > 0.99
    told = {"": 0.0, "elastic+viscous_friction": 4.0, "elastic+damping_error": 4.0}
    near = [claim("viscous_friction", 102.0), claim("damping_error", 102.0)]
    (_, second) = exchange.exchanged(Told(told), causes, Told(told, near))[1]
    assert second.probability == pytest.approx(2.0 / (2.0 + np.exp(-2.0)))


def test_the_first_cause_is_as_likely_as_it_is_beside_the_second(named):
    causes = [weighing.Cause(claim(n), 0.9, [], []) for n in ("gain", "elastic")]
    near = [claim("gain", 100.0), claim("tilt", 99.0)]
    (first, second) = exchange.exchanged(Told({}), causes, Told({}, near))[1]
    assert second == causes[1]
    assert first.equivalent == ["tilt"]
    assert first.probability == pytest.approx(0.62, abs=0.01)


def test_the_first_cause_stays_if_it_is_found_again(named):
    assert named(Told({}), Told({}, [claim("gain")])) == ["gain", "elastic"]


def test_the_first_cause_goes_if_the_second_explains_as_much(named):
    assert named(Told({"": 0.0}), Told({"elastic": -5.0})) == ["elastic"]
    assert named(Told({"": 0.0}), Told({"elastic": -50.0})) == ["gain", "elastic"]


def test_lost_commands_are_looked_at_alone_though_they_have_no_size(named):
    lost = claim("elastic")._replace(own=np.zeros(0), lost={0: [np.ones(3, bool)]})
    second = verdict.Cause(lost, 0.9, [], [])
    alone = Told({"elastic": -55.0})
    assert named(Told({"": -50.0}), alone, second) == ["elastic"]


@pytest.mark.parametrize(("joints", "share", "places"), [
    (2, 0.4, [(0, 1)]),
    (3, 0.1, [(0, 1, 2)]),  # most joints
    (4, 0.4, [(0, 1)]),  # half of the joints: theirs, if one share suits both
    (4, 0.1, [(0,), (1,)]),
])  # fmt: skip
def test_commands_that_joints_lost_one_after_the_other_are_one_cause(
    monkeypatch, joints, share, places
):
    rng = np.random.default_rng(0)
    masks = [rng.uniform(size=500) < each for each in (0.4, share)]
    losses = [
        claim("dropped_commands", gain)._replace(
            where=(k,), fits={k: FIT}, lost={k: [masks[k]]}, coded=7.0
        )
        for k, gain in enumerate((100.0, 99.0))
    ]
    judge = Told({}, losses)
    judge.most, judge.joints, judge.fork = 2, [None] * joints, lambda: judge
    judge.current, judge.apart = lambda claim: claim, bool
    judge.case.commands = lambda index: [np.sin(0.1 * np.arange(500))]
    for name in ("whole", "worth_naming", "adequate"):
        monkeypatch.setattr(verdict, name, lambda *_: True)
    monkeypatch.setattr(verdict, "_everywhere", lambda judge: [])
    monkeypatch.setattr(verdict, "instead", lambda judge, causes, _: (judge, causes))
    found = verdict.decide(judge).causes
    assert sorted(cause.claim.where for cause in found) == places
    if len(places) == 1:
        (whole,) = (cause.claim for cause in found)
        assert whole.coded == 14.0 and set(whole.lost) == set(whole.fits) == {0, 1}


def test_a_cause_of_the_joint_that_carries_a_link_is_looked_for_again(named):
    load = claim("payload")._replace(where=(1,), fits={1: FIT})
    second = verdict.Cause(load, 0.9, [], [])
    judge = Told({"": 0.0})
    fresh = Told({"payload+friction": 20.0}, [claim("friction")])
    fresh.joints = [None, None]
    fresh.case.bearers = lambda body: [0, body]
    assert named(judge, fresh, second) == ["payload", "friction"]
    first = verdict.Cause(claim("gain"), 0.9, [], [])
    again = Told({"payload+friction": 20.0}, [claim("friction")])
    again.joints, again.case = fresh.joints, fresh.case
    chosen, found = exchange.exchanged(judge, [second, first], again)
    assert chosen is not judge
    assert [cause.claim.body for cause in found] == [1, None]


def test_a_further_value_of_a_cause_takes_no_other_causes_place(named, monkeypatch):
    def at(cause, k):
        return claim(cause)._replace(where=(k,), fits={k: FIT})

    every = [at("lag", 0), at("lag", 1), at("lag", 2), at("gain", 3), at("rub", 4)]
    judge = Told({}, [*every, at("sag", 5)])
    judge.most, judge.joints, judge.fork = 3, [None] * 6, lambda: judge
    judge.apart, judge.current = lambda joints: False, lambda claim: claim
    monkeypatch.setattr(verdict, "_everywhere", lambda judge: [])
    monkeypatch.setattr(verdict, "exchanged", lambda judge, causes, _: (judge, causes))
    monkeypatch.setattr(verdict, "instead", lambda judge, causes, _: (judge, causes))
    monkeypatch.setattr(verdict, "adequate", lambda judge, k: True)
    found = [cause.claim for cause in verdict.decide(judge).causes]
    assert [each.where for each in found] == [each.where for each in every]


@pytest.mark.parametrize(("gain", "expected"), [(99.0, ["gain"]), (102.0, [])])
def test_a_cause_is_not_told_beside_a_better_one_that_is_no_finding(
    named, monkeypatch, gain, expected
):
    every = sorted([claim("gain"), claim("elastic", gain)], key=lambda c: -c.gain)
    judge = Told({"": 0.0, "gain": 9.0}, every)
    judge.most, judge.fork = 1, lambda: judge
    monkeypatch.setattr(
        verdict, "worth_naming", lambda judge, claim: claim.hypothesis.cause == "gain"
    )
    monkeypatch.setattr(verdict, "instead", lambda judge, causes, _: (judge, causes))
    monkeypatch.setattr(verdict, "adequate", lambda judge, k: True)
    judge.current = lambda claim: claim
    causes = verdict.decide(judge).causes
    assert [cause.claim.hypothesis.cause for cause in causes] == expected


@pytest.mark.parametrize(("gain", "where", "first", "told"), [
    (100.0, (1,), "", ["gain"]),
    (100.0, (1,), "doubt", ["gain"]),  # a cause that is too unlikely to be told
    (25.0, (1,), "", []),  # what disturbs one joint may be felt at another one
    (100.0, (0, 1), "", []),
    (100.0, (1,), "floor", []),  # which all joints feel
])  # fmt: skip
def test_a_joint_without_a_name_ends_no_search_at_others(
    named, monkeypatch, gain, where, first, told
):
    fits = dict.fromkeys(where, FIT)
    other = claim("gain", gain)._replace(where=where, fits=fits)
    best = claim(first, 300.0)
    best = best._replace(fits={}) if first == "floor" else best
    judge = Told({}, [best, other])
    judge.most, judge.joints, judge.fork = 3, [None] * 4, lambda: judge
    judge.current, judge.apart = lambda claim: claim, bool
    monkeypatch.setattr(verdict, "whole", lambda judge, claim: claim.hypothesis.cause)
    monkeypatch.setattr(
        verdict, "worth_telling",
        lambda judge, claim, *_: claim.hypothesis.cause not in ("doubt", "floor"),
    )  # fmt: skip
    monkeypatch.setattr(verdict, "_everywhere", lambda judge: [])
    monkeypatch.setattr(verdict.pairs, "better", lambda *_: None)
    monkeypatch.setattr(verdict, "instead", lambda judge, causes, _: (judge, causes))
    monkeypatch.setattr(verdict, "adequate", lambda judge, k: k != 0)
    found = verdict.decide(judge)
    assert [cause.claim.hypothesis.cause for cause in found.causes] == told
    assert found.unexplained == [0]
    assert (found.law is None) == bool(first)
    assert found.verdict == ("named" if told else "unknown")


@pytest.mark.parametrize("first, second, covered", [
    ("payload", "com_shift", True),  # it is a payload beside the centre of mass
    ("com_shift", "payload", False),
    ("viscous_friction", "damping_error", True),  # an alias
])  # fmt: skip
def test_a_cause_that_a_known_one_covers_is_not_told_again(first, second, covered):
    assert again(claim(second), [claim(first)], 2) == covered


@pytest.mark.parametrize(("gain", "level", "known", "told"), [
    (99.0, 1.2, [], "encoder_offset"),
    (95.0, 1.2, [], ""),  # the law explains what the catalogue does not
    (99.0, 4.0, [], ""),  # neither explains the joint
    (99.0, 1.2, [claim("stiction")], ""),  # which may be a half of it
])  # fmt: skip
def test_a_law_without_a_name_gives_way_to_a_cause_that_is_as_good(
    monkeypatch, gain, level, known, told
):
    for name in ("worth_naming", "whole"):
        monkeypatch.setattr(verdict, name, lambda judge, claim: True)
    fit, judge = FIT._replace(residual=np.array([level])), Told({})
    judge.joints, judge.accepted = [SimpleNamespace(noise=1.0)], known
    law = claim("")
    other = claim("encoder_offset", gain)._replace(fits={0: fit})
    elsewhere = claim("gain", 99.5)._replace(where=(1,))
    found = verdict._catalogued(judge, [law, elsewhere, other], law)
    assert found.hypothesis.cause == told


def test_what_is_drawn_only_looks_better(named):
    fresh = Told({"elastic": 500.0}, pulled=[0])
    assert named(Told({"": 0.0}), fresh) == ["gain", "elastic"]


def test_what_need_not_be_drawn_any_more_is_better(named):
    fresh = Told({"elastic+friction": -50.0}, [claim("friction")])
    judge = Told({"": 0.0}, pulled=[0])
    assert named(judge, fresh) == ["elastic", "friction"]


@pytest.fixture
def concluded(monkeypatch):
    """Causes that `conclude` answers, given what each kind of loads would say."""

    class Loaded(Judge):
        def __init__(self, case, tell):
            self.case, self.tell = case, tell

    def run(measured, settled, strain, follows=True):
        """Both sides: names of causes, evidence, joints that are drawn."""
        first = SimpleNamespace(name="measured")
        second = SimpleNamespace(name="settled") if follows else first
        answers = {"measured": measured, "settled": settled}

        def decide(judge):
            names, nats, drawn, *law = answers[judge.case.name]
            found = [verdict.Cause(claim(n), 1.0, [], []) for n in names]
            side = Told({"": nats}, pulled=drawn)
            x = np.full(COUNT, np.sqrt(strain / COUNT))
            side.known = [FIT._replace(x=x)]
            best = claim(law[0]) if law else None
            return verdict.Verdict("named", found, [], best, [], side)

        monkeypatch.setattr(verdict, "decide", decide)
        monkeypatch.setattr(verdict.cases, "settled", lambda case, tell: second)
        chosen = verdict.conclude(Loaded(first, None))
        return [cause.claim.hypothesis.cause for cause in chosen.causes]

    return run


@pytest.mark.parametrize(
    ("measured", "strain", "expected"),
    [
        ((["limit"], 50.0, []), 60.0, ["limit"]),
        ((["limit"], 50.0, []), 20.0, []),  # nothing imitates it: noise of the loads
        ((["limit"], 5.0, []), 60.0, []),  # the tolerances explain as much
        (([], 50.0, []), 60.0, []),
        ((["limit"], 50.0, [0]), 60.0, []),  # it only looks better: it is drawn
    ],
)
def test_a_cause_that_tolerances_hide(concluded, measured, strain, expected):
    assert concluded(measured, ([], 0.0, []), strain) == expected


def test_a_cause_on_settled_loads_is_not_looked_for_elsewhere(concluded):
    assert concluded((["limit"], 50.0, []), (["delay"], 0.0, []), 60.0) == ["delay"]


def test_an_unnamed_law_on_settled_loads_is_not_a_cause_elsewhere(concluded):
    assert concluded((["limit"], 50.0, []), ([], 0.0, [], "spring"), 60.0) == []


def test_loads_that_do_not_follow_are_looked_at_once(concluded):
    assert concluded((["limit"], 0.0, []), None, 60.0, follows=False) == ["limit"]


@pytest.mark.parametrize("probability, separation, said", [
    (1.0, 9.0, "already; it would confirm it."), (1.0, 2.0, "hardly enough to decide."),
    (0.9, 9.0, "the most of all safe motions."),
])  # fmt: skip
def test_a_motion_says_whether_it_would_decide(probability, separation, said):
    causes = [verdict.Cause(claim("gain"), probability, [], [])]
    found = verdict.Verdict("named", causes, [], None, [], Told({}))
    text = experiment._why(found, "jumps", ("gain_error", "backlash"), separation)
    assert text.startswith("Jumps: the predictions of gain error and backlash differ")
    assert text.endswith(said)
    alike = causes[0]._replace(equivalent=["payload"])
    text = experiment._why(found._replace(causes=[alike]), "jumps", ("a", "b"), 9.0)
    assert text.endswith("the most of all safe motions.")


def test_the_next_experiment_is_about_the_least_sure_cause():
    lag, delay, gain = (claim(name) for name in ("lag", "delay", "gain"))
    sure = verdict.Cause(lag, 1.0, [(delay, 0.0)], [])
    doubtful = verdict.Cause(gain, 0.7, [(lag, 0.2), (delay, 0.1)], [])
    told = verdict.Verdict("ambiguous", [sure, doubtful], [], None, [], Told({}))
    assert experiment.leading(told) == [gain, delay]  # lag is there anyway


@pytest.mark.parametrize(("gain", "expected"), [(95.0, ["delay"]), (40.0, [])])
def test_an_alias_that_the_logs_tell_apart_is_not_listed(gain, expected):
    best = claim("command_delay")
    alias = claim("measurement_delay", gain)
    judge = Told({})
    cause = weighing.weighed(judge, best, [best, alias])
    assert cause.equivalent == [f"measurement_{name}" for name in expected]
    assert cause.probability == pytest.approx(1.0)
