"""`gatjax bench diagnose`: cases, solvers in processes of their own, baselines."""

import json
import os
import signal
import sys
import threading
import time

import numpy as np
import pytest

from gatjax.benchmark.baselines import Found, bic
from gatjax.benchmark.cases import Case, make, read_cases
from gatjax.benchmark.solve import Solver, answer, solve
from gatjax.benchmark.squares import Solved
from gatjax.cli import main
from gatjax.cli.arguments import BenchDiagnose
from gatjax.cli.blind import _check_out
from gatjax.diagnosis.bank import CAUSES
from gatjax.runs import read_json

SEED = 16  # a lively log of one servo with friction that shows
BOUND = hasattr(os, "sched_getaffinity")
CHOICE = ["--robots", "arm_servo", "--causes", "coulomb_friction", "--kinds", "single"]
FAKE = """
import json, os, pathlib, sys, time
flags = dict(zip(sys.argv[1:], sys.argv[2:]))
out = pathlib.Path(flags["--out"])
count = out / "count"
count.write_text(str(int(count.read_text()) + 1 if count.exists() else 1))
print("gatjax: the model falls apart")
time.sleep({sleep})
if {good}:
    mine = sorted(os.sched_getaffinity(0)) if {bound} else []
    said = {{"seed": flags["--seed"], "processors": mine}}
    (out / "answer.json").write_text(json.dumps(said))
sys.exit({code})
"""


@pytest.fixture(scope="module")
def blind(tmp_path_factory):
    """A folder in which one case was made, diagnosed and scored."""
    out = tmp_path_factory.mktemp("blind")
    arguments = ["bench", "diagnose", "--cases", "1", "--seed", str(SEED), *CHOICE]
    arguments += ["--jobs", "1", "--baselines", "--out", str(out)]
    assert main(arguments) == 0
    return out, arguments


def fake(tmp_path, good=True, sleep=0.0, code=0):
    script = tmp_path / "fake.py"
    script.write_text(FAKE.format(good=good, sleep=sleep, code=code, bound=BOUND))
    return Solver("fake", (sys.executable, str(script)), "answer.json")


def nothing(case, seconds):
    pass


@pytest.mark.timeout(300)
def test_a_case_is_made_diagnosed_and_scored(blind):
    out, _ = blind
    own = read_json(out / "scores.json")["solvers"]
    row = own["gatjax"]["cases"][0]
    assert (row["truth"], row["first"]) == ("coulomb_friction", "coulomb_friction")
    assert row["joint"] and row["error"] < 0.3
    single = own["largest improvement"]["cases"][0]
    assert single["first"] == "coulomb_friction" and single["error"] < 0.3
    assert 0.5 < single["share"] < 1.5
    assert list(own) == ["gatjax", "largest improvement", "BIC", "fit everything"]


def test_what_is_done_is_not_done_again(blind, capsys):
    out, arguments = blind
    file = out / "diagnoses" / f"h{SEED}_0000" / "diagnosis.json"
    before = file.stat().st_mtime_ns
    assert main(arguments) == 0
    assert "all 1 cases are solved already" in capsys.readouterr().out
    assert file.stat().st_mtime_ns == before


def test_another_seed_wants_another_folder(blind, capsys):
    _, arguments = blind
    other = [str(SEED + 1) if word == str(SEED) else word for word in arguments]
    assert main(other) == 1
    assert "seed" in capsys.readouterr().err


def test_the_diagnosis_says_what_was_checked(blind):
    out, _ = blind
    found = read_json(out / "diagnoses" / f"h{SEED}_0000" / "diagnosis.json")
    assert {"file", "level", "check", "text"} <= set(found["data_checks"][0])
    assert (out / "diagnoses" / f"h{SEED}_0000" / "report.html").stat().st_size > 1000


def test_solved_cases_are_left_alone_and_failed_ones_tried_again(blind, tmp_path):
    cases = read_cases(blind[0] / "set")
    bad = fake(tmp_path, good=False, code=1)
    solve(bad, cases, tmp_path, 5, 1, nothing)
    failed = answer(bad, cases[0], tmp_path)
    assert failed.said is None and failed.error == "gatjax: the model falls apart"
    good = fake(tmp_path)
    for _ in range(2):
        solve(good, cases, tmp_path, 5, 1, nothing)
    assert answer(good, cases[0], tmp_path).said["seed"] == "5"
    assert (tmp_path / cases[0].name / "count").read_text() == "2"


