"""Going on from the command line: with the same search or run, or not at all."""

import dataclasses
import importlib
import json
import os
import shutil
import zipfile
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

from gatjax import loop, runs
from gatjax.cli import collecting, logs, main, resume, verbs
from gatjax.cli.film import film
from gatjax.cli.parsing import parse
from gatjax.cli.resume import resumed, world_digest
from gatjax.data.recording import Recording, write_recording
from gatjax.grounding.envelope import Envelope
from gatjax.grounding.learn import Grounding, write_grounding
from gatjax.hosts import Crew
from gatjax.loop.steps import physics
from gatjax.records import JOINTS, Base
from gatjax.settings import DEMO, EVALUATION, ROBOT_LOG, seeds
from gatjax.sim.stored import write_world
from gatjax.sim.world import add_cause, nominal
from gatjax.walk.parameters import THETA0


def refused(capsys, given):
    """Run the command line; return the one line with which it fails."""
    assert main(given) == 1
    lines = capsys.readouterr().err.strip().splitlines()
    lines = [line for line in lines if not line.startswith("[")]  # progress
    assert len(lines) == 1, lines
    return lines[0]


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """A search of one generation."""
    folder = tmp_path_factory.mktemp("found")
    assert main(search(folder)) == 0
    return folder


def search(folder, *more):
    return [
        "search", "--out", str(folder), "--population", "4", "--rollouts", "1",
        "--generations", "1", "--backend", "native", *more,
    ]  # fmt: skip


def world_file(folder, *causes):
    world = nominal()
    for cause, value in causes:
        world = add_cause(world, cause, ["all"], value)
    folder.mkdir(exist_ok=True)
    write_world(folder / "world.json", world, {}, None)
    return folder / "world.json"


def test_a_search_goes_on_in_its_own_folder_only(found, tmp_path, capsys):
    other = tmp_path / "other"
    theta = THETA0.copy()
    theta[0] += 0.001
    runs.write_policy(tmp_path, "start", theta, {})
    world = world_file(other, ("command_delay", 0.02))
    for more, says in (
        (["--world", str(world)], "world = None, now it is '"),
        (["--policy", str(tmp_path / "start.json")], "policy."),
        (["--seed", "1"], "seed = 0, now it is 1"),
        (["--backend", "mjx", "--impl", "jax"], "backend = 'native', now it is 'mjx'"),
        (["--rate-hz", "100"], "rate_hz = 50.0, now it is 100.0"),
        (["--population", "6"], "search.population = 4, now it is 6"),
        (["--rollouts", "2"], "search.rollouts = 1, now it is 2"),
    ):
        assert f"started with {says}" in refused(capsys, search(found, *more))


def test_more_generations_are_how_a_search_goes_on(found, tmp_path, capsys):
    folder = tmp_path / "found"
    shutil.copytree(found, folder)
    first = (folder / "policies" / "search_0_0_mean.json").read_bytes()
    assert main(search(folder, "--generations", "2")) == 0
    assert (folder / "policies" / "search_0_1_mean.json").is_file()
    assert (folder / "policies" / "search_0_0_mean.json").read_bytes() == first
    capsys.readouterr()
    assert "has 2 generations already" in refused(capsys, search(folder))


def test_a_folder_of_something_else_is_not_searched_in(found, tmp_path, capsys):
    folder = runs.open_run(tmp_path, DEMO, "run").path
    assert "not a search folder" in refused(capsys, search(folder))
    shutil.copytree(found, tmp_path / "old")
    (tmp_path / "old" / "config.json").unlink()
    assert "unknown world" in refused(capsys, search(tmp_path / "old"))


