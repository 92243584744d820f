"""The run folder: written before the work, readable after a kill, resumable."""

import errno
import fcntl
import json
import os
import re
import subprocess
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from gatjax.runs import (
    add_rows,
    held,
    latest_run,
    open_run,
    read_policy,
    read_table,
    resume_run,
    write_json,
    write_policy,
    write_whole,
)
from gatjax.runs.folder import FOLDERS
from gatjax.runs.tables import TABLES
from gatjax.walk.parameters import PARAMETERS

THETA0 = np.array([parameter.theta0 for parameter in PARAMETERS])


@dataclass(frozen=True, kw_only=True)
class Search:
    population: int = 150
    alphas: tuple[float, ...] = (0.5, 1.0)


@dataclass(frozen=True, kw_only=True)
class Run:
    seed: int = 0
    out: Path = Path("runs")
    search: Search = field(default_factory=Search)


def disk_full(_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def refusal(error, act, *arguments):
    with pytest.raises(error) as caught:
        act(*arguments)
    line = str(caught.value)
    assert "\n" not in line
    return line


def test_a_new_run_has_its_name_settings_and_folders(tmp_path):
    run = open_run(tmp_path / "runs", Run())
    assert re.fullmatch(r"\d{8}-\d{6}-[0-9a-f]{8}", run.path.name)
    assert json.loads((run.path / "config.json").read_text()) == {
        "seed": 0,
        "out": "runs",
        "search": {"population": 150, "alphas": [0.5, 1.0]},
    }
    assert all((run.path / folder).is_dir() for folder in FOLDERS)


def test_the_digest_in_the_name_changes_with_a_nested_setting(tmp_path):
    names = [
        open_run(tmp_path / str(size), Run(search=Search(population=size))).path.name
        for size in (150, 151)
    ]
    assert names[0][-8:] != names[1][-8:]


def test_the_environment_names_versions_and_device(tmp_path):
    run = open_run(tmp_path, Run(), "a", device="cpu:0")
    environment = json.loads((run.path / "environment.json").read_text())
    assert environment["packages"]["numpy"] == np.__version__
    assert set(environment["packages"]) == {
        *("gatjax", "jax", "mujoco", "mujoco-mjx"),
        *("dartpy", "evosax", "numba", "numpy"),
    }
    assert environment["device"] == "cpu:0"
    assert environment["cpu_count"] == os.cpu_count()
    assert {"python", "platform", "commit"} <= set(environment)
    assert environment["seed"] == 0
    other = open_run(tmp_path, Search(), "b").path / "environment.json"
    assert "seed" not in json.loads(other.read_text())


def test_a_run_that_exists_is_not_written_over(tmp_path):
    open_run(tmp_path, Run(), "a")
    line = refusal(FileExistsError, open_run, tmp_path, Run(seed=1), "a")
    assert "exists already; resume it or choose another name" in line
    assert resume_run(tmp_path / "a").config["seed"] == 0


def test_a_full_disk_leaves_no_run_behind(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "fsync", disk_full)
    line = refusal(OSError, open_run, tmp_path, Run(), "a")
    assert "No space left on device" in line
    assert list(tmp_path.iterdir()) == []


def test_a_run_is_resumed_with_the_settings_it_was_started_with(tmp_path):
    run = open_run(tmp_path, Run(seed=3), "a")
    assert resume_run(run.path, Run(seed=3)) == run
    assert resume_run(run.path) == run


@pytest.mark.parametrize(
    ("config", "says"),
    [
        (Run(seed=1), "started with seed = 0, now it is 1"),
        (
            replace(Run(), search=Search(population=10)),
            "started with search.population = 150, now it is 10",
        ),
        (
            replace(Run(), search=Search(alphas=(0.5,))),
            "started with search.alphas = [0.5, 1.0], now it is [0.5]",
        ),
    ],
)
def test_resuming_with_another_setting_is_refused_by_its_name(tmp_path, config, says):
    run = open_run(tmp_path, Run(), "a")
    assert says in refusal(ValueError, resume_run, run.path, config)


def test_a_setting_that_is_gone_is_refused(tmp_path):
    run = open_run(tmp_path, Run(), "a")
    write_json(run.path / "config.json", {**run.config, "old": 1})
    line = refusal(ValueError, resume_run, run.path, Run())
    assert "old = 1, now it is None" in line


def test_two_do_not_work_in_a_folder_at_a_time(tmp_path):
    with (
        held(tmp_path),
        pytest.raises(ValueError, match="another gatjax is at work in it"),
        held(tmp_path),
    ):
        pass
    with held(tmp_path):
        pass
    assert not list(tmp_path.iterdir())


def test_a_folder_is_free_when_its_process_is_killed(tmp_path):
    program = (
        "import sys, time; from pathlib import Path; from gatjax.runs import held\n"
        "with held(Path(sys.argv[1])):\n print('held', flush=True); time.sleep(60)"
    )
    line = [sys.executable, "-c", program, str(tmp_path)]
    with subprocess.Popen(line, stdout=subprocess.PIPE) as other:
        assert other.stdout.readline() == b"held\n"
        with pytest.raises(ValueError, match="another gatjax"), held(tmp_path):
            pass
        other.kill()
    with held(tmp_path):
        pass


def test_a_folder_is_worked_in_where_there_are_no_locks(tmp_path, monkeypatch):
    def lacking(place, kind):
        raise OSError(errno.ENOTSUP, "not supported")

    monkeypatch.setattr(fcntl, "flock", lacking)
    with held(tmp_path):
        pass


def test_a_folder_that_is_no_run_lists_the_runs_beside_it(tmp_path):
    open_run(tmp_path, Run(), "a")
    line = refusal(FileNotFoundError, resume_run, tmp_path / "b")
    assert line.endswith(f"runs in {tmp_path}: a")


def test_the_latest_run_is_the_one_started_last_whatever_its_name(tmp_path):
    for name in ("b", "c", "a"):
        open_run(tmp_path, Run(), name)
    assert latest_run(tmp_path).name == "a"


def test_no_run_at_all_is_said(tmp_path):
    assert "no run here" in refusal(FileNotFoundError, latest_run, tmp_path)


def test_a_policy_comes_back_from_its_file(tmp_path):
    path = write_policy(tmp_path, "theta0", THETA0, {"method": "theta0"})
    assert path == tmp_path / "theta0.json"
    np.testing.assert_array_equal(read_policy(path), THETA0)
    tree = json.loads(path.read_text())
    assert tree["schema"] == "gatjax.policy/1"
    assert (tree["robot"], tree["engine"]) == ("nao", "walk2014-ut15")
    assert tree["made_by"] == {"method": "theta0"}
    assert tree["parameters"] == {
        p.name: {"value": p.theta0, "unit": p.unit} for p in PARAMETERS
    }


@pytest.mark.parametrize("side", ["low", "high"])
def test_a_policy_on_its_bounds_survives_float32(tmp_path, side):
    theta = np.array([getattr(p, side) for p in PARAMETERS], np.float32)
    path = write_policy(tmp_path, "edge", theta, {})
    np.testing.assert_array_equal(read_policy(path), theta)


def edit(path, change):
    tree = json.loads(path.read_text())
    change(tree)
    path.write_text(json.dumps(tree))


FIRST = PARAMETERS[0]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            lambda t: t.update(robot="pepper"),
            "robot is 'pepper', gatjax walks with 'nao",
        ),
        (lambda t: t.update(engine="zmp"), "engine is 'zmp'"),
        (lambda t: t.update(schema="gatjax.policy/2"), "schema is 'gatjax.policy/2'"),
        (lambda t: t.pop("robot"), "robot is None"),
        (lambda t: t.pop("parameters"), "'parameters' must hold"),
        (
            lambda t: t["parameters"].update(speed=1),
            "unknown parameter speed; known are",
        ),
        (
            lambda t: t["parameters"].pop(FIRST.name),
            f"parameter {FIRST.name} is missing",
        ),
        (
            lambda t: t["parameters"][FIRST.name].update(value=FIRST.high + 1.0),
            f"it must be {FIRST.low:g} to {FIRST.high:g} {FIRST.unit}",
        ),
        (
            lambda t: t["parameters"][FIRST.name].update(value=float("nan")),
            f"{FIRST.name} is nan",
        ),
        (
            lambda t: t["parameters"][FIRST.name].update(value="0.1"),
            f"parameter {FIRST.name} must be",
        ),
        (
            lambda t: t["parameters"][FIRST.name].update(unit="inch"),
            f"unit of {FIRST.name} is 'inch'; it must be {FIRST.unit!r}",
        ),
        (lambda t: t["parameters"].update({FIRST.name: 0.1}), "must be {"),
    ],
)
def test_a_policy_that_does_not_fit_is_refused(tmp_path, change, says):
    path = write_policy(tmp_path, "theta0", THETA0, {})
    edit(path, change)
    line = refusal(ValueError, read_policy, path)
    assert says in line
    assert line.startswith(str(path))


