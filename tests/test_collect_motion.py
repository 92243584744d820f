"""Motions on robots: stand-in robots, simulated worlds, and the command line."""

import json

import mujoco
import numpy as np
import pytest

from gatjax import motions
from gatjax.cli import main
from gatjax.data.recording import check_recording, read_recording
from gatjax.loop import Simulator
from gatjax.loop.play import Play, Player, record_motion
from gatjax.records import JOINTS
from gatjax.robot.model import joint_names
from gatjax.sim.limbs import limbs_of
from gatjax.sim.world import add_cause, nominal
from gatjax.surrogate import ROBOTS, make_robot
from gatjax.task import task_at

HEAD, HIPS = JOINTS.index("HeadYaw"), [JOINTS.index(s + "HipPitch") for s in "LR"]
ARM = """
<mujoco model="arm">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default>
    <joint damping="0.3" armature="0.01"/>
    <position kp="20" kv="0.7" forcerange="-4 4"/>
  </default>
  <worldbody>
    <body pos="0 0 1">
      <joint name="lift" axis="0 1 0" range="-1.5 1.0"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2"/>
      <body pos="0.2 0 0">
        <joint name="turn" axis="1 0 0"/>
        <geom type="capsule" fromto="0 0 0 0 0.1 0" size="0.02" mass="0.1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="lift" joint="lift" ctrlrange="-1.2 0.9"/>
    <position name="turn" joint="turn"/>
  </actuator>
  <keyframe><key qpos="0.4 0.1"/></keyframe>
</mujoco>
"""
POST = """
<mujoco model="post">
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <geom type="plane" size="1 1 0.1"/>
    <body pos="0 0 1">
      <freejoint/>
      <geom type="box" size="0.05 0.05 0.05" mass="0.5"/>
      <body pos="0 0 -0.25">
        <joint name="lift" type="slide" axis="0 0 1" range="-0.01 0.22" damping="20"/>
        <geom type="box" size="0.1 0.1 0.01" mass="1"/>
      </body>
    </body>
  </worldbody>
  <actuator><position name="lift" joint="lift" kp="500"/></actuator>
</mujoco>
"""  # stands on a wide foot, 0.26 m high, and can kneel


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    return path


def head_turn(robot, seconds=1.5):
    """Targets that turn the head by 0.5 rad and back while the robot stands."""
    time = np.arange(round(50.0 * seconds)) / 50.0
    targets = np.tile(robot.limbs().home, (len(time), 1))
    targets[:, HEAD] += 0.25 * (1.0 - np.cos(2.0 * np.pi * time / seconds))
    return targets


def robot_of(name):
    return make_robot(name, workers=1)


def same(first, second):
    for one, other in zip(first, second, strict=True):
        if isinstance(one, tuple):
            same(one, other)
        else:
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_standing_robot_follows_and_keeps_its_feet(name):
    robot = robot_of(name)
    assert isinstance(robot, Player)
    targets = head_turn(robot)
    record = robot.play(np.stack([targets, targets]), 50.0, [0, 1])
    assert record.alive.shape == (2, 75) and record.alive.all()
    np.testing.assert_array_equal(record.command[0], targets)
    np.testing.assert_allclose(record.time[1], np.arange(75) * 0.02)
    head = record.reading.angle[0, :, HEAD]
    late = [np.mean((head[k:75] - targets[: 75 - k, HEAD]) ** 2) for k in range(15)]
    assert 3 <= np.argmin(late) <= 8  # 36 ms of transport and a servo
    assert np.sqrt(min(late)) < 0.03
    # It has come to rest before the first row.
    assert np.abs(record.reading.gyro[:, :5]).max() < 0.1
    alone = robot.play(targets[None], 50.0, [1])
    np.testing.assert_array_equal(alone.reading.angle[0], record.reading.angle[1])
    assert np.any(record.reading.gyro[0] != record.reading.gyro[1])


@pytest.mark.parametrize("name", ROBOTS)
def test_a_fall_ends_a_motion(name):
    robot = robot_of(name)
    targets = head_turn(robot, 2.0)
    targets[25:, HIPS] -= 0.8  # bow
    record = robot.play(targets[None], 50.0, [0])
    alive = record.alive[0]
    last = int(alive.sum())
    assert 25 < last < 100 and alive[:last].all()
    held = record.reading.angle[0, last:]
    np.testing.assert_array_equal(held, np.tile(held[0], (len(held), 1)))


