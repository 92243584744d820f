"""LoLA: bytes by hand from its description, and client and simulated NAO together."""

import contextlib
import gc
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

import msgpack as library
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gatjax.cli import main
from gatjax.data.recording import check_recording, read_recording
from gatjax.hardware import lola, messagepack
from gatjax.hardware.attendant import WALKS
from gatjax.hardware.deploy import Asked, deploy
from gatjax.hardware.frames import BadFrame, Command, Lost
from gatjax.hardware.lola import Lola, answer, as_frame, read_frame
from gatjax.hardware.session import Session, Stopped
from gatjax.hardware.terminal import Terminal
from gatjax.hardware.tracker import Tracker
from gatjax.records import FORCE_SENSORS, JOINTS
from gatjax.surrogate.attended import SimulatedNao
from gatjax.surrogate.lola import Server
from gatjax.walk.parameters import THETA0
from gatjax.walk.policy import write_policy


def by_hand(**changes):
    """A frame written from the description of LoLA, not by gatjax."""

    def text(word):
        return bytes([0xA0 + len(word)]) + word.encode()

    def floats(values):
        head = (
            bytes([0x90 + len(values)]) if len(values) < 16
            else b"\xdc" + struct.pack(">H", len(values))
        )  # fmt: skip
        return head + b"".join(b"\xca" + struct.pack(">f", value) for value in values)

    parts = {
        "Position": floats([0.01 * index for index in range(25)]),
        "Stiffness": floats([0.5] * 25),
        "Temperature": floats([38.0 + index for index in range(25)]),
        "Current": floats([0.1] * 25),
        "Status": b"\xdc\x00\x19" + bytes(25),
        "FSR": floats([0.1 * index for index in range(8)]),
        "Accelerometer": floats([0.1, 0.2, 9.8]),
        "Gyroscope": floats([0.01, 0.02, 0.03]),
        "Angles": floats([0.05, -0.06]),
        "Battery": floats([0.87, -1.2, 0.0, 31.0]),
        "Sonar": floats([0.3, 0.4]),
        "Touch": floats([1.0] + [0.0] * 13),
        "RobotConfig": b"\x94" + b"".join(
            text(word)
            for word in ("P0000073A03S94700011", "6.0.0",
                         "P0000074A05S93M00061", "6.0.0")
        ),
    } | changes  # fmt: skip
    return bytes([0x80 + len(parts)]) + b"".join(
        text(key) + value for key, value in parts.items()
    )


def test_a_frame_has_896_bytes_and_every_value_finds_its_place():
    message = by_hand()
    assert len(message) == lola.FRAME == 896
    frame = as_frame(read_frame(message), 1.5, 2.5)
    angle = dict(zip(JOINTS, frame.reading.angle, strict=True))
    assert angle["HeadPitch"] == pytest.approx(0.01)
    assert angle["LHipYawPitch"] == pytest.approx(0.07)  # the eighth in LoLA's order
    assert angle["LHand"] == pytest.approx(0.23)
    assert angle["RHand"] == pytest.approx(0.24)
    force = dict(zip(FORCE_SENSORS, frame.reading.force, strict=True))
    assert force["RFootRearRight"] == pytest.approx(0.7 * 9.81)
    assert frame.temperature[JOINTS.index("RWristYaw")] == pytest.approx(60.0)
    np.testing.assert_allclose(frame.reading.gyro, [0.01, 0.02, 0.03], rtol=1e-6)
    np.testing.assert_allclose(frame.tilt, [0.05, -0.06], rtol=1e-6)
    assert (frame.battery, frame.chest) == (pytest.approx(0.87), True)
    assert (frame.time, frame.received) == (1.5, 2.5)


def test_an_answer_is_the_bytes_of_the_description():
    target = np.arange(25.0)
    message = answer(Command(target, np.ones(25)))
    assert message[:1] == b"\x82"
    assert message[1:10] == b"\xa8Position"
    assert message[10:13] == b"\xdc\x00\x19"
    told = messagepack.unpack(message)
    position = dict(zip(lola.ORDER, told["Position"], strict=True))
    assert position["LHipYawPitch"] == JOINTS.index("LHipYawPitch")
    assert position["RHand"] == JOINTS.index("RHand")
    np.testing.assert_array_equal(told["Stiffness"], 1.0)


