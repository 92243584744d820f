"""The loop: complete, resumable after any stop, and the same numbers either way."""

import dataclasses
import shutil

import numpy as np
import pytest
from short_walks import SHORT

from gatjax import loop, runs
from gatjax.loop import stages
from gatjax.loop.setting import Entry, Setting
from gatjax.report import build_report
from gatjax.settings import (
    CONFIRMATION,
    EVALUATION,
    EXPLANATION,
    LAST,
    ROBOT_LOG,
    SIMULATOR_LOG,
    LoopSettings,
    SearchSettings,
)
from gatjax.settings import (
    seeds as seeds_of,
)
from gatjax.sim.world import add_cause, nominal
from gatjax.surrogate import make_robot
from gatjax.walk.parameters import THETA0

SETTINGS = LoopSettings(
    methods=("none", "gat"),
    robot_trajectories=5,
    simulator_trajectories=5,
    evaluations=2,
    search=SearchSettings(population=4, rollouts=2, generations=2),
    iterations=1,
    backend="native",
)


pytestmark = pytest.mark.usefixtures("short_walks")


class Late(loop.Simulator):
    """A robot that answers late: quick to simulate, different from the simulator."""

    name = "late"

    def __init__(self):
        super().__init__(add_cause(nominal(SHORT), "command_delay", ["all"], 0.03))


@pytest.fixture(scope="module")
def robot():
    return Late()


def quiet(stop_at=None):
    """Progress that says nothing, or stops the loop as Ctrl-C does."""

    def stage(text):
        if text == stop_at:
            raise KeyboardInterrupt

    return loop.Progress(stage=stage, work=lambda units: None)


def without_seconds(path):
    rows = runs.read_table(path)
    key = ("method", "iteration", "generation", "candidate")
    rows.sort(key=lambda row: tuple(row[name] for name in key))
    return [{k: v for k, v in row.items() if k != "seconds"} for row in rows]


@pytest.fixture(scope="module")
def done(tmp_path_factory, robot):
    folder = runs.open_run(tmp_path_factory.mktemp("runs"), SETTINGS).path
    loop.run(folder, SETTINGS, robot, quiet())
    return folder


def test_a_run_leaves_what_the_contract_says(done):
    rows = without_seconds(done / "metrics.csv")
    chosen = [row for row in rows if row["candidate"] == "chosen"]
    assert len(rows) == 1 + 2 * 2 * 2 + len(chosen)  # theta0; methods x generations x 2
    assert {row["method"] for row in chosen} == {"none", "gat"}
    assert all(row["robot_rollouts"] == 10 for row in chosen)
    assert all(row["generation"] > 0 for row in chosen)
    assert all(row["robot_rollouts"] for row in rows)
    searched = [row for row in rows if row["candidate"] != "chosen"]
    searched = [row for row in searched if row["method"] != "theta0"]
    assert all(row["simulator_velocity_m_s"] is not None for row in searched)
    walks = runs.read_table(done / "evaluations.csv")
    assert len(walks) == 10 + 8 * 2 + len(chosen) * 10
    for method in ("none", "gat"):
        seeds = {
            kind: {
                row["seed"]
                for row in walks
                if row["method"] == method and (row["candidate"] == "chosen") == kind
            }
            for kind in (True, False)
        }
        assert seeds[True] and not seeds[True] & seeds[False]
    horizons = {row["horizon_s"] for row in runs.read_table(done / "prediction.csv")}
    assert horizons == {0.02, 0.5}
    for name in ("theta0", "gat_0_1_best", "none_0_0_mean"):
        assert runs.read_policy(done / "policies" / f"{name}.json").shape == (15,)
    for name in ("recordings/robot_0.parquet", "recordings/simulator_0.parquet"):
        assert (done / name).is_file()
    assert (done / "walks" / "gat_best_robot.npz").is_file()
    assert build_report(done).stat().st_size > 50_000


class Begun(list):
    """Seeds of walks that were begun."""


