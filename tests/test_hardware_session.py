"""A robot under guard before and after its walks, and who holds the process."""

import contextlib
import os
import select
import signal

import hardware_runs as runs
import numpy as np
import pytest

from gatjax import motions
from gatjax import task as tasks
from gatjax.hardware import process, walks
from gatjax.hardware import session as sessions
from gatjax.hardware.frames import Lost
from gatjax.hardware.guard import CROUCH, FELL, Guard, Mode, Stage
from gatjax.hardware.lola import ORDER
from gatjax.hardware.process import interruptible
from gatjax.hardware.robot import HungHardware
from gatjax.hardware.session import Session, Stopped, first_frame
from gatjax.hardware.terminal import Terminal
from gatjax.loop.play import Play, recorded
from gatjax.motions import standing_nao
from gatjax.records import JOINTS, Reading
from gatjax.surrogate.attended import SimulatedNao
from gatjax.surrogate.faults import (
    PERIOD,
    Direct,
    dropped,
    frozen,
    standing,
    started,
)
from gatjax.walk.parameters import THETA0

KNEE = JOINTS.index("LKneePitch")


def changed(link, change, after=0):
    """Let frames of a link say something else, `after` so many."""
    seen, count = link.receive, [0]

    def receive(timeout):
        frame = seen(timeout)
        count[0] += 1
        return change(frame) if count[0] > after else frame

    link.receive = receive


def lying():
    """A robot in its hands, without power."""
    link = Direct(SimulatedNao("stiff", 0, 0))
    return Session(link), link


def hot(frame):
    temperature = frame.temperature.copy()
    temperature[KNEE] = 95.0
    return frame._replace(temperature=temperature)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (hot, "LKneePitch is hot"),
        (lambda frame: frame._replace(battery=0.02), "battery is at 2 %"),
        (lambda frame: frame._replace(battery=np.nan), "not a number"),
        (lambda frame: frame._replace(chest=True), "button was pressed"),
    ],
)
def test_what_counts_while_it_gets_up(change, says):
    session, link = lying()
    changed(link, change, after=30)
    with pytest.raises(Stopped, match=says):
        session.prepare(tasks.pose(THETA0))
    assert link.nao.told.stiffness.max() == 0.0
    np.testing.assert_allclose(session.guard.sent[KNEE], CROUCH[KNEE], atol=1e-6)


def test_a_button_that_says_go_stops_nothing_and_held_robots_may_tip():
    session, link = lying()
    session.prepare(tasks.pose(THETA0))
    changed(link, lambda frame: frame._replace(chest=True, tilt=np.array([0.0, 1.2])))
    count = iter(range(50))
    session.wait(lambda frame: next(count) == 40)
    assert session.guard.mode is Mode.FOLLOW


@pytest.mark.parametrize("stage", [Stage.WALKS, Stage.RISES])
def test_a_fall_counts_in_frames_that_are_bad_otherwise_and_in_a_crouch(stage):
    link = Direct(SimulatedNao("stiff", 0, 0))
    frame = link.receive(0.0)
    guard = Guard(frame, link)
    guard.share = 1.0
    guard.enter(stage)
    angle = frame.reading.angle.copy()
    angle[KNEE] = np.nan
    down = frame._replace(
        reading=frame.reading._replace(angle=angle), tilt=np.array([0.0, 1.2])
    )
    if stage is Stage.RISES:
        guard.see(down)
        guard.see(down)  # a bad reading, twice: it goes down, held or not
    else:
        guard.see(down)
        assert guard.mode is Mode.FOLLOW  # one frame is a slip
    guard.see(down)
    assert guard.mode is Mode.LIMP and guard.why.endswith(FELL)
    powers = [guard.command(None).stiffness[0] for _ in range(10)]
    assert powers[-1] <= 0.0


def test_a_bent_robot_without_power_rises_from_where_it_is():
    session, link = lying()
    link.nao.angle = link.nao.angle.copy()
    link.nao.angle[KNEE] = 1.0
    session.take()
    count = iter(range(200))
    session.wait(lambda frame: next(count) == 100, power=0.0)
    assert session.guard.sent[KNEE] == pytest.approx(1.0, abs=0.05)


def test_a_frozen_shoulder_is_told_and_does_not_end_a_walk():
    session, _ = runs.session(frozen("Position", ORDER.index("LShoulderPitch")))
    walk = runs.walk(session)
    assert np.isinf(walk.fell_at) and len(walk.rows) > 150
    assert session.guard.odd == {"LShoulderPitch"}


def sent_at(link, *signals):
    """Send this process signals at some frames: (frame, signal)."""
    seen, count = link.receive, [0]

    def receive(timeout):
        count[0] += 1
        for frame, number in signals:
            if frame == count[0]:
                os.kill(os.getpid(), number)
        return seen(timeout)

    link.receive = receive


