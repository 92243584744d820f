"""Who looks after the robot: a terminal, motion capture, and what is asked again."""

import contextlib
import errno
import json
import os
import signal
import socket
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from gatjax.data.recording import read_recording
from gatjax.hardware import process
from gatjax.hardware.deploy import Asked, deploy
from gatjax.hardware.frames import Frame
from gatjax.hardware.guard import Guard
from gatjax.hardware.log import Log
from gatjax.hardware.mind import Mind
from gatjax.hardware.robot import Hardware
from gatjax.hardware.terminal import Terminal
from gatjax.hardware.tracker import STALE, Tracker, place
from gatjax.surrogate.attended import SimulatedNao
from gatjax.surrogate.faults import Direct
from gatjax.surrogate.lola import Server
from gatjax.task import task_at
from gatjax.walk.parameters import THETA0


@pytest.fixture
def keys(monkeypatch):
    """A terminal as standard input; what is written into it was typed."""
    typed, read = os.openpty()
    with os.fdopen(read, "r") as stream:
        monkeypatch.setattr("sys.stdin", stream)
        yield lambda text: os.write(typed, text.encode())
    os.close(typed)


def frame(chest=False):
    seen = Direct(SimulatedNao("stiff", 0, 0)).receive(0.0)
    return seen._replace(chest=chest)


def test_only_enter_alone_and_only_after_the_question(keys, capsys):
    person, quiet = Terminal(), frame()
    keys("\n\n")  # before anything was asked
    time.sleep(0.05)
    assert not person.ready("go?", quiet)
    keys("stop!\n")
    time.sleep(0.05)
    assert not person.ready("go?", quiet)
    keys("\n")
    time.sleep(0.05)
    assert person.ready("go?", quiet)
    assert capsys.readouterr().err.count("go?") == 1


def test_a_button_counts_when_somebody_holds_it_down():
    def told(frames, tilt=0.0):
        person, seen = Terminal(), frame()
        return [
            person.ready(
                "go?",
                seen._replace(
                    time=0.012 * k, chest=down == "#", tilt=np.array([0.0, tilt])
                ),
            )
            for k, down in enumerate(frames)
        ]

    assert not any(told("#" * 30))  # it was down when it was asked for
    assert not any(told("##..###...###"))  # touched
    assert told("##.." + "#" * 9) == [False] * 12 + [True]  # 0.1 s
    assert not any(told("...." + "#" * 30, tilt=1.5))  # it lies on it


def test_a_distance_is_a_number(keys, capsys):
    person = Terminal()
    assert person.distance(2) is None
    keys("far\nnan\n")
    time.sleep(0.05)
    assert person.distance(2) is None
    keys("123.5\n")
    time.sleep(0.05)
    assert person.distance(2) == pytest.approx(1.235)
    told = capsys.readouterr().err
    assert "walk 3: how far" in told and "'far' is no number of centimetres" in told


@contextlib.contextmanager
def screen(monkeypatch):
    """A pipe as standard error; both its ends. (In a fixture pytest takes it back.)"""
    read, write = os.pipe()
    with os.fdopen(write, "w") as stream, monkeypatch.context() as patch:
        patch.setattr("sys.stderr", stream)
        yield read, write
    with contextlib.suppress(OSError):
        os.close(read)


def test_a_terminal_that_is_gone_says_nothing(monkeypatch):
    with screen(monkeypatch) as (read, _):
        os.close(read)
        Terminal().say("hello")


def test_without_a_terminal_nothing_is_said(monkeypatch):
    monkeypatch.setattr("sys.stderr", None)  # 2>&-
    Terminal().say("hello")


def test_a_terminal_that_takes_nothing_holds_no_stop_up(monkeypatch):
    """The handler of a signal runs where the robot is told what to do."""
    with screen(monkeypatch) as (_, write):
        monkeypatch.setattr(process, "STDERR", write)
        os.set_blocking(write, False)
        with contextlib.suppress(BlockingIOError):
            while True:
                os.write(write, b"." * 4096)
        os.set_blocking(write, True)
        asked = []
        with process.interruptible(lambda at_once: asked.append(at_once) or "stops"):
            os.kill(os.getpid(), signal.SIGTERM)  # would wait for ever
        assert asked == [False]


