"""Proposals: which starts of a law are followed, and for how long."""

import jax
import numpy as np
import pytest
from scipy.optimize import brentq
from test_diagnosis_plant import NOMINAL, joint, wave

from gatjax.diagnosis import fit as fits
from gatjax.diagnosis import search, shaken
from gatjax.diagnosis.bank import CAUSES, OTHERS, of_drive
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import (
    COUNT,
    TOLERANCES,
    Hypothesis,
    combined,
    numbers,
)
from gatjax.diagnosis.joint import Joint
from gatjax.diagnosis.valleys import exchanged


def begun(cause, cost, floor):
    """A start of a law at a cost, that iterations bring down to a floor."""
    law = Hypothesis(cause, "", lambda *_: None, (), (), (), (), lambda *_: {})
    none = np.zeros(0)
    return Fit(law, np.array([floor]), cost, none, np.zeros((0, 0)), none, 1.0, True)


@pytest.fixture
def descent(monkeypatch):
    """Every iteration halves what is left above a start's floor."""

    def improve(joint, found, rounds):
        return [
            fit._replace(cost=fit.x[0] + (fit.cost - fit.x[0]) * 0.5**rounds)
            for fit in found
        ]

    monkeypatch.setattr(fits, "improve", improve)
    monkeypatch.setattr(search, "_relaxed", lambda *_: [])

    def proposed(*found):
        monkeypatch.setattr(search, "_started", lambda *_: (list(found), False))
        return search.proposals(tuple.__new__(Joint), found[0], ())

    return proposed


def test_a_start_that_looks_worse_and_leads_further_is_followed(descent):
    stuck, good = begun("gain_error", 10.0, 9.9), begun("gain_error", 30.0, 1.0)
    other = begun("load_friction", 20.0, 8.0)
    best, second = descent(stuck, good, other)
    assert (best.hypothesis.cause, best.x[0]) == ("gain_error", 1.0)
    assert second.hypothesis.cause == "load_friction"


def test_each_law_is_proposed_once_and_eight_at_most(descent):
    many = [begun(f"law{k}", 10.0 + k + n, 0.1 * k) for k in range(12) for n in (0, 1)]
    found = descent(*many)
    names = [fit.hypothesis.cause for fit in found]
    assert len(names) == len(set(names)) == search.RIVALS


def test_stiction_fades_within_the_motion_of_its_joint():
    """At 2 rad/s by 0.6, at 30 by its bound; a joint at rest has none."""
    elbow = joint(wave)
    time = np.asarray(elbow.grid.clock)
    for top, most in ((2.0, 0.6), (30.0, 3.0), (0.0, None)):
        path = top / (2 * np.pi) * np.sin(2 * np.pi * time)
        moving = elbow._replace(grid=elbow.grid._replace(path=path))
        found = [h for h in of_drive(moving, CAUSES) if h.cause == "stiction"]
        assert len(found) == (most is not None)
        if not found:
            continue
        (stiction,) = found
        assert np.exp(stiction.high[1]) == pytest.approx(most, rel=0.01)
        fastest = max(speed for _, speed in stiction.starts)
        assert fastest <= stiction.high[1] and len(stiction.starts) >= 4


def test_what_is_sure_is_no_cause():
    elbow = joint(wave)
    sure = elbow._replace(allowed=elbow.allowed._replace(kp=0.0, limit=0.0))
    usual, left = ({h.cause for h in of_drive(one, CAUSES)} for one in (elbow, sure))
    assert usual - left == {"gain_error", "torque_limit", "torque_saturation"}


@pytest.mark.parametrize(("cause", "size"), [
    ("encoder_scale", -0.012), ("clock_drift", 0.0008),
])  # fmt: skip
def test_a_small_effect_of_a_linear_law_starts_where_it_is(cause: str, size: float):
    """The bank's own starts are so far off that they say little, or look worse."""
    elbow = joint(wave)
    laws = of_drive(elbow, CAUSES)
    law = next(h for h in laws if h.cause == cause)
    drive = numbers(elbow, law, np.append(np.zeros(COUNT), size))
    noise = 7e-4 * np.random.default_rng(0).normal(size=elbow.measured.shape)
    elbow = elbow._replace(measured=elbow.simulate([drive], False)[..., 0] + noise)
    base = search.healthy(elbow)
    best = min(search.scan(elbow, base, (law,)), key=lambda fit: fit.cost)
    assert best.x[-1] == pytest.approx(size, rel=0.3)
    assert best.cost < base.cost