@pytest.mark.parametrize(
    ("message", "says"),
    [
        (b"", "cannot be read"),
        (by_hand()[:500], "cannot be read"),
        (by_hand() + b"\x00", "too many"),
        (b"\x93\x01\x02\x03", "no map"),
        (b"\xc1" + by_hand()[1:], "cannot be read"),
        (by_hand(FSR=b"\x90"), "FSR"),
        (by_hand(Gyroscope=b"\x93\xa1x\xa1y\xa1z"), "Gyroscope"),
        (b"\x80", "Position"),
    ],
)
def test_a_frame_that_is_none_is_refused_in_a_line(message, says):
    with pytest.raises(BadFrame, match=says):
        read_frame(message)


@given(st.binary(max_size=64), st.integers(0, 895))
def test_no_bytes_break_the_reader(noise, place):
    message = bytearray(by_hand())
    message[place : place + len(noise)] = noise
    try:
        read_frame(bytes(message))
    except BadFrame:
        pass


values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**31), 2**31 - 1) | st.text(max_size=40)
    | st.floats(width=32, allow_nan=False),
    lambda inner: st.lists(inner, max_size=20)
    | st.dictionaries(st.text(max_size=5), inner, max_size=20),
    max_leaves=30,
)  # fmt: skip


@given(values.filter(lambda value: value is not None))
def test_packing_is_that_of_the_library(value):
    def none(entry):
        if isinstance(entry, dict):
            return any(none(part) for part in entry.values())
        return any(map(none, entry)) if isinstance(entry, list) else entry is None

    message = library.packb(value, use_single_float=True)
    assert listed(messagepack.unpack(message)) == value
    if not none(value):
        assert library.unpackb(messagepack.pack(value)) == value


def listed(value):
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {key: listed(entry) for key, entry in value.items()}
    return [listed(entry) for entry in value] if isinstance(value, list) else value


@pytest.fixture
def nao(tmp_path):
    """A simulated NAO in lockstep; the path of its socket."""
    path, said = tmp_path / "nao.sock", []
    server = Server(path, lockstep=True)
    robot = SimulatedNao("stiff", 0, 0)
    thread = threading.Thread(target=server.serve, args=(robot, said.append))
    thread.daemon = True
    thread.start()
    yield path
    server.close()


def test_deploy_walks_and_logs_every_frame(nao, tmp_path, capsys):
    out = tmp_path / "deployed"
    command = ["deploy", "theta0", "--robot", f"lola:{nao}", "--out", str(out)]
    short = ["--seconds", "2", "--walks", "2"]
    assert main([*command, *short]) == 0
    told = json.loads((out / "walks.json").read_text())
    assert [walk["fell_at_s"] for walk in told["walks"]] == [None, None]
    assert all(walk["velocity_m_s"] > 0.05 for walk in told["walks"])
    recording = read_recording(out / "frames_000.csv")
    check_recording(recording, JOINTS)
    assert set(recording.trajectory) == {0, 1}
    for run in (0, 1):
        time = recording.time[recording.trajectory == run]
        np.testing.assert_allclose(np.diff(time), lola.PERIOD, atol=1e-6)
        assert len(time) > 2.5 / lola.PERIOD
    # A diagnosis of a robot that stands takes no rows of a crouch, whose power goes.
    assert (recording.columns["stiffness.LKneePitch"] == 1.0).all()
    columns = recording.columns
    late = columns["sent"] - columns["received"]
    assert (late > 0.0).all()
    assert (read_recording(out / "between_000.csv").trajectory == -1).all()
    capsys.readouterr()
    assert main([*command, *short]) == 0  # both are there
    assert json.loads((out / "walks.json").read_text()) == told
    assert main([*command, "--seconds", "2", "--walks", "1"]) == 0  # none is forgotten
    assert json.loads((out / "walks.json").read_text()) == told
    for other in (["--seconds", "3"], ["--forward", "0.5"]):
        assert main([*command, "--walks", "2", *short, *other]) == 1
        assert "choose another --out" in capsys.readouterr().err
    write_policy(tmp_path, "slow", 0.9 * THETA0, {})
    command[1] = str(tmp_path / "slow.json")
    assert main([*command, *short]) == 1
    assert "has walks with policy theta0, not" in capsys.readouterr().err
    (out / "walks.json").write_text('{"robot": {}}')
    assert main([*command, *short]) == 1
    assert "is of something else" in capsys.readouterr().err
    assert not (out / "frames_001.csv").exists()


