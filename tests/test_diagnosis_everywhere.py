"""A robot that is wrong in several ways at all joints: they are found together."""

from types import SimpleNamespace

import numpy as np
import pytest

from gatjax.data.recording import write_recording
from gatjax.diagnosis import agreed, bank, everywhere, proposed, stepwise
from gatjax.diagnosis.agreed import CHANCE
from gatjax.diagnosis.borrowing import borrowed
from gatjax.diagnosis.case import held, prepare
from gatjax.diagnosis.claims import SHARED, WHOLE, Claim
from gatjax.diagnosis.fit import Fit, put_together, start
from gatjax.diagnosis.given import Logs, given
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.option import Option
from gatjax.diagnosis.proposed import current
from gatjax.diagnosis.start import Start
from gatjax.diagnosis.tolerances import USUAL
from gatjax.diagnosis.verdict import _everywhere as whole
from gatjax.diagnosis.verdict import conclude
from gatjax.effects import catalogue as causes
from gatjax.surrogate.hidden import design, rigid
from gatjax.surrogate.hidden.catalogue import CATALOGUE
from gatjax.surrogate.hidden.measure import Channels, log_of, recording
from gatjax.surrogate.hidden.numbers import Specimen, draw
from gatjax.surrogate.hidden.robots import robot
from gatjax.surrogate.hidden.targets import Lane

DELAY, STRAIN = 0.03, 0.03  # s; rad, error of a servo that balances the friction
LEG = robot("leg_six")
ODD, OFFSET = 2, 0.07  # joint; rad
FRICTION = STRAIN * LEG.model.actuator_gainprm[:, 0]  # N m


def late(specimen):
    every = list(range(len(LEG.joints)))
    return CATALOGUE["command_delay"].apply(specimen, LEG, every, DELAY, {})


def rubbing(specimen):
    for joint, torque in enumerate(FRICTION):
        specimen = CATALOGUE["coulomb_friction"].apply(
            specimen, LEG, [joint], torque, {}
        )
    return specimen


def crooked(specimen):
    """An encoder at one joint that is off by more than everything else does."""
    more = {"in_loop": False}
    return CATALOGUE["encoder_offset"].apply(specimen, LEG, [ODD], OFFSET, more)


def geared(cause, size):
    """What gives every joint of a leg a gear, and its motor little torque."""

    def both(specimen):
        limits = LEG.model.actuator_forcerange[:, 1]
        for joint, limit in enumerate(limits):
            weak = CATALOGUE["torque_limit"].apply
            specimen = weak(specimen, LEG, [joint], 0.16 * limit, {})
            specimen = CATALOGUE[cause].apply(specimen, LEG, [joint], size, {})
        return specimen

    return both


def judged(folder, *effects):
    """The judge of a leg with effects at all of its joints; one log of some 12 s."""
    specimen = Specimen(draw(LEG, np.random.default_rng(8)))
    for effect in effects:
        specimen = effect(specimen)
    lane = Lane(specimen, design._log(LEG, "rich", 50.0, 0.0004, (8, 0, 0)))
    (history,) = rigid.simulate(LEG, [lane])
    log = recording(LEG, [log_of(LEG, lane, history, Channels())], 50.0)
    (folder / "leg.xml").write_text(LEG.xml)
    write_recording(folder / "fit.parquet", log)
    data = given(Start(str(folder / "leg.xml")), Logs([log], []), 0)
    base = held(data.model, data.logs, 0, USUAL, data.start.joints(data.model))

    def tell(stage, share):
        assert 0.0 <= share <= 1.0

    return Judge(prepare(base, data.logs, tell), tell)


def places(verdict):
    where = {}
    for cause in verdict.causes:
        where.setdefault(cause.claim.hypothesis.cause, []).extend(cause.claim.where)
    return where


def what_is_wrong_at_one_joint_is_named_there(verdict):
    assert places(verdict)["encoder_offset"] == [ODD]
    (cause,) = (
        c for c in verdict.causes if c.claim.hypothesis.cause == "encoder_offset"
    )
    values = cause.claim.hypothesis.values(verdict.judge.joints[ODD], cause.claim.own)
    assert values["offset"] == pytest.approx(OFFSET, abs=0.02)  # beside its tolerance


def both_causes_are_named_at_all_joints(verdict):
    where = places(verdict)
    del where["encoder_offset"]
    every = list(range(len(LEG.joints)))
    assert where.keys() <= {"command_delay", "measurement_delay", "coulomb_friction"}
    assert len(where) == 2 and all(sorted(each) == every for each in where.values())
    assert verdict.verdict == "named" and not verdict.unexplained
    assert all(cause.probability > 0.9 for cause in verdict.causes)


