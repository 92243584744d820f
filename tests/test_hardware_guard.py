"""The guard: whatever goes wrong, no joint gets what it should not."""

import os
import signal
from functools import cache
from types import SimpleNamespace

import hardware_runs as runs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gatjax.hardware.guard import CROUCH, Guard, Mode
from gatjax.hardware.session import Stopped
from gatjax.records import JOINTS
from gatjax.robot import nao
from gatjax.surrogate.attended import SimulatedNao
from gatjax.surrogate.faults import FAULTS, Direct, reads, started
from gatjax.walk.parameters import THETA0


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_ends_in_a_crouch_or_the_walk_goes_on(name):
    fault, says = FAULTS[name]
    session, link = runs.session(fault)
    if says:
        with pytest.raises(Stopped, match=says):
            runs.walk(session)
        np.testing.assert_allclose(link.nao.told.stiffness, 0.0)
        np.testing.assert_allclose(session.guard.sent[10], CROUCH[10], atol=1e-6)
    else:
        assert np.isinf(runs.walk(session).fell_at)
    runs.check_commands(link)
    assert link.nao.base().position[2] > 0.2  # it has not fallen
    assert np.abs(session.frame.tilt).max() < 0.5


@pytest.mark.parametrize(
    "name",
    [
        "2 frames dropped",
        "10 frames dropped",
        "NaN knee",
        "1 frame 40 ms late",
        "chest button",
    ],
)
def test_the_crouch_begins_within_two_frames(name):
    fault, _ = FAULTS[name]
    began = []

    def watched(link, since, message):
        began.append(len(link.commands))
        return fault(link, since, message)

    session, link = runs.session(watched)
    with pytest.raises(Stopped):
        runs.walk(session)
    targets, _ = runs.check_commands(link)
    first = next(
        index for index in range(began[0], len(targets) - 1)
        if (np.sign(targets[index + 1] - targets[index])
            == np.sign(CROUCH - targets[index])).all()
    )  # fmt: skip
    assert first - began[0] <= 2


def test_a_fall_takes_the_power_at_once():
    def tip(entries):
        entries["Angles"][1] = 1.2

    session, link = runs.session(reads(1 << 30, tip))
    seen = link.receive
    link.receive = lambda wait: seen(wait)._replace(base=link.nao.base())
    walk = runs.walk(session)
    assert np.isfinite(walk.fell_at)
    assert walk.outcome.fell_at == walk.fell_at and walk.outcome.cost > 10.0
    _, powers = runs.check_commands(link)
    on = np.flatnonzero(powers[:, 0] >= 0.99)[-1]
    assert np.flatnonzero(powers[on:, 0] <= 0.0)[0] <= 10  # 0.1 s


def test_a_mind_that_is_killed_or_hangs():
    for number in (signal.SIGKILL, signal.SIGSTOP):
        mind = started(runs.TASK, THETA0)

        def kill(link, since, message, mind=mind, number=number):
            if since == 0:
                os.kill(mind.process.pid, number)
            return message

        session, link = runs.session(kill)
        with pytest.raises(Stopped, match="no target, 2 times in a row"):
            runs.walk(session, mind=mind)
        runs.check_commands(link)
        assert link.nao.base().position[2] > 0.2


@cache
def held():
    """A robot in its hands: its link and its first frame."""
    link = Direct(SimulatedNao("stiff", 0, 0))
    return link, link.receive(0.0)


@pytest.mark.parametrize("missing", [0, 1])
def test_a_sleep_is_seen_where_frames_were_missing_before_it(missing):
    _, first = held()
    guard = Guard(first, SimpleNamespace(realtime=True, clocked=True, period=0.012))

    def later(seconds, ticks):
        at = first.received + seconds
        return first._replace(received=at, time=first.time + 0.012 * ticks)

    assert guard.see(later(0.012, 1)) is not None
    for _ in range(missing):
        guard.see(None)
    guard.see(later(0.012 * (2 + missing), 2 + missing))
    assert guard.mode is Mode.FOLLOW and guard.why == ""
    for _ in range(missing):
        guard.see(None)
    guard.see(later(2.0, 4 + 2 * missing))
    assert guard.mode is Mode.RELEASED and "ms after the one before" in guard.why


@given(
    arrays(float, (6, len(JOINTS)), elements=st.floats(allow_nan=True)),
    st.integers(0, 2),
)
def test_no_wish_breaks_a_limit(wishes, stop):
    link, frame = held()
    guard = Guard(frame, link)
    before = guard.sent
    for index, wish in enumerate(wishes):
        if index == 3:
            guard.stop("", [Mode.FOLLOW, Mode.CROUCH, Mode.LIMP][stop])
        target = guard.command(wish).target
        assert np.isfinite(target).all()
        assert (target >= nao.LOW).all() and (target <= nao.HIGH).all()
        assert (np.abs(target - before) <= nao.SPEEDS * runs.PERIOD + 1e-9).all()
        before = target