def test_the_digest_of_a_world_follows_its_file_and_its_grounding(tmp_path):
    plain = world_digest(world_file(tmp_path / "a"))
    assert plain == world_digest(world_file(tmp_path / "b"))
    assert plain != world_digest(world_file(tmp_path / "c", ("backlash", 0.01)))
    digests = set()
    for alpha in (0.5, 0.9):
        write_world(tmp_path / "world.json", nominal(), {}, ".")
        params = Envelope(np.float32(alpha), np.zeros(len(JOINTS), np.float32))
        write_grounding(tmp_path, Grounding("envelope", params, {}))
        digests.add(world_digest(tmp_path / "world.json"))
    assert len(digests) == 2


def test_the_digest_of_a_world_follows_what_its_model_includes(tmp_path):
    (tmp_path / "arm.xml").write_text(
        '<mujoco><include file="opt.xml"/><worldbody><body><joint name="a"/><geom '
        'size="0.1"/></body></worldbody><actuator><position joint="a"/></actuator>'
        "</mujoco>"
    )
    digests, simulators = set(), set()
    for gravity in (-9.8, -3.0):
        option = f'<mujoco><option gravity="0 0 {gravity}"/></mujoco>'
        (tmp_path / "opt.xml").write_text(option)
        world = nominal(source=tmp_path / "arm.xml")
        write_world(tmp_path / "world.json", world, {}, None)
        digests.add(world_digest(tmp_path / "world.json"))
        simulators.add(physics(world)["model"])
    assert len(digests) == len(simulators) == 2


# run --resume


@pytest.fixture
def started(tmp_path):
    """Two runs that did nothing yet; the later one has another seed."""
    settings = dataclasses.replace(loop.resolved(DEMO), backend="native")
    first = runs.open_run(tmp_path, settings, "first").path
    later = dataclasses.replace(settings, seed=7)
    return first, runs.open_run(tmp_path, later, "later").path


def test_resume_takes_the_latest_run_or_the_one_that_is_named(started, tmp_path):
    first, later = started
    given = ["run", "--resume", "--out", str(tmp_path)]
    folder, settings = resumed(parse(given))
    assert (folder, settings.seed) == (later, 7)
    folder, settings = resumed(parse([*given, "--run", str(first)]))
    assert (folder, settings.seed) == (first, 0)


def test_run_without_resume_is_refused(started, tmp_path, capsys):
    given = ["run", "--run", str(started[0]), "--out", str(tmp_path)]
    assert "goes with --resume" in refused(capsys, given)


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--seed", "3"], "seed = 7, now it is 3"),
        (["--generations=99"], "generations = 6, now it is 99"),
        (["--robot_trajectories", "9"], "robot_trajectories = 30, now it is 9"),
        (["--methods", "gat"], "started with methods"),
        (["--explain"], "explain = False, now it is True"),
        (["--preset", "paper"], "now it is"),
    ],
)
def test_flags_that_a_resumed_run_does_not_have_are_refused(
    started, tmp_path, capsys, flags, says
):
    line = refused(capsys, ["run", "--resume", "--out", str(tmp_path), *flags])
    assert "later: started with" in line and says in line


def test_flags_that_a_resumed_run_has_already_are_fine(started, tmp_path):
    given = ["run", "--resume", "--out", str(tmp_path), "--seed", "7"]
    assert resumed(parse([*given, "--population", "40"]))[0] == started[1]


def test_no_explain_is_a_setting_too(tmp_path, capsys):
    settings = dataclasses.replace(loop.resolved(DEMO), explain=True)
    runs.open_run(tmp_path, settings)
    given = ["run", "--resume", "--out", str(tmp_path)]
    assert resumed(parse(given))[1].explain
    line = refused(capsys, [*given, "--no-explain"])
    assert "explain = True, now it is False" in line


def test_a_run_from_before_explain_goes_on(started, tmp_path):
    file = started[1] / "config.json"
    config = json.loads(file.read_text())
    del config["explain"]
    file.write_text(json.dumps(config))
    assert not resumed(parse(["run", "--resume", "--out", str(tmp_path)]))[1].explain