class Wandering(Late):
    """A robot that walks in processes of its own."""

    def __init__(self, told):
        super().__init__()
        self.told = told

    def walk(self, policies, seeds, task):
        self.told.append(list(seeds))
        return super().walk(policies, seeds, task)

    def begin_walks(self, policies, seeds, task):
        self.told.append(Begun(seeds))

        def wait():
            self.told.append("wait")
            return super(Wandering, self).walk(policies, seeds, task)[1]

        return wait

    def drop_walks(self):
        self.told.append("drop")


def test_trials_side_by_side_walk_together_and_each_finds_what_it_finds_alone(
    tmp_path, done
):
    one = dataclasses.replace(SETTINGS, methods=("none",))
    both = [one, dataclasses.replace(one, seed=1)]
    folders = [runs.open_run(tmp_path / str(each.seed), each).path for each in both]
    told = []
    loop.run_all(folders, both, Wandering(told), quiet())
    # theta0 confirmed and shown, two logs, two times candidates, winners, best shown
    told = [seeds for seeds in told if seeds != "wait"]
    assert [len(seeds) for seeds in told] == [20, 2, 5, 5, 8, 8, 20, 2]
    whole = [not isinstance(seeds, Begun) for seeds in told]  # with trajectories
    assert whole == [False, True, True, True, False, False, False, True]
    for seeds in (told[0], told[1], told[6], told[7]):  # of both trials, all different
        assert len(set(seeds)) == len(seeds)
    alone = [
        row
        for row in without_seconds(done / "metrics.csv")
        if row["method"] in ("none", "theta0")
    ]
    assert without_seconds(folders[0] / "metrics.csv") == alone
    assert without_seconds(folders[1] / "metrics.csv") != alone
    for folder in folders:
        assert len(runs.read_table(folder / "evaluations.csv")) == 10 + 8 + 10
        assert (folder / "walks" / "none_best_robot.npz").is_file()


def shown(seeds):
    """Whether walks were begun, and how many."""
    return f"begin {len(seeds)}" if isinstance(seeds, Begun) else len(seeds)


def searching(told, monkeypatch):
    """Let a search find a policy a generation at once, and say what it began with."""

    def search(alike, iteration, thetas):
        name = alike[0][1].name
        told.append((name, iteration, *(theta[0] for theta in thetas)))
        step = {"none": 1.01, "gat": 0.99}[name]
        return [
            [
                loop.Candidate(name, iteration, n, "best", step**n * theta)
                for n in range(2)
            ]
            for theta in thetas
        ]

    monkeypatch.setattr(stages, "search", search)


def test_a_robot_elsewhere_walks_while_the_next_search_goes_on(
    tmp_path, monkeypatch, robot
):
    told, folders, said = [], [], []
    searching(told, monkeypatch)
    for name, backend, walker in (
        ("a", "mjx", Wandering(told)),
        ("b", "native", Wandering(told)),
        ("c", "mjx", robot),
    ):
        settings = dataclasses.replace(
            SETTINGS, candidates=("best",), backend=backend, impl="jax"
        )
        folders.append(runs.open_run(tmp_path, settings, name).path)
        loop.run(folders[-1], settings, walker, quiet())
        said.append([x if isinstance(x, str | tuple) else shown(x) for x in told])
        told.clear()
    none, gat = ((name, 0, THETA0[0]) for name in ("none", "gat"))
    theta0 = ["begin 10", "wait", 1]
    winners = ["begin 20", "wait", 2]
    four = ["begin 4", "wait"]
    beside = [none, "begin 4", gat, "begin 4", "wait", "wait"]
    assert said[0] == [*theta0, *beside, *winners]
    assert said[1] == [*theta0, none, *four, gat, *four, *winners]
    for name in ("metrics.csv", "evaluations.csv"):
        one, other, third = (rows_of(folder / name) for folder in folders)
        assert one == other == third


