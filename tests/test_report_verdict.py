"""The verdict of the report: it claims no more than the walks show."""

import math
from pathlib import Path

import numpy as np
import pytest

from gatjax.report.intervals import (
    difference_interval,
    gain_interval,
    mean_interval,
    share_interval,
)
from gatjax.report.read import Rollout, Run
from gatjax.report.tables import summarise
from gatjax.report.verdict import judge

SPREAD = (-0.004, -0.002, 0.0, 0.002, 0.004)  # m/s, one walk each
METHODS = ("none", "envelope", "guided", "gat")
# (velocity m/s, falls of 5) of generations 0, 1, 2
THETA0 = [(0.18, 0)]
FALLING = [(0.19, 0), (0.20, 0), (0.24, 5)]
AFTER = "after the first generation"
ALWAYS = [(0.2, 1), (0.2, 5), (0.2, 4), (0.2, 5)]
GOOD = [(0.19, 0), (0.22, 0), (0.25, 0)]
SLOW = [(0.181, 0), (0.185, 0), (0.19, 0)]


def walks(method, generation, candidate, velocities, falls):
    """Rows of one candidate; its first `falls` walks fell."""
    return [
        Rollout(
            method,
            0,
            generation,
            candidate,
            seed,
            velocity,
            2.0 if seed < falls else math.inf,
        )
        for seed, velocity in enumerate(velocities)
    ]


def run_of(rollouts, **config):
    return Run(Path("run"), config, {}, {}, [], [], rollouts, {}, [], {}, "", {})


def rollouts_of(chosen=None, **methods):
    """Rows of all candidates, and of the chosen ones: (velocity, falls of 5)."""
    rows = []
    for method, generations in methods.items():
        for generation, (velocity, falls) in enumerate(generations):
            each = [velocity + change for change in SPREAD]
            rows += walks(method, generation, "best", each, falls)
    for method, (velocity, falls) in (chosen or {}).items():
        each = [velocity + change for change in SPREAD]
        rows += walks(method, len(methods[method]) - 1, "chosen", each, falls)
    return rows


def summary_of(chosen=None, **methods):
    return summarise(run_of(rollouts_of(chosen, **methods)))


def verdict_of(chosen=None, **methods):
    return judge(summary_of(chosen, **methods))


def test_better_grounding_is_said():
    verdict = verdict_of(theta0=THETA0, none=FALLING, gat=GOOD)
    assert verdict.kind == "better"
    assert verdict.sentence.startswith("In this run, one search a method, the fastest")
    assert "is from GAT: 25.0 cm/s, 39 % faster than theta0" in verdict.sentence
    assert "beat no grounding by 5.0 cm/s" in verdict.sentence
    assert "fell in 0 % of its walks" in verdict.sentence
    assert "against 50 %" in verdict.sentence


def test_worse_grounding_is_said():
    verdict = verdict_of(theta0=THETA0, none=GOOD, gat=SLOW)
    assert verdict.kind == "not better"
    assert "is from no grounding" in verdict.sentence
    assert "did not beat no grounding: 6.0 cm/s slower" in verdict.sentence


def test_overlapping_intervals_are_no_win():
    near = [(velocity + 0.0005, falls) for velocity, falls in GOOD]
    verdict = verdict_of(theta0=THETA0, none=GOOD, gat=near)
    assert verdict.kind == "unclear"
    assert "GAT (level with no grounding)" in verdict.sentence
    assert "did not make the walk measurably faster" in verdict.sentence


def test_several_that_are_level_are_listed_with_commas():
    near = [(velocity - 0.0005, falls) for velocity, falls in GOOD]
    verdict = verdict_of(theta0=THETA0, none=near, envelope=near, guided=near, gat=GOOD)
    assert "(level with no grounding, noise envelope and guided)" in verdict.sentence


def test_as_few_falls_are_no_but():
    verdict = verdict_of(
        {"none": (0.22, 2), "gat": (0.22, 0)}, theta0=THETA0, none=GOOD, gat=GOOD
    )
    assert "fell in 2 of 5 walks, and in the search grounding fell" in verdict.sentence


