"""SimSpark: recorded traffic, replayed; live where GATJAX_SIMSPARK names a server."""

import json
import os
import re
import socket
from collections import deque
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from simspark_server import Kinematic, Recorded, Walking, lines

from gatjax.cli import main
from gatjax.data.recording import check_recording, read_recording
from gatjax.hardware.agent import parse
from gatjax.hardware.deploy import Asked, deploy
from gatjax.hardware.frames import BadFrame, Command, Lost
from gatjax.hardware.links import open_link
from gatjax.hardware.monitor import torso
from gatjax.hardware.simspark import EFFECTORS, PERIOD, SLOTS, SimSpark, shared
from gatjax.hardware.terminal import Terminal
from gatjax.records import JOINTS

DATA = Path(__file__).parent / "data" / "simspark"
TYPE = {"nao": "simspark", "naov4": "simspark-v4"}


def stance():
    """The stance of the recordings, degrees in SimSpark's signs."""
    angle = dict.fromkeys(EFFECTORS, 0.0)
    for side, sign in (("l", 1.0), ("r", -1.0)):
        arm, leg = f"{side}ae", f"{side}le"
        angle |= {f"{arm}1": -90.0, f"{arm}2": 10.0 * sign}
        angle |= {f"{arm}3": -80.0 * sign, f"{arm}4": -30.0 * sign}
        angle |= {f"{leg}3": 25.0, f"{leg}4": -50.0, f"{leg}5": 25.0}
    return angle


def gait(seconds):
    """The gait of the recordings."""
    angle, ramp = stance(), min(1.0, max(0.0, (seconds - 2.0) / 2.0))
    left = 2.0 * np.pi * seconds / 0.4
    for side, phase in (("l", left), ("r", left + np.pi)):
        lift = 30.0 * max(0.0, np.sin(phase)) * ramp
        swing, sway = -8.0 * np.cos(phase) * ramp, 4.0 * np.sin(left) * ramp
        angle[f"{side}le3"] += 0.5 * lift + swing
        angle[f"{side}le4"] -= lift
        angle[f"{side}le5"] += 0.5 * lift - swing
        angle[f"{side}le2"] += sway
        angle[f"{side}le6"] -= sway
    return angle


def told(angle):
    """Targets [J] of angles in SimSpark's signs."""
    target = np.zeros(len(JOINTS))
    for slot, degrees in zip(SLOTS, angle.values(), strict=True):
        target[slot.joint] = slot.sign * np.deg2rad(degrees)
    return Command(target, np.ones(len(JOINTS)))


@pytest.fixture
def server(request):
    recorded = Recorded(lines(DATA / f"{request.param}.txt.gz"))
    yield recorded, request.param
    recorded.close()


ALL = ["nao_stand", "naov4_stand", "nao_walk", "naov4_walk"]


@pytest.mark.parametrize("server", ALL, indirect=True)
def test_the_client_says_what_was_recorded(server):
    recorded, name = server
    robot, motion = name.split("_")
    messages = recorded.messages
    scene = messages[0][1].replace("(syn)", "")
    link = SimSpark(TYPE[robot], "127.0.0.1", recorded.port, scene=scene)
    frames = []
    for _ in range(sum(side == "<" for side, _ in messages) - 4):
        frames.append(link.receive(5.0))
        seconds = len(frames) * PERIOD  # of the target: one frame ahead
        link.send(told(gait(seconds) if motion == "walk" else stance()))
    link.close()
    said = [text for side, text in messages if side == ">"]
    heard = [re.sub(r"\(\w+s [\d.]+\)", "", text) for text in recorded.heard]
    assert len(heard) >= 1000
    assert heard == said[: len(heard)]
    check_frames(frames, motion)


def check_frames(frames, motion):
    """The signs of what is read: by the laws of motion, from the ground truth."""
    np.testing.assert_allclose(np.diff([f.time for f in frames]), PERIOD, atol=2e-3)
    late = frames[200:]
    angle = np.array([frame.reading.angle for frame in late])
    if motion == "stand":
        assert np.rad2deg(angle[-1, JOINTS.index("LKneePitch")]) == pytest.approx(
            50.0, abs=0.5
        )
    up = np.mean([frame.reading.accelerometer for frame in late], axis=0)
    assert up[2] == pytest.approx(9.8, abs=0.2) and np.abs(up[:2]).max() < 1.0
    force = np.mean([frame.reading.force.sum() for frame in late])
    assert 44.0 < force < 51.0  # the robots weigh 4.6 and 5.0 kg
    quaternion = np.array([frame.base.quaternion for frame in late])
    gyro = np.array([frame.reading.gyro for frame in late])
    if motion == "walk":
        forward = late[-1].base.position[0] - late[0].base.position[0]
        assert 1.5 < forward < 4.0
        for axis, part in enumerate(turned(quaternion).T):
            assert np.corrcoef(part, gyro[1:-1, axis])[0, 1] > 0.9


def turned(quaternion):
    """Body rates [T - 2, 3] rad/s of attitudes [T, 4]."""
    old, new = quaternion[:-2] * [1.0, -1.0, -1.0, -1.0], quaternion[2:]
    w = old[:, 0] * new[:, 0] - (old[:, 1:] * new[:, 1:]).sum(1)
    vector = old[:, :1] * new[:, 1:] + new[:, :1] * old[:, 1:]
    vector += np.cross(old[:, 1:], new[:, 1:])
    return 2.0 * vector * np.sign(w)[:, None] / (2.0 * PERIOD)