def a_value_that_suits_all_joints_is_one_value(verdict):
    (cause,) = (
        c for c in verdict.causes if c.claim.hypothesis.cause.endswith("_delay")
    )
    (delay,) = cause.claim.hypothesis.values(
        verdict.judge.joints[0], cause.claim.own
    ).values()
    assert delay == pytest.approx(DELAY, abs=0.003)
    assert cause.claim.gain > 100.0


def values_that_differ_are_told_for_each_joint(verdict):
    found = {}
    for cause in verdict.causes:
        claim = cause.claim
        if claim.hypothesis.cause == "coulomb_friction":
            for k in claim.where:
                values = claim.hypothesis.values(verdict.judge.joints[k], claim.own)
                found[k] = values["torque"]
    shares = np.array([found[k] for k in sorted(found)]) / FRICTION
    assert np.abs(shares - 1.0).max() < 0.35  # beside the tolerance of its own friction


def the_joints_are_explained_to_near_the_noise(verdict):
    judge = verdict.judge
    for joint, fit, before in zip(
        judge.joints, judge.known, judge.case.healthy, strict=True
    ):
        assert fit.rms() < 3.0 * joint.noise < 0.3 * before.rms()


def test_a_leg_that_is_late_rubs_and_has_a_crooked_encoder_is_told_all_of_it(tmp_path):
    """One test: its diagnosis takes minutes, which each worker would spend again."""
    verdict = conclude(judged(tmp_path, late, rubbing, crooked))
    what_is_wrong_at_one_joint_is_named_there(verdict)
    both_causes_are_named_at_all_joints(verdict)
    a_value_that_suits_all_joints_is_one_value(verdict)
    values_that_differ_are_told_for_each_joint(verdict)
    the_joints_are_explained_to_near_the_noise(verdict)


@pytest.mark.parametrize(
    ("wrong", "count", "odd"),
    [([3], 6, {3}), ([3, 4], 6, set()), ([3, 4], 12, {3, 4}), ([3], 4, set())],
)
def test_few_joints_that_are_still_wrong_are_odd(monkeypatch, wrong, count, odd):
    monkeypatch.setattr(everywhere, "_left", lambda judge, known: wrong)
    assert everywhere.odd_ones(object.__new__(Judge), [fit("")] * count) == odd


def test_an_odd_joint_has_the_value_of_the_others_and_no_say(tmp_path):
    judge = judged(tmp_path, late)
    every = tuple(range(len(judge.joints)))
    law = next(h for h in bank.CAUSES if h.cause == "command_delay")
    low, high = np.array(law.low), np.array(law.high)
    theirs, own = 0.7 * low + 0.3 * high, 0.1 * low + 0.9 * high
    free = []
    for k in every:
        parts = [(law, own if k == ODD else theirs)]
        free += start(judge.joints[k], [put_together(np.zeros(COUNT), parts)])
    for groups in ([every], [(k,) for k in every]):
        _, claims, known = agreed._divided(judge, free, free, 0, groups, {ODD})
        for claim in claims:
            assert claim.own == pytest.approx(theirs)
        assert len(known) == len(every)
    _, (claim,), _ = agreed._divided(judge, free, free, 0, [every], set())
    assert claim.own != pytest.approx(theirs, rel=1e-3)


def test_what_one_cause_may_explain_is_left_to_the_usual_way(tmp_path):
    assert everywhere.causes(judged(tmp_path, late)) == []


def fit(words):
    """A fit of some causes; only their names matter."""
    law = Hypothesis("", words, lambda *_: None, (), (), (), (), lambda *_: {})
    none = np.zeros(0)
    return Fit(law, none, 0.0, none, np.zeros((0, 0)), np.zeros((0, 0)), 1.0, True)


def option(cause, gain, after=""):
    law = Hypothesis(cause, "", lambda *_: None, (), (), (), (), lambda *_: {})
    return Option(law, {0: gain}, {0: fit(after)}, gain)