def test_every_method_goes_on_from_its_own_best_walk(tmp_path, monkeypatch, robot):
    told = []
    searching(told, monkeypatch)
    settings = dataclasses.replace(SETTINGS, candidates=("best",), iterations=2)
    loop.run(runs.open_run(tmp_path, settings).path, settings, robot, quiet())
    assert [each[:2] for each in told] == [
        ("none", 0), ("gat", 0), ("none", 1), ("gat", 1)
    ]  # fmt: skip
    begun = [each[2] / THETA0[0] for each in told]
    np.testing.assert_allclose(begun, [1.0, 1.0, 1.01, 0.99])


def test_a_stop_drops_walks_that_were_begun_and_they_are_made_again(
    tmp_path, monkeypatch, robot
):
    told, tables = [], []
    searching(told, monkeypatch)
    settings = dataclasses.replace(SETTINGS, candidates=("best",), backend="mjx")
    folder = runs.open_run(tmp_path, settings, "stopped").path
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        found = stages.search

        def stopped(alike, iteration, thetas):
            if alike[0][1].name == "gat":
                raise KeyboardInterrupt
            return found(alike, iteration, thetas)

        patch.setattr(stages, "search", stopped)
        loop.run(folder, settings, Wandering(told), quiet())
    assert told[-1] == "drop" and shown(told[-2]) == "begin 4"
    whole = runs.open_run(tmp_path, settings, "whole").path
    for each in (folder, whole):
        loop.run(each, settings, Wandering(told), quiet())
        tables.append(rows_of(each / "evaluations.csv"))
    assert tables[0] == tables[1]
    assert len(tables[0]) == 10 + 2 * 4 + 2 * 10


def _is_check(path, rows):
    """The rows that measure the candidates of a finished search in the simulator."""
    return "simulator_falls" in rows[0]


def _is_robot_summary(path, rows):
    """The second table that an evaluation on the robot writes."""
    return "robot_falls" in rows[0]


STOPS = (  # in the order in which a run meets them
    (None, "gat: ground the simulator"),
    (None, "gat: generation 1 (last: 1)"),
    (_is_check, None),  # after the last checkpoint of the search
    (None, "gat: walk on the robot"),
    (_is_robot_summary, None),  # between two tables
)


def test_a_run_that_is_stopped_anywhere_goes_on_with_the_same_numbers(
    done, robot, tmp_path, monkeypatch
):
    folder = tmp_path / "run"
    shutil.copytree(done, folder)
    for path in folder.glob("**/gat_*"):
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    tables = ("metrics.csv", "evaluations.csv", "prediction.csv")
    for name in tables:
        lines = (folder / name).read_text().splitlines(keepends=True)
        (folder / name).write_text("".join(x for x in lines if not x.startswith("gat")))
    add_rows = runs.add_rows
    for rows_to_stop_at, stage in STOPS:

        def add_or_stop(path, rows, last=rows_to_stop_at):
            if last is not None and last(path, rows):
                raise KeyboardInterrupt
            add_rows(path, rows)

        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(runs, "add_rows", add_or_stop)
            loop.run(folder, SETTINGS, robot, quiet(stage))
    loop.run(folder, SETTINGS, robot, quiet())
    for name in tables:
        assert rows_of(folder / name) == rows_of(done / name)
    for path in (done / "policies").glob("*.json"):
        np.testing.assert_array_equal(
            runs.read_policy(path), runs.read_policy(folder / "policies" / path.name)
        )


def rows_of(path):
    """Rows of a table in a fixed order, without the times that differ."""
    rows = [{**row, "seconds": None} for row in runs.read_table(path)]
    return sorted(rows, key=lambda row: [str(value) for value in row.values()])


def test_a_finished_run_does_nothing_again(done, tmp_path):
    class Idle:
        name = "late"

        def constants(self):
            return {}

        def walk(self, policies, seeds, task=None):
            raise AssertionError("the robot must not walk again")

    folder = tmp_path / "run"
    shutil.copytree(done, folder)
    shutil.rmtree(folder / "recordings")  # what was learned from them is there
    loop.run(folder, SETTINGS, Idle(), quiet())