def test_a_folder_with_another_config_is_no_run(found, capsys):
    line = refused(capsys, ["run", "--resume", "--run", str(found)])
    assert "not a run folder, it has no environment.json" in line
    runs.write_json(found / "environment.json", {})
    line = refused(capsys, ["run", "--resume", "--run", str(found)])
    (found / "environment.json").unlink()
    assert "config.json is not that of a run" in line


@pytest.mark.parametrize("finished", [True, False])
def test_a_finished_run_says_so(started, tmp_path, capsys, monkeypatch, finished):
    def work(folder, settings, robot, progress):
        if not finished:
            progress.stage("collect")

    monkeypatch.setattr(loop, "run", work)
    monkeypatch.setattr(verbs, "robot_named", lambda *_: None)
    monkeypatch.setattr(verbs, "build_report", lambda folder: folder / "report.html")
    monkeypatch.setattr(verbs, "headline", lambda folder: "GAT is faster.")
    assert main(["run", "--resume", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert ("finished already; its report is written again" in printed) is finished
    assert f"GAT is faster.\nreport {started[1] / 'report.html'}" in printed


def test_one_walk_has_no_spread():
    one = SimpleNamespace(velocity=np.array([0.2]), fell_at=np.array([2.0]))
    two = SimpleNamespace(velocity=np.array([0.2, 0.3]), fell_at=np.full(2, np.inf))
    assert collecting.summary(one) == "20.0 cm/s, 1 fall"
    assert collecting.summary(two) == "25.0 +- 5.0 cm/s, 0 falls"


def test_walks_that_stood_are_told_beside_those_that_fell():
    speed, one, no = np.array([0.2, 0.1]), np.array([np.inf, 2.0]), np.full(2, np.inf)
    fell, stood = (SimpleNamespace(velocity=speed, fell_at=at) for at in (one, no))
    assert collecting.upright(fell) == "; 20.0 cm/s without those that fell"
    assert collecting.upright(stood) == ""
    assert collecting.upright(SimpleNamespace(velocity=speed, fell_at=speed)) == ""


# Ctrl-C and errors that nobody foresaw


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["run", "--out", "there"], "`gatjax run --resume --out there` goes on"),
        (["run", "--resume", "--run", "a/b"], "`gatjax run --resume --run a/b` goes"),
        (["search", "--out", "there"], "the same command goes on"),
        (["evaluate"], "nothing was kept"),
        (["evaluate", "--robot", "lola"], "the same command goes on after the walks"),
    ],
)
def test_ctrl_c_says_how_this_verb_goes_on(given, says, capsys, monkeypatch, tmp_path):
    def stop(verb):
        runs.open_run("there", DEMO, "begun")
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(verbs, "act", stop)
    assert main(given) == 130
    assert f"gatjax: stopped; {says}" in capsys.readouterr().err


def test_ctrl_c_leaves_an_earlier_diagnosis(capsys, monkeypatch, tmp_path):
    def stop(verb):
        raise KeyboardInterrupt

    def drawing(verb):
        file = tmp_path / "diagnosis.json"
        file.write_text("{}")
        os.utime(file, ns=(0, next(times)))
        raise KeyboardInterrupt

    times = iter((10**9, 2 * 10**9))
    given = ["diagnose", "--model", "m.xml", "--data", "a.csv", "--out", str(tmp_path)]
    monkeypatch.setattr(verbs, "act", stop)
    assert main(given) == 130 and "nothing was kept" in capsys.readouterr().err
    monkeypatch.setattr(verbs, "act", drawing)
    for _ in range(2):  # without an earlier one, and with it
        assert main(given) == 130
        assert "has the new diagnosis, all but its report" in capsys.readouterr().err
    monkeypatch.setattr(verbs, "act", stop)
    assert main(given) == 130
    assert f"{tmp_path} keeps the earlier diagnosis" in capsys.readouterr().err

    def late(verb):
        (tmp_path / "diagnosis.json").unlink()
        raise KeyboardInterrupt

    monkeypatch.setattr(verbs, "act", late)
    assert main(given) == 130
    assert f"in {tmp_path} was being replaced" in capsys.readouterr().err