def test_fewer_falls_at_the_same_speed_are_safer():
    grounded = [(0.18, 0), (0.20, 0), (0.20, 0), (0.20, 0)]
    ungrounded = [(0.20, 0), (0.20, 0), (0.24, 4), (0.25, 5), (0.24, 5), (0.25, 5)]
    assert verdict_of(theta0=THETA0, none=ungrounded, gat=grounded).kind == "safer"


def test_more_falls_are_no_win_at_any_speed():
    ungrounded = [(0.18, 0)] * 6
    grounded = [(0.18, 0), (0.25, 0), *[(0.25, 5)] * 8]
    verdict = verdict_of(theta0=THETA0, none=ungrounded, gat=grounded)
    assert verdict.kind == "unclear"
    assert "7.0 cm/s faster than no grounding" in verdict.sentence
    assert "but fell in 89 % of its walks" in verdict.sentence


def test_a_method_that_always_falls_loses():
    stands = [*GOOD, (0.25, 0)]
    won = verdict_of(theta0=THETA0, none=ALWAYS, gat=stands)
    assert won.kind == "better" and "every candidate of no grounding" in won.sentence
    lost = verdict_of(none=stands, gat=ALWAYS)
    assert lost.kind == "not better"

    assert f"every candidate of GAT {AFTER} fell at least once" in lost.sentence
    both = verdict_of(none=ALWAYS, gat=ALWAYS)
    assert both.kind == "not better"
    assert f"no learned walk {AFTER} got through" in both.sentence


@pytest.mark.parametrize("found_in", [0, 1, 2])
def test_one_slow_walk_among_falls_did_not_beat_no_grounding(found_in):
    grounded = [(0.10, 5)] * 6
    grounded[found_in] = (0.10, 0)
    ungrounded = [(0.20, 1)] * 6
    verdict = verdict_of(theta0=[(0.165, 0)], none=ungrounded, gat=grounded)
    assert verdict.kind in ("unclear", "not better")
    assert ") beat no grounding:" not in verdict.sentence
    share = "80 %" if found_in else "100 %"
    assert f"fell in {share} of its walks" in verdict.sentence
    assert "against 20 %" in verdict.sentence


def test_fewer_falls_do_not_excuse_a_walk_slower_than_theta0():
    grounded, ungrounded = [(0.10, 0)] * 6, [(0.20, 4)] * 6
    slow = verdict_of(theta0=THETA0, none=ungrounded, gat=grounded)
    assert slow.kind == "unclear" and "slower than theta0" in slow.sentence
    level = [(0.18, 0)] * 6
    assert verdict_of(theta0=THETA0, none=ungrounded, gat=level).kind == "better"


def test_nothing_to_compare_is_said():
    alone = verdict_of(theta0=THETA0, gat=GOOD)
    assert alone.kind == "no comparison"
    assert "the method “no grounding” did not walk on the robot" in alone.sentence
    envelope = verdict_of(theta0=THETA0, none=GOOD, envelope=GOOD)
    assert envelope.kind == "no comparison"
    assert "the method “GAT” did not walk on the robot" in envelope.sentence
    start = verdict_of(theta0=THETA0)
    assert start.kind == "no data" and "only theta0" in start.sentence
    blind = verdict_of(none=SLOW, gat=GOOD)
    assert "theta0 was not evaluated" in blind.sentence


def test_the_compared_method_is_named_in_advance():
    both = verdict_of(theta0=THETA0, none=SLOW, guided=GOOD, gat=SLOW)
    assert both.kind == "unclear" and "grounding (GAT)" in both.sentence
    instead = rollouts_of(theta0=THETA0, none=SLOW, guided=GOOD)
    found = judge(summarise(run_of(instead)))
    assert found.kind == "better" and "grounding (guided)" in found.sentence
    pending = judge(summarise(run_of(instead, methods=["none", "guided", "gat"])))
    assert pending.kind == "no comparison"


