"""The command line: help that teaches, errors that are one line, honest exit codes."""

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from gatjax import loop, runs, speed
from gatjax.cli import doctor, main
from gatjax.cli.arguments import VERBS
from gatjax.cli.interrupts import heeded
from gatjax.cli.parsing import parse
from gatjax.cli.progress import shown
from gatjax.data.recording import Recording, write_recording
from gatjax.robot.nao import WALKING_JOINTS
from gatjax.settings import DEMO, PAPER
from gatjax.walk.parameters import THETA0

GATJAX = [sys.executable, "-m", "gatjax.cli"]


def one_line(capsys, arguments):
    """Run the command line; return its exit code and the one line on stderr."""
    code = main(arguments)
    error = capsys.readouterr().err.strip().splitlines()
    error = [line for line in error if not line.startswith("[")]  # progress
    assert len(error) == 1, error
    assert error[0].startswith("gatjax: ")
    return code, error[0]


@pytest.mark.parametrize("verb", sorted(VERBS))
def test_every_verb_has_help(verb, capsys):
    with pytest.raises(SystemExit) as stopped:
        parse([verb, "--help"])
    assert stopped.value.code == 0
    assert VERBS[verb].__doc__.split("\n")[0].rstrip(".") in " ".join(
        capsys.readouterr().out.split()
    )


def test_a_mistyped_verb_is_told_the_one_that_is_meant(capsys):
    code, line = one_line(capsys, ["diagnos", "--data", "x.csv"])
    assert code == 1 and "did you mean diagnose?" in line
    code, line = one_line(capsys, ["xyz"])
    assert "did you mean" not in line and "is no verb; there are run, collect" in line


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("run --method gat", "no option --method (did you mean --methods?)"),
        ("run --generations abc", "--generations takes a whole number, not 'abc'"),
        ("collect --out x --reach abc", "--reach takes a number, not 'abc'"),
        ("run --preset big", "knows no 'big'; choose from demo, paper"),
        ("ground --out x", "ground needs --robot-log, --simulator-log;"),
        ("search --out", "Missing value for argument '--out'"),
        ("evaluate --foo 3", "evaluate has no option --foo;"),
        ("bench diagnose --case 3 --out x", "(did you mean --cases?)"),
    ],
)
def test_a_refused_option_is_one_line_that_names_the_verbs_help(given, says, capsys):
    code, line = one_line(capsys, given.split())
    verb = "bench diagnose" if "diagnose" in given else given.split()[0]
    assert code == 1 and says in line
    assert line.endswith(f"; see gatjax {verb} --help")


def test_a_robot_that_collect_does_not_have(tmp_path, capsys):
    arguments = ["--out", str(tmp_path / "x.parquet"), "--robot", "pepper"]
    _, line = one_line(capsys, ["collect", *arguments])
    assert "choose from simulator, dart, stiff" in line
    given = ["run", "--robot", "simulator", "--out", str(tmp_path)]
    _, line = one_line(capsys, given)
    assert "'simulator'" in line and "choose from dart, stiff" in line


def test_presets_set_the_defaults_and_flags_override_them():
    assert parse(["run"]).loop == DEMO
    assert parse(["run", "--preset", "paper"]).loop == PAPER
    chosen = parse(["run", "--preset=paper", "--generations", "3"]).loop.search
    assert (chosen.population, chosen.rollouts, chosen.generations) == (150, 20, 3)


def log(path, spoil=None):
    time = np.arange(300) * 0.02
    columns = {}
    for joint in WALKING_JOINTS:
        columns[f"command.{joint}"] = 0.1 * np.sin(time)
        columns[f"position.{joint}"] = 0.1 * np.sin(time)
    if spoil is not None:
        columns[spoil] = columns[spoil].copy()
        columns[spoil][17] = np.nan
    trajectory = np.zeros(300, int)
    metadata = {"robot": "nao", "base": "floating", "rate_hz": 50.0}
    write_recording(path, Recording("x", time, trajectory, columns, metadata))
    return str(path)


def policy(path, **changes):
    runs.write_policy(path.parent, path.stem, THETA0, {})
    text = json.loads(path.read_text())
    for key, value in changes.items():
        if key in text["parameters"]:
            text["parameters"][key]["value"] = value
        else:
            text[key] = value
    path.write_text(json.dumps(text))
    return str(path)


