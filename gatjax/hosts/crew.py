"""The hosts of a search, as its leader sees them."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable
from multiprocessing import AuthenticationError
from multiprocessing.connection import (
    Connection,
    Listener,
    answer_challenge,
    deliver_challenge,
)
from typing import Any, NamedTuple

import numpy as np

from gatjax.hosts import wire
from gatjax.hosts.wire import LOST, Order, Task

Array = Any
Run = Callable[[Array, Array], Array]
"""(policies [N, 15], words of the keys [R, 2]) -> costs [N, R]."""

HANDSHAKE = 300.0  # s that a host has to look at the task and say whether it can do it
FAREWELL = 5.0  # s for hosts that are being let in when the search ends
HUNG = 600.0  # s that an answer may come after the leader's own share, at least
SLOWER = 20.0  # times as long as the leader for its share a host may take, if more


class Host(NamedTuple):
    """One that joined."""

    name: str
    link: Connection


class Crew:
    """Hosts that joined; others may join while the search runs."""

    def __init__(self, port: int, task: Task, say: Callable[[str], None]) -> None:
        """Begin to listen.

        Args:
            port: to listen at on all addresses of this host; 0 for any free one.
            task: what those who join are told.
            say: shows a line to the user.

        Raises:
            ValueError: one line: the port can not be had.
        """
        try:
            self._door = Listener(("", port), "AF_INET")
        except OSError as error:
            raise ValueError(f"port {port}: {error}; choose another --listen") from None
        self.port = self._door.address[1]
        self._task, self._say, self._open = task, say, True
        self._secret, self._number = wire.secret(), 0
        self._hosts: list[Host] = []
        self._waiting: list[Host] = []
        self._guests: list[threading.Thread] = []
        self._lock = threading.Lock()
        self._porter = threading.Thread(target=self._welcome, daemon=True)
        self._porter.start()

    def wait(self, count: int, seconds: float) -> None:
        """Wait until so many hosts beside the leader have joined, or time is up."""
        end, there = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            with self._lock:
                there = len(self._hosts) + len(self._waiting)
            if there >= count:
                return
            time.sleep(0.05)
        self._say(f"begins with {there} of {count} hosts; others may still join")

    def evaluate(self, run: Run, policies: Array, keys: Array) -> np.ndarray:
        """Costs [N, R] of policies [N, 15] with keys [R, 2], on all hosts.

        What a host that is lost had to do is done by the leader. Hosts beyond the
        policies have nothing to do. If `run` raises, it may be called again.

        Args:
            run: the same on the leader alone.
            policies: of a generation, at least one.
            keys: words of the rollouts' keys.
        """
        with self._lock:
            self._hosts += self._waiting
            self._waiting.clear()
        parts = min(len(self._hosts) + 1, len(policies))
        mine, *shares = np.array_split(np.arange(len(policies)), parts)
        asked = list(zip(self._hosts[: len(shares)], shares, strict=True))
        self._number += 1
        for host, rows in asked:
            self._ask(host, Order(self._number, policies[rows], keys))
        begun = time.monotonic()
        own = np.asarray(run(policies[mine], keys))
        now = time.monotonic()
        end = now + max(HUNG, SLOWER * (now - begun))
        costs = np.empty((len(policies), own.shape[1]), own.dtype)
        costs[mine] = own
        left = []  # run when all have answered, so that nobody's time is up meanwhile
        for host, rows in asked:
            found = self._answer(host, (len(rows), own.shape[1]), end)
            if found is None:
                left.append(rows)
            else:
                costs[rows] = found
        for rows in left:
            costs[rows] = run(policies[rows], keys)
        return costs

    def close(self, done: bool = True) -> None:
        """Send everybody home; a search that is not done may go on, and they wait."""
        self._open = False
        with contextlib.suppress(OSError):  # somebody at the door, so that it is shut
            socket.create_connection(("127.0.0.1", self.port), 1.0).close()
        end = time.monotonic() + FAREWELL
        self._porter.join(FAREWELL)
        for guest in self._guests:
            guest.join(max(0.0, end - time.monotonic()))
        self._door.close()
        for host in [*self._hosts, *self._waiting]:
            with contextlib.suppress(*LOST), host.link:
                if done:
                    wire.send(host.link, end=True)

    def _welcome(self) -> None:
        """Let everybody in by a thread of its own: who is silent keeps nobody out."""
        while self._open:
            with contextlib.suppress(*LOST):
                link = self._door.accept()
                guest = threading.Thread(target=self._admit, args=(link,), daemon=True)
                there = [other for other in self._guests if other.is_alive()]
                self._guests = [*there, guest]
                guest.start()

    def _admit(self, link: Connection) -> None:
        """Let one in that knows the secret and can do the task."""
        try:
            wire.heed(link)
            wire.hurry(link)
            deliver_challenge(link, self._secret)
            answer_challenge(link, self._secret)
            self._introduce(link)
            return
        except AuthenticationError:
            self._say("a host was sent away: it has another GATJAX_SECRET")
        except LOST:
            pass
        except Exception as error:  # of what a stranger sent
            self._say(f"a host was sent away: {error}")
        link.close()

    def _introduce(self, link: Connection) -> None:
        """Tell a host the task, and hear whether it can do it."""
        wire.send_task(link, self._task)
        if not link.poll(HANDSHAKE):
            self._say(f"a host was sent away: {HANDSHAKE:g} s were not enough for it "
                      f"to say whether it can do the task")  # fmt: skip
            link.close()
            return
        answer = wire.receive(link)
        name, refusal = str(answer["name"]), str(answer["refusal"])
        if refusal:
            self._say(f"{name} was sent away: {refusal}")
            link.close()
            return
        with self._lock:
            self._waiting.append(Host(name, link))
        self._say(f"{name} joined")

    def _ask(self, host: Host, order: Order) -> None:
        """Send an order; whether it arrived shows with the answer."""
        try:
            wire.send(host.link, **order._asdict())
        except LOST:
            return

    def _answer(
        self, host: Host, shape: tuple[int, int], end: float
    ) -> np.ndarray | None:
        """Costs that a host sends; None if it is lost, which it then is for good."""
        why = "it did not answer in time"
        try:
            while host.link.poll(max(0.0, end - time.monotonic())):
                answer = wire.receive(host.link)
                costs = answer["costs"]
                if not np.array_equal(answer["number"], self._number):
                    continue  # asked for by a generation that was begun again
                if costs.shape == shape and costs.dtype.kind == "f":
                    return costs
                why = f"it sent costs {costs.shape} {costs.dtype} instead of {shape}"
                break
        except LOST:
            why = "it died or can not be reached"
        except KeyError:
            why = "it sent no costs"
        self._say(f"{host.name} is lost ({why}); its policies are run here")
        self._hosts.remove(host)
        host.link.close()
        return None