def test_a_terminal_that_takes_nothing_holds_nobody(monkeypatch):
    """Ctrl-S, or a line that is slow: what is to be said waits, the robot does not."""
    with screen(monkeypatch) as (read, write):
        os.set_blocking(write, False)
        with contextlib.suppress(BlockingIOError):
            while True:
                os.write(write, b"." * 4096)
        os.set_blocking(write, True)
        person, quiet = Terminal(), frame()
        person.say("hello")  # would wait for ever
        assert b"hello" not in os.read(read, 1 << 20)
        person.ready("go?", quiet)
        os.set_blocking(read, False)
        assert os.read(read, 1 << 20) == b"hello\ngo?\n"


@pytest.mark.parametrize(
    "told",
    [
        b"\xff", b"[]", b"null", b"{}", b"[" * 3000,
        b'{"position": null, "quaternion": [1, 0, 0, 0]}',
        b'{"position": [1, 2], "quaternion": [1, 0, 0, 0]}',
        b'{"position": [NaN, 0, 0.3], "quaternion": [1, 0, 0, 0]}',
        b'{"position": [0, 0, 0.3], "quaternion": [0, 0, 0, 0]}',
        b'{"position": [0, 0, "x"], "quaternion": [1, 0, 0, 0]}',
    ],
)  # fmt: skip
def test_what_is_no_place_is_none(told):
    assert place(told) is None


def test_a_place_grows_old():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    tracker = Tracker(str(port))
    told = {"position": [1.0, 2.0, 0.3], "quaternion": [1.02, 0.0, 0.0, 0.0]}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bridge:
        for message in (json.dumps(told).encode(), b"noise"):
            bridge.sendto(message, ("127.0.0.1", port))
    base = tracker.latest()
    assert base.position.tolist() == [1.0, 2.0, 0.3]
    assert base.quaternion.tolist() == [1.0, 0.0, 0.0, 0.0]
    time.sleep(1.5 * STALE)
    assert tracker.latest() is None
    tracker.close()
    for address in ("nowhere", "127.0.0.1:99999"):
        with pytest.raises((ValueError, OSError), match="tracker"):
            Tracker(address)


@pytest.fixture
def blind(tmp_path):
    """A simulated NAO of which no motion capture says where it is."""
    path, robot = tmp_path / "nao.sock", SimulatedNao("stiff", 0, 0)
    server = Server(path, lockstep=True)
    server.notes.write_text('{"lockstep": true}')
    thread = threading.Thread(target=server.serve, args=(robot, print), daemon=True)
    thread.start()
    yield f"lola:{path}"
    server.close()


class Person(Terminal):
    """Answers with a distance, too far at first, or not at all."""

    def __init__(self, centimetres=None):
        super().__init__()
        self.centimetres, self.asked = centimetres, []

    def here(self):
        return self.centimetres is not None

    def distance(self, run):
        self.asked.append(run)
        late = len(self.asked) > 2  # it takes some frames
        told = 12.0 if len(self.asked) == 3 else self.centimetres / 100.0
        return told if late else None


def test_a_walk_waits_for_somebody_who_says_how_far_it_went(blind, tmp_path):
    out, asked = tmp_path / "out", Asked(walks=1, seconds=1.0)
    with pytest.raises(ValueError, match="nobody can say how far it walks"):
        deploy(Path("theta0"), blind, asked, out, Person())
    assert len(list(out.glob("walk_*.npz"))) == 1
    person = Person(30.0)
    lines = deploy(Path("theta0"), blind, asked, out, person)
    assert lines[0] == "walk 1: 30.0 cm/s, stood to the end"
    assert person.asked == [0, 0, 0, 0]  # nobody, nobody, 12 m, 30 cm
    again = Person(99.0)
    assert deploy(Path("theta0"), blind, asked, out, again)[0] == lines[0]
    assert again.asked == []