def test_no_gain_over_theta0_is_said():
    none, gat = [(0.16, 0)], [(0.17, 0)]
    same = verdict_of(theta0=THETA0, none=none, gat=gat)
    assert "6 % slower than theta0" in same.sentence and same.kind == "unclear"


def test_the_first_generation_does_not_count():
    falls = summary_of(none=[(0.2, 5), (0.2, 1), (0.2, 0)]).methods[0].falls
    assert (falls.count, falls.rollouts) == (1, 10)
    first = [(0.3, 0), (0.2, 0), (0.19, 0)]
    method = summary_of(theta0=THETA0, none=first).methods[0]
    assert method.best.generation == 1 and method.gain.mean == pytest.approx(100 / 9)
    assert summary_of(none=[(0.3, 0), (0.2, 1)]).methods[0].best is None
    assert summary_of(none=[(0.3, 0)]).methods[0].best.generation == 0


def test_chosen_walks_decide():
    methods = {"theta0": THETA0, "none": SLOW, "gat": GOOD}
    summary = summary_of({"none": (0.21, 0), "gat": (0.185, 0)}, **methods)
    none, gat = summary.methods
    assert gat.best.upright == pytest.approx([100 * (0.185 + c) for c in SPREAD])
    assert gat.gain.mean == pytest.approx(100 * (0.185 / 0.18 - 1))
    assert (none.falls.rollouts, gat.falls.rollouts) == (10, 10)  # of the search
    assert all(each.candidate == "best" for each in gat.candidates)
    verdict = judge(summary)
    assert verdict.kind == "not better"
    assert "is from no grounding: 21.0 cm/s" in verdict.sentence
    assert ", 0 of 5 confirmation walks fell;" in verdict.sentence
    assert "not confirmed: picked by the same 5" in verdict_of(**methods).sentence


def test_a_winner_that_falls_when_confirmed_does_not_lead():
    methods = {"theta0": THETA0, "none": GOOD, "gat": GOOD}
    fell = verdict_of({"none": (0.21, 0), "gat": (0.25, 1)}, **methods)
    assert fell.kind == "not better" and "is from no grounding" in fell.sentence
    assert "the winner of GAT fell in 1 of 5 walks" in fell.sentence
    both = verdict_of({"none": (0.21, 2), "gat": (0.25, 1)}, **methods)
    assert "every winner fell at least once" in both.sentence
    assert "is from GAT: 25.1 cm/s" in both.sentence
    assert ", 1 of 5 confirmation walks fell;" in both.sentence
    assert both.kind == "not better"
    never = verdict_of({"none": (0.21, 5), "gat": (0.25, 5)}, **methods)
    assert f"no learned walk {AFTER} got through" in never.sentence


def test_the_last_iteration_with_a_chosen_walk_counts():
    rows = rollouts_of({"none": (0.20, 0)}, none=GOOD)
    again = [row._replace(iteration=1) for row in rows]
    lost = [
        row._replace(iteration=2, fell_at_s=1.0)
        for row in rows
        if row.candidate != "chosen"
    ]
    best = summarise(run_of(rows + again + lost)).methods[0].best
    assert (best.iteration, best.candidate) == (1, "chosen")


def test_confirmed_and_unconfirmed_are_not_compared():
    verdict = verdict_of({"none": (0.2, 0)}, theta0=THETA0, none=GOOD, gat=GOOD)
    assert verdict.kind == "unclear"
    assert "the walk of GAT was not confirmed" in verdict.sentence
    assert "is from no grounding: 20.0 cm/s" in verdict.sentence


def simulated(draw, faster=0.0, falls=0.05, confirmed=True):
    """One run of four methods whose walks are those of theta0, or all faster."""
    rows = walks("theta0", 0, "best", draw.normal(0.165, 0.01, 8), 0)
    for method in METHODS:
        candidates = [(g, kind, 4) for g in range(6) for kind in ("best", "mean")]
        stood = []
        for generation, kind, count in candidates:
            fell = draw.binomial(count, falls)
            velocities = draw.normal(0.165 + faster, 0.01, count)
            rows += walks(method, generation, kind, velocities, fell)
            if generation and not fell:
                stood.append(generation)
        if stood and confirmed:
            velocities = draw.normal(0.165 + faster, 0.01, 10)
            fell = draw.binomial(10, falls)
            rows += walks(method, stood[0], "chosen", velocities, fell)
    return judge(summarise(run_of(rows)))


