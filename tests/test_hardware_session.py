"""A robot under guard before and after its walks, and who holds the process."""

import os
import signal

import hardware_runs as runs
import numpy as np
import pytest

from gatjax import task as tasks
from gatjax.hardware import session as sessions
from gatjax.hardware.frames import Lost
from gatjax.hardware.guard import CROUCH, FELL, Guard, Mode, Stage
from gatjax.hardware.lola import ORDER
from gatjax.hardware.mind import Mind
from gatjax.hardware.session import Session, Stopped, first_frame
from gatjax.records import JOINTS, Reading
from gatjax.surrogate.attended import SimulatedNao
from gatjax.surrogate.faults import Direct, frozen
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
    assert (guard.mode, guard.why) == (Mode.LIMP, FELL)
    powers = [guard.command(None).stiffness[0] for _ in range(10)]
    assert powers[-1] <= 0.0


def test_a_bent_robot_without_power_rises_from_where_it_is():
    session, link = lying()
    link.nao.angle = link.nao.angle.copy()
    link.nao.angle[KNEE] = 1.0
    changed(link, lambda frame: frame)
    session.take()
    count = iter(range(200))
    session.wait(lambda frame: next(count) == 100, power=0.0)
    assert session.guard.sent[KNEE] == pytest.approx(1.0, abs=0.05)


def test_a_frozen_shoulder_is_told_and_does_not_end_a_walk():
    session, _ = runs.session(frozen("Position", ORDER.index("LShoulderPitch")))
    walk = runs.walk(session)
    assert np.isinf(walk.fell_at) and len(walk.rows) > 150
    assert session.guard.odd == {"LShoulderPitch"}


@pytest.mark.parametrize(
    "number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT]
)
def test_whatever_ends_the_process_lets_it_crouch_first(number):
    session, link = lying()
    changed(link, lambda frame: os.kill(os.getpid(), number) or frame, after=30)
    with session.interruptible(), pytest.raises(KeyboardInterrupt):
        session.prepare(tasks.pose(THETA0))
    assert link.nao.told.stiffness.max() == 0.0
    with session.interruptible(), pytest.raises(KeyboardInterrupt):
        session.take()  # it stays down


def test_ctrl_z_does_not_leave_it_alone():
    session, _ = lying()
    with session.interruptible():
        os.kill(os.getpid(), signal.SIGTSTP)  # would stop this test for ever
        assert signal.getsignal(signal.SIGTTIN) is signal.SIG_IGN


def test_an_error_of_ours_does_not_drop_it():
    session, link = runs.session()
    before = len(link.commands)

    def broken(frame):
        raise ZeroDivisionError

    changed(link, broken, after=50)
    with pytest.raises(ZeroDivisionError):
        runs.walk(session)
    targets, powers = runs.check_commands(link)
    assert powers[before:, 0].max() == 1.0 and powers[-1, 0] == 0.0
    np.testing.assert_allclose(targets[-1, KNEE], CROUCH[KNEE], atol=1e-6)


def test_a_robot_that_is_silent_or_not_ours(monkeypatch):
    monkeypatch.setattr(sessions, "OPENING", 0.1)
    link = Direct(SimulatedNao("stiff", 0, 0))
    link.receive = lambda timeout: None
    with pytest.raises(Lost, match=r"no frame that can be read in 0\.1 s; nobody"):
        first_frame(link)
    assert not link.commands  # whoever holds it is not disturbed
    session, link = runs.session()
    link.receive = lambda timeout: None
    with pytest.raises(Stopped, match="no frame came"):
        runs.walk(session)
    assert link.nao.told.stiffness.max() == 0.0  # it went down without a frame


def test_trying_a_mind_changes_nothing_that_it_says():
    readings = [
        Reading(np.full(25, 0.01 * k), np.zeros(3), np.zeros(3), np.ones(8))
        for k in range(5)
    ]
    said = []
    for tried in (False, True):
        mind = Mind(runs.TASK, THETA0)
        if tried:
            assert np.isfinite(mind.pace()).all()
        said.append([mind.ask(reading, True, 5.0) for reading in readings])
        mind.close()
    np.testing.assert_array_equal(*said)