def test_a_robot_is_not_given_power_for_nothing(blind, tmp_path, monkeypatch):
    """Somebody must be there to say how far it went, and its computer be fast."""
    notes = Path(f"{blind.partition(':')[2]}.json")
    notes.write_text("{}")  # it believes that the robot goes on without it
    monkeypatch.setattr(Guard, "_time", lambda *_: None)  # this computer may be busy
    asked, out = Asked(seconds=0.5), tmp_path / "out"
    person = Person()
    with pytest.raises(ValueError, match="nobody can say"):
        deploy(Path("theta0"), blind, asked, out, person)
    slow = np.r_[np.full(60, 0.006), np.full(40, 0.001)]
    monkeypatch.setattr(Mind, "pace", lambda mind: slow)
    with pytest.raises(ValueError, match=r"needs 6\.0 ms a frame .* and has 7\.2"):
        deploy(Path("theta0"), blind, asked, out, person)
    assert not list(out.glob("walk_*"))
    for log in out.glob("between_*.csv"):
        stiffness = read_recording(log).columns["stiffness.LKneePitch"]
        assert stiffness.max() == 0.0


def test_walks_of_another_robot_do_not_count(tmp_path, capsys):
    out, task = tmp_path / "out", task_at(83.3, duration=0.5)
    for body, there in ((0, False), (1, False), (0, True)):
        path = tmp_path / f"{body}.sock"
        server, robot = Server(path, lockstep=True), SimulatedNao("stiff", body, 0)
        args = (robot, lambda text: None)
        threading.Thread(target=server.serve, args=args, daemon=True).start()
        hardware = Hardware(f"lola:{path}", out, Terminal())
        assert hardware.constants()["identity"] == f"STIFF{body:015d}"
        hardware.walk(THETA0[None], [0], task)
        told = capsys.readouterr().err
        assert ("1 of 1 walks are in" in told) is there
        server.close()
    assert len(list(out.glob("walk_*.npz"))) == 2


def test_a_log_never_writes_over_another_and_notes_places(tmp_path):
    (tmp_path / "frames_007.csv").write_text("mine")
    link = Direct(SimulatedNao("stiff", 0, 0))
    seen: Frame = link.receive(0.0)
    log = Log(tmp_path, "lola", "fixed", 0.012)
    assert log.path.name == "frames_008.csv"
    command = type("C", (), {"target": np.zeros(25), "stiffness": np.zeros(25)})
    log.add(0, seen, command, 1.0)
    log.add(0, seen._replace(base=link.nao.base()), command, 1.0)
    log.close()
    assert (tmp_path / "frames_007.csv").read_text() == "mine"
    assert len((tmp_path / "frames_008.csv").read_text().splitlines()) == 3
    places = (tmp_path / "place_008.csv").read_text().splitlines()
    assert places[0] == "time,trajectory,x,y,z,qw,qx,qy,qz" and len(places) == 2


def test_a_full_disk_leaves_whole_rows(tmp_path):
    log = Log(tmp_path, "lola", "fixed", 0.012)

    class Full:
        def __init__(self, file):
            self.file, self.close, self.fileno = file, file.close, file.fileno
            self.tell, self.truncate = file.tell, file.truncate

        def write(self, data):
            if self.file.tell() > 10_000:
                raise OSError(errno.ENOSPC, "No space left on device")
            return self.file.write(data[:1000])

    log._files = [Full(file) for file in log._files]
    seen = Direct(SimulatedNao("stiff", 0, 0)).receive(0.0)
    command = type("C", (), {"target": np.zeros(25), "stiffness": np.zeros(25)})
    for _ in range(3):
        for _ in range(2):
            log.add(0, seen, command, 1.0)
        log._write(False)
    for _ in range(20):
        log.add(0, seen, command, 1.0)
    log.close()
    assert "rows were lost (No space left on device)" in str(log.failed)
    head, *rows = log.path.read_text().splitlines()
    assert len(rows) == 6 and {row.count(",") for row in rows} == {head.count(",")}


def test_a_log_writes_on_where_the_disk_took_a_part(tmp_path):
    """A file without a buffer may write less than it is given, and says how much."""
    log = Log(tmp_path, "lola", "fixed", 0.012)

    class Slow:
        def __init__(self, file):
            self.file, self.close, self.fileno = file, file.close, file.fileno
            self.tell = file.tell

        def write(self, data):
            return self.file.write(data[:7])

    log._files = [Slow(file) for file in log._files]
    seen = Direct(SimulatedNao("stiff", 0, 0)).receive(0.0)
    command = type("C", (), {"target": np.zeros(25), "stiffness": np.zeros(25)})
    log.add(0, seen, command, 1.0)
    log.close()
    head, row = log.path.read_text().splitlines()
    assert row.count(",") == head.count(",")
