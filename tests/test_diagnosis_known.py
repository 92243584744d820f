"""What a judge makes of a claim that it accepts."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_diagnosis_pairs import NOISE, claim, fit
from test_diagnosis_plant import COUNT, LEAD, STEP, joint, wave
from test_diagnosis_sensitivity import logged

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import accepting, drops, known, lost
from gatjax.diagnosis import case as cases
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.accepting import ODD, Accepting
from gatjax.diagnosis.bank import CAUSES
from gatjax.diagnosis.claims import Claim
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT as TOLERANCES
from gatjax.diagnosis.hypotheses import Hypothesis
from gatjax.diagnosis.joint import BOUNCING, GEARS
from gatjax.diagnosis.judge import Judge


class Arm(Accepting):
    """Three joints of NOISE, of which the first carries links 1 and 2."""

    def __init__(self, pulled=(), astray=9.0):
        self.astray = astray  # that joints go, times the noise, if they are let go
        self.joints = [SimpleNamespace(noise=NOISE, carries=None) for _ in range(3)]
        self.case = SimpleNamespace(
            pulled=dict.fromkeys(pulled, 10.0),
            aside={},
            bearers=lambda body: [0, body] if body else [0],
        )
        self.known, self.found, self.accepted = [fit(1.0)] * 3, {}, []

    def altered(self, case):
        carries = self.accepted[-1].body if self.accepted else None
        return [SimpleNamespace(noise=NOISE, carries=carries) for _ in range(3)]

    def _draw(self, rates):
        pulled = {k: rate for k, rate in (self.case.pulled | rates).items() if rate}
        self.case = SimpleNamespace(pulled=pulled, aside={}, bearers=self.case.bearers)
        self.joints = self.altered(self.case)
        free = {k: self.astray for k in rates if k not in pulled}
        self.known = [fit(free.get(k, 1.0)) for k in range(3)]

    def _converged(self, claim):
        return claim  # these joints are not simulated

    def _settled(self, claim, prior):
        return claim

    def _evidence(self, index):
        return 0.0


def test_joints_that_stay_drawn_carry_what_was_accepted(monkeypatch):
    monkeypatch.setattr(accepting, "astray", lambda joint, found: known.ASTRAY)
    monkeypatch.setattr(known, "of_drive", lambda joint, bank: ())
    monkeypatch.setattr(known.search, "explain", lambda joint, one, bank: [one])
    arm = Arm(pulled=[0])
    found = claim("payload", fits={0: fit(1.0), 1: fit(1.0)})._replace(
        body=1, where=(1,)
    )
    arm.accept(found)
    assert arm.case.pulled == {0: 10.0}
    assert [one.carries for one in arm.joints] == [1, 1, 1]


@pytest.mark.parametrize(("left", "drawn"), [(9.0, {0: 10.0}), (2.0, {})])
def test_a_joint_without_a_cause_is_let_go_if_it_can_be_followed(left, drawn):
    arm = Arm(pulled=[0], astray=left)
    arm.accept(claim("gain_error", fits={1: fit(1.0)}))
    assert arm.case.pulled == drawn


@pytest.mark.parametrize(
    ("left", "drawn"), [((9.0, 9.0, 30.0), [0, 1]), ((1.0, 1.0, 9.0), [])]
)
def test_gaps_that_nobody_can_follow_are_drawn_but_for_an_odd_one(
    monkeypatch, left, drawn
):
    for gap in (True, False):
        monkeypatch.setattr(accepting, "parted", lambda joint, found, gap=gap: gap)
        arm = Arm()
        assert arm.bounced([fit(rms) for rms in left]) is bool(gap and drawn)
        assert arm.case.pulled == (dict.fromkeys(drawn, BOUNCING) if gap else {})


def test_joints_that_a_whole_robots_causes_explain_are_not_searched_any_further(
    monkeypatch,
):
    """Twice the noise is left where one joint carries something else besides."""
    monkeypatch.setattr(Arm, "_weigh", lambda arm: None)
    arm = Arm()
    whole = [fit(x) for x in (1.0, 1.6, 2.0)]
    arm.take([claim("gain_error", fits={0: fit(1.0)})], whole)
    assert arm.found == {0: [], 1: []}


def test_an_accepted_cause_of_one_joint_has_the_size_at_which_its_fit_rests():
    (cause,) = (h for h in CAUSES if h.cause == "command_delay")
    own = np.log([0.03])  # s
    one = logged(cause, own)
    far = np.append(np.zeros(TOLERANCES), own - 1.0)
    begun = fits.start(one, [(cause, far)])
    (early,) = fits.improve(one, begun, 1)
    arm = Arm()
    arm.joints, arm.known = [one], [early]
    hurried = Claim(cause, early.x[-1:], (0,), {0: early}, 10.0)
    drawn = Arm(pulled=[0])
    drawn.joints, drawn.known = [one], [early]
    assert Accepting._converged(drawn, hurried) is hurried
    rested = Accepting._converged(arm, hurried)
    assert rested.fits[0].settled and not early.settled
    assert rested.own == pytest.approx(own, abs=0.05)
    assert abs(early.x[-1] - own[0]) > 0.1
    more = fits.evidence(one, rested.fits[0]) - fits.evidence(one, early)
    assert more > 0.0 and rested.gain == pytest.approx(10.0 + more)
    several = hurried._replace(fits={0: early, 1: early}, where=(0, 1))
    assert Accepting._converged(arm, several) is several


def test_all_joints_that_carry_a_link_bear_what_it_carries():
    whole = Arm().carried(claim("payload", fits={1: fit(1.0)}))
    assert (whole.body, whole.where, sorted(whole.fits)) == (1, (1,), [0, 1])
    first = claim("payload", fits={0: fit(1.0)})
    assert Arm().carried(first) is first
    other = claim("gain_error", fits={1: fit(1.0)})
    assert Arm().carried(other) is other


@pytest.mark.parametrize(
    ("left", "odd"),
    [((1.0, 2.0, 9.0), 2), ((1.0, 9.0, 6.0), None), ((1.0, 1.0, 3.0), None)],
)
def test_a_joint_with_a_cause_of_its_own_has_no_say(left, odd):
    assert ODD == pytest.approx(2.0)
    found = {k: fit(rms) for k, rms in enumerate(left)}
    assert Arm()._odd(found) == odd
    assert Arm()._odd({k: found[k] for k in (0, 2)}) is None


def test_the_others_agree_without_a_joint_that_is_odd(monkeypatch):
    heard = []
    monkeypatch.setattr(accepting, "combined", lambda first, newest: newest)
    monkeypatch.setattr(known.fits, "start", lambda joint, points: [fit(1.0)])
    monkeypatch.setattr(known.fits, "improve", lambda joint, found, rounds: found)
    monkeypatch.setattr(accepting, "uncertainty", lambda found, count: None)
    agreed = lambda found, count: heard.append(len(found)) or np.zeros(1)  # noqa: E731
    monkeypatch.setattr(accepting, "shared_value", agreed)
    many = claim("gain_error", fits={k: fit(1.0) for k in range(3)})
    many = many._replace(hypothesis=many.hypothesis._replace(low=(-1.0,), high=(1.0,)))
    settled = Arm()._agreed(many, [fit(1.0)] * 3, 2)
    Arm()._agreed(many, [fit(1.0)] * 3, None)
    assert heard == [2, 3] and sorted(settled.fits) == [0, 1, 2]


def test_a_fit_that_leads_far_astray_does_not_make_the_motion(monkeypatch):
    grid = (np.arange(COUNT) - LEAD) * STEP
    monkeypatch.setattr(cases.motions, "grid_time", lambda runs, step, lead: grid)
    plain = joint(wave)
    stamps = plain.time[0]
    run = JointRun(0, stamps, 0.0 * stamps[:, None], 0.0 * stamps[:, None])
    point = None, np.zeros(TOLERANCES)
    wrong = fits.start(plain, [point])[0]  # the joint was measured at rest
    (motion,) = cases._resimulated([run], [plain], [wrong])
    assert np.abs(motion.position).max() < 1e-12
    seen = -fits.residuals(plain, [point]).reshape(1, -1)
    moved = plain._replace(measured=seen)
    right = fits.start(moved, [point])[0]
    (motion,) = cases._resimulated([run], [moved], [right])
    assert np.abs(motion.position).max() > 0.2


class Rough(Judge):
    """A judge of one joint, with a cause that leaves so much of 10 times the noise."""

    def __init__(self, cause, left):
        elbow, none = joint(wave), np.zeros(TOLERANCES)
        law = Hypothesis(cause, "", lambda *_: None, (), (), (), (), lambda *_: {})
        law = law._replace(geared=cause in GEARS)
        known, best = (
            Fit(
                hypothesis, none, 0.0, np.full(4, level * elbow.noise),
                np.zeros((4, TOLERANCES)), np.eye(TOLERANCES), 1e-2, True,
            )
            for hypothesis, level in ((None, 10.0), (law, left))
        )  # fmt: skip
        self.joints, self.case = [elbow], SimpleNamespace(pulled={})
        self.known, self.found = [known], {0: [best]}


@pytest.mark.parametrize(("cause", "left", "drawn"), [
    ("backlash", 1.5, False), ("backlash", 2.0, True), ("joint_elasticity", 2.0, True),
    ("stiction", 2.0, False), ("stiction", 3.4, False), ("stiction", 3.6, True),
])  # fmt: skip
def test_a_joint_is_drawn_where_its_best_cause_leaves_much(cause, left, drawn):
    """Of a gear less is much, however well it explains the rest: teeth part any runs.

    So fast that only teeth can need it, none without a gear is.
    """
    assert Rough(cause, left)._misses(0, 10.0) == drawn
    assert Rough(cause, left)._misses(0, BOUNCING) == (drawn and cause in GEARS)


def test_what_was_lost_costs_what_it_takes_to_write_it_down():
    """Else a cause of the same joint had to beat a pattern that costs nothing."""
    judge = Rough("stiction", 1.5)
    (fit,) = judge.known
    judge.accepted = []
    before = judge.evidence()
    own = Claim(drops.LOST, np.zeros(0), (0,), {0: fit}, 50.0, coded=38.0)
    judge.accepted = [own]
    assert before - judge.evidence() == pytest.approx(38.0)
    other = own._replace(where=(1,), fits={1: fit}, lost={1: []}, coded=4.0)
    assert lost.joined([own._replace(lost={0: []}), other], 2).coded == 42.0
