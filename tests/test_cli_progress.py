"""What a log without a terminal hears of long work."""

import itertools

from gatjax.cli import progress


def test_a_stage_that_goes_on_is_told_again(monkeypatch, capsys):
    monkeypatch.setattr(progress, "QUIET", 0.0)
    with progress.shown(1.0) as teller:
        teller.stage("search")
        teller.work(0.5)
    first, again = capsys.readouterr().err.splitlines()
    assert first.endswith("0%] search")
    assert " 50%, about " in again and again.endswith("] search")


def test_a_stage_is_told_once_if_it_is_short(capsys):
    with progress.shown(1.0) as teller:
        teller.stage("search")
        teller.work(0.5)
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_the_time_left_is_told_until_all_is_done(monkeypatch, capsys):
    monkeypatch.setattr(progress, "QUIET", 0.0)
    now = iter([0.0, 0.0, 50.0, 50.0, 58.0, 58.0, 100.0, 100.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(now))
    with progress.shown(10.0) as teller:
        teller.stage("search")
        teller.work(2.0)
        teller.work(3.0)
        teller.work(5.0)
    said = [line.split("]")[0] for line in capsys.readouterr().err.splitlines()]
    assert said == [
        "[    0 s,   0%", "[   50 s,  20%, about 3.3 min left",
        "[   58 s,  50%, about 58 s left", "[  100 s, 100%",
    ]  # fmt: skip


def test_no_bar_runs_over_what_a_person_is_asked(monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with progress.shown_beside("lola:/tmp/nao.sock", 1.0) as teller:
        teller.stage("2 walks")
    assert capsys.readouterr().err == "[    0 s,   0%] 2 walks\n"


def test_a_bar_is_where_it_does_not_mix_with_results(monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with progress.shown(1.0) as teller:
        teller.stage("10 walks")
        teller.work(1.0)
    said = capsys.readouterr()
    assert said.out == "" and "10 walks" in said.err


def test_what_was_done_before_says_nothing_of_the_time_left(monkeypatch, capsys):
    monkeypatch.setattr(progress, "QUIET", 0.0)
    now = itertools.chain([0.0, 0.0, 5.0], itertools.repeat(10.0))
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(now))
    with progress.shown(100.0) as teller:
        teller.stage("search")
        teller.past(50.0)
        teller.work(5.0)
    assert "55%, about 1.5 min left" in capsys.readouterr().err.splitlines()[-1]


def test_a_bar_begins_with_what_was_done_before(monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with progress.shown(100.0) as teller:
        teller.stage("search")
        teller.past(50.0)
        teller.work(5.0)
        teller.past(0.0)
    said = capsys.readouterr().err
    assert "55%" in said and "search" in said