@pytest.mark.parametrize(("cause", "field", "share"), [
    ("armature", "armature", 6.0), ("viscous_friction", "damping", 0.8),
])  # fmt: skip
def test_a_cause_of_what_the_model_has_none_of_is_found(cause, field, share):
    """MuJoCo's defaults: no armature and no damping, which leaves no unit for them."""
    elbow = joint(wave)
    bare = elbow.nominal | {"armature": 0.0, "damping": 0.0, "kv": 0.0}
    if cause == "armature":
        bare["kv"] = elbow.nominal["kv"]
    elbow = elbow._replace(nominal=bare)
    scale = elbow.inertia if cause == "armature" else bare["kp"] ** 0.5
    size = share * scale * (1.0 if cause == "armature" else elbow.inertia**0.5)
    noise = 7e-4 * np.random.default_rng(0).normal(size=elbow.measured.shape)
    moved = elbow.simulate([{field: size}], False)[..., 0]
    elbow = elbow._replace(measured=moved + noise)
    law = next(h for h in of_drive(elbow, CAUSES) if h.cause == cause)
    begun = search.scan(elbow, search.healthy(elbow), (law,))
    found = min(fits.improve(elbow, begun, 16), key=lambda fit: fit.cost)
    (value,) = law.values(elbow, found.x[COUNT:]).values()
    assert value == pytest.approx(size, rel=0.15)  # masses have tolerances
    assert found.rms() < 1.2 * elbow.noise


def test_tolerances_that_stand_for_a_linear_law_give_way_to_it():
    """A torque that a spring's bias is, which friction and zeros were bent to."""
    elbow = joint(wave)
    law = next(h for h in OTHERS if h.variant == "parallel spring")
    drive = numbers(elbow, law, np.append(np.zeros(COUNT), (0.0, 0.01)))
    elbow = elbow._replace(measured=elbow.simulate([drive], False)[..., 0])
    base = search.healthy(elbow)
    best = min(search.scan(elbow, base, (law,)), key=lambda fit: fit.cost)
    assert best.x[-2:] == pytest.approx((0.0, 0.01), abs=0.002)


@pytest.mark.parametrize(("law", "best"), [
    ({"skew": 0.4}, "uneven gain"), ({"one_sided": 0.4}, "asymmetric_friction"),
])  # fmt: skip
def test_an_uneven_servo_is_told_from_friction_of_one_direction(law, best):
    """Both make one direction slower; the friction alone has a name."""
    elbow = joint(wave, rest=0.8)
    noise = 7e-4 * np.random.default_rng(0).normal(size=elbow.measured.shape)
    elbow = elbow._replace(measured=elbow.simulate([law], False)[..., 0] + noise)
    bank = tuple(
        h for h in of_drive(elbow, CAUSES + OTHERS)
        if h.cause == "asymmetric_friction" or h.variant == "uneven gain"
    )  # fmt: skip
    found = search.explain(elbow, search.healthy(elbow), bank)[0].hypothesis
    assert found is not None and best in (found.cause, found.variant)


def test_a_spring_beside_the_servo_that_slips_has_no_name():
    """A hose after Bouc and Wen (1976, n = 1), which the bank's law is simpler than."""
    elbow, way, most = joint(wave, rest=0.3), 0.1, 0.6
    n, inertia, h = NOMINAL, 0.018 + NOMINAL["armature"], 1e-4
    clock = np.asarray(elbow.grid.clock)[:, 0]
    q = v = bent = 0.0
    path = []
    for t in np.arange(clock[0], clock[-1], h):
        path.append(q)
        bent += h * (v - (abs(v) * bent + v * abs(bent)) / (2.0 * way))
        torque = n["kp"] * (wave(t) - q) - (n["kv"] + n["damping"]) * v
        v += h * (torque - most / way * bent - 0.3) / inertia
        q += h * v
    read = np.interp(elbow.time[0], np.arange(clock[0], clock[-1], h), path)
    noise = 7e-4 * np.random.default_rng(0).normal(size=read.shape)
    elbow = elbow._replace(measured=(read + noise)[None])
    loads = "gravity_tilt", "payload", "com_shift"
    bank = of_drive(elbow, CAUSES + OTHERS)
    bank = tuple(h for h in bank if h.cause not in loads)
    with jax.numpy_rank_promotion("allow"):
        found = search.explain(elbow, search.healthy(elbow), bank)
    assert found[0].hypothesis is not None
    assert found[0].hypothesis.variant == "hysteretic spring"
    assert found[0].rms() < 3.0 * elbow.noise