def test_numbers_that_fail_are_no_mistake_of_the_user(capsys, monkeypatch):
    def fail(verb):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(verbs, "act", fail)
    assert main(["evaluate"]) == 1
    assert "internal error: LinAlgError: Singular matrix" in capsys.readouterr().err


def test_ctrl_c_before_a_run_has_its_folder_leaves_nothing(
    started, tmp_path, capsys, monkeypatch
):
    def stop(settings):
        raise KeyboardInterrupt

    monkeypatch.setattr(loop, "resolved", stop)
    assert main(["run", "--out", str(tmp_path)]) == 130
    assert "gatjax: stopped; nothing was kept" in capsys.readouterr().err


@pytest.mark.parametrize(
    "error", [KeyError("where"), TypeError("a\nb"), zipfile.BadZipFile("bad")]
)
def test_an_unforeseen_error_is_one_line_too(error, capsys, monkeypatch):
    def fail(verb):
        raise error

    monkeypatch.setattr(verbs, "act", fail)
    line = refused(capsys, ["doctor"])
    assert line.startswith(f"gatjax: internal error: {type(error).__name__}: ")
    assert line.endswith("run again with --debug for the traceback")
    assert main(["doctor", "--debug"]) == 1
    assert "Traceback" in capsys.readouterr().err


# ground, collect, evaluate, view


def log(path, time, *, count=1, scale=1.0, metadata=None):
    wave = np.tile(0.1 * np.sin(time), count)
    columns = {f"{k}.{j}": wave for k in ("command", "position") for j in JOINTS}
    columns["position.LKneePitch"] = columns["position.LKneePitch"] * scale
    ids = np.repeat(np.arange(count), len(time))
    times = np.tile(time, count)
    write_recording(path, Recording("x", times, ids, columns, metadata or {}))
    return str(path)


def ground(folder, *more):
    return [
        "ground", "--robot-log", str(folder / "robot.parquet"), "--simulator-log",
        str(folder / "simulator.parquet"), "--out", str(folder / "out"), *more,
    ]  # fmt: skip


def test_a_log_at_another_rate_is_not_learned_from(tmp_path, capsys):
    log(tmp_path / "robot.parquet", np.arange(100) * 0.01, count=4)
    log(tmp_path / "simulator.parquet", np.arange(100) * 0.02, count=4)
    line = refused(capsys, ground(tmp_path))
    assert "robot.parquet: a row every 10 ms, the control period is 20 ms" in line
    line = refused(capsys, ground(tmp_path, "--rate-hz", "100"))
    assert "simulator.parquet: a row every 20 ms, the control period is 10 ms" in line
    assert not (tmp_path / "out").exists()


def test_gaps_are_cut_and_counted(tmp_path, capsys):
    time = np.arange(300) * 0.02
    log(tmp_path / "robot.parquet", np.delete(time, [50, 120, 121]))
    recording = verbs.read_recording(tmp_path / "robot.parquet")
    cut = logs.checked(recording, nominal(), least=1)
    assert np.bincount(cut.trajectory).tolist() == [50, 69, 178]
    assert "robot.parquet: cut at 2 gaps in time" in capsys.readouterr().out


def test_a_grounding_starts_from_a_world_without_one(tmp_path, capsys):
    for name in ("robot", "simulator"):
        log(tmp_path / f"{name}.parquet", np.arange(300) * 0.02)
    path = tmp_path / "world.json"
    write_world(path, nominal(), {}, "grounding")
    line = refused(capsys, ground(tmp_path, "--world", str(path)))
    assert "has a grounding already" in line
    plain = world_file(tmp_path / "plain", ("command_delay", 0.02))
    world = loop.ungrounded(plain, nominal().task)
    assert [row["cause"] for row in world.causes] == ["command_delay"]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"count": 3}, "robot.parquet: 3 trajectories longer than 0.7 s, need 4"),
        ({"scale": 60.0}, "column 'position.LKneePitch': "),
        ({"metadata": {"robot": "simulator"}}, "one of 'simulator'; --simulator-log"),
    ],
)
def test_logs_that_can_not_be_right_are_refused(tmp_path, capsys, change, says):
    time, out = np.arange(50) * 0.02, tmp_path / "out"
    log(tmp_path / "robot.parquet", time, **{"count": 4} | change)
    named = {"robot": "dart"}
    log(tmp_path / "simulator.parquet", time, count=4, metadata=named)
    assert says in refused(capsys, ground(tmp_path))
    assert not out.exists()