class Story:
    """One joint whose evidence is told for every set of causes, as for "lag delay"."""

    def __init__(self, monkeypatch, nats, ranked):
        nats = {"": 0.0} | nats
        self.nats, self.ranked = nats, ranked

        def words(known):
            return known[0].hypothesis.variant

        def without(judge, known, cause):
            return {0: fit(" ".join(c for c in words(known).split() if c != cause))}

        def scored(judge, option, known, base):
            gain = nats[words(known)] - nats[words(base)]
            return option._replace(gains={0: gain}, gain=gain)

        self.words = words
        for name, function in {
            "refitted": without, "scored": scored,
            "ranked": lambda judge, known, beside: ranked.get(words(known), []),
        }.items():  # fmt: skip
            monkeypatch.setattr(stepwise, name, function)
        told = lambda joints, known: nats[words(known)]  # noqa: E731
        for name in ("retried", "followed"):
            monkeypatch.setattr(stepwise, name, lambda judge, known: known)
        monkeypatch.setattr(stepwise.sharing, "nats", told)
        monkeypatch.setattr(Judge, "joints", [], raising=False)
        self.shares = []
        tell = lambda judge, stage, share: self.shares.append(share)  # noqa: E731
        monkeypatch.setattr(Judge, "tell", tell, raising=False)

    def improved(self, *found):
        """The causes that are left, each with what was weighed in its place."""
        known = {0: fit(" ".join(cause for cause, _ in found))}
        start = [[option(cause, gain)] for cause, gain in found]
        left, known = stepwise._improved(object.__new__(Judge), start, known)
        assert all(0.0 <= share < 1.0 for share in self.shares)
        rows = [[each.hypothesis.cause for each in rows] for rows in left]
        return rows, self.words(known)


def test_a_cause_gives_way_to_one_that_explains_more_beside_the_others(monkeypatch):
    nats = {"gain delay": 300.0, "delay": 100.0, "delay rub": 400.0, "rub": 50.0}
    ranked = {"delay": [option("rub", 300.0, "delay rub"), option("gain", 200.0)]}
    story = Story(monkeypatch, nats, ranked)
    causes, known = story.improved(("gain", 200.0), ("delay", 100.0))
    assert causes == [["rub", "gain"], ["delay"]] and known == "delay rub"


def test_the_newest_cause_is_looked_for_again_after_an_exchange(monkeypatch):
    nats = {"gain delay": 500.0, "delay": 100.0, "delay rub": 900.0, "rub": 400.0}
    nats |= {"rub lag": 940.0, "lag": 150.0}
    ranked = {
        "delay": [option("rub", 800.0, "delay rub")],
        "rub": [option("lag", 540.0, "rub lag"), option("delay", 500.0, "delay rub")],
    }
    story = Story(monkeypatch, nats, ranked)
    causes, known = story.improved(("gain", 400.0), ("delay", 100.0))
    assert [first for first, *_ in causes] == ["rub", "lag"] and known == "rub lag"


def test_another_takes_the_place_of_a_cause_of_few_joints(monkeypatch):
    nats = {"spot delay": 900.0, "delay": 400.0, "delay rub": 700.0, "rub": 100.0}
    story = Story(monkeypatch, nats, {"delay": [option("rub", 300.0, "delay rub")]})
    seen = Option.common
    spot = lambda mine, joints: mine.hypothesis.cause != "spot" and seen(mine, joints)  # noqa: E731
    monkeypatch.setattr(Option, "common", spot)
    causes, known = story.improved(("spot", 500.0), ("delay", 400.0))
    assert causes == [["rub"], ["delay"]] and known == "delay rub"


def test_a_cause_stays_where_no_other_one_explains_more(monkeypatch):
    nats = {"gain delay": 300.0, "delay": 100.0, "delay rub": 299.0}
    ranked = {"delay": [option("rub", 199.0, "delay rub"), option("gain", 190.0)]}
    story = Story(monkeypatch, nats, ranked)
    causes, known = story.improved(("gain", 200.0), ("delay", 100.0))
    assert causes == [["gain", "rub"], ["delay"]] and known == "gain delay"


@pytest.mark.parametrize("worth, kept", [(9.0, ["delay"]), (11.0, ["lag", "delay"])])
def test_a_cause_that_is_worth_nothing_any_more_is_dropped(monkeypatch, worth, kept):
    nats = {"lag delay": 100.0 + worth, "delay": 100.0}
    story = Story(monkeypatch, nats, {})
    causes, _ = story.improved(("lag", 80.0), ("delay", 60.0))
    assert [first for first, *_ in causes] == kept