def test_bad_policies(tmp_path, capsys):
    cases = [
        ({"walk_hip_height": 0.5}, "walk_hip_height"),
        ({"arm_swing": float("nan")}, "arm_swing"),
        ({"robot": "pepper"}, "pepper"),
    ]
    for changes, word in cases:
        path = policy(tmp_path / "p.json", **changes)
        code, line = one_line(capsys, ["evaluate", "--policies", path, "--runs", "1"])
        assert code == 1
        assert word in line


def test_missing_files(tmp_path, capsys):
    missing = str(tmp_path / "no.json")
    for arguments in (
        ["evaluate", "--policies", missing],
        ["evaluate", "--robot", "simulator", "--world", missing],
        ["report", "--run", missing],
        ["run", "--resume", "--out", str(tmp_path / "runs")],
        ["run", "--robot", "pepper", "--out", str(tmp_path / "runs")],
    ):
        code, line = one_line(capsys, arguments)
        assert code == 1
        assert str(tmp_path) in line or "pepper" in line


def test_a_nan_in_a_log_is_named(tmp_path, capsys):
    good = log(tmp_path / "good.parquet")
    bad = log(tmp_path / "bad.parquet", spoil="position.LKneePitch")
    out = tmp_path / "out"
    arguments = [
        "ground",
        "--robot-log",
        bad,
        "--simulator-log",
        good,
        "--out",
        str(out),
    ]
    code, line = one_line(capsys, arguments)
    assert code == 1
    assert "bad.parquet" in line and "row 18, column 'position.LKneePitch'" in line
    assert not out.exists()


def test_worlds_that_can_not_be(tmp_path, capsys):
    effects = [
        {"cause": "blacklash", "where": ["LKneePitch"], "values": {"width": 0.1}}
    ]
    path = tmp_path / "world.json"
    world = {"schema": "gatjax.world/1", "model": "nao", "effects": effects}
    path.write_text(json.dumps(world))
    arguments = ["evaluate", "--robot", "simulator", "--world", str(path)]
    code, line = one_line(capsys, arguments)
    assert code == 1
    assert "blacklash" in line and "backlash" in line
    effects[0] |= {"cause": "backlash", "where": ["LKnee"]}
    path.write_text(json.dumps(world))
    code, line = one_line(capsys, arguments)
    assert code == 1
    assert "LKnee" in line and "LKneePitch" in line


def test_warp_without_a_gpu(tmp_path, capsys):
    arguments = ["run", "--backend", "mjx", "--impl", "warp", "--out", str(tmp_path)]
    code, line = one_line(capsys, arguments)
    assert code == 1
    assert "warp" in line
    assert not list(tmp_path.iterdir())


def test_a_truncated_checkpoint(tmp_path, capsys):
    arguments = [
        "search", "--out", str(tmp_path), "--population", "4", "--rollouts", "1",
        "--generations", "1", "--backend", "native",
    ]  # fmt: skip
    assert main(arguments) == 0
    capsys.readouterr()
    files = [p for p in (tmp_path / "checkpoints").rglob("*") if p.is_file()]
    biggest = max(files, key=lambda path: path.stat().st_size)
    biggest.write_bytes(biggest.read_bytes()[:-7])
    arguments[arguments.index("--generations") + 1] = "2"
    code, line = one_line(capsys, arguments)
    assert code == 1
    assert "checkpoints" in line


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_ctrl_c_that_gets_lost_stops_the_next_piece_of_work(number):
    with heeded(), shown(1.0) as progress:
        progress.stage("work")
        try:  # what a destructor or a C callback does with an exception
            signal.raise_signal(number)
        except KeyboardInterrupt:
            pass
        with pytest.raises(KeyboardInterrupt):
            progress.work(1.0)
    with shown(1.0) as progress:
        progress.stage("nothing was pressed since")
    with pytest.raises(KeyboardInterrupt), heeded():
        try:
            signal.raise_signal(number)
        except KeyboardInterrupt:
            raise ImportError("initialization failed") from None  # what C makes of it