@pytest.mark.parametrize("name", [*ROBOTS, "simulator"])
def test_an_odd_rate_is_refused(name):
    robot = Simulator(nominal()) if name == "simulator" else robot_of(name)
    with pytest.raises(ValueError, match="60"):
        robot.play(head_turn(robot)[None], 60.0, [0])


def test_the_simulator_stands_and_follows():
    robot = Simulator(nominal())
    assert isinstance(robot, Player)
    limbs, standing = robot.limbs(), make_robot("stiff").limbs()
    assert limbs.names == JOINTS and limbs.floating
    for mine, its in zip(limbs[1:4], standing[1:4], strict=True):
        np.testing.assert_allclose(mine, its, rtol=1e-4)
    targets = head_turn(robot)
    record = robot.play(np.stack([targets, targets]), 50.0, [0, 1])
    assert record.alive.all()
    np.testing.assert_allclose(record.reading.angle[0, 0], targets[0], atol=0.02)
    weight = nominal().model.body_mass.sum() * 9.81
    assert record.reading.force.sum(-1).mean() == pytest.approx(weight, rel=0.03)
    assert np.any(record.reading.gyro[0] != record.reading.gyro[1])  # noise
    same(record, robot.play(np.stack([targets, targets]), 50.0, [0, 1]))
    targets[25:, HIPS] -= 0.8
    alive = robot.play(targets[None], 50.0, [0]).alive[0]
    assert alive[:30].all() and not alive[-1]


def test_any_floating_robot_is_put_on_the_floor_and_may_kneel(tmp_path):
    path = tmp_path / "post.xml"
    path.write_text(POST)
    robot = Simulator(nominal(source=path))
    assert robot.limbs().floating
    targets = np.zeros((2, 100, 1))
    targets[1, 20:] = 0.2
    record = robot.play(targets, 50.0, [0, 1])
    np.testing.assert_allclose(record.base.position[0, :, 2], 0.26, atol=0.01)
    assert record.alive[0].all()
    assert record.alive[1, :20].all() and not record.alive[1, -1]


def test_limbs_of_a_model(arm):
    limbs = limbs_of(mujoco.MjModel.from_xml_path(str(arm)))
    assert limbs.names == ("lift", "turn") and not limbs.floating
    np.testing.assert_allclose(limbs.limits, [[-1.2, 0.9], [-np.pi, np.pi]])
    np.testing.assert_allclose(limbs.home, [0.4, 0.1])
    np.testing.assert_allclose(limbs.speed, 4.0 / (0.3 + 0.7))


def test_a_bolted_arm_follows_from_rest(arm):
    world = add_cause(nominal(source=arm), "gain_error", ["lift"], {"scale": 0.5})
    play = Play(
        motion=motions.MENU["hold_loaded"],
        joints=np.array([True, False]),
        rate_hz=50.0,
        seeds=range(7, 9),
        reach=0.5,
        seconds=12.0,
    )
    log, falls = record_motion(Simulator(world), play)
    check_recording(log, joint_names(world.model))
    assert falls == 0
    assert sorted(log.columns) == sorted(
        f"{family}.{joint}"
        for family in ("command", "position")
        for joint in ("lift", "turn")
    )
    assert log.metadata["base"] == "fixed" and log.metadata["rate_hz"] == 50.0
    assert log.metadata["motion"] == "hold_loaded" and log.metadata["joints"] == "lift"
    assert np.bincount(log.trajectory).tolist() == [600, 600]
    lift, told = log.columns["position.lift"], log.columns["command.lift"]
    assert lift[0] == pytest.approx(lift[40], abs=1e-3)  # a second of rest
    sagging = lift[0] - told[0]  # the arm hangs down: + is down
    torque = 9.81 * (0.2 * 0.1 + 0.1 * 0.2) * np.cos(lift[0])
    assert sagging == pytest.approx(torque / 10.0, rel=0.05)  # half of kp 20
    assert np.any(told[:600] != told[600:])  # each run has a draw of its own