@pytest.mark.parametrize("cause, size", [("backlash", 0.02), ("joint_elasticity", 8.0)])
def test_a_spring_gives_way_to_a_gap_that_explains_more(
    tmp_path, monkeypatch, cause, size
):
    judge = judged(tmp_path, geared(cause, size))
    sides = "encoder on motor", "encoder and kv on link"
    laws = {law.cause: law for law in bank.CAUSES if law.variant not in sides}
    weak, spring = laws["torque_limit"], laws["joint_elasticity"]

    def one(index):
        places = [judge.known[index].x, np.zeros(COUNT)]
        sets = [
            [(weak, np.array(own)), (spring, np.array(soft))]
            for own in weak.starts for soft in spring.starts
        ]  # fmt: skip
        return borrowed(judge.joints[index], places, [sets])[0]

    known = {k: one(k) for k in (1, 2, 4)}
    found = [[current(Option(law, {}, {}), known)] for law in (weak, spring)]
    exchanged = []

    def improved(judge, found, known):
        exchanged.append([first.hypothesis.cause for first, *_ in found])
        return stepwise.Partial(found, known)

    monkeypatch.setattr(stepwise, "_improved", improved)
    before = stepwise.Partial(found, known)
    after = stepwise.regeared(judge, before)
    assert exchanged == [["torque_limit", "backlash"]]
    assert [first.hypothesis.cause for first, *_ in after.found] == [
        "torque_limit", cause
    ]  # fmt: skip
    if cause == "joint_elasticity":
        assert after is before
    else:
        (gap,) = after.found[-1]
        width = gap.hypothesis.values(judge.joints[1], gap.own)["width"]
        assert width == pytest.approx(size, rel=0.2)
        assert stepwise.regeared(judge, after) is after
    assumed = judge.joints[3].assumed._replace(barred=frozenset({"backlash"}))
    judge.joints[3] = judge.joints[3]._replace(assumed=assumed)
    assert stepwise.regeared(judge, before) is before
    assert len(exchanged) == 1


@pytest.mark.parametrize("third, expected", [
    (60.0, ["limit", "lag"]), (200.0, ["gain", "rub", "delay"])
])  # fmt: skip
def test_it_begins_with_the_causes_that_explain_most_together(
    monkeypatch, third, expected
):
    nats = {"gain": 200.0, "limit": 190.0, "gain rub": 420.0, "limit lag": 500.0}
    nats |= {"lag": 150.0, "rub": 120.0, "rub delay": 220.0, "gain delay": 280.0}
    nats["gain rub delay"] = 420.0 + third
    firsts = [option("gain", 200.0, "gain"), option("limit", 190.0, "limit")]
    firsts.append(option("sag", 90.0, "sag"))  # too far behind to be asked for more
    ranked = {
        "gain": [option("rub", 220.0, "gain rub")],
        "limit": [option("lag", 310.0, "limit lag")],
        "gain rub": [option("delay", third, "gain rub delay")],
        "sag": [option("lag", 900.0, "sag lag")],
    }
    nats["sag lag"] = 990.0
    story, judge = (
        Story(monkeypatch, nats | {"sag": 90.0}, ranked),
        object.__new__(Judge),
    )
    judge.case = None
    found, known = stepwise.begun(judge, firsts, {0: fit("")})
    assert [each[0].hypothesis.cause for each in found] == expected
    assert story.words(known) == " ".join(expected)


@pytest.mark.parametrize("together, expected", [
    (970.0, ["dead", "load"]), (1050.0, ["dead", "rub", "load"])
])  # fmt: skip
def test_of_causes_that_are_near_each_other_the_next_one_decides(
    monkeypatch, together, expected
):
    nats = {"dead": 900.0, "dead load": 980.0, "dead rub": 960.0, "dead sag": 930.0}
    nats |= {"dead rub load": together, "dead sag load": 2000.0}
    nats |= {"load": 10.0, "rub": 10.0, "rub load": 20.0}
    options = [option("load", 80.0, "dead load"), option("rub", 60.0, "dead rub")]
    options.append(option("sag", 30.0, "dead sag"))  # too far behind
    ranked = {
        "dead rub": [option("load", together - 960.0, "dead rub load")],
        "dead sag": [option("load", 1070.0, "dead sag load")],
    }
    story = Story(monkeypatch, nats, ranked)
    before = stepwise.Partial([[option("dead", 900.0)]], {0: fit("dead")})
    found, known = stepwise.added(object.__new__(Judge), before, options)
    assert [each[0].hypothesis.cause for each in found] == expected
    assert story.words(known) == " ".join(expected)