def test_ctrl_c_in_a_generation_loses_nothing(tmp_path):
    arguments = [
        "search", "--out", str(tmp_path), "--population", "16", "--rollouts", "4",
        "--generations", "50", "--backend", "native",
    ]  # fmt: skip
    process = subprocess.Popen(
        [*GATJAX, *arguments], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    policies = tmp_path / "policies"
    while not list(policies.glob("search_0_1_*.json")):
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    try:
        _, error = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "Traceback" not in error
    kept = {path.name: path.read_bytes() for path in policies.iterdir()}
    generations = max(int(name.split("_")[2]) for name in kept) + 1
    arguments[arguments.index("--generations") + 1] = str(generations + 1)
    subprocess.run([*GATJAX, *arguments], check=True, capture_output=True)
    for name, content in kept.items():
        assert (policies / name).read_bytes() == content


@pytest.mark.parametrize(
    "given",
    [
        "evaluate --policies a.json --policies b.json",
        "run --methods none --methods=gat",
        "collect --out x.csv --motion rich --joints a --joints b",
        "bench --models full --models light",
        "bench diagnose --out x --kinds null --kinds pair",
    ],
)
def test_a_list_in_two_parts_is_refused(given, capsys):
    _, line = one_line(capsys, given.split())
    assert "comes twice; give all of it after one --" in line


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("search --out {} --seed 99999999999999999999", "--seed is 9999"),
        ("view --robot simulator --seed 4294967296", "use 4294967295 or less"),
        ("collect --motion rich --seconds inf --out {}/x.csv", "--seconds is inf"),
        ("collect --motion rich --seconds nan --out {}/x.csv", "--seconds is nan"),
        ("bench --seconds nan", "--seconds is nan"),
    ],
)
def test_numbers_out_of_reach(given, says, tmp_path, capsys):
    _, line = one_line(capsys, given.format(tmp_path).split())
    assert says in line


def test_an_out_that_cannot_be_written_is_told_before_any_walk(
    tmp_path, capsys, monkeypatch
):
    def walk(*given):
        raise AssertionError("it walked")

    monkeypatch.setattr(loop.Simulator, "walk", walk)
    monkeypatch.setattr(speed, "measure", walk)
    (tmp_path / "file").write_text("")
    for given in (
        "collect --robot simulator --out {}/x.parquet", "bench --json {}/x.json",
        "view --robot simulator --out {}/x.html",
    ):  # fmt: skip
        _, line = one_line(capsys, given.format(tmp_path / "file").split())
        assert "is a file, --out needs a folder here" in line or "is a file" in line


def test_a_motion_that_a_model_has_no_room_for_is_told(tmp_path, capsys):
    """MJCF takes angles for degrees: this range is a 57th of what was meant."""
    model, world = tmp_path / "arm.xml", tmp_path / "arm.json"
    model.write_text("""<mujoco><worldbody><body><joint name="a" axis="0 1 0"
      range="-1.5 1.5" damping="0.1" armature="0.01"/><geom size="0.05" mass="0.2"/>
      </body></worldbody><actuator><position name="a" joint="a" kp="5"/></actuator>
      </mujoco>""")
    world.write_text('{"schema": "gatjax.world/1", "model": "arm.xml", "effects": []}')
    asked = ["collect", "--robot", "simulator", "--world", str(world), "--runs", "1"]
    asked += ["--motion", "rich", "--out", str(tmp_path / "log.parquet")]
    assert main(asked) == 0
    assert "warning: a: told to move less than 0.05 rad" in capsys.readouterr().err
    model.write_text(model.read_text().replace("-1.5 1.5", "-85 85"))
    assert main([*asked[:-1], str(tmp_path / "wide.parquet")]) == 0
    assert "warning" not in capsys.readouterr().err


def test_a_shipped_model_that_is_misspelt_is_meant(tmp_path, capsys):
    asked = ["diagnose", "--model", "nao_hun", "--data", "x", "--out", str(tmp_path)]
    assert main(asked) == 1
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.endswith("does not exist; did you mean nao_hung")


def test_collect_does_not_write_over_a_policy(tmp_path, capsys):
    path = tmp_path / "best.json"
    policy(path)
    before = path.read_bytes()
    given = ["collect", "--robot", "simulator", "--policy", str(path), "--out"]
    _, line = one_line(capsys, [*given, str(tmp_path / "best.csv")])
    assert f"{path} would be written over" in line
    assert path.read_bytes() == before


def test_an_installation_that_is_broken_is_no_success(capsys, monkeypatch):
    rows = [("python", "3.11"), ("MJX-Warp", "needs a GPU"), ("dart", "broken: no so")]
    monkeypatch.setattr(doctor, "examine", lambda: iter(rows))
    code, line = one_line(capsys, ["doctor"])
    assert code == 1 and line == "gatjax: dart: not as it should be, see above"
    monkeypatch.setattr(doctor, "examine", lambda: iter(rows[:2]))
    assert main(["doctor"]) == 0