def crouched(link):
    """Whether it went down with power, which then went in a second."""
    targets, powers = runs.check_commands(link)
    down = np.abs(targets[:, KNEE] - CROUCH[KNEE]) < 1e-6
    return bool(down.any() and powers[np.argmax(down), 0] > 0.9 and powers[-1, 0] == 0)


@pytest.mark.parametrize(
    "number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT]
)
def test_whatever_ends_the_process_lets_it_crouch_first(number, monkeypatch):
    """Even twice: a terminal that closes may say so again."""
    monkeypatch.setattr(process, "AGAIN", 0.0)
    session, link = runs.session()
    again = [(210, number)] if number != signal.SIGINT else []
    sent_at(link, (200, number), *again)
    with interruptible(session.stop), pytest.raises(KeyboardInterrupt):
        runs.walk(session)
    assert crouched(link)
    with interruptible(session.stop), pytest.raises(KeyboardInterrupt):
        session.take()  # it stays down


def test_a_second_ctrl_c_takes_its_power(monkeypatch):
    for again, falls in ((0.0, True), (1e3, False)):  # too soon is the same press
        monkeypatch.setattr(process, "AGAIN", again)
        session, link = runs.session()
        sent_at(link, (200, signal.SIGINT), (205, signal.SIGINT))
        with interruptible(session.stop), pytest.raises(KeyboardInterrupt):
            runs.walk(session)
        _, powers = runs.check_commands(link)
        on = np.flatnonzero(powers[:, 0] >= 0.99)[-1]
        off = np.flatnonzero(powers[on:, 0] <= 0.0)[0]  # frames: 0.1 s, or a second
        assert bool(off <= 10) is falls
        assert crouched(link) is not falls


def test_ctrl_z_does_not_leave_it_alone():
    with interruptible(lambda at_once: ""):
        os.kill(os.getpid(), signal.SIGTSTP)  # would stop this test for ever
        assert signal.getsignal(signal.SIGTTIN) is signal.SIG_IGN


def test_a_stop_after_the_walk_is_not_forgotten():
    """A button in the crouch: the walk counts, and nothing goes on after it."""
    session, link = runs.session()
    changed(link, lambda frame: frame._replace(chest=True), after=330)
    walk = runs.walk(session, runs.TASK)
    assert np.isinf(walk.fell_at) and len(walk.rows) > 200
    assert isinstance(walk.late, Stopped) and "button" in str(walk.late)


def test_a_robot_that_goes_after_the_walk_does_not_take_it_along():
    session, link = runs.session()

    def gone(frame):
        raise Lost("the robot is gone")

    changed(link, gone, after=330)
    walk = runs.walk(session, runs.TASK)
    assert len(walk.rows) > 200 and isinstance(walk.late, Lost)


def test_a_robot_that_lost_its_power_does_not_get_it_back():
    """LoLA takes it while this process sleeps; later commands must not raise it."""
    session, link = runs.session()
    before = len(link.commands)
    changed(link, lambda f: f._replace(received=f.received + 2.0), after=50)
    with pytest.raises(Stopped, match="ms after the one before"):
        runs.walk(session)
    powers = [command.stiffness[0] for command in link.commands[before:]]
    assert min(powers[:50]) == 1.0 and powers[50:] and max(powers[50:]) == 0.0
    session, link = runs.session()
    none = np.zeros(len(JOINTS))
    changed(link, lambda frame: frame._replace(stiffness=none), after=50)
    with pytest.raises(Stopped, match="somebody else took its power"):
        runs.walk(session)
    assert link.commands[-1].stiffness[0] == 0.0


def test_a_robot_that_stalled_is_not_told_where_it_never_went():
    """It stands still for half a second, and hears nothing of the crouch meanwhile."""
    session, link = runs.session()
    seen, sent, count = link.receive, link.send, [0]
    stalls = range(50, 90)  # 0.5 s

    def receive(timeout):
        count[0] += 1
        return None if count[0] in stalls else seen(timeout)

    def send(command):
        if count[0] not in stalls:
            sent(command)

    link.receive, link.send = receive, send
    before = len(link.commands)
    with pytest.raises(Stopped, match="no frame came"):
        runs.walk(session)
    targets = np.array([command.target for command in link.commands[before:]])
    steps = np.abs(np.diff(targets, axis=0)).max(1)
    assert steps.max() < 0.1  # else it is told to be 0.9 rad further at once
    assert np.allclose(targets[-1, KNEE], CROUCH[KNEE], atol=1e-6)


def test_who_ends_it_hears_what_the_robot_does():
    session, _ = lying()
    assert "no power" in session.stop(False)
    session, _ = runs.session()
    assert session.stop(False).startswith("it crouches")
    assert session.stop(True) == "its power is off"