def test_there_are_never_more_causes_than_a_robot_may_have(monkeypatch):
    names = ["gain", "lag", "dead", "limit", "delay"]
    nats = {" ".join(names): 900.0, " ".join([*names, "rub"]): 990.0}
    nats |= {" ".join([*names, "load"]): 980.0, " ".join([*names, "load", "rub"]): 2e3}
    nats |= {" ".join(n for n in [*names, "rub"] if n != own): 0.0 for own in names}
    known = " ".join(names)
    options = [option(name, 90.0, f"{known} {name}") for name in ("rub", "load")]
    ranked = {f"{known} load": [option("rub", 1e3, f"{known} load rub")]}
    story = Story(monkeypatch, nats, ranked)
    before = [[option(name, 100.0)] for name in names]
    before = stepwise.Partial(before, {0: fit(known)})
    found, _ = stepwise.added(object.__new__(Judge), before, options)
    assert len(found) == stepwise.MOST and max(story.shares) < 1.0


@pytest.mark.parametrize("worth, expected", [(9.0, ["dead"]), (11.0, ["dead", "rub"])])
def test_nothing_is_added_that_all_causes_together_make_little_of(
    monkeypatch, worth, expected
):
    nats = {"dead": 900.0, "rub": 10.0, "dead rub": 900.0 + worth}
    story = Story(monkeypatch, nats, {})
    before = stepwise.Partial([[option("dead", 900.0)]], {0: fit("dead")})
    options = [option("rub", 60.0, "dead rub")]  # without the joint that it helps most
    found, known = stepwise.added(object.__new__(Judge), before, options)
    assert [each[0].hypothesis.cause for each in found] == expected
    assert story.words(known) == " ".join(expected)


def test_starts_are_compared_on_the_loads_of_the_best_one(monkeypatch):
    judge = object.__new__(Judge)
    judge.case = "measured"

    def follow(judge, known):
        judge.case = "along " + known[0].hypothesis.variant
        return {0: fit("followed")}

    monkeypatch.setattr(stepwise, "followed", follow)
    again = lambda judge, known: {0: fit(known[0].hypothesis.variant + " again")}  # noqa: E731
    monkeypatch.setattr(stepwise, "refitted", again)
    starts = [stepwise.Partial([], {0: fit(name)}) for name in ("lag", "rub")]
    starts, known = stepwise._followed(judge, starts, {0: fit("none")})
    fits = [*(start.known for start in starts), known]
    names = [each[0].hypothesis.variant for each in fits]
    assert judge.case == "along lag" and names == [
        "followed",
        "rub again",
        "none again",
    ]
    monkeypatch.setattr(stepwise, "followed", lambda judge, known: known)  # no better
    assert stepwise._followed(judge, starts, known) == (starts, known)


def test_the_best_start_is_kept_where_all_explain_less(monkeypatch):
    Story(monkeypatch, {"lag": -40.0, "rub": -30.0}, {})
    starts = [
        stepwise.Partial([[option(name, 20.0)]], {0: fit(name)})
        for name in ("lag", "rub")
    ]
    kept = stepwise._nearest(object.__new__(Judge), starts, {0: fit("")})
    assert [each.found[0][0].hypothesis.cause for each in kept] == ["rub"]


@pytest.mark.parametrize(
    "left, beside, taken",
    [
        ([], True, []),
        ([5], False, ["lag"]),  # something else is wrong there
        ([5], True, ["lag", "rub"]),  # worth it beside what tolerances imitate of it
        ([4, 5], True, ["lag", "rub"]),
        ([4, 5], False, ["lag"]),
        ([3, 4, 5], False, []),
    ],
)
def test_one_cause_is_taken_where_little_is_wrong_besides(
    monkeypatch, left, beside, taken
):
    judge = object.__new__(Judge)
    judge.most, judge.joints, judge.tell = 3, [None] * 6, lambda *_: None
    judge.case = None
    judge.known = [fit("")] * 6
    lag, rub = (
        option(cause, 300.0)._replace(fits={k: fit(cause) for k in range(6)})
        for cause in ("lag", "rub")
    )
    ranked = {(): [lag], ("lag",): [rub] if beside else []}

    def rank(judge, known, beside):
        return ranked.get(tuple(each.hypothesis.cause for each in beside), [])

    for module in (everywhere, stepwise):
        monkeypatch.setattr(module, "ranked", rank)
        monkeypatch.setattr(module, "followed", lambda judge, known: known)
    same = lambda judge, found, known: stepwise.Partial(found, known)  # noqa: E731
    monkeypatch.setattr(stepwise, "_improved", same)
    monkeypatch.setattr(stepwise, "retried", lambda judge, known: known)
    worth = {"": 0.0, "lag": 300.0, "rub": 600.0}
    nats = lambda joints, known: worth[known[0].hypothesis.variant]  # noqa: E731
    monkeypatch.setattr(stepwise.sharing, "nats", nats)
    monkeypatch.setattr(everywhere, "_probes", lambda judge, wrong: wrong)
    monkeypatch.setattr(everywhere, "current", lambda option, known: option)
    wrong = lambda judge, known: left if known[0] is lag.fits[0] else [*known]  # noqa: E731
    monkeypatch.setattr(everywhere, "_left", wrong)
    found = everywhere.causes(judge)
    assert [first.hypothesis.cause for first, *_ in found] == taken