def test_a_stop_in_the_last_crouch_hides_no_walk(nao, tmp_path, monkeypatch):
    """And of the walk that will not be nothing is said."""
    rest = Session.rest

    def pressed(session):
        if session.run == 0:
            os.kill(os.getpid(), signal.SIGINT)
        rest(session)

    monkeypatch.setattr(Session, "rest", pressed)
    said, out = [], tmp_path / "out"
    person = Terminal()
    monkeypatch.setattr(person, "say", said.append)
    with pytest.raises(KeyboardInterrupt):
        deploy(Path("theta0"), f"lola:{nao}", Asked(2, seconds=1.0), out, person)
    (told,) = json.loads((out / "walks.json").read_text())["walks"]
    assert told["fell_at_s"] is None
    assert said[-1].startswith("walk 1: ") and "walk 2 of 2" not in said
    monkeypatch.setattr(Session, "rest", rest)
    said.clear()
    deploy(Path("theta0"), f"lola:{nao}", Asked(3, seconds=1.0), out, person)
    places = [k for k, line in enumerate(said) if line.startswith("walk 2")]
    assert said[places[0]] == "walk 2 of 3"
    assert (
        said[places[1]].startswith("walk 2: ") and said[places[1] + 1] == "walk 3 of 3"
    )


def test_collect_and_evaluate_through_lola(nao, tmp_path, capsys):
    out = tmp_path / "walks.parquet"
    at = ["--robot", f"lola:{nao}", "--rate-hz", "83.3"]
    assert main(["collect", *at, "--trajectories", "1", "--out", str(out)]) == 0
    recording = read_recording(out)
    check_recording(recording, JOINTS)
    assert {"base.x", "command.LKneePitch", "force.LFootFrontLeft"} <= set(
        recording.columns
    )
    place = tmp_path / "evaluated"
    assert main(["evaluate", *at, "--runs", "1", "--out", str(place)]) == 0
    assert "lola" in capsys.readouterr().out


def test_a_robot_is_never_left_with_power(nao, tmp_path):
    """A program that fails while the robot stands lets it crouch first."""

    class Broken(Terminal):
        def ready(self, what, frame):
            if what == WALKS:
                raise EOFError("nobody at the terminal")
            return super().ready(what, frame)

    out = tmp_path / "deployed"
    with pytest.raises(EOFError):
        deploy(Path("theta0"), f"lola:{nao}", Asked(), out, Broken())
    stiffness = read_recording(out / "between_000.csv").columns["stiffness.LKneePitch"]
    assert stiffness.max() == 1.0 and stiffness[-1] < 0.02


def test_nothing_holds_the_loop_up(nao, tmp_path, monkeypatch):
    """While the robot has power no collection looks at what was there before."""
    other = "gatjax.surrogate.lola.unhindered"  # the simulated robot is in this process
    monkeypatch.setattr(other, contextlib.nullcontext)
    frozen, collected = {}, gc.get_threshold()

    class Watching(Quiet):
        def ready(self, what, frame):
            if what not in frozen:  # counting takes milliseconds
                frozen[what] = gc.get_freeze_count(), sys.getswitchinterval()
            return super().ready(what, frame)

    asked = Asked(seconds=0.5)
    deploy(Path("theta0"), f"lola:{nao}", asked, tmp_path / "out", Watching())
    assert len(frozen) == 2
    assert all(n > 10_000 and seconds < 0.001 for n, seconds in frozen.values())
    assert gc.get_freeze_count() == 0 and gc.get_threshold() == collected