def test_a_simulation_that_falls_apart_is_refused(arm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log there
    stiff = ARM.replace('kp="20"', 'kp="20000"').replace("implicitfast", "Euler")
    arm.write_text(stiff.replace('forcerange="-4 4"', ""))
    world = nominal(source=arm)
    play = Play(motions.MENU["chirp"], np.ones(2, bool), 50.0, [0], 0.6, 10.0)
    with pytest.raises(ValueError, match=r"falls apart .* s into the motion"):
        record_motion(Simulator(world), play)


def collect(capsys, *given):
    code = main(["collect", *map(str, given)])
    out, error = capsys.readouterr()
    lines = [line for line in error.strip().splitlines() if not line.startswith("[")]
    return code, out.splitlines(), lines


def test_collect_plays_a_motion(arm, tmp_path, capsys):
    world = tmp_path / "world.json"
    facts = {"schema": "gatjax.world/1", "model": "arm.xml", "effects": []}
    world.write_text(json.dumps(facts))
    out = tmp_path / "new" / "log.parquet"
    given = ("--robot", "simulator", "--world", world, "--seconds", "9", "--rate-hz")
    given += ("100.0", "--motion", "chirp", "--joints", "turn,lift", "--out", out)
    code, lines, error = collect(capsys, *given, "--runs", "2")
    assert (code, error) == (0, [])
    assert lines[0].endswith("2 runs of chirp with reach 0.6")
    assert "mostly for command_delay" in lines[1]
    log = read_recording(out)
    assert np.bincount(log.trajectory).tolist() == [900, 900]
    assert log.metadata["joints"] == "lift,turn"
    assert np.ptp(log.columns["command.lift"]) > 0.5
    np.testing.assert_allclose(np.diff(log.time[:900]), task_at(100.0).control_period)


def test_a_simulated_motion_has_any_rate_and_only_a_nao_walks(arm, tmp_path, capsys):
    world, out = tmp_path / "world.json", tmp_path / "log.parquet"
    facts = {"schema": "gatjax.world/1", "model": "arm.xml", "effects": []}
    world.write_text(json.dumps(facts))
    given = ("--robot", "simulator", "--world", world, "--out", out)
    playing = (*given, "--motion", "chirp", "--seconds", "9", "--runs", "1")
    assert collect(capsys, *playing, "--rate-hz", "240")[0] == 0
    log = read_recording(out)
    np.testing.assert_allclose(np.diff(log.time), 1.0 / 240.0, rtol=1e-6)
    refused = collect(capsys, *playing, "--rate-hz", "4")
    assert "--rate-hz is 4" in refused[2][0]
    assert "arm.xml: only a NAO can walk" in collect(capsys, *given)[2][0]
    assert "a recording ends in" in collect(capsys, "--out", "walks.txt")[2][0]
    for verb in (("search", "--out"), ("evaluate", "--robot", "simulator")):
        tail = (tmp_path / "found",) if verb[-1] == "--out" else ()
        code = main([str(word) for word in (*verb, *tail, "--world", world)])
        assert code == 1 and "only a NAO can walk" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "line"),
    [
        (["--motion", "wave"], "motion 'wave' is unknown; choose from rich, chirp"),
        (["--motion", "rich", "--joints", "LKnee"], "the robot has no joint 'LKnee'"),
        (
            ["--motion", "rich", "--reach", "2"],
            "reach is 2; use more than 0, at most 1",
        ),
        (["--motion", "rich", "--seconds", "3"], "3 s is too short for it; give it"),
        (["--motion", "rich", "--rate-hz", "60"], "rate 60.0 Hz is unknown"),
        (["--motion", "rich", "--runs", "0"], "--trajectories is 0; use 1 or more"),
        (["--motion", "rich", "--policy", "p.json"], "--policy is for walks"),
        (["--joints", "LKneePitch"], "--joints goes with --motion"),
        (["--reach", "0.1"], "--reach goes with --motion"),
        (["--seconds", "9"], "--seconds goes with --motion"),
    ],
)
def test_what_collect_refuses(given, line, tmp_path, capsys):
    out = tmp_path / "log.parquet"
    code, lines, error = collect(capsys, "--out", out, "--robot", "stiff", *given)
    assert code == 1 and lines == []
    assert len(error) == 1 and error[0].startswith("gatjax: ") and line in error[0]
    assert not out.exists()
