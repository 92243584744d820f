"""Trials of an experiment: they go on, with more methods, but not with other sizes."""

import contextlib
import dataclasses
import json

import pytest

from gatjax import loop, runs
from gatjax.benchmark import trials
from gatjax.settings import LoopSettings, SearchSettings

SETTINGS = loop.resolved(
    LoopSettings(methods=("none",), search=SearchSettings(population=4))
)


class Nobody:
    name = "nobody"


def test_explained_is_a_method_among_others():
    settings = trials.with_methods(SETTINGS, ["gat", "explained", "sgat"])
    assert settings.methods == ("gat", "sgat")
    assert settings.explain
    assert not trials.with_methods(SETTINGS, ["gat"]).explain
    alone = trials.with_methods(SETTINGS, ["explained"])
    assert loop.resolved(alone).methods == ()


def test_a_trial_goes_on_with_more_methods_and_keeps_what_it_has(tmp_path):
    folder = trials.opened(tmp_path, "stiff_0", SETTINGS)
    (folder / "policies" / "theta0.json").write_text("{}")
    more = trials.with_methods(SETTINGS, ["gat", "explained"])
    assert trials.opened(tmp_path, "stiff_0", more) == folder
    assert (folder / "policies" / "theta0.json").read_text() == "{}"
    config = json.loads((folder / "config.json").read_text())
    assert (config["methods"], config["explain"]) == (["none", "gat"], True)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"seed": 5}, "started with seed = 0, now it is 5"),
        ({"search": SearchSettings(population=8)}, "search.population = 4, now it is"),
        ({"candidates": ("best",)}, "started with candidates"),
    ],
)
def test_a_trial_of_another_size_is_refused(tmp_path, change, says):
    trials.opened(tmp_path, "stiff_0", SETTINGS)
    with pytest.raises(ValueError, match=says):
        trials.opened(tmp_path, "stiff_0", dataclasses.replace(SETTINGS, **change))
    config = json.loads((tmp_path / "stiff_0" / "config.json").read_text())
    assert config["seed"] == 0


def test_trials_run_the_loop_in_their_folders_and_report(tmp_path, monkeypatch):
    told = []
    monkeypatch.setattr(trials.loop, "run_all", lambda *what: told.append(what))
    monkeypatch.setattr(trials, "build_report", lambda folder: told.append(folder))

    @contextlib.contextmanager
    def shown(units):
        assert units == 2 * loop.total_work(SETTINGS)
        yield runs.Progress(print, print)

    robot, both = Nobody(), [dataclasses.replace(SETTINGS, seed=k) for k in (0, 1)]
    robot.constants = dict
    robot.walk = print
    folders = trials.run_trials(tmp_path, both, robot, shown)
    assert folders == [tmp_path / "dart_0", tmp_path / "dart_1"]
    assert told[0][:3] == (folders, both, robot)
    assert told[1:] == folders
