"""Trials of the loop as the paper counts them: columns, intervals and paired tests."""

import math
from pathlib import Path

import numpy as np
import pytest

from gatjax import runs
from gatjax.benchmark import transfer
from gatjax.benchmark.document import document
from gatjax.benchmark.transfer import Found, corrected, line, paired, trial_of

TABLE1 = Path(__file__).parents[1] / "experiments" / "table1"


def found(gain, generation=2, confirmed=None, confirmed_falls=None):
    return Found(gain, None if gain is None else generation, confirmed,
                 confirmed_falls, falls=3, walks=10)  # fmt: skip


def rows_of(method, generations, kind="best", iteration=0):
    return [
        {"method": method, "iteration": iteration, "generation": number,
         "candidate": kind, "robot_velocity_m_s": speed, "robot_falls": falls,
         "robot_rollouts": 5}
        for number, (speed, falls) in enumerate(generations)
    ]  # fmt: skip


@pytest.fixture
def run(tmp_path):
    rows = rows_of("theta0", [(0.2, 0)])
    rows += rows_of("gat", [(0.4, 0), (0.22, 0), (0.24, 0), (0.3, 2)])
    rows += [{**rows_of("gat", [(0.23, 1)], "chosen")[0], "generation": 2,
              "robot_rollouts": 10}]  # fmt: skip
    rows += rows_of("gat", [(0.2, 0), (0.5, 0)], iteration=1)
    rows += rows_of("none", [(0.3, 0), (0.3, 5)])
    runs.add_rows(tmp_path / "metrics.csv", rows)
    return tmp_path


def test_a_trial_is_its_fastest_policy_that_never_fell_after_the_first(run):
    gat = trial_of(run)["gat"]
    assert gat.gain == pytest.approx(20.0)
    assert gat.generation == 2
    assert gat.confirmed == pytest.approx(15.0)
    assert (gat.confirmed_falls, gat.falls, gat.walks) == (1, 2, 15)
    assert trial_of(run, iteration=1)["gat"].gain == pytest.approx(150.0)


def test_the_first_generation_counts_where_there_is_no_other(tmp_path):
    rows = [*rows_of("theta0", [(0.2, 0)]), *rows_of("gat", [(0.25, 0)])]
    runs.add_rows(tmp_path / "metrics.csv", rows)
    gat = trial_of(tmp_path)["gat"]
    assert (gat.gain, gat.generation) == (pytest.approx(25.0), 0)


def test_a_trial_without_a_stable_policy_failed(run):
    none = trial_of(run)["none"]
    assert none == Found(None, None, None, None, falls=5, walks=5)
    assert none.failed
    assert none.useful == 0.0


def test_a_run_that_is_not_done_is_refused(run, tmp_path):
    runs.add_rows(run / "metrics.csv", [
        {"method": "gat", "iteration": 0, "generation": 4, "candidate": "best",
         "sigma": 1.0}
    ])  # fmt: skip
    with pytest.raises(ValueError, match="gat has not walked on the robot yet"):
        trial_of(run)
    assert set(trial_of(run, methods=["none"])) == {"none"}  # it is done


def test_the_papers_columns():
    each = [found(10.0, 1, 8.0, 0), found(30.0, 3, 20.0, 2), found(None), found(-5.0)]
    one = line("gat", each)
    assert one.gain.mean == pytest.approx(20.0)
    assert one.useful.mean == pytest.approx(10.0)
    assert (one.failures, one.generation, one.stood, one.trials) == (2, 2.0, 1, 4)
    assert one.confirmed.mean == pytest.approx(14.0)
    assert one.falls.mean == pytest.approx(0.3)


def test_the_winner_of_a_trial_that_failed_does_not_count():
    one = line("gat", [found(10.0, 1, 8.0, 0), found(-1.0, 1, 2.0, 0)])
    assert (one.failures, one.stood, one.confirmed.mean) == (1, 1, 8.0)


def test_a_method_that_always_fails_has_no_gain():
    one = line("none", [found(None)] * 3)
    assert math.isnan(one.gain.mean)
    assert one.failures == 3
    assert one.useful.mean == 0.0


def test_the_bootstrap_covers():
    """Of 300 samples of 10 normal numbers about 90 % to 95 % cover their mean."""
    rng = np.random.default_rng(3)
    intervals = [transfer.mean(rng.normal(5.0, 2.0, 10).tolist()) for _ in range(300)]
    share = np.mean([each.low <= 5.0 <= each.high for each in intervals])
    assert 0.84 <= share <= 0.96


