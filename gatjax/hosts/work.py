"""A host that works for a leader."""

from __future__ import annotations

import contextlib
import os
import platform
import time
from collections.abc import Callable
from multiprocessing import AuthenticationError
from multiprocessing.connection import Client, Connection

from gatjax.hosts import wire
from gatjax.hosts.crew import Run
from gatjax.hosts.wire import LOST, Task

FAILURES = (ValueError, ImportError, RuntimeError, OSError)  # of preparing a task
PAUSE = 1.0  # s between attempts to reach the leader


def serve(
    address: tuple[str, int],
    prepared: Callable[[Task], Run],
    patience: float,
    say: Callable[[str], None],
) -> int:
    """Work for a leader until it says that it is done.

    A leader that dies is waited for: it goes on where it was, and so does this host.

    Args:
        address: host and port of the leader.
        prepared: what runs the policies of a task; raises one of FAILURES where this
            host can not.
        patience: s to wait for a leader that is not there.
        say: shows a line to the user.

    Returns:
        Shares of generations that it ran.

    Raises:
        ValueError: one line: no leader, another secret, or the task can't be done.
    """
    answered = 0
    while True:
        with _reached(address, patience) as link:
            done, shares = _worked(link, prepared, say, _name(address))
        answered += shares
        if done:
            return answered
        say(f"{_name(address)} is gone; waiting {patience:.0f} s for it")


def _worked(
    link: Connection,
    prepared: Callable[[Task], Run],
    say: Callable[[str], None],
    leader: str,
) -> tuple[bool, int]:
    """Do what is asked for; say whether the leader is done, and in how many shares."""
    shares = 0
    with contextlib.suppress(*LOST):
        task = wire.task_of(wire.receive(link))
        me = f"{platform.node()} (process {os.getpid()})"
        try:
            run = prepared(task)
        except FAILURES as error:
            wire.send(link, name=me, refusal=str(error))
            raise ValueError(str(error)) from error
        wire.send(link, name=me, refusal="")
        say(f"works for {leader}")
        while "end" not in (order := wire.receive(link)):
            try:
                costs = run(order["policies"], order["keys"])
            except LOST as error:  # of this host's own: nobody is gone
                raise ValueError(f"this host failed: {error}") from error
            wire.send(link, number=order["number"], costs=costs)
            shares += 1
        return True, shares
    return False, shares


def _reached(address: tuple[str, int], patience: float) -> Connection:
    """Connect, as soon as the leader is there."""
    end = time.monotonic() + patience
    while True:
        try:
            link = Client(address, "AF_INET", authkey=wire.secret())
        except AuthenticationError:
            raise ValueError(
                f"{_name(address)} has another GATJAX_SECRET; give both the same"
            ) from None
        except LOST as error:
            if time.monotonic() > end:
                raise ValueError(
                    f"nobody leads at {_name(address)} ({error}); start gatjax search "
                    f"with --listen {address[1]} there"
                ) from None
            time.sleep(PAUSE)
            continue
        wire.heed(link)
        return link


def _name(address: tuple[str, int]) -> str:
    """HOST:PORT."""
    return f"{address[0]}:{address[1]}"