def test_the_monitor_port_sees_the_torso():
    seen = [torso(text) for _, text in lines(DATA / "nao_monitor_5s.txt.gz")]
    bases = [base for base in seen if base is not None]
    assert len(bases) == 3
    np.testing.assert_allclose(bases[1].position, [-12.0, 0.0, 0.396], atol=1e-3)
    np.testing.assert_allclose(np.abs(bases[1].quaternion), [1, 0, 0, 0], atol=1e-3)
    np.testing.assert_allclose(bases[2].position[2], 0.384, atol=1e-3)


def test_a_force_is_shared_so_that_its_centre_stays():
    for left in (True, False):
        sensors = shared(["0.0", "0.02", "0"], ["0", "0", "40"], left)
        assert sensors.sum() == pytest.approx(40.0)
        assert sensors.min() >= 0.0
    left = shared(["-0.02", "0.05", "0"], ["0", "0", "40"], True)
    assert left.argmax() == 0  # front left


@given(st.text(alphabet="() ab.1-", max_size=60))
def test_no_message_breaks_the_reader(text):
    try:
        parse(text)
    except BadFrame:
        depth = np.cumsum([(c == "(") - (c == ")") for c in text])
        assert depth[-1] != 0 or depth.min() < 0


def test_who_is_not_there_says_what_to_do(monkeypatch, capsys):
    monkeypatch.setenv("GATJAX_SIMSPARK", "127.0.0.1:1")
    with pytest.raises(Lost, match="GATJAX_SIMSPARK"):
        open_link("simspark")
    assert main(["evaluate", "--robot", "simspark:nowhere"]) == 1
    assert "HOST:PORT" in capsys.readouterr().err


def test_silence_is_an_error_and_not_a_wait(monkeypatch):
    monkeypatch.setattr("gatjax.hardware.simspark.PATIENCE", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        with pytest.raises(Lost, match=r"no answer to .scene rsg/agent/nao"):
            SimSpark("simspark", "127.0.0.1", port)


@pytest.mark.parametrize("robot", TYPE.values())
def test_a_whole_walk_over_the_wire(robot, tmp_path, capsys):
    """A server whose robot only moves its joints: every phase of two runs."""
    server = Kinematic()
    out = tmp_path / "walked"
    command = ["deploy", "theta0", "--robot", f"{robot}:127.0.0.1:{server.port}"]
    asked = ["--walks", "2", "--seconds", "1", "--out", str(out)]
    assert main([*command, *asked]) == 0
    assert "walk 2: 0.0 cm/s, stood to the end" in capsys.readouterr().out
    recording = read_recording(out / "frames_000.csv")
    check_recording(recording, JOINTS)
    assert set(recording.trajectory) == {0, 1}
    knee = recording.columns["position.LKneePitch"]
    told = recording.columns["command.LKneePitch"]
    walking = recording.trajectory == 0
    assert np.corrcoef(knee[walking][2:70], told[walking][:68])[0, 1] > 0.95
    scenes = [text for text in server.heard if text.startswith("(scene")]
    assert len(scenes) >= 3  # looked at, then made anew for each run
    stiff = any("(lle3s 1.00)" in text for text in server.heard)
    assert stiff == (robot == "simspark-v4")
    server.close()


def test_a_robot_walks_over_the_wire(tmp_path):
    """MuJoCo's NAO, whose joints take speeds as SimSpark's do, walks theta0."""
    server, out = Walking(), tmp_path / "walked"
    address = f"simspark-v4:127.0.0.1:{server.port}"
    asked = Asked(walks=2, seconds=2.0)
    deploy(Path("theta0"), address, asked, out, Terminal())
    told = json.loads((out / "walks.json").read_text())["walks"]
    assert max(walk["velocity_m_s"] for walk in told) > 0.1
    places = read_recording(out / "place_000.csv")
    assert set(places.trajectory) >= {0, 1}
    server.close()


@pytest.mark.skipif(
    "GATJAX_SIMSPARK" not in os.environ, reason="GATJAX_SIMSPARK names no server"
)
@pytest.mark.parametrize("robot", ["simspark", "simspark-v4"])
def test_live(robot, tmp_path, capsys):
    command = ["evaluate", "--robot", robot, "--rate-hz", "50", "--runs", "2"]
    assert main([*command, "--out", str(tmp_path)]) == 0
    assert "cm/s" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("pull", "tilt"),
    [("0 0 9.8", [0, 0]), ("0 -9.8 0", [0, 90]), ("-9.8 0 0", [90, 0])],
)
def test_a_robot_without_gps_knows_from_its_accelerometer_how_it_lies(pull, tilt):
    """Upright, on its face, on its left side; SimSpark tells right, forward, up."""
    robot = object.__new__(SimSpark)
    robot.monitor, robot._angle = None, np.zeros(len(JOINTS))
    robot._temperature, robot._battery = np.zeros(len(JOINTS)), 1.0
    robot._pulls = deque(maxlen=10)
    frame = robot._frame(parse(f"(time (now 1.0))(ACC (n torso) (a {pull}))"), 0.0)
    np.testing.assert_allclose(frame.tilt, np.deg2rad(tilt), atol=1e-9)