def test_the_delay_is_three_frames(nao):
    """A request shows in the third frame after the one that it answers."""
    robot = SimulatedNao("stiff", 0, 0)
    robot.angle = np.zeros(25)
    robot._put_down()
    knee = JOINTS.index("LKneePitch")
    before = robot.reading().angle.copy()
    target = before.copy()
    target[knee] += 0.5
    moved = []
    for _ in range(6):
        robot.advance(robot.told._replace(target=target, stiffness=np.ones(25)))
        moved.append(robot.reading().angle[knee] - before[knee])
    # A step of 29 deg: nothing, nothing, 0.26 deg, more than a degree.
    assert abs(moved[0]) < 0.002 and abs(moved[1]) < 0.002
    assert 0.003 < moved[2] < 0.01 and moved[3] > 0.015


class Robot:
    """LoLA's side of a socket, frame by frame, under the test's hand."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.socket.bind(str(path))
        self.socket.listen(1)
        self.link = Lola(path)
        self.client, _ = self.socket.accept()

    def send(self, *gyros):
        """Send frames in one piece, which a number tells apart."""
        parts = [
            by_hand(Gyroscope=b"\x93" + 3 * (b"\xca" + struct.pack(">f", gyro)))
            for gyro in gyros
        ]
        self.client.sendall(b"".join(parts))

    def close(self):
        """Let go."""
        for end in (self.link, self.client, self.socket):
            end.close()


@pytest.fixture
def robot(tmp_path):
    robot = Robot(tmp_path / "lola")
    yield robot
    robot.close()


def test_in_real_time_the_last_of_several_frames_counts(robot):
    link = robot.link
    assert link.realtime and link.receive(0.0) is None
    robot.send(1.0)
    first = link.receive(1.0)
    assert link.identity == "P0000073A03S94700011"
    robot.send(2.0, 3.0, 4.0)
    robot.client.sendall(by_hand()[:100])  # the next one is on its way
    last = link.receive(0.0)
    assert last.reading.gyro[0] == 4.0
    assert last.time - first.time == pytest.approx(3 * lola.PERIOD)
    assert link.receive(0.0) is None
    robot.client.sendall(by_hand()[100:])
    assert link.receive(0.0).reading.gyro[0] == pytest.approx(0.01)


def test_a_robot_in_real_time_is_told_something_each_period(robot):
    """Frames stop: it is still told to crouch, and then has no power."""
    for _ in range(2):
        robot.send(1.0)
    session = Session(robot.link)
    session.guard.share = 1.0
    heard = bytearray()

    def listen():
        while part := robot.client.recv(1 << 16):
            heard.extend(part)

    thread = threading.Thread(target=listen)
    thread.start()
    with pytest.raises(Stopped, match="no frame came that can be read, 2 times"):
        session.wait(lambda frame: False)
    robot.link.close()
    thread.join()
    told, stream = [], bytes(heard)
    while (found := messagepack.first(stream)) is not None:
        told.append(found[0]["Stiffness"][0])
        stream = found[1]
    assert len(told) > 100 and told[-1] == 0.0  # a crouch, then a second to no power


@pytest.mark.parametrize(
    ("notes", "says"),
    [
        ("{", "not JSON"),
        ("[]", "expected"),
        ('{"tracked": 3}', "'tracked' is unknown"),
        ('{"tracker": "here"}', "use a port, or HOST:PORT"),
        ('{"tracker": "127.0.0.1:99999"}', "cannot listen"),
    ],
)
def test_notes_beside_a_socket_that_are_wrong(notes, says, nao):
    nao.with_name("nao.sock.json").write_text(notes)
    with pytest.raises((ValueError, OSError), match=says):
        Lola(nao)


def test_notes_of_a_killed_simulation_do_not_slow_a_robot(tmp_path):
    """The watchdog of a robot must not believe that it waits for answers."""
    notes = tmp_path / "lola.json"
    notes.write_text('{"lockstep": true}')
    os.utime(notes, (1e9, 1e9))  # before the socket
    robot = Robot(tmp_path / "lola")
    assert robot.link.realtime
    robot.close()


def test_an_answer_that_is_none_ends_a_client_and_not_the_robot(nao):
    for noise in (b"\x93\x01\x02\x03", b"\xc1", b"\x91" * 5000,
                  messagepack.pack({"Position": [float("nan")] * 25}),
                  messagepack.pack({"Position": [0.0] * 3}),
                  messagepack.pack({"Stiffness": "much"})):  # fmt: skip
        link = Lola(nao)
        link.receive(5.0)
        link.socket.sendall(noise)
        with pytest.raises(Lost):
            for _ in range(3):
                link.receive(5.0)
        link.close()
    deploy(Path("theta0"), f"lola:{nao}", Asked(seconds=0.5), nao.parent / "o", Quiet())


class Quiet(Terminal):
    """Nobody; motion capture knows."""

    def say(self, text):
        pass


def test_a_message_without_end_is_refused():
    for depth in (10, 100_000):
        with pytest.raises(ValueError, match="MessagePack"):
            messagepack.unpack(b"\x91" * depth)


def test_who_is_not_there_and_who_runs_at_another_rate(nao, tmp_path, capsys):
    with pytest.raises(Lost, match="gatjax nao"):
        Lola(tmp_path / "nobody")
    command = ["collect", "--robot", f"lola:{nao}", "--out", str(tmp_path / "x.csv")]
    assert main(command) == 1
    assert "--rate-hz 83.3" in capsys.readouterr().err
    folder = tmp_path / "runs"
    assert main(["run", "--robot", f"lola:{nao}", "--out", str(folder)]) == 1
    assert "--rate-hz 83.3" in capsys.readouterr().err
    assert not folder.exists()  # nothing for --resume to take up
    for flag, value in (("--walks", "0"), ("--forward", "3"), ("--seconds", "nan")):
        assert main(["deploy", "theta0", "--robot", f"lola:{nao}", flag, value]) == 1
        assert f"{flag} is {value}" in capsys.readouterr().err
    for robot, out, says in (
        ("lola:", tmp_path, "no address after its colon"),
        (f"lola:{nao}", nao.parent / "notes.txt", "is a file"),
    ):
        (nao.parent / "notes.txt").write_text("mine")
        assert main(["deploy", "theta0", "--robot", robot, "--out", str(out)]) == 1
        assert says in capsys.readouterr().err
    assert main(["deploy", "theta1", "--robot", f"lola:{nao}"]) == 1
    assert "no such policy" in capsys.readouterr().err
    file = tmp_path / "notes.txt"
    file.write_text("mine")
    assert main(["nao", "--socket", str(file)]) == 1
    assert "is a file" in capsys.readouterr().err and file.read_text() == "mine"
    assert main(["run", "--robot", f"lola:{nao}", "--methods", "oracle"]) == 1
    assert "oracle searches on the robot itself" in capsys.readouterr().err
    assert main(["evaluate", "--robot", "karl"]) == 1
    assert "choose from simulator, dart, stiff, lola" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("number", "after"), [(signal.SIGSTOP, 1.0), (signal.SIGHUP, 0.0)]
)
def test_in_real_time_a_robot_that_lost_its_power_stays_down(number, after, tmp_path):
    """A client that slept gives no power back; one without a terminal crouches."""
    server, robot = Server(tmp_path / "s", lockstep=False), SimulatedNao("stiff", 0, 0)
    powers, live = [], robot.advance
    robot.advance = lambda told: powers.append(told.stiffness.max()) or live(told)
    args = (robot, lambda text: None)
    threading.Thread(target=server.serve, args=args, daemon=True).start()
    command = [sys.executable, "-m", "gatjax.hardware", "theta0", "--seconds", "60"]
    place = ["--robot", f"lola:{server.path}", "--out", tmp_path / "out"]
    process = subprocess.Popen([*command, *place], stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60.0
    while not (powers and powers[-1] == 1.0):
        assert time.monotonic() < deadline and process.poll() is None
        time.sleep(0.01)
    process.send_signal(number)
    if number == signal.SIGHUP:
        process.send_signal(number)  # some terminals say it twice
    time.sleep(after)
    process.send_signal(signal.SIGCONT)
    assert process.wait(60.0) in (1, 130)
    server.close()
    off = np.flatnonzero(np.diff(powers) < 0.0)
    went = powers[off[0] :]  # from the first loss of power on
    assert max(np.diff(went)) <= 0.0 and went[-1] < 0.02
    if number == signal.SIGHUP:
        assert len(off) > 50  # a second from full power to none, not a tenth


def test_a_kill_loses_less_than_the_last_second(nao, tmp_path):
    out = tmp_path / "deployed"
    command = [sys.executable, "-m", "gatjax.hardware", "theta0", "--seconds", "60"]
    process = subprocess.Popen(
        [*command, "--robot", f"lola:{nao}", "--out", out], stderr=subprocess.DEVNULL
    )
    path, deadline = out / "frames_000.csv", time.monotonic() + 60.0
    while not (path.exists() and path.stat().st_size > 1_000_000):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    process.kill()
    killed = time.monotonic()
    process.wait()
    recording = read_recording(path)
    check_recording(recording, JOINTS)
    assert killed - recording.columns["received"][-1] < 1.0


def _until_free(port):
    """Wait for who has a killed program's port: it may have been starting a walk."""
    deadline = time.monotonic() + 30.0
    while True:
        try:
            return Tracker(str(port)).close()
        except OSError:
            assert time.monotonic() < deadline
            time.sleep(0.05)