def test_paired_tests_see_what_is_there_and_nothing_else():
    rng = np.random.default_rng(0)
    trials = rng.normal(15.0, 6.0, 10)
    same = [found(float(gain)) for gain in trials]
    better = [found(float(gain + 3.0 + rng.normal())) for gain in trials]
    strong = paired(better, same)
    assert strong.p == pytest.approx(2 / 2**10)
    assert strong.difference.low > 1.0
    assert paired(same, same).p == 1.0
    assert paired(better[:1], same[:1]).p == 1.0  # one trial proves nothing
    p = [
        paired(*[[found(float(g)) for g in rng.normal(15.0, 6.0, 10)] for _ in "ab"]).p
        for _ in range(100)
    ]
    assert np.mean(np.array(p) < 0.05) <= 0.12


def test_failures_are_compared_in_the_trials_where_they_differ():
    fails, stands = found(None), found(10.0)
    test = paired([stands] * 6 + [fails, stands], [fails] * 6 + [stands, stands])
    assert (test.fewer, test.more) == (6, 1)
    assert test.p_failures == pytest.approx(2 * (1 + 7) / 2**7)
    with pytest.raises(ValueError, match="same trials"):
        paired([stands], [stands, fails])


def test_falls_are_compared_trial_by_trial():
    often = [found(10.0)._replace(falls=falls) for falls in (5, 6, 4, 7, 5, 6)]
    test = paired([found(10.0)] * 6, often)  # 3 of 10 walks
    assert test.fallen.mean == pytest.approx(-25.0)
    assert test.p_fallen == pytest.approx(2 / 2**6)
    assert paired(often, often).p_fallen == 1.0


def test_falls_of_the_paper_size_are_those_that_its_readme_tells():
    """Dagger's candidates fall less often than GAT's: -28 points, p 0.004."""
    trials = transfer.read_trials(TABLE1 / "paper")["stiff"].values()
    test = paired([each["dagger"] for each in trials], [each["gat"] for each in trials])
    assert round(test.fallen.mean) == -28 and round(test.p_fallen, 3) == 0.004
    assert (round(test.fallen.low), round(test.fallen.high)) == (-39, -17)


def test_the_document_has_a_line_a_method_beside_the_paper(tmp_path):
    for trial, gain in enumerate((10.0, 20.0)):
        methods = {"none": found(None), "gat": found(gain, 1, gain, 0)}
        runs.write_json(tmp_path / f"dart_{trial}.json", {
            "robot": "dart", "trial": trial,
            "methods": {name: each._asdict() for name, each in methods.items()},
        })  # fmt: skip
    text = document(transfer.read_trials(tmp_path))
    assert "## Simulator to dart" in text
    gat, none = (
        next(row for row in text.splitlines() if row.startswith(f"| {name} "))
        for name in ("gat", "none")
    )
    assert "15.0 (10.0 to 20.0)" in gat and "22.5, 1, 2.7" in gat
    assert "| 2        |" in none
    assert "none - gat" in text and "falls, points" in text


def test_a_diagnosis_that_a_run_refused_is_a_failure_of_explained(run):
    assert "explained" not in trial_of(run)
    (run / "diagnosis").mkdir()
    (run / "diagnosis" / "skipped.txt").write_text("the robot fell\n")
    refused = trial_of(run)["explained"]
    assert refused.failed and refused.useful == refused.kept == 0.0
    assert "explained" not in trial_of(run, methods=["gat"])
    good, gat = found(30.0, 3, 30.0, 0)._replace(falls=0), found(10.0, 1, 10.0, 0)
    test = paired([good, refused], [gat, gat])
    assert test.difference.mean == pytest.approx(5.0) and test.more == 1
    assert test.fallen.mean == pytest.approx(-30.0)  # of the trial that walked
    assert line("explained", [good, refused]).failures == 1
    assert np.isnan(line("explained", [refused]).falls.mean)


def test_p_values_of_a_family_are_corrected_for_their_number():
    """Holm's example: 0.01, 0.04, 0.03 and 0.005 become 0.03, 0.06, 0.06 and 0.02."""
    assert corrected([0.01, 0.04, 0.03, 0.005]) == pytest.approx(
        [0.03, 0.06, 0.06, 0.02]
    )
    assert corrected([0.7, 0.9]) == [1.0, 1.0]
    assert corrected([]) == []
    assert corrected([0.01, np.nan, 0.04])[::2] == pytest.approx([0.02, 0.04])


def test_the_document_corrects_over_all_tests_of_gains_and_falls_of_a_robot(tmp_path):
    """Two methods against a third, three tests each: 2 of 2^6 becomes 6 times that."""
    for trial in range(6):
        methods = {
            "gat": found(10.0, 1, 10.0, 0), "better": found(20.0, 1, 20.0, 0),
            "same": found(10.0, 1, 10.0, 0),
        }  # fmt: skip
        runs.write_json(tmp_path / f"dart_{trial}.json", {
            "robot": "dart", "trial": trial,
            "methods": {name: each._asdict() for name, each in methods.items()},
        })  # fmt: skip
    text = document(transfer.read_trials(tmp_path))
    row = next(row for row in text.splitlines() if row.startswith("| better - gat"))
    assert row.count("0.031 (0.188)") == 2 and "1.000 (1.000)" in row
