"""What a log without a terminal hears of long work."""

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
