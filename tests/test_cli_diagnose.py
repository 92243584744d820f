"""`gatjax diagnose`: what it refuses, what it shows on the way, what it prints."""

from pathlib import Path

import numpy as np
import pytest

from gatjax.cli import main
from gatjax.cli.arguments import Diagnose
from gatjax.cli.diagnosis import read_given
from gatjax.cli.found import gain_lines, named_lines, unseen_lines
from gatjax.cli.parsing import parse
from gatjax.data.recording import Recording, read_recording, write_recording
from gatjax.diagnosis.given import given as given_logs
from gatjax.diagnosis.start import Start
from gatjax.loop.staged import ENGINE, staged
from gatjax.runs import Progress

ARM = """
<mujoco><worldbody><body>{free}<joint name="servo" range="-115 115"/>
<geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02"/></body></worldbody>
<actuator>{servo}</actuator></mujoco>
"""
SERVO = '<position name="m" joint="servo" kp="10" kv=".2" forcerange="-3 3"/>'

NEITHER = """<general name="m" joint="servo" gainprm="9" biastype="affine"
 biasprm="0 -5 0"/>"""


def model(path, servo=SERVO, free=""):
    path.write_text(ARM.format(servo=servo, free=free))
    return str(path)


def log(path, seed=0, seconds=12.0, base="fixed", reach=1.0):
    time = np.arange(round(seconds * 100)) * 0.01
    draw = np.random.default_rng(seed)
    waves = [np.sin(2 * np.pi * (f * time**1.2 + draw.uniform())) for f in (0.2, 0.5)]
    command = reach * (sum(waves) * 0.4 + 0.3 * np.sign(np.sin(1.7 * time + seed)))
    command -= command[0]
    position = np.convolve(command, np.ones(6) / 6)[: len(time)]
    position += draw.normal(0.0, 5e-4, len(time))
    columns = {"command.servo": command, "position.servo": position}
    metadata = {"robot": "arm", "base": base, "rate_hz": 100.0}
    zero = np.zeros(len(time), int)
    write_recording(path, Recording("x", time, zero, columns, metadata))
    return str(path)


@pytest.fixture
def given(tmp_path):
    """A model and two logs."""
    robot = model(tmp_path / "arm.xml")
    return robot, log(tmp_path / "fit.parquet"), log(tmp_path / "held.parquet", seed=4)


def refused(capsys, *arguments):
    """Run the verb; return its one line."""
    assert main(["diagnose", *arguments]) == 1
    error = capsys.readouterr().err.strip().splitlines()
    assert len(error) == 1 and error[0].startswith("gatjax: "), error
    return error[0]


def test_good_logs_are_taken(given, tmp_path):
    robot, fit, held = given
    words = ["--model", robot, "--data", fit, "--held-out", held, "--out", "x"]
    _, logs, _ = read_given(parse(["diagnose", *words]))
    assert [r.name for r in logs.fit + logs.held] == [fit, held]
    assert {row["file"] for row in logs.checks} == {fit, held}


def test_trajectories_that_take_turns_have_a_rate_of_their_own(given, tmp_path):
    """Rows of two, one after the other, beside a file of one."""
    robot, plain, other = given
    first, second = (read_recording(Path(each)) for each in (plain, other))
    turns = np.argsort(np.tile(first.time, 2), kind="stable")
    two = first._replace(
        time=np.tile(first.time, 2)[turns],
        trajectory=np.repeat([0, 1], len(first.time))[turns],
        columns={name: np.append(values, second.columns[name])[turns]
                 for name, values in first.columns.items()},
    )  # fmt: skip
    path = tmp_path / "turns.parquet"
    write_recording(path, two)
    more = log(tmp_path / "more.parquet", seed=7)
    words = ["--model", robot, "--data", str(path), "--held-out", more, "--out", "x"]
    _, logs, _ = read_given(parse(["diagnose", *words]))
    assert np.unique(np.diff(logs.fit[0].time).round(6)).tolist() == [0.0, 0.01]


def test_a_joint_that_was_not_logged_is_told(given, tmp_path, capsys):
    _, fit, _ = given
    hand = '<body><joint name="wrist"/><geom size=".01"/></body></body></worldbody>'
    second = '<position name="w" joint="wrist" kp="10" kv=".2"/></actuator>'
    robot = tmp_path / "two.xml"
    text = ARM.format(servo=SERVO, free="").replace("</actuator>", second)
    robot.write_text(text.replace("</body></worldbody>", hand))
    error = refused(capsys, "--model", str(robot), "--data", fit, "--out", "x")
    assert "no command and position of wrist" in error and "log it" in error