@pytest.mark.parametrize(
    "gap, looked", [(True, ["spring", "gap"]), (False, ["spring"])]
)
def test_more_is_looked_for_beside_a_gap_in_a_springs_place(monkeypatch, gap, looked):
    judge = object.__new__(Judge)
    judge.most, judge.joints, judge.tell = 3, [None] * 6, lambda *_: None
    judge.known = [fit("")] * 6
    every = {k: fit("lag") for k in range(6)}
    spring, lag, other = (
        option(cause, 300.0)._replace(fits=every) for cause in ("spring", "lag", "gap")
    )
    before = stepwise.Partial([[spring], [lag]], every)
    after = stepwise.Partial([[other], [lag]], every) if gap else before
    seen = []

    def more(judge, partial):
        seen.append(partial.found[0][0].hypothesis.cause)
        return partial

    for name, function in {
        "ranked": lambda judge, known, beside: [spring],
        "begun": lambda judge, firsts, known: before,
        "regeared": lambda judge, before: after,
        "_more": more,
        "_probes": lambda judge, wrong: wrong,
        "_left": lambda judge, known: [*known],
        "current": lambda option, known: option,
    }.items():
        monkeypatch.setattr(everywhere, name, function)
    found = everywhere.causes(judge)
    assert seen == looked
    assert [first.hypothesis.cause for first, *_ in found] == [looked[-1], "lag"]


@pytest.mark.parametrize("together, kept", [(9.0, []), (11.0, ["command_delay"])])
def test_a_cause_that_joints_want_otherwise_is_none_of_the_robot(
    monkeypatch, tmp_path, together, kept
):
    judge = judged(tmp_path)
    law = next(h for h in bank.CAUSES if h.cause == "command_delay")

    def proposals(joint, known, allowed):
        parts = [(law, np.array(law.low))]
        return start(joint, [put_together(np.zeros(COUNT), parts)])

    healthy = fit("")
    monkeypatch.setattr(proposed.search, "proposals", proposals)
    alone = lambda joint, fit: 0.0 if fit is healthy else 500.0  # noqa: E731
    monkeypatch.setattr(proposed.sharing, "alone", alone)
    monkeypatch.setattr(proposed, "spread", lambda *_: None)
    monkeypatch.setattr(proposed.sharing, "gained", lambda *_: together)
    known = dict.fromkeys(range(6), healthy)
    found = proposed.ranked(judge, known, [])
    assert [option.hypothesis.cause for option in found] == kept


@pytest.mark.parametrize("together, kept", [(9.0, ["delay"]), (11.0, ["lag", "delay"])])
def test_a_cause_that_joints_want_otherwise_now_is_dropped(monkeypatch, together, kept):
    story = Story(monkeypatch, {"lag delay": 600.0, "delay": 100.0}, {})
    scored = stepwise.scored

    def weighed(judge, mine, known, base):
        gain = {"lag": together}.get(mine.hypothesis.cause, 90.0)
        return scored(judge, mine, known, base)._replace(gain=gain)

    monkeypatch.setattr(stepwise, "scored", weighed)
    causes, _ = story.improved(("lag", 80.0), ("delay", 60.0))
    assert [first for first, *_ in causes] == kept


def test_a_cause_is_of_the_robot_only_if_it_is_worth_it_at_most_joints():
    few = option("stiction", 0.0)._replace(gains={0: 500.0, 1: -1.0, 2: -1.0})
    assert not few.common(3)
    assert few._replace(gains={0: 1.0, 1: 1.0}).common(3)


class Taken(Exception):
    """A whole robot's causes are taken for known."""