def test_a_kill_between_walks_leaves_the_report_of_the_first(nao, tmp_path):
    out, policy = tmp_path / "deployed", tmp_path / "p.json"
    write_policy(tmp_path, "p", THETA0, {})
    order = [policy, "--robot", f"lola:{nao}", "--out", out, "--seconds"]
    command = [sys.executable, "-m", "gatjax.hardware", *order, "1", "--walks", "99"]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    report, deadline = out / "walks.json", time.monotonic() + 60.0
    while not (report.is_file() and json.loads(report.read_text())["walks"]):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    process.kill()
    process.wait()
    _until_free(json.loads(Path(f"{nao}.json").read_text())["tracker"])
    asked, address = Asked(1, seconds=1.0), f"lola:{nao}"
    for other in (Asked(1, seconds=2.0), Asked(1, forward=0.5, seconds=1.0)):
        with pytest.raises(ValueError, match="choose another --out"):
            deploy(policy, address, other, out, Quiet())
    write_policy(tmp_path, "p", 0.9 * THETA0, {})
    with pytest.raises(ValueError, match="not as it is now; choose another --out"):
        deploy(policy, address, asked, out, Quiet())


def test_a_second_nao_does_not_take_the_socket_of_the_first(tmp_path):
    first = Server(tmp_path / "s", lockstep=False)
    with pytest.raises(OSError, match="a NAO is there already"):
        Server(tmp_path / "s", lockstep=False)
    first.socket.close()  # killed: its socket stays behind
    first.tracker.close()
    Server(tmp_path / "s", lockstep=False).close()


