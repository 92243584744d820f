"""A run with --explain: diagnosed once, one more method, and never stopped by it."""

import dataclasses
import importlib
import json
import math
import shutil
from concurrent.futures.process import BrokenProcessPool
from typing import ClassVar

import jax
import numpy as np
import pytest
from short_walks import SHORT

from gatjax import loop, runs
from gatjax.data.recording import read_recording
from gatjax.diagnosis.start import Start
from gatjax.grounding import prediction
from gatjax.grounding.learn import read_grounding, with_alpha
from gatjax.loop import case, explain
from gatjax.loop.ground import helpful
from gatjax.loop.setting import DIAGNOSIS_UNIT, Setting
from gatjax.robot.model import HUNG
from gatjax.settings import LoopSettings, SearchSettings
from gatjax.sim.contact import Law, law_of
from gatjax.sim.stored import read_world, write_world
from gatjax.sim.walker import lasting
from gatjax.sim.world import add_cause, nominal, with_contact
from gatjax.task import Task
from gatjax.walk.parameters import THETA0

DELAY = 0.03  # s, what the robot has and the simulator lacks
SETTINGS = LoopSettings(
    methods=("none",),
    explain=True,
    robot_trajectories=5,
    simulator_trajectories=4,
    evaluations=1,
    search=SearchSettings(population=4, rollouts=1, generations=1),
    backend="native",
)
QUIET = loop.Progress(stage=lambda text: None, work=lambda units: None)
pytestmark = pytest.mark.usefixtures("short_walks")


class Late(loop.Simulator):
    """A robot that answers late; it walks, and plays motions."""

    name = "late"

    def __init__(self):
        super().__init__(add_cause(nominal(SHORT), "command_delay", ["all"], DELAY))


class Hanging(Late):
    """The same robot, which can hang."""

    def hung(self):
        held = nominal(SHORT, HUNG)
        return loop.Simulator(add_cause(held, "command_delay", ["all"], DELAY))


class Wandering(Late):
    """The same robot, which walks in processes of its own."""

    def begin_walks(self, policies, seeds, task):
        raise AssertionError("only a search on mjx lets it")

    def drop_walks(self):
        raise AssertionError("nothing was begun")


class Walker:
    """The same robot, which can only walk."""

    name = "late"

    def __init__(self, robot):
        self.constants, self.walk = robot.constants, robot.walk


class Diagnosis:
    """A diagnosis that says what it was told to, and keeps what it was given."""

    def __init__(self, promoted=True, law=None, **causes):
        self.causes, self.promoted, self.given = causes, promoted, []
        self.law = law

    def __call__(self, start, files, out, seed, tell):
        self.given.append((start, files.fit, files.held))
        tell("causes", 0.5)
        out.mkdir()
        world = start.world(Task().control_period, 0.0005)
        if self.law is not None:
            world = with_contact(world, self.law)
        for name, value in self.causes.items():
            world = add_cause(world, name, ["all"], value)
        write_world(out / "world.json", world, {}, None)
        gain = {"before": 0.02, "after": 0.01, "promoted": self.promoted}
        gain = None if self.promoted is None else gain
        text = {"verdict": "named", "sentence": "It is late.", "gain": gain}
        text["data_checks"] = list(files.checks)
        runs.write_json(out / "diagnosis.json", text)
        return text


@pytest.fixture(scope="module")
def robot():
    return Late()


@pytest.fixture(scope="module")
def run(tmp_path_factory, robot):
    """A finished run, and the diagnosis that it asked."""
    folder = runs.open_run(tmp_path_factory.mktemp("runs"), SETTINGS).path
    found = Diagnosis(command_delay=DELAY)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(case, "diagnose", found)
        loop.run(folder, SETTINGS, robot, QUIET)
    return folder, found


def setting_of(folder, robot, tell=None):
    progress = loop.Progress(tell, QUIET.work) if tell else QUIET
    return Setting(folder, SETTINGS, SHORT, nominal(SHORT), robot, progress)