@pytest.mark.parametrize(
    ("cause", "sizes", "agree"),
    [
        ("command_delay", [0.03, 0.033, 0.034, 0.036, 0.031, 0.08], True),  # one is odd
        ("command_delay", [0.03, 0.033, 0.034, 0.036, 0.031, 0.03, 0.08, 0.1], True),
        ("command_delay", [0.01, 0.033, 0.05, 0.036, 0.02, 0.08], False),
        ("command_delay", [0.03, 0.033, 0.034], False),  # alike by chance
        ("gain_error", [0.5, 0.52, 0.48, 0.5, 0.55, 0.45], True),
        ("gain_error", [0.8, 0.9, 1.1, 1.2, 0.95, 1.05], False),  # not even the sign
        ("torque_limit", [2.0, 2.1, 1.9, 2.2, 1.8, 2.0], True),
    ],
)
def test_joints_agree_on_values_that_are_alike(cause, sizes, agree):
    law = next(h for h in bank.CAUSES if h.cause == cause)
    main = causes.CATALOGUE[cause].main.name
    law = law._replace(values=lambda joint, own: {main: float(own[0])})
    judge = object.__new__(Judge)
    judge.joints = [None] * len(sizes)
    claims = [
        Claim(law, np.array([size]), (k,), {}, 90.0) for k, size in enumerate(sizes)
    ]
    assert agreed.common(judge, claims) is agree


def test_joints_agree_on_one_share_of_what_each_motor_has():
    law = next(h for h in bank.CAUSES if h.cause == "torque_limit")
    law = law._replace(values=lambda limit, own: {"limit": limit * float(own[0])})
    judge = object.__new__(Judge)
    judge.joints = [1.0, 2.0, 3.0, 0.5, 0.2, 8.0]

    def agree(*shares):
        pairs = enumerate(shares)
        each = [Claim(law, np.array([own]), (k,), {}, 90.0) for k, own in pairs]
        return agreed.common(judge, each)

    assert agree(0.3, 0.31, 0.33, 0.28, 0.3, 0.3)
    assert agree(*(0.1 / limit for limit in judge.joints))  # 0.1 N m at all
    assert not agree(0.3, 0.1, 0.6, 0.9, 0.3, 0.2)


@pytest.mark.parametrize(
    ("gains", "seen", "weak"),
    [
        ({(0, 1, 2, 3, 4, 5): 11.0}, 3.0, False),  # one value for all
        ({(0, 1, 2, 3, 4, 5): 9.0}, 3.0, True),
        ({(0, 1, 2, 3, 4, 5): 11.0}, 0.4, True),  # not to be seen
        ({(0, 1, 2): 90.0, (3, 4, 5): 9.0}, 3.0, True),  # at half of them only
        ({(0, 1, 2): 11.0, (3,): 11.0, (4, 5): -5.0}, 3.0, True),  # nor at two thirds
        ({(0, 1, 2): 11.0, (3, 4): 11.0, (5,): -5.0}, 3.0, False),
        ({(k,): 9.0 for k in range(6)}, 3.0, True),  # quite something together
        ({(k,): 35.0 if k < 3 else 8.0 for k in range(6)}, 3.0, True),
    ],
)
def test_values_are_worth_it_at_most_joints_or_the_cause_is_dropped(
    monkeypatch, gains, seen, weak
):
    judge = object.__new__(Judge)
    judge.joints = [None] * 6
    monkeypatch.setattr(Judge, "visibility", lambda judge, claim: seen)
    law = option("stiction", 0.0).hypothesis
    claims = [Claim(law, np.zeros(1), w, {}, gain) for w, gain in gains.items()]
    assert agreed._weak(judge, claims, set()) is weak


def test_what_is_worth_least_is_left_out_first(monkeypatch):
    def weighed(judge, options):
        """What imitates the delay takes most of its worth."""
        names = [each.hypothesis.cause for each in options]
        worth = {"lag": 5.0, "delay": 8.0 if "lag" in names else 900.0}
        claims = [
            [Claim(each.hypothesis, np.zeros(1), (0,), {}, worth[name])]
            for each, name in zip(options, names, strict=True)
        ]
        return claims, fits, set()

    fits, weak = [fit("")], lambda judge, claims, odd: claims[0].gain < 10.0
    monkeypatch.setattr(agreed, "_agreed", weighed)
    monkeypatch.setattr(agreed, "_weak", weak)
    found = [[option("delay", 9.0)], [option("lag", 9.0)]]
    left, known = agreed.valued(object.__new__(Judge), found)
    assert [each.options[0].hypothesis.cause for each in left] == ["delay"]
    assert known is fits


def test_values_found_again_keep_every_cause_and_what_else_it_could_be(monkeypatch):
    def weighed(judge, options):
        claims = [
            [Claim(each.hypothesis, np.ones(1), (0,), {}, 0.0)] for each in options
        ]
        return claims, drawn, set()

    drawn = [fit("drawn")]
    monkeypatch.setattr(agreed, "_agreed", weighed)
    rows = [[option("delay", 9.0), option("lag", 8.0)], [option("gap", 7.0)]]
    found = [agreed.Valued(options, []) for options in rows]
    again, known = agreed.revalued(object.__new__(Judge), found)
    assert [each.options for each in again] == rows and known is drawn
    assert [claim.own[0] for each in again for claim in each.claims] == [1.0, 1.0]