def test_commands_that_the_model_clips_are_told(given, tmp_path):
    _, fit, _ = given
    narrow = SERVO.replace("<position", '<position ctrlrange="-0.5 0.5"')
    robot = model(tmp_path / "narrow.xml", narrow, "")
    _, logs, _ = read_given(
        parse(["diagnose", "--model", robot, "--data", fit, "--out", "x"])
    )
    texts = [row["text"] for row in logs.checks if row["check"] == "limits"]
    assert any("lies beyond the ctrlrange -0.5 to 0.5" in text for text in texts)
    (run,) = given_logs(Start(robot), logs, 0).logs
    assert run.command.max() == 0.5 < logs.fit[0].columns["command.servo"].max()


def test_one_file_may_move_little_beside_a_lively_one(given, tmp_path, capsys):
    robot, fit, _ = given
    calm = log(tmp_path / "calm.parquet", seed=5, reach=0.01)
    words = ["--model", robot, "--data", fit, calm, "--out", "x"]
    _, logs, _ = read_given(parse(["diagnose", *words]))
    rows = [row for row in logs.checks if row["check"] == "excitation"]
    assert [(row["file"], row["level"]) for row in rows] == [(calm, "warning")]
    line = refused(capsys, "--model", robot, "--data", calm, "--out", "x")
    assert "no joint moves enough" in line


def test_it_starts_from_a_model_or_from_a_world(given, capsys):
    robot, fit, _ = given
    for words in ([], ["--model", robot, "--world", "w.json"]):
        line = refused(capsys, *words, "--data", fit, "--out", "x")
        assert "--model robot.xml, or --world" in line


def test_a_model_and_a_world_are_told_apart(given, tmp_path, capsys):
    robot, fit, _ = given
    line = refused(capsys, "--world", robot, "--data", fit, "--out", "x")
    assert "an MJCF model is given as --model" in line
    world = tmp_path / "world.json"
    world.write_text("{}")
    line = refused(capsys, "--model", str(world), "--data", fit, "--out", "x")
    assert "a world file is given as --world" in line


@pytest.mark.parametrize("beside", [(), ("signals.parquet",)])
def test_files_of_others_are_not_written_over(given, tmp_path, beside):
    """Those of a diagnosis that was stopped are: it writes its signals first."""
    robot, fit, _ = given
    for name in ("report.html", *beside):
        (tmp_path / name).write_text("mine")
    verb = Diagnose(data=(Path(fit),), out=tmp_path, model=Path(robot))
    if beside:
        read_given(verb)
        return
    with pytest.raises(ValueError, match="html is not of a diagnosis"):
        read_given(verb)


def test_several_files_follow_one_flag():
    words = "diagnose --model m.xml --data a b --held-out c d --out o".split()
    verb = parse(words)
    assert isinstance(verb, Diagnose)
    assert [path.name for path in verb.data + verb.held_out] == ["a", "b", "c", "d"]


def test_a_flag_that_would_forget_files_is_refused(given, capsys):
    robot, fit, held = given
    line = refused(
        capsys, "--model", robot, "--data", fit, "--data", held, "--out", "o"
    )
    assert "--data comes twice" in line


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (("", '<freejoint name="base"/>'), "no ground to stand"),
        ((NEITHER, ""), "'m' is no drive"),
        (("", ""), "no actuators"),
    ],
)
def test_robots_that_it_cannot_simulate(tmp_path, capsys, change, text):
    servo, free = change
    robot = model(tmp_path / "arm.xml", servo or (SERVO if free else ""), "")
    if free:
        xml = (tmp_path / "arm.xml").read_text()
        child = '<body><freejoint/><geom size=".1"/><body><joint name="servo"'
        xml = xml.replace('<body><joint name="servo"', child)
        xml = xml.replace("</body></worldbody>", "</body></body></worldbody>")
        (tmp_path / "arm.xml").write_text(xml)
    fit = log(tmp_path / "fit.parquet")
    line = refused(capsys, "--model", robot, "--data", fit, "--out", "o")
    assert text in line and "arm.xml" in line


def test_logs_that_it_cannot_trust(given, tmp_path, capsys):
    robot, fit, held = given
    floating = log(tmp_path / "floating.parquet", base="floating")
    still = log(tmp_path / "still.parquet", reach=0.0)
    out = tmp_path / "out"
    cases = [
        ((floating,), (), "base is floating"),
        ((still,), (), "still.parquet"),
        ((fit, fit), (), "named twice"),
        ((fit,), (fit,), "are also in"),
        ((str(tmp_path / "fit*.parquet"),), (), "no such file; "),
        ((fit,), (str(tmp_path / "none.parquet"),), "held.parquet"),
        ((), (), "--data names no file"),
        ((fit,), (held, held), "is named twice after --held-out"),
    ]
    for data, unseen, text in cases:
        held_out = ["--held-out", *unseen] if unseen else []
        words = ["--model", robot, "--data", *data, *held_out, "--out", str(out)]
        assert text in refused(capsys, *words), text
    words = ["--model", "no.xml", "--data", fit, "--out", str(out)]
    assert "no.xml does not exist" in refused(capsys, *words)
    assert "--seed is -1" in refused(capsys, *words, "--seed", "-1")
    assert not out.exists()
    mine = model(tmp_path / "extended.xml")
    words = ["--model", mine, "--data", fit, "--out", str(tmp_path)]
    assert "would write over it" in refused(capsys, *words)
    words = ["--model", robot, "--data", fit, "--out", held]
    assert "is a file, --out needs a folder" in refused(capsys, *words)


