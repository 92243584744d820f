"""What the report says of a run with --explain: shares, transfer, what is missing."""

import json
import math

import pytest
from test_report_page import GOOD, THETA0, page_of, shown, write_run
from test_report_verdict import rollouts_of, run_of

from gatjax.report.explained import chains, explained_section, transfer
from gatjax.report.read import Prediction
from gatjax.report.tables import summarise
from gatjax.runs import add_rows

FAST = [(0.19, 0), (0.24, 0), (0.27, 0)]
FALLING = [(0.19, 0), (0.22, 5), (0.25, 5)]


def predicted(method, before, after, horizon=0.02, iteration=0):
    joints = ("LHipPitch", "RKneePitch")
    return [
        Prediction(method, iteration, joint, horizon, before, after) for joint in joints
    ]


def test_shares_are_those_of_the_way_to_gat_after_diagnosis():
    rows = predicted("gat", 0.020, 0.010) + predicted("explained", 0.012, 0.004)
    (line,) = chains(rows)
    radians = (line.nominal, line.extended, line.alone, line.after)
    assert [math.radians(each) for each in radians] == pytest.approx(
        [0.020, 0.012, 0.010, 0.004]
    )
    assert line.explained == pytest.approx(0.5)


def test_horizons_are_apart_and_later_iterations_do_not_count():
    rows = predicted("gat", 0.02, 0.01) + predicted("explained", 0.01, 0.0)
    rows += predicted("gat", 0.2, 0.1, 0.5) + predicted("explained", 0.25, 0.1, 0.5)
    rows += predicted("explained", 9.0, 9.0, iteration=1)
    shares = {line.horizon_s: line.explained for line in chains(rows)}
    assert shares == {0.02: pytest.approx(0.5), 0.5: pytest.approx(-0.5)}


def test_without_an_improvement_there_are_no_shares():
    rows = predicted("gat", 0.02, 0.01) + predicted("explained", 0.015, 0.03)
    assert math.isnan(chains(rows)[0].explained)


@pytest.mark.parametrize("others", [[], predicted("none", 0.02, 0.02)])
def test_gat_alone_may_be_missing(others):
    (line,) = chains(predicted("explained", 0.012, 0.004) + others)
    assert math.isnan(line.alone)
    assert math.isnan(line.nominal) is not bool(others)


@pytest.mark.parametrize(
    ("explained", "gat", "says"),
    [
        (FAST, GOOD, "The walk transfers better than with GAT alone"),
        (GOOD, FAST, "The walk transfers worse than with GAT alone"),
        (GOOD, GOOD, "cannot be said, in this run of one search each: 0.0 cm/s"),
        (FALLING, FALLING, "cannot be said by its speed: every candidate of GAT after"),
    ],
)
def test_transfer_follows_speed_and_falls(explained, gat, says):
    rows = rollouts_of(theta0=THETA0, gat=gat, explained=explained)
    said = transfer(summarise(run_of(rows)))
    assert says in said and "GAT after diagnosis fell in" in said


def test_faster_but_falling_more_is_not_better():
    often = [(0.19, 0), *9 * [(0.21, 5)], (0.27, 0)]
    never = [(0.19, 0), *9 * [(0.21, 0)], (0.22, 0)]
    pairs = [(never, often), (often, never)]
    for gat, explained in pairs:
        said = transfer(
            summarise(run_of(rollouts_of(theta0=THETA0, gat=gat, explained=explained)))
        )
        assert "cannot be said" in said


def test_a_winner_that_falls_is_not_called_better():
    chosen = {"gat": (0.24, 0), "explained": (0.27, 1)}
    rows = rollouts_of(chosen, theta0=THETA0, gat=GOOD, explained=FAST)
    assert "cannot be said" in transfer(summarise(run_of(rows)))


def test_transfer_needs_both():
    summary = summarise(run_of(rollouts_of(theta0=THETA0, gat=GOOD)))
    assert "“GAT after diagnosis” did not walk on the robot" in transfer(summary)


def test_a_run_without_explain_has_no_such_part():
    run = run_of(rollouts_of(theta0=THETA0, gat=GOOD))
    assert explained_section(run, summarise(run)) == ""


def write_explained(folder, sentence="The commands come 36 ms late."):
    write_run(folder, theta0=THETA0, gat=GOOD, explained=FAST)
    (folder / "config.json").write_text('{"seed": 3, "explain": true}')
    (folder / "diagnosis").mkdir()
    text = {"schema": "gatjax.diagnosis/1", "verdict": "named", "sentence": sentence}
    (folder / "diagnosis" / "diagnosis.json").write_text(json.dumps(text))
    rows = [
        row._asdict()
        for horizon in (0.02, 0.5)
        for row in predicted("explained", 0.014, 0.004, horizon)
    ]
    add_rows(folder / "prediction.csv", rows)
    return folder


def test_the_page_shows_it_in_every_part(tmp_path):
    page = page_of(write_explained(tmp_path))
    text = shown(page)
    assert "What the diagnosis explained The commands come 36 ms late." in text
    assert 'href="diagnosis/report.html"' in page
    assert "1.146° 0.802° 0.573° 0.229° 38 % 62 %" in text  # 0.02, 0.014, 0.01, 0.004
    assert "The walk transfers better than with GAT alone" in text
    assert text.count("GAT after diagnosis") > 6
    assert "var(--explained)" in page and "--explained: #" in page
    other = (tmp_path / "diagnosis" / "report.html").read_text()
    assert "The commands come 36 ms late" in other


def test_the_page_says_what_torques_the_search_kept_to(tmp_path):
    folder = write_explained(tmp_path)
    assert "kept to the torques" not in shown(page_of(folder))
    knees = {"where": ["LKneePitch", "RKneePitch"], "values": {"limit": 2.553}}
    rows = [
        {"cause": "torque_limit", "where": ["all"], "values": {"limit": 3.7}},
        {"cause": "current_limit", "role": "bound"} | knees,
    ]
    (folder / "extended.json").write_text(json.dumps({"effects": rows}))
    text = shown(page_of(folder))
    assert "under more: 2.55 N m (LKneePitch, RKneePitch)." in text
    assert "3.70" not in text


def test_the_page_says_why_there_is_none(tmp_path):
    folder = write_run(tmp_path, theta0=THETA0, gat=GOOD)
    (folder / "config.json").write_text('{"seed": 3, "explain": true}')
    assert "GAT after diagnosis has not been learned yet" in shown(page_of(folder))
    (folder / "diagnosis").mkdir()
    (folder / "diagnosis" / "skipped.txt").write_text("the robot <falls>\n")
    text = shown(page_of(folder))
    assert "There is no GAT after diagnosis: the robot &lt;falls&gt;." in text