def opened(root, monkeypatch, diagnosis):
    monkeypatch.setattr(case, "diagnose", diagnosis)
    return runs.open_run(root, SETTINGS).path


def found_in(world):
    """Causes of a world, without what a search is kept to."""
    return [row["cause"] for row in world.causes if row.get("role") != "bound"]


def test_the_robot_stands_and_plays_for_its_diagnosis(run):
    folder, found = run
    ((start, fit, held),) = found.given
    assert start == Start("nao")
    motions = [[log.metadata["motion"] for log in logs] for logs in (fit, held)]
    assert motions == [["rich", "steps_small"], ["multisine"]]
    assert all(log.metadata["base"] == "floating" for log in (*fit, *held))
    assert len({log.metadata["seed"] for log in (*fit, *held)}) == 3
    kept = {path.name for path in folder.glob("recordings/explain_*")}
    names = [name for each in motions for name in each]
    assert kept == {f"explain_standing_{name}.parquet" for name in names}
    assert "data_checks" in json.loads(
        (folder / "diagnosis/diagnosis.json").read_text()
    )


def test_what_is_found_is_added_to_the_nominal_simulator(run):
    folder, _ = run
    world, grounding = read_world(folder / "extended.json")
    assert grounding is None and world.source == "nao"
    assert found_in(world) == ["command_delay"]
    kept = [row for row in world.causes if row.get("role") == "bound"]
    assert {row["cause"] for row in kept} == {"current_limit"}
    assert world.model.opt.timestep == nominal(SHORT).model.opt.timestep


def test_gat_after_diagnosis_is_one_more_method(run):
    folder, _ = run
    searched = {row["method"] for row in runs.read_table(folder / "metrics.csv")}
    assert searched == {"theta0", "none", "explained"}
    learned = json.loads((folder / "grounding/explained_0/grounder.json").read_text())
    assert learned["method"] == "gat"
    grounded, _ = read_world(folder / "grounding" / "explained_0")
    assert found_in(grounded) == ["command_delay"]
    assert (folder / "recordings/simulator_0_explained.parquet").is_file()
    assert not (folder / "recordings/robot_0_explained.parquet").exists()
    assert (folder / "walks/explained_best_robot.npz").is_file()


def test_the_true_cause_explains_most_of_the_error(run):
    rows = runs.read_table(run[0] / "prediction.csv")
    before = {
        method: np.mean([r["before_rad"] for r in rows if r["method"] == method])
        for method in ("none", "explained")
    }
    assert before["explained"] < 0.3 * before["none"]


def test_gat_does_not_spoil_what_the_diagnosis_explained(run):
    rows = [
        row for row in runs.read_table(run[0] / "prediction.csv")
        if row["method"] == "explained" and row["horizon_s"] > 0.1
    ]  # fmt: skip
    before, after = (
        np.sqrt(np.mean([row[name] ** 2 for row in rows]))
        for name in ("before_rad", "after_rad")
    )
    assert after < 1.2 * before


def test_a_correction_is_taken_as_far_as_it_helps(robot, run, monkeypatch):
    grounding = read_grounding(run[0] / "grounding/explained_0")
    world, _ = read_world(run[0] / "extended.json", SHORT)
    log = read_recording(run[0] / "recordings/robot_0.parquet")

    def share(values):
        (alpha,) = {float(a) for a in np.ravel(values.command["grounding"].alpha)}
        return alpha

    def error(backend, values, windows, step):
        return abs(share(values) - 0.3)

    def fallen(backend, values, theta, keys):
        return int(share(values) < stands - 1e-6) * len(keys)

    monkeypatch.setattr(prediction, "error_soon", error)
    own = importlib.import_module("gatjax.loop.ground")  # the name is a function, too
    monkeypatch.setattr(own, "count_falls", fallen)
    whole = with_alpha(grounding, 1.0)
    whole = whole._replace(facts=whole.facts | {"falls": 0.0})
    rest = log, 0, THETA0, jax.random.key(0)
    stands = 0.0
    assert helpful(world, whole, *rest).facts["alpha"] == 0.3
    assert helpful(world, with_alpha(whole, 0.0), *rest).facts["alpha"] == 0.0
    stands = 0.4  # with less it falls
    assert helpful(world, whole, *rest).facts["alpha"] == 0.4
    stands = 2.0
    assert helpful(world, whole, *rest).facts["alpha"] == 1.0