def told(calls):
    """Progress of some calls of the engine: stages said, share done after each."""
    stages, done = [], [0.0]

    def work(units):
        assert units > 0.0
        done.append(done[-1] + units)

    tell = staged(Progress(stages.append, work))
    for stage, share in calls:
        tell(stage, share)
    return stages, done


def test_progress_never_falls_back_or_overshoots():
    rounds = [("causes", k / 5) for _ in range(4) for k in range(1, 6)]
    calls = [("tolerances", 0.5), ("tolerances", 1.0), *rounds, ("measure", 0.0)]
    stages, done = told(calls)
    assert done == sorted(done) and done[-1] < 1.0
    assert stages.count("weigh causes") == 1
    assert stages.count("weigh causes, once more") == 3


def test_progress_reaches_a_stage_where_it_begins():
    _, done = told([("tolerances", 1.0), ("measure", 0.5)])
    assert done[-1] > ENGINE["measure"][1]


CAUSE = {
    "cause": "command_delay",
    "where": ["hip", "knee"],
    "parameters": {
        "delay": {"value": 0.0201, "low": 0.019, "high": 0.021, "unit": "s"},
        "in_loop": {"value": 1.0, "low": 1.0, "high": 1.0, "unit": "1"},
    },
    "probability": 0.876,
    "equivalent": ["measurement_delay"],
}


def test_the_table_of_causes():
    head, first, second = named_lines([CAUSE])
    assert head.split("  ")[0] == "cause"
    for text in ("command_delay", "hip, knee", "delay 0.0201 s", "0.019 to 0.021",
                 "0.88", "measurement_delay"):  # fmt: skip
        assert text in first
    assert second.strip() == "in_loop 1"
    assert first.index("delay 0.0201") == second.index("in_loop")
    assert named_lines([]) == []


def test_a_cause_with_many_values_is_one_row():
    def at(joint, size):
        ends = {"value": size, "low": 0.9 * size, "high": 1.1 * size, "unit": "N*m"}
        rest = {"cause": "coulomb_friction", "variant": "", "equivalent": []}
        return rest | {
            "where": [joint], "parameters": {"torque": ends}, "probability": size,
        }  # fmt: skip

    many = [at(joint, 0.1 * n) for n, joint in enumerate("abcde", start=4)]
    _, row, other, *_ = named_lines([*many, CAUSE])
    for text in ("a, b, c, 2 more", "torque 0.4 to 0.8 N*m", "0.36 to 0.88", "0.40"):
        assert text in row
    assert "command_delay" in other
    assert len(named_lines(many[:3])) == 4


def test_the_gain_is_said_only_where_it_was_measured():
    assert "give logs" in gain_lines(None, False)[0]
    assert "falls at the start" in gain_lines(None, True)[0]
    gain = {"before": 0.02, "after": 0.005, "low": 0.7, "high": 0.8, "promoted": True}
    lines = gain_lines(gain, True)
    assert len(lines) == 1
    assert (
        "1.15 -> 0.286 deg rms, 75% less" in lines[0]
        and "70% less to 80% less" in lines[0]
    )
    told = gain | {"learned_ceiling": 0.03, "noise_floor": 0.001}
    assert (
        "reaches 1.72 deg, worse than the nominal one; noise"
        in gain_lines(told, True)[1]
    )
    told |= {"learned_ceiling": 0.01}
    assert "reaches 0.573 deg; noise is 0.0573 deg" in gain_lines(told, True)[1]
    told = gain | {"without_calibration": 0.0125}
    alone = "0.716 deg with the causes alone, without the numbers fitted again beside"
    assert gain_lines(told, True)[1].split() == [*alone.split(), "them"]
    worse = gain | {"after": 0.021, "promoted": False}
    assert (
        "5% more" in gain_lines(worse, True)[0]
        and "no gain is proven" in gain_lines(worse, True)[-1]
    )


def test_a_verdict_of_none_tells_what_may_be_there_all_the_same():
    least = {
        "cause": "dead_band", "where": ["knee"], "parameter": "half_width",
        "value": 0.00412, "unit": "rad", "at_most": False,
    }  # fmt: skip
    (line,) = unseen_lines({"verdict": "none", "smallest_effects": [least] * 9})
    assert line.count("dead band 0.0041 rad (half_width) at knee") == 3
    assert unseen_lines({"verdict": "named", "smallest_effects": [least]}) == []
    assert unseen_lines({"verdict": "none", "smallest_effects": []}) == []