@pytest.mark.parametrize("seed", [0, 4])
def test_tolerances_at_their_bounds_hold_no_cause_back(seed: int):
    """They imitate it before it is known: 2.13 of 2.3 was left, or another cause."""
    elbow, draw = joint(wave, rest=0.3), np.random.default_rng(seed)
    every = of_drive(elbow, CAUSES)
    bank = tuple(h for h in every if h.cause in ("damping_error", "viscous_friction"))
    law = next(h for h in bank if h.cause == "damping_error")
    drive = numbers(elbow, law, np.append(0.8 * draw.normal(size=COUNT), 2.3))
    noise = 7e-4 * draw.normal(size=elbow.measured.shape)
    elbow = elbow._replace(measured=elbow.simulate([drive], False)[..., 0] + noise)
    best = search.explain(elbow, search.healthy(elbow), bank)[0]
    assert best.law == law.law and best.x[-1] == pytest.approx(2.3, abs=0.05)


@pytest.mark.parametrize(("cause", "own", "beside"), [
    ("gain_error", np.log(0.6), "supply_sag"), ("first_order_lag", np.log(0.05), None),
])  # fmt: skip
def test_a_start_beside_strained_tolerances_hides_no_cause(cause, own, beside):
    """It changes least, and leads nowhere: a gain was dropped, of 50 ms 27 found."""
    elbow, draw = joint(wave, rest=0.3), np.random.default_rng(0)
    without = ("gravity_tilt", "payload", "com_shift", "command_quantization")
    bank = tuple(h for h in of_drive(elbow, CAUSES) if h.cause not in without)
    law = next(h for h in bank if h.cause == cause)
    x = np.append(0.8 * draw.normal(size=COUNT), own)
    angle = elbow.simulate([numbers(elbow, law, x)], False)[..., 0]
    angle = angle + 7e-4 * draw.normal(size=angle.shape)
    elbow = elbow._replace(measured=angle)
    (right,) = fits.improve(elbow, fits.start(elbow, [(law, x)]), 8)
    base = search.healthy(elbow)
    for found, more in ((search.explain, 4.0), (search.proposals, 15.0)):
        costs = {fit.law[0]: fit.cost for fit in found(elbow, base, bank)}
        assert costs.pop(cause) < right.cost + more
        assert beside is None or costs[beside] < right.cost + more


@pytest.mark.parametrize(("cause", "imitator"), [
    ("coulomb_friction", "friction"), ("gain_error", "kp"),
    ("viscous_friction", "damping"), ("torque_limit", "limit"),
])  # fmt: skip
def test_a_cause_takes_over_what_its_imitator_stands_for(cause, imitator):
    elbow = joint(wave, rest=0.3)
    law = next(h for h in of_drive(elbow, CAUSES) if h.cause == cause)
    assert law.imitator == imitator
    x = np.append(np.zeros(COUNT), 0.4 * law.low[0] + 0.6 * law.high[0])
    assert exchanged(elbow, law, x) is None
    strained = x.copy()
    strained[TOLERANCES.index(imitator)] = 2.0
    pair = combined(CAUSES[0], law)
    beside = np.insert(strained, COUNT, -4.0)
    for hypothesis, start in ((law, strained), (pair, beside)):
        found = exchanged(elbow, hypothesis, start)
        assert found is not None
        np.testing.assert_allclose(found[:COUNT], 0.0)
        before, after = (numbers(elbow, hypothesis, one) for one in (start, found))
        assert after[imitator] == pytest.approx(before[imitator])
        assert found[-1] != start[-1]


def test_a_fit_leaves_the_valley_between_friction_and_its_tolerance():
    """At once; slopes take longer, or end in it: 0.0335 of 0.07 N m at a finger."""
    elbow, draw = joint(wave, rest=0.3), np.random.default_rng(0)
    law = next(h for h in CAUSES if h.cause == "coulomb_friction")
    right = np.append(np.zeros(COUNT), np.log(0.12))
    angle = elbow.simulate([numbers(elbow, law, right)], False)[..., 0]
    angle = angle + 7e-4 * draw.normal(size=angle.shape)
    elbow = elbow._replace(measured=angle)
    total = numbers(elbow, law, right)["friction"]
    strained = right.copy()
    strained[TOLERANCES.index("friction")] = 3.4

    def missed(own: float) -> float:
        strained[-1] = own
        return numbers(elbow, law, strained)["friction"] - total

    strained[-1] = brentq(missed, law.low[0], law.high[0])
    best, found = fits.improve(
        elbow, fits.start(elbow, [(law, right), (law, strained)]), 1
    )
    assert found.cost < best.cost + 1.0