def row(joint, before, after, horizon=0.5):
    angles = np.deg2rad([before, after]).tolist()
    names = ("joint", "horizon_s", "before_rad", "after_rad")
    return dict(zip(names, (joint, horizon, *angles), strict=True))


def test_suspicious_predictions_are_said():
    fine = [row("LKneePitch", 30.0, 1.0, 0.02), row("LKneePitch", 3.0, 2.0)]
    assert logs.warnings(fine) == []
    (far,) = logs.warnings([*fine, row("LHipRoll", 25.0, 20.0)])
    assert far.startswith("WARNING: LHipRoll is 25 deg off after 0.5 s")
    (worse,) = logs.warnings([*fine, row("LHipRoll", 3.0, 5.0)])
    assert "worse, 3.00 -> 3.50 deg" in worse
    assert worse in logs.table([*fine, row("LHipRoll", 3.0, 5.0)])


def test_numbers_and_paths_that_make_no_sense_are_one_line(tmp_path, capsys):
    (tmp_path / "file").write_text("x")
    file = str(tmp_path / "file")
    for given, says in (
        (["evaluate", "--runs", "0"], "--runs is 0; use 1 or more"),
        (["evaluate", "--forward", "2"], "--forward is 2.0"),
        (["collect", "--out", "a.csv", "--trajectories", "0"], "--trajectories is 0"),
        (["collect", "--out", "a.csv", "--body-seed", "-1"], "--body-seed is -1"),
        (["collect", "--out", "a.csv", "--seed", "10000"], "--seed is 10000; use 0 to"),
        (["evaluate", "--seed", "10000"], "--seed is 10000; use 0 to 9999"),
        (["evaluate", "--seed", "-1"], "--seed is -1; use 0 to 9999"),
        (["run", "--seed", "-1", "--out", str(tmp_path / "runs")], "seed is -1; use 0"),
        (
            [
                "ground",
                "--robot-log",
                "a.csv",
                "--simulator-log",
                "b.csv",
                "--out",
                "c",
                "--seed",
                "-1",
            ],
            "--seed is -1; use 0 or more",
        ),
        (["bench", "--worlds", "0"], "--worlds is 0"),
        (["bench", "--seconds", "0"], "--seconds is 0"),
        (["search", "--out", file], "is a file, --out needs a folder"),
        (["view", "--out", "walk.gif"], "a walk ends in .html or .mp4"),
        (["report", "--run", str(tmp_path)], "not a run folder"),
        (["run", "--robot", "pepper", "--out", str(tmp_path / "runs")], "pepper"),
        (["search", "--out", str(tmp_path / "new"), "--population", "1"], "use 4 or"),
    ):
        assert says in refused(capsys, given)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_live_view_needs_a_display(monkeypatch):
    from gatjax.cli import window

    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(RuntimeError, match="no display for --live"):
        window.play(nominal().model, np.zeros((1, 34)), 0.02)


def test_a_robot_that_does_not_know_where_its_torso_is_is_not_drawn(
    tmp_path, monkeypatch, capsys
):
    class Walked(NamedTuple):
        base: Base

    base = Base(np.full((1, 9, 3), np.nan), np.full((1, 9, 4), np.nan))
    robot = SimpleNamespace(name="nao", walk=lambda *given: (Walked(base), None))
    monkeypatch.setattr(verbs, "robot_of", lambda *given: robot)
    line = refused(capsys, ["view", "--out", str(tmp_path / "walk.html")])
    assert "nao does not tell where its torso is" in line
    assert not list(tmp_path.iterdir())