def test_where_the_torso_truly_was_chooses_no_alpha(run, monkeypatch):
    grounding = read_grounding(run[0] / "grounding/explained_0")
    world, _ = read_world(run[0] / "extended.json", SHORT)
    log = read_recording(run[0] / "recordings/robot_0.parquet")
    assert "base.z" in log.columns
    taken, cut = [], prediction.cut

    def noted(world, recording, *rest):
        taken.extend(recording.columns)
        return cut(world, recording, *rest)

    monkeypatch.setattr(prediction, "cut", noted)
    helpful(world, with_alpha(grounding, 1.0), log, 0, THETA0, jax.random.key(0))
    assert taken and not [name for name in taken if name.startswith("base.")]


def test_a_run_that_is_done_is_not_diagnosed_again(run, robot, tmp_path, monkeypatch):
    shutil.copytree(run[0], tmp_path / "run")
    again = Diagnosis()
    monkeypatch.setattr(case, "diagnose", again)
    loop.run(tmp_path / "run", SETTINGS, robot, QUIET)
    assert not again.given


def test_a_diagnosis_that_was_done_serves_the_run_that_goes_on(
    run, robot, tmp_path, monkeypatch
):
    shutil.copytree(run[0], tmp_path / "run")
    (tmp_path / "run" / "extended.json").unlink()
    again = Diagnosis()
    monkeypatch.setattr(case, "diagnose", again)
    (entry,) = explain.explained(setting_of(tmp_path / "run", robot))
    assert not again.given
    assert found_in(entry.world) == ["command_delay"]


def refuses(*_):
    raise ValueError("the robot falls\nin every log")


@pytest.mark.parametrize(
    ("diagnosis", "reason"),
    [
        (refuses, "the robot falls in every log"),
        (Diagnosis(), "the diagnosis changes nothing"),
        (
            Diagnosis(promoted=False, command_delay=DELAY),
            "what the diagnosis found does not surely predict the held-out motion",
        ),
        (
            Diagnosis(promoted=None, command_delay=DELAY),
            "a robot fell at the start of the held-out motion",
        ),
        (Diagnosis(torque_limit=0.3), "theta0 falls in 20 of 20 walks"),
    ],
)
def test_what_stands_against_a_diagnosis_is_told_and_kept(
    diagnosis, reason, run, robot, tmp_path, monkeypatch
):
    folder, told = opened(tmp_path, monkeypatch, diagnosis), []
    shutil.copytree(run[0] / "recordings", folder / "recordings", dirs_exist_ok=True)
    setting = setting_of(folder, robot, told.append)
    assert explain.explained(setting) == []
    assert told[-1].startswith(f"no GAT after diagnosis: {reason}")
    assert (folder / "diagnosis/skipped.txt").read_text().startswith(reason)
    assert not (folder / "extended.json").exists()
    told.clear()
    assert explain.explained(setting) == []  # it is told again, with what helps
    assert len(told) == 1 and told[0].startswith(f"no GAT after diagnosis: {reason}")
    assert told[0].endswith(f"(to try again, delete {folder / 'diagnosis'})")