@pytest.mark.skipif(not BOUND, reason="this system binds no process to a processor")
def test_solvers_at_a_time_do_not_share_processors(blind, tmp_path):
    cases = read_cases(blind[0] / "set")
    twins = [cases[0]._replace(name=name) for name in "ab"]
    every = os.sched_getaffinity(0)
    slow = fake(tmp_path, sleep=1.0)
    solve(slow, twins, tmp_path, 0, 2, nothing)
    said = [set(answer(slow, twin, tmp_path).said["processors"]) for twin in twins]
    assert said[0] | said[1] == every
    assert len(every) == 1 or not said[0] & said[1]


def test_stopping_stops_the_solvers(blind, tmp_path):
    cases = read_cases(blind[0] / "set")
    slow = fake(tmp_path, sleep=60)
    twins = [cases[0]._replace(name=name) for name in "ab"]
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "answer.json").write_text(json.dumps({}))
    begun = time.monotonic()

    caught = threading.Event()

    def press():
        while not (tmp_path / "a" / "count").exists():
            time.sleep(0.05)
        signal.raise_signal(signal.SIGINT)
        while not caught.wait(8.0):  # Python loses one while it collects garbage
            signal.raise_signal(signal.SIGINT)

    thread = threading.Thread(target=press)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        solve(slow, twins, tmp_path, 0, 1, nothing)
    caught.set()
    thread.join()
    assert time.monotonic() - begun < 30.0
    assert not (tmp_path / "b").exists()


def test_bic_asks_for_more_than_a_better_fit():
    friction = next(h for h in CAUSES if h.cause == "coulomb_friction")
    before, counts = np.array([1.0, 1.0]), np.array([1000, 1000])

    def gain(squares):
        one = Solved(friction, np.zeros(1), np.array([squares]), np.zeros(1))
        return bic(Found(one, (1,)), before, counts)

    assert gain(0.996) < 0.0 < gain(0.98)


def test_bad_folders_and_names(tmp_path, capsys):
    bench = ["bench", "diagnose", "--out", str(tmp_path / "out")]
    cases = [
        (["--folder", str(tmp_path)], "answers.json: no such file"),
        (["--robots", "nobody"], "--robots nobody is unknown; choose from arm_servo"),
        (
            ["--causes", "magic", "--robots", "arm_servo"],
            "gatjax: magic: unknown; kinds are",
        ),
        (["--cases", "0"], "--cases is 0"),
        (["--jobs", "0"], "--jobs is 0"),
        (["--folder", str(tmp_path), "--causes", "backlash"], "--causes chooses"),
    ]
    for flags, text in cases:
        assert main([*bench, *flags]) == 1
        assert text in capsys.readouterr().err.splitlines()[-1]


def test_diagnoses_are_not_marked_by_the_answers_of_other_cases(tmp_path):
    verb = BenchDiagnose(folder=tmp_path / "set", out=tmp_path / "out")
    verb.out.mkdir()
    old, new = (
        Case("h3_0000", tmp_path, (), (), ("a",), {"id": "h3_0000", "d": d})
        for d in (3.0, 4.0)
    )
    _check_out(verb, [old])
    _check_out(verb, [old, new._replace(name="h3_0001")])  # more cases may follow
    _check_out(verb, [old])
    with pytest.raises(ValueError, match=r"started with truth\.h3_0000"):
        _check_out(verb, [new])
    with pytest.raises(ValueError, match=r"started with truth\.h3_0001"):
        _check_out(verb, [old._replace(name="h3_0001")])


def test_cases_that_are_there_are_not_made_again(tmp_path):
    wanted = {
        "cases": 2, "seed": 5, "kinds": ["null"], "robots": ["arm_servo"],
        "causes": [], "least_visibility": 0.8,
    }  # fmt: skip
    folder, seen = tmp_path / "set", []

    def stopping(done, count):
        seen.append(done)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make(folder, wanted, stopping)
    (held,) = read_cases(folder)[0].held
    kept = held.stat().st_mtime_ns
    make(folder, wanted, lambda done, count: seen.append(done))
    assert seen == [1, 2]
    assert len(read_cases(folder)) == 2
    assert held.stat().st_mtime_ns == kept
    with pytest.raises(ValueError, match="seed"):
        make(folder, wanted | {"seed": 1}, lambda done, count: None)
    (folder / "asked.json").unlink()
    with pytest.raises(ValueError, match="unknown origin"):
        make(folder, wanted, lambda done, count: None)