def test_a_run_does_not_go_on_with_another_robot(done, robot, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(done, folder)
    before = (folder / "robot.json").read_text()
    other = loop.Simulator(robot.world)
    with pytest.raises(
        ValueError, match="begun with the robot 'late', not 'simulator'"
    ):
        loop.run(folder, SETTINGS, other, quiet())
    assert (folder / "robot.json").read_text() == before


def test_a_run_does_not_go_on_with_another_body_of_a_robot(tmp_path):
    for _ in range(2):
        stages.name_robot(tmp_path, make_robot("stiff", 0))
    with pytest.raises(ValueError, match="'stiff, body 0', not 'stiff, body 1'"):
        stages.name_robot(tmp_path, make_robot("stiff", 1))


def test_a_run_does_not_go_on_with_other_settings(done, robot, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(done, folder)
    other = dataclasses.replace(SETTINGS.search, sigma=0.1)
    changed = dataclasses.replace(SETTINGS, search=other)
    said = f"started with search.sigma = {SETTINGS.search.sigma}, now it is 0.1"
    with pytest.raises(ValueError, match=said):
        loop.run(folder, changed, robot, quiet())
    fewer = dataclasses.replace(SETTINGS, methods=("none",))
    loop.run(folder, fewer, robot, quiet())  # what is compared may change


def test_a_second_iteration_starts_from_the_best_walk(robot, tmp_path):
    settings = LoopSettings(
        methods=("gat",), robot_trajectories=4, simulator_trajectories=4, evaluations=1,
        search=SearchSettings(population=4, rollouts=1, generations=1), iterations=2,
        backend="native",
    )  # fmt: skip
    folder = runs.open_run(tmp_path, settings).path
    loop.run(folder, settings, robot, quiet())
    names = sorted(path.name for path in (folder / "recordings").iterdir())
    assert names == [
        "robot_0.parquet", "robot_1_gat.parquet",
        "simulator_0.parquet", "simulator_1_gat.parquet",
    ]  # fmt: skip
    iterations = {row["iteration"] for row in runs.read_table(folder / "metrics.csv")}
    assert iterations == {0, 1}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"methods": ("gatt",)}, "method 'gatt' is unknown; choose from"),
        ({"methods": ("gat", "gat")}, "name one twice"),
        ({"methods": ()}, "no methods given"),
        ({"search": SearchSettings(generations=0)}, "generations is 0; use 1 or more"),
        ({"evaluations": 0}, "evaluations is 0; use 1 or more"),
        ({"seed": -1}, "seed is -1; use 0 to 9999"),
        ({"seed": 10_000}, "seed is 10000; use 0 to 9999"),
        ({"body_seed": -1}, "body_seed is -1; use 0 or more"),
        ({"robot_trajectories": 1}, "robot_trajectories is 1; use 4 or more"),
        ({"rate_hz": 60.0}, "rate 60.0 Hz is unknown; choose from"),
        ({"backend": "gpu"}, "backend 'gpu' is unknown; choose from"),
        ({"backend": "native", "impl": "wrap"}, "impl 'wrap' is unknown; choose from"),
        ({"backend": "mjx", "impl": "warp"}, "warp"),
    ],
)
def test_wrong_settings_are_refused_before_any_work(change, message):
    with pytest.raises(ValueError, match=message):
        loop.resolved(LoopSettings(**change))


def test_no_seed_that_a_run_may_have_shares_walks_with_another_purpose():
    purposes = (ROBOT_LOG, SIMULATOR_LOG, EVALUATION, CONFIRMATION, EXPLANATION)
    firsts = [seeds_of(each, seed, 1)[0] for each in purposes for seed in (0, 1, LAST)]
    assert np.diff(np.sort(firsts)).min() >= 10**5
    assert seeds_of(ROBOT_LOG, LAST + 1, 9) == seeds_of(SIMULATOR_LOG, 0, 9)