def test_joints_that_are_odd_have_no_say_in_what_a_cause_is_worth(monkeypatch):
    judge = object.__new__(Judge)
    judge.joints = [None] * 6
    monkeypatch.setattr(Judge, "visibility", lambda judge, claim: 3.0)
    law = option("stiction", 0.0).hypothesis
    claims = [
        Claim(law, np.zeros(1), (k,), {}, 11.0 if k < 4 else 0.0) for k in range(6)
    ]
    assert not agreed._weak(judge, claims, {5})
    assert agreed._weak(judge, claims, {0})


def test_every_cause_that_joints_share_has_a_size_to_compare(tmp_path):
    judge = judged(tmp_path)
    judge.joints = [judge.joints[0]] * CHANCE
    for law in bank.CAUSES:
        if law.cause not in SHARED or law.cause in WHOLE:
            continue
        own = 0.3 * np.array(law.low) + 0.7 * np.array(law.high)
        claims = [Claim(law, own, (k,), {}, 90.0) for k in range(CHANCE)]
        claims[0] = claims[0]._replace(own=np.array(law.low))
        assert agreed.common(judge, claims), law.law


def test_joints_that_agree_on_no_value_have_no_cause_in_common(monkeypatch):
    def take(claims, known):
        taken.extend(known)
        raise Taken

    taken = []
    judge = object.__new__(Judge)
    judge.joints, judge.take = [None] * 3, take
    judge.case, followed = "measured", object.__new__(Judge)
    followed.case, followed.joints = "followed", [0, 1, 2]
    monkeypatch.setattr(Judge, "fork", lambda judge: followed)
    lag = option("lag", 300.0).hypothesis
    own = [Claim(lag, np.zeros(1), (k,), {}, 90.0) for k in range(3)]
    shared = [Claim(lag, np.zeros(1), (0, 1, 2), {}, 90.0)]
    monkeypatch.setattr(everywhere, "causes", lambda judge: [])
    for claims in ([own, own], [own, shared]):
        found = [agreed.Valued([], each) for each in claims], [fit("")] * 3
        monkeypatch.setattr(agreed, "valued", lambda judge, causes, found=found: found)
        if claims[1] is own:
            assert whole(judge) == [] and judge.case == "measured"
        else:
            for body in (True, False):
                monkeypatch.setattr(agreed, "carried", lambda *_, body=body: body)
                if body:
                    assert whole(judge) == [] and judge.case == "measured"
            again = found[0], [fit("drawn")] * 3
            monkeypatch.setattr(agreed, "revalued", lambda *_, again=again: again)
            for drawn, mine in ((False, found[1]), (True, again[1])):
                followed.bounced = lambda known, drawn=drawn: drawn
                with pytest.raises(Taken):
                    whole(judge)
                assert taken == mine
                taken.clear()
            assert judge.case == "followed"  # the loads that the causes were found on
            assert judge.joints is followed.joints


@pytest.mark.parametrize(("gain", "better"), [(300.0, True), (240.0, False)])
def test_what_most_joints_carry_is_compared_with_causes_of_the_robot(
    monkeypatch, gain, better
):
    payload = Claim(option("payload", 0.0).hypothesis, np.zeros(1), (4,), {}, gain, 4)
    payload = payload._replace(fits=dict.fromkeys(range(5), fit("")))
    asked = []
    judge, looked = object.__new__(Judge), object.__new__(Judge)
    judge.joints, judge.known = ["before"] * 6, [fit("")] * 6
    judge.case = SimpleNamespace(bearers=lambda body: list(range(body + 1)))
    judge.borne = lambda bodies: asked.extend(bodies) or [payload]
    looked.joints = ["after"] * 6
    nats = {"before": -10.0, "after": 50.0}
    monkeypatch.setattr(agreed.fits, "evidence", lambda joint, fit: nats[joint])
    monkeypatch.setattr(agreed, "price", lambda claim, count: 10.0)
    claims = [Claim(payload.hypothesis, np.zeros(1), tuple(range(6)), {}, 0.0)] * 3
    found = agreed.carried(judge, looked, claims, [fit("")] * 6)
    assert found is better  # five joints gain 60 each, three values cost 10 each
    assert asked == [2, 3, 4, 5]  # that half of the joints carry