def test_a_whole_number_in_a_policy_is_a_number(tmp_path):
    path = write_policy(tmp_path, "theta0", THETA0, {})
    index = [parameter.name for parameter in PARAMETERS].index("arm_swing")
    edit(path, lambda tree: tree["parameters"]["arm_swing"].update(value=5))
    assert read_policy(path)[index] == 5.0


def test_a_truncated_policy_is_refused(tmp_path):
    path = write_policy(tmp_path, "theta0", THETA0, {})
    path.write_text(path.read_text()[:40])
    assert "not JSON" in refusal(ValueError, read_policy, path)


def test_a_missing_policy_lists_those_that_are_there(tmp_path):
    write_policy(tmp_path, "theta0", THETA0, {})
    line = refusal(FileNotFoundError, read_policy, tmp_path / "gat.json")
    assert line.endswith("there are: theta0.json")


@pytest.mark.parametrize(
    ("theta", "says"),
    [
        (THETA0[:14], "shape (15,), not (14,)"),
        (np.full(15, np.nan), f"{FIRST.name} is nan"),
        (THETA0 + 1e3, f"{FIRST.name} is"),
    ],
)
def test_a_bad_policy_is_not_written(tmp_path, theta, says):
    assert says in refusal(ValueError, write_policy, tmp_path, "bad", theta, {})
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_the_old_policy(tmp_path, monkeypatch):
    path = write_policy(tmp_path, "theta0", THETA0, {})
    before = path.read_bytes()
    monkeypatch.setattr(os, "fsync", disk_full)
    line = refusal(OSError, write_policy, tmp_path, "theta0", THETA0, {"method": "x"})
    assert "nothing was changed" in line
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def metrics_row(generation, **values):
    key = {"method": "gat", "iteration": 0, "candidate": "best"}
    return {**key, "generation": generation, **values}