def test_a_single_word_of_motion_capture_is_no_fall():
    for words, falls in ((1, False), (2, True)):
        session, link = runs.session()
        count = [0]

        def seen(frame, words=words, count=count, link=link):
            count[0] += 1
            base = link.nao.base()
            low = base._replace(position=base.position * [1.0, 1.0, 0.1])
            odd = 100 <= count[0] < 100 + words
            return frame._replace(base=low if odd else base)

        changed(link, seen)
        walk = runs.walk(session)
        assert np.isfinite(walk.outcome.fell_at) == falls
        assert np.isfinite(walk.fell_at) == falls


def test_an_error_of_ours_does_not_drop_it(monkeypatch):
    session, link = runs.session()
    slept = []
    monkeypatch.setattr(sessions.time, "sleep", slept.append)
    before = len(link.commands)

    def broken(frame):
        raise ZeroDivisionError

    changed(link, broken, after=50)
    with pytest.raises(ZeroDivisionError):
        runs.walk(session)
    targets, powers = runs.check_commands(link)
    assert powers[before:, 0].max() == 1.0 and powers[-1, 0] == 0.0
    np.testing.assert_allclose(targets[-1, KNEE], CROUCH[KNEE], atol=1e-6)
    assert len(slept) > 80  # a period each: it does not crouch in one


def test_a_robot_that_is_silent_or_not_ours(monkeypatch):
    monkeypatch.setattr(sessions, "OPENING", 0.1)
    link = Direct(SimulatedNao("stiff", 0, 0))
    link.receive = lambda timeout: None
    with pytest.raises(Lost, match=r"no frame that can be read in 0\.1 s; nobody"):
        first_frame(link)
    assert not link.commands  # whoever holds it is not disturbed
    session, link = runs.session()

    def gone(frame):
        raise Lost("LoLA closed the connection")

    changed(link, gone, after=50)
    with pytest.raises(Lost, match="closed the connection: look whether it has"):
        runs.walk(session)
    session, link = runs.session()
    link.receive = lambda timeout: None
    with pytest.raises(Stopped, match=r"no frame came .* look whether it has crouched"):
        runs.walk(session)
    assert link.nao.told.stiffness.max() == 0.0  # it went down without a frame


def test_trying_a_mind_changes_nothing_that_it_says():
    readings = [
        Reading(np.full(25, 0.01 * k), np.zeros(3), np.zeros(3), np.ones(8))
        for k in range(5)
    ]
    said = []
    for tried in (False, True):
        mind = started(runs.TASK, THETA0)
        if tried:
            assert np.isfinite(mind.pace()).all()
        said.append([mind.ask(reading, True, 5.0) for reading in readings])
        mind.close()
    np.testing.assert_array_equal(*said)


def test_a_mind_whose_answer_nobody_reads_ends_without_a_word(capfd):
    mind = started(runs.TASK, THETA0)
    assert mind.ask(Reading(*map(np.zeros, (25, 3, 3, 8))), True, 0.0) is None
    assert select.select([mind.socket], [], [], 5.0)[0]
    mind.socket.close()
    mind.process.wait(5.0)
    assert capfd.readouterr().err == ""


class Hanging(HungHardware):
    """Hung hardware that has its session already."""

    def __init__(self, session):
        self.name, self.period, self.attendant = "nao", PERIOD, Terminal()
        self.held = session

    @contextlib.contextmanager
    def _session(self):
        yield self.held

    def _run(self, session, number, pose, what, run):
        return run()


@pytest.mark.parametrize("since", [10, 298, 299])
def test_frames_that_are_lost_in_a_motion_are_no_fall(since):
    session, link = standing("stiff", dropped(1), 1_000_000)
    link.begin = link.feet + round(walks.STEADY / PERIOD) + since
    targets = np.tile(tasks.pose(THETA0), (300, 1))
    run = Hanging(session).play(targets[None], 1.0 / PERIOD, np.zeros(1, int))
    alive, time = run.alive[0], run.time[0]
    assert alive[-1] and alive.sum() == 299
    assert (np.diff(time[alive]) > 0.0).all()
    assert time[-1] <= 300 * PERIOD


def test_a_hung_robot_keeps_what_came_though_a_frame_was_lost():
    session, link = standing("stiff", dropped(1), 1_000_000)
    limbs, motion = standing_nao()._replace(floating=False), motions.motion("rich")
    link.begin = link.feet + 100
    robot, moving = Hanging(session), np.ones(len(limbs.names), bool)
    play = Play(motion, moving, 1.0 / PERIOD, [0], 0.1, 6.0)
    targets = np.tile(tasks.pose(THETA0), (1, 300, 1))
    trajectory = robot.play(targets, play.rate_hz, np.zeros(1, int))
    assert len(recorded(robot, play, trajectory).time) == 299
    alive = trajectory.alive.copy()
    alive[0, 200:] = False
    with pytest.raises(ValueError, match=r"falls apart 2\.4 s into the motion"):
        recorded(robot, play, trajectory._replace(alive=alive))