def share_of_claims(**how):
    draw = np.random.default_rng(5)
    verdicts = [simulated(draw, **how) for _ in range(300)]
    claims = [
        each.kind == "better" or "% faster than theta0" in each.sentence
        for each in verdicts
    ]
    return sum(claims) / len(claims)


def test_equal_walks_are_rarely_called_faster():
    assert share_of_claims() <= 0.05
    assert share_of_claims(falls=0.0) <= 0.05


def test_the_winner_of_many_needs_its_confirmation():
    assert share_of_claims(falls=0.0, confirmed=False) > 0.08


def test_walks_that_are_faster_are_called_faster():
    assert share_of_claims(faster=0.03) > 0.95


@pytest.mark.parametrize("seed", range(20))
def test_intervals_contain_the_mean(seed):
    draw = np.random.default_rng(seed)
    after, before = draw.exponential(2.0, 6) + 1.0, draw.exponential(1.0, 4) + 3.0
    for interval, mean in (
        (mean_interval(after), after.mean()),
        (difference_interval(after, before), after.mean() - before.mean()),
        (gain_interval(after, before), 100 * (after.mean() / before.mean() - 1)),
        (share_interval(seed, 20), seed / 20),
    ):
        assert interval.mean == pytest.approx(mean)
        assert interval.low <= interval.mean <= interval.high
        assert interval.low < interval.high


def test_mean_interval_is_student_t():
    # t(0.975, 3) = 3.18245, standard deviation of 1, 2, 3, 4 over sqrt(4) = 0.645497
    interval = mean_interval([1.0, 2.0, 3.0, 4.0])
    assert interval == pytest.approx((2.5, 2.5 - 2.054260, 2.5 + 2.054260), abs=1e-5)


def test_intervals_of_few_walks_cover_what_they_promise():
    draw = np.random.default_rng(1)
    trials = 2000
    covered = np.zeros(3)
    for _ in range(trials):
        after, before = draw.normal(20.0, 2.0, 4), draw.normal(16.0, 1.0, 6)
        for place, (interval, true) in enumerate(
            (
                (mean_interval(after), 20.0),
                (difference_interval(after, before), 4.0),
                (gain_interval(after, before), 25.0),
            )
        ):
            covered[place] += interval.low <= true <= interval.high
    # 95 % within four standard errors of 2000 trials, and Welch's approximation
    assert covered / trials == pytest.approx([0.95] * 3, abs=0.02)


def test_gain_grows_unsure_with_theta0():
    after = [20.0, 20.2, 19.8, 20.0]
    sure, unsure = (gain_interval(after, [16.0 - d, 16.0, 16.0 + d]) for d in (0.1, 2))
    assert unsure.high - unsure.low > 3 * (sure.high - sure.low)
    assert not gain_interval(after, [0.1, 20.0, 40.0]).known
    assert gain_interval(after, [-1.0, 0.0]) is None


def test_wilson_interval_has_its_published_values():
    # closed form at p = 0: high = z^2 / (n + z^2)
    assert share_interval(0, 10)[:2] == (0.0, 0.0)
    assert share_interval(0, 10).high == pytest.approx(0.27753, abs=1e-4)
    assert share_interval(5, 10)[1:] == pytest.approx((0.2366, 0.7634), abs=1e-4)


def test_one_walk_gives_no_interval_and_no_win():
    rows = walks("none", 0, "best", [0.2], 0) + walks("gat", 0, "best", [0.3], 0)
    verdict = judge(summarise(run_of(rows)))
    assert verdict.kind == "unclear"
    assert "too few walks for an interval" in verdict.sentence