def test_the_floor_that_a_diagnosis_found_is_walked_on(
    run, robot, tmp_path, monkeypatch
):
    law = Law("elliptic", 2.0)
    folder = opened(tmp_path, monkeypatch, Diagnosis(law=law))
    shutil.copytree(run[0] / "recordings", folder / "recordings", dirs_exist_ok=True)
    monkeypatch.setattr(explain, "bounded", lambda world, walks, seed: world)
    monkeypatch.setattr(explain, "_stand", lambda setting, world, text: None)
    (entry,) = explain.explained(setting_of(folder, robot))
    assert law_of(entry.world.model) == law
    assert not lasting(entry.world)


class InTurn:
    """Workers that work in this process."""

    counts: ClassVar[list[int]] = []

    def __init__(self, count, shares):
        self.counts.append(count)

    def results(self, function, jobs):
        return ((place, function(*job)) for place, job in enumerate(jobs))

    def close(self):
        pass


@pytest.fixture
def pair(run, robot, tmp_path, monkeypatch):
    """Builds two trials with logs; what the progress hears of is kept."""
    InTurn.counts.clear()
    monkeypatch.setattr(explain, "Workers", InTurn)
    told, work = [], []

    def build(diagnosis):
        trials = []
        for name in "ab":
            folder = opened(tmp_path / name, monkeypatch, diagnosis)
            logs = run[0] / "recordings", folder / "recordings"
            shutil.copytree(*logs, dirs_exist_ok=True)
            progress = loop.Progress(stage=told.append, work=work.append)
            trials.append(setting_of(folder, robot)._replace(progress=progress))
        return trials, told, work

    return build


@pytest.mark.parametrize(("cores", "memory"), [(1, math.inf), (64, 7e9)])
def test_trials_are_diagnosed_in_turn_where_the_machine_is_small(cores, memory, pair):
    found = Diagnosis(command_delay=DELAY)
    trials, _, work = pair(found)
    assert explain.ahead(trials, cores, memory) == set()
    assert (found.given, InTurn.counts, work) == ([], [], [])


def test_trials_are_diagnosed_side_by_side_where_the_machine_suffices(pair):
    found = Diagnosis(command_delay=DELAY)
    trials, _, work = pair(found)
    assert explain.ahead(trials, 2, 9e9) == {each.folder for each in trials}
    assert (len(found.given), InTurn.counts) == (2, [2])
    for each in trials:
        assert explain.explained(each, 1.0)
    assert len(found.given) == 2
    assert sum(work) == pytest.approx(2 * DIAGNOSIS_UNIT)
    assert explain.ahead(trials, 2, 9e9) == set()  # they are done
    assert len(InTurn.counts) == 1


def test_what_cannot_be_diagnosed_ahead_is_told_once(pair):
    trials, told, work = pair(refuses)
    assert explain.ahead(trials, 8, 1e12) == {each.folder for each in trials}
    for each in trials:
        assert (each.folder / explain.SKIPPED).read_text().startswith("the robot falls")
        assert explain.explained(each, 1.0) == []
    said = [text for text in told if text.startswith("no GAT after diagnosis")]
    assert len(said) == 2 and all("the robot falls in every log" in t for t in said)
    assert sum(work) == pytest.approx(2 * DIAGNOSIS_UNIT)


@pytest.mark.parametrize(("kind", "calls"), [(Wandering, [2] * 3), (Late, [1] * 6)])
def test_a_robot_elsewhere_plays_for_all_trials_at_once_and_for_each_as_alone(
    kind, calls, run, tmp_path, monkeypatch
):
    robot = kind()
    monkeypatch.setattr(explain, "Workers", InTurn)
    trials, played, play = [], [], robot.play
    for seed in (SETTINGS.seed, SETTINGS.seed + 1):
        folder = opened(tmp_path / f"{seed}", monkeypatch, Diagnosis())
        settings = dataclasses.replace(SETTINGS, seed=seed)
        trials.append(setting_of(folder, robot)._replace(settings=settings))

    def heard(targets, rate_hz, seeds):
        played.append(len(set(seeds)))
        return play(targets, rate_hz, seeds)

    monkeypatch.setattr(robot, "play", heard)
    explain.ahead(trials, 2, 1e12)
    assert played == calls
    for path in (run[0] / "recordings").glob("explain_*"):
        one, other = (read_recording(each.folder / "recordings" / path.name)
                      for each in trials)  # fmt: skip
        alone = read_recording(path)
        assert one.metadata == alone.metadata != other.metadata
        assert set(other.trajectory) == {0}
        for name, values in alone.columns.items():
            np.testing.assert_allclose(one.columns[name], values, atol=1e-9)
        assert not np.allclose(other.columns["command.LKneePitch"][:100],
                               one.columns["command.LKneePitch"][:100])  # fmt: skip