def test_a_gap_is_found_where_slopes_end_in_the_first_valley():
    """Teeth bounce: of a gap of 90 mrad slopes make one of 52, the search one of 87."""
    elbow = joint(wave, rest=0.3)
    law = next(h for h in CAUSES if h.law == ("backlash", "encoder on link"))
    own = np.log(0.09), 0.0, 0.15, np.log(0.1)
    drive = numbers(elbow, law, np.append(np.zeros(COUNT), own))
    noise = 7e-4 * np.random.default_rng(0).normal(size=elbow.measured.shape)
    elbow = elbow._replace(measured=elbow.simulate([drive], True)[..., 0] + noise)
    first = np.append(np.zeros(COUNT), (np.log(0.03), 0.1, 0.1, np.log(0.3)))
    (slopes,) = fits.improve(elbow, fits.start(elbow, [(law, first)]), 20)
    assert slopes.rms() > 5.0 * elbow.noise
    found = shaken.found(elbow, slopes)
    assert found.rms() < 1.3 * elbow.noise
    assert np.exp(found.x[COUNT]) == pytest.approx(0.09, rel=0.08)


def test_rough_fits_are_searched_for_anew_if_they_are_best_or_have_a_gear(
    monkeypatch,
):
    def fit(name, level, geared=False):
        law = Hypothesis(name, "", lambda *_: None, (), (), (), (), lambda *_: {})
        rest = np.full(4, level * elbow.noise)
        law = law._replace(geared=geared)
        return begun("", 0.0, 0.0)._replace(hypothesis=law, residual=rest)

    elbow, asked = joint(wave), []
    found = [fit("a", 2.0), fit("b", 2.1), fit("calm", 1.2, True), fit("c", 3.0)]
    found += [fit("gear", 4.0, True)]
    gone = [fit("lost", 5.0), fit("teeth", 6.0, True), found[-1]]
    beside = fit("drag", 6.0)  # of a joint that has a gear already
    both = combined(gone[1].hypothesis, beside.hypothesis)
    gone += [beside._replace(hypothesis=both)]
    assert both.geared
    monkeypatch.setattr(
        shaken, "found", lambda _, one: asked.append(one.hypothesis.cause) or one
    )
    assert len(search._shaken(elbow, found, gone)) == len(found) + len(asked)
    assert asked == ["a", "b", "gear"]
    asked.clear()
    search._shaken(elbow, [fit("spring", 1.9, True), *found], gone)
    assert asked == ["spring", "a", "gear", "teeth"]
    asked.clear()
    search._shaken(elbow, [fit("calm", 1.2), *found], gone)
    assert asked == ["a"]


def test_rounded_targets_are_looked_at_closely_where_they_promise_something(
    monkeypatch,
):
    law = next(h for h in CAUSES if h.rung)
    elbow = joint(wave)
    elbow = elbow._replace(grid=jax.tree.map(np.asarray, elbow.grid))
    drive = numbers(elbow, law, np.append(np.zeros(COUNT), np.log(0.0533)))
    rounded = elbow._replace(measured=elbow.simulate([drive], False)[..., 0])
    plain = elbow._replace(measured=elbow.simulate([{}], False)[..., 0])
    started, points = fits.start, []

    def start(joint, some):
        points.append(len(some))
        return started(joint, some)

    monkeypatch.setattr(fits, "start", start)
    for one, calls in ((rounded, 1 + search.ZOOMS), (plain, 1)):
        base = search.healthy(one)
        points.clear()
        search.scan(one, base, (law,))
        assert len(points) == calls
    assert search.scan(plain, base, ()) == []


def test_a_simulation_that_falls_apart_is_left_by_a_step(monkeypatch):
    """All that it tells is that it did, whatever is changed."""
    monkeypatch.setattr(fits, "spread", lambda joint: 1e-3)
    law = next(h for h in OTHERS if h.variant == "quadratic drag")
    x = np.append(np.zeros(COUNT), law.starts[0])
    slopes = np.full((50, len(x)), 1e26)
    fit = fits.Fit(law, x, 1e55, slopes[:, 0], slopes, slopes.T @ slopes, 1.0, False)
    assert np.isfinite(fits._step(joint(np.sin), fit, 0.0)).all()