def test_a_folder_stands_for_its_world_file(tmp_path):
    world = verbs.walker_of(
        world_file(tmp_path, ("backlash", 0.01)).parent, nominal().task
    )
    assert [cause["cause"] for cause in world.causes] == ["backlash"]


def test_the_version_is_printed(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == "gatjax 0.1.0\n"


class Seen:
    """A robot that keeps the seeds it was asked to walk with."""

    name = "seen"

    def walk(self, policies, drawn, task):
        self.drawn = list(drawn)
        raise ValueError("enough")


def test_evaluation_repeats_no_walk_that_was_learned_from(
    tmp_path, capsys, monkeypatch
):
    robot = Seen()
    for part in (verbs, collecting):
        monkeypatch.setattr(part, "robot_of", lambda *_: robot)
    given = ["collect", "--out", str(tmp_path / "a.parquet"), "--seed", "3"]
    refused(capsys, given)
    learned = robot.drawn
    assert learned == list(seeds(ROBOT_LOG, 3, 15))
    refused(capsys, ["evaluate", "--seed", "3"])
    assert robot.drawn == list(seeds(EVALUATION, 3, 10))
    assert not set(learned) & set(robot.drawn)


def test_a_video_without_ffmpeg_is_one_line(tmp_path, monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(ImportError, match=r"pip install .*-e '\.\[video\]'"):
        film(tmp_path / "walk.mp4", nominal().model, np.zeros((3, 34)), 0.02)
    assert not list(tmp_path.iterdir())


def test_a_search_folder_holds_what_the_search_is(found):
    config = json.loads((found / "config.json").read_text())
    assert config["schema"] == resume.SEARCH
    assert config["world"] is None
    assert config["search"]["generations"] == 1
    assert list(config["policy"].values()) == THETA0.tolist()


def test_a_search_that_never_began_claims_no_folder(tmp_path, capsys):
    line = refused(capsys, search(tmp_path, "--hosts", "2"))
    assert "--hosts is for --listen" in line
    assert main([*search(tmp_path, "--rate-hz", "100"), "--seed", "3"]) == 0
    told = capsys.readouterr().out
    assert told.endswith("policies/search_0_0_mean.json --rate-hz 100\n")


def test_a_search_that_is_done_waits_for_no_hosts(found, tmp_path, monkeypatch):
    waited = []
    monkeypatch.setattr(Crew, "wait", lambda crew, hosts, most: waited.append(hosts))
    shutil.copytree(found, tmp_path / "done")
    more = ["--listen", "0", "--hosts", "2"]
    assert main(search(tmp_path / "done", *more)) == 0
    assert main(search(tmp_path / "new", *more)) == 0
    assert waited == [0, 2]


def test_a_search_folder_that_another_process_works_in(found, capsys):
    with runs.held(found):
        line = refused(capsys, search(found))
    assert "another gatjax is at work in it" in line


def test_a_command_to_go_on_with_can_be_typed(capsys, monkeypatch, tmp_path):
    def stop(verb):
        runs.open_run("my runs", DEMO, "begun")
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(verbs, "act", stop)
    main(["run", "--out", "my runs"])
    assert "run --resume --out 'my runs'` goes on" in capsys.readouterr().err


def test_a_grounding_writes_over_no_world_that_is_none(tmp_path, capsys):
    time = np.arange(50) * 0.02
    log(tmp_path / "robot.parquet", time, count=4)
    log(tmp_path / "simulator.parquet", time, count=4)
    path = world_file(tmp_path / "out", ("command_delay", 0.02))
    before = path.read_bytes()
    for more in ([], ["--world", str(path)]):
        line = refused(capsys, ground(tmp_path, "--method", "envelope", *more))
        assert f"{path} is not of a grounding" in line
    assert path.read_bytes() == before