def test_a_trial_without_logs_leaves_the_others_alone(pair, robot, monkeypatch):
    trials, told, _ = pair(Diagnosis(command_delay=DELAY))
    for path in (trials[0].folder / "recordings").glob("explain_*"):
        path.unlink()
    play = robot.play

    def falls(*what):
        trajectory = play(*what)
        return trajectory._replace(alive=np.zeros_like(trajectory.alive))

    monkeypatch.setattr(robot, "play", falls)
    assert explain.ahead(trials, 8, 1e12) == {trials[1].folder}
    assert [len(explain.explained(each)) for each in trials] == [0, 1]
    (said,) = [text for text in told if text.startswith("no GAT after diagnosis")]
    assert "no trajectory has a row before its fall" in said


def test_a_diagnosis_that_dies_leaves_them_to_be_made_one_by_one(pair, monkeypatch):
    trials, told, _ = pair(Diagnosis(command_delay=DELAY))

    def dies(workers, function, jobs):
        yield 0, function(*jobs[0])
        raise BrokenProcessPool

    monkeypatch.setattr(InTurn, "results", dies)
    assert explain.ahead(trials, 8, 1e12) == {trials[0].folder}
    assert "one by one" in told[-1]
    assert explain.explained(trials[1])


def test_a_robot_that_can_hang_hangs_for_its_diagnosis(tmp_path, monkeypatch):
    found = Diagnosis(command_delay=DELAY)
    folder = opened(tmp_path, monkeypatch, found)
    (entry,) = explain.explained(setting_of(folder, Hanging()))
    ((start, fit, held),) = found.given
    assert start == Start(HUNG)
    assert all(log.metadata["base"] == "fixed" for log in (*fit, *held))
    assert read_world(folder / "diagnosis/world.json")[0].source == HUNG
    assert entry.world.source == "nao"  # that walks
    assert found_in(entry.world) == ["command_delay"]
    assert list(folder.glob("recordings/explain_hung_*"))


def test_how_a_hung_robot_was_mounted_is_left_behind(tmp_path, monkeypatch):
    told = []
    folder = opened(tmp_path, monkeypatch, Diagnosis(gravity_tilt=0.05))
    assert explain.explained(setting_of(folder, Hanging(), told.append)) == []
    assert told[-1].startswith("no GAT after diagnosis: the diagnosis changes nothing")


def test_a_robot_without_motions_is_diagnosed_by_its_walks(
    run, robot, tmp_path, monkeypatch
):
    found = Diagnosis(command_delay=DELAY)
    folder = opened(tmp_path, monkeypatch, found)
    walks = "recordings/robot_0.parquet"
    shutil.copy(run[0] / walks, folder / walks)
    assert len(explain.explained(setting_of(folder, Walker(robot)))) == 1
    (_, (fit,), (held,)) = found.given[0]
    ids = [set(np.unique(log.trajectory)) for log in (fit, held)]
    assert [len(each) for each in ids] == [4, 1]
    assert not ids[0] & ids[1]
    assert len(fit.columns["position.LKneePitch"]) == len(fit.time)


def test_one_more_method_is_more_work():
    plain = dataclasses.replace(SETTINGS, explain=False)
    two = dataclasses.replace(plain, methods=("none", "gat"))
    assert loop.total_work(SETTINGS) > loop.total_work(two) > loop.total_work(plain)