def test_table_headers_are_those_of_the_documentation(tmp_path):
    text = " ".join(
        (Path(__file__).parents[1] / "docs" / "files.md").read_text().split()
    )
    for name, table in TABLES.items():
        assert ", ".join(table.key + table.values) in text, name
        add_rows(tmp_path / name, [])
        header = (tmp_path / name).read_text()
        assert header == ",".join(table.key + table.values) + "\n"
        assert read_table(tmp_path / name) == []


def test_rows_come_back_with_their_types_and_full_precision(tmp_path):
    path = tmp_path / "metrics.csv"
    add_rows(path, [metrics_row(1, simulator_cost=np.float64(0.1 + 0.2), sigma=1)])
    add_rows(path, [metrics_row(2, simulator_cost=-0.5, robot_falls=np.int64(3))])
    rows = read_table(path)
    assert [row["generation"] for row in rows] == [1, 2]
    assert rows[0]["simulator_cost"] == 0.1 + 0.2
    assert rows[0]["robot_falls"] is None
    assert rows[1]["robot_falls"] == 3
    assert isinstance(rows[1]["robot_falls"], int)
    assert rows[1]["method"] == "gat"


def test_a_walk_that_never_fell_is_read_as_infinite(tmp_path):
    path = tmp_path / "evaluations.csv"
    row = {**metrics_row(1), "seed": 7, "velocity_m_s": 0.2, "fell_at_s": np.inf}
    add_rows(path, [row])
    assert read_table(path) == [row]