def test_policies_that_are_best_in_more_rollouts_walk_on_the_robot(robot, tmp_path):
    kinds = "best", "rechecked"
    settings = dataclasses.replace(SETTINGS, methods=("none",), candidates=kinds)
    folder = runs.open_run(tmp_path, settings, "run").path
    loop.run(folder, settings, robot, quiet())
    rows = [r for r in without_seconds(folder / "metrics.csv") if r["method"] == "none"]
    found = {(row["generation"], row["candidate"]) for row in rows}
    assert found >= {(number, kind) for number in range(2) for kind in kinds}
    before = without_seconds(folder / "evaluations.csv")
    policies = {path: path.read_text() for path in folder.glob("policies/none_0_1_*")}
    for path in policies:
        path.unlink()
    shutil.rmtree(folder / "checkpoints" / "none_0" / "1")
    loop.run(folder, settings, robot, quiet())
    assert without_seconds(folder / "evaluations.csv") == before
    assert len(policies) == len(kinds)
    for path, text in policies.items():
        assert path.read_text() == text
    assert "in more rollouts" in build_report(folder).read_text()


def test_an_oracle_searches_on_the_robot_itself(robot, tmp_path):
    asked = []

    class Watched(Late):
        def walk(self, policies, seeds, task):
            asked.append((np.asarray(policies), np.asarray(seeds)))
            return super().walk(policies, seeds, task)

    settings = dataclasses.replace(SETTINGS, methods=("oracle",), candidates=("mean",))
    folder = runs.open_run(tmp_path, settings, "run").path
    loop.run(folder, settings, Watched(), quiet())
    rows = without_seconds(folder / "metrics.csv")
    found = [row for row in rows if row["method"] == "oracle"]
    assert {row["candidate"] for row in found} <= {"mean", "chosen"}
    assert {row["generation"] for row in found} == {0, 1}
    assert not (folder / "recordings" / "robot_0.parquet").exists()
    searched = [each for each in asked if len(each[0]) == 8]  # 4 policies, 2 walks
    assert len(searched) == 2
    policies, drawn = searched[0]
    np.testing.assert_array_equal(drawn, np.tile(drawn[:2], 4))  # the same for all
    assert len(np.unique(policies, axis=0)) == 4
    assert set(drawn).isdisjoint(row["seed"] for row in runs.read_table(
        folder / "evaluations.csv"))  # fmt: skip
    count = len(asked)
    loop.run(folder, settings, Watched(), quiet())
    assert len(asked) == count
    assert build_report(folder).is_file()


def test_trials_are_grouped_by_entry_also_where_one_lacks_it(tmp_path):
    world, settings = nominal(SHORT), LoopSettings()
    still = runs.Progress(lambda text: None, lambda units: None)
    one, other = (
        Setting(tmp_path, settings, SHORT, world, loop.Simulator(world), still)
        for _ in range(2)
    )
    none, gat, more = (Entry(name, "gat", world) for name in ("none", "gat", "more"))
    trials = [(one, none), (one, gat), (other, none), (other, gat), (other, more)]
    places = [
        [(setting is other, entry.name) for setting, entry in alike]
        for alike in stages.by_entry(trials)
    ]
    assert places == [
        [(False, "none"), (True, "none")],
        [(False, "gat"), (True, "gat")],
        [(True, "more")],
    ]


class Clumsy(Late):
    """A robot that only theta0 gets over."""

    name = "clumsy"

    def walk(self, policies, seeds, task=SHORT):
        walk, outcome = super().walk(policies, seeds, task)
        known = (np.asarray(policies) == THETA0).all(axis=1)
        return walk, outcome._replace(fell_at=np.where(known, np.inf, 0.1))


def test_no_walk_is_shown_as_the_best_of_a_method_that_found_none(
    tmp_path, monkeypatch
):
    searching([], monkeypatch)
    settings = dataclasses.replace(SETTINGS, candidates=("best",), methods=("gat",))
    monkeypatch.setattr(stages, "search", lambda alike, iteration, thetas: [
        [loop.Candidate("gat", iteration, 1, "best", 1.01 * theta)] for theta in thetas
    ])  # fmt: skip
    folder = runs.open_run(tmp_path, settings).path
    loop.run(folder, settings, Clumsy(), quiet())
    assert [path.name for path in (folder / "walks").iterdir()] == ["theta0_robot.npz"]