def test_who_only_looks_is_not_told_of(tmp_path):
    server, said = Server(tmp_path / "s", lockstep=True), []
    silent = "disconnected: no answers while it had power"
    robot = SimulatedNao("stiff", 0, 0)
    thread = threading.Thread(target=server.serve, args=(robot, said.append))
    thread.start()
    for answers in (0, 2):
        link = Lola(tmp_path / "s")
        for _ in range(answers):
            frame = link.receive(5.0)
            link.send(Command(frame.reading.angle, np.zeros(25)))
        link.close()
    until = time.monotonic() + 10.0
    while len(said) < 3 and time.monotonic() < until:
        time.sleep(0.01)
    server.close()
    thread.join(10.0)
    assert said[:1] + said[-2:] == ["connected", "client left", silent]
    assert said.count("connected") == 1


def test_a_nao_that_is_closed_lets_go_of_its_client(tmp_path):
    server, robot = Server(tmp_path / "s", lockstep=True), SimulatedNao("stiff", 0, 0)
    thread = threading.Thread(target=server.serve, args=(robot, lambda text: None))
    thread.start()
    link = Lola(tmp_path / "s")
    frame = link.receive(5.0)
    server.close()
    link.send(Command(frame.reading.angle, np.zeros(25)))
    thread.join(10.0)
    assert not thread.is_alive()
    link.close()


def test_a_kill_takes_the_socket_along(tmp_path):
    path = tmp_path / "s"
    process = subprocess.Popen(
        [sys.executable, "-m", "gatjax.cli", "nao", "--robot", "stiff",
         "--socket", str(path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    assert process.stdout is not None and b"as a NAO at" in process.stdout.readline()
    process.terminate()
    _, error = process.communicate(timeout=60)
    assert error.startswith(b"gatjax: stopped") and not list(tmp_path.iterdir())