def test_a_row_with_a_known_key_fills_in_that_row(tmp_path):
    path = tmp_path / "metrics.csv"
    add_rows(path, [metrics_row(g, simulator_cost=float(g)) for g in (1, 2)])
    add_rows(path, [metrics_row(1, robot_velocity_m_s=0.25)])
    rows = read_table(path)
    assert len(rows) == 2
    assert rows[0]["simulator_cost"] == 1.0
    assert rows[0]["robot_velocity_m_s"] == 0.25
    assert rows[1]["robot_velocity_m_s"] is None


@pytest.mark.parametrize("cut", range(1, 12))
def test_a_truncated_last_line_is_dropped_and_then_written_again(tmp_path, cut):
    path = tmp_path / "metrics.csv"
    row = metrics_row(2, simulator_cost=-0.25, seconds=1.5)
    add_rows(path, [metrics_row(1, simulator_cost=-0.125), row])
    whole = path.read_bytes()
    path.write_bytes(whole[:-cut])
    assert [r["generation"] for r in read_table(path)] == [1]
    add_rows(path, [row])
    assert path.read_bytes() == whole


def test_a_truncated_header_is_an_empty_table(tmp_path):
    path = tmp_path / "metrics.csv"
    path.write_text("method,itera")
    assert read_table(path) == []


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        ([{**metrics_row(1), "speed": 1.0}], "unknown column speed; it has method"),
        ([{"method": "gat"}], "a row needs method, iteration, generation, candidate"),
        ([metrics_row(1), metrics_row(1)], "two rows for gat, 0, 1, best"),
        ([metrics_row(1, sigma="wide")], "column 'sigma': 'wide' is not a number"),
        ([{**metrics_row(1), "method": "g\nat"}], "is not one line"),
    ],
)
def test_rows_that_do_not_fit_are_refused_and_nothing_is_written(tmp_path, rows, says):
    path = tmp_path / "metrics.csv"
    assert says in refusal(ValueError, add_rows, path, rows)
    assert not path.exists()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a,b\n", "the header is not method,iteration,joint"),
        (
            "method,iteration,joint,horizon_s,before_rad,after_rad\ngat,0,HeadYaw\n",
            "row 1 has 3 cells, not 6",
        ),
        (
            "method,iteration,joint,horizon_s,before_rad,after_rad\n"
            "gat,0,HeadYaw,0.5,1.0,2.0\ngat,0,HeadYaw,0.02,x,2.0\n",
            "row 2, column 'before_rad': 'x' is not a number",
        ),
    ],
)
def test_a_table_that_makes_no_sense_is_refused(tmp_path, text, says):
    path = tmp_path / "prediction.csv"
    path.write_text(text)
    assert says in refusal(ValueError, read_table, path)


def test_another_file_name_is_no_table(tmp_path):
    line = refusal(ValueError, add_rows, tmp_path / "other.csv", [])
    assert line.endswith("those are metrics.csv, prediction.csv, evaluations.csv")


def test_a_full_disk_leaves_the_old_table(tmp_path, monkeypatch):
    path = tmp_path / "metrics.csv"
    add_rows(path, [metrics_row(1)])
    before = path.read_bytes()
    monkeypatch.setattr(os, "fsync", disk_full)
    refusal(OSError, add_rows, path, [metrics_row(2)])
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_of_several_files_it_is_said_which_are_new_if_one_cannot_be_put(tmp_path):
    """What is full or forbidden shows before the first; only a place that is taken."""
    one, two, three = (tmp_path / name for name in ("one", "two", "three"))
    two.mkdir()
    one.write_text("old")
    with pytest.raises(OSError, match="nothing was") as caught:
        write_whole({two: b"new", one: b"new"})
    assert one.read_text() == "old"
    with pytest.raises(OSError) as caught:
        write_whole({one: b"new", two: b"new", three: b"new"})
    line = str(caught.value)
    assert line.startswith(f"{two}: cannot be written (Is a directory); {one} is new")
    assert "nothing was changed" not in line and "\n" not in line
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one", "two"]
    assert one.read_text() == "new"
