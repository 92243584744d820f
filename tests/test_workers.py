"""Worker processes: what they are told, and how they end."""

import math
import multiprocessing
import os
import signal
import struct
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import pytest

from gatjax import processors
from gatjax.workers import Workers


@pytest.fixture
def workers():
    before = set(multiprocessing.active_children())
    given = Workers(2)
    yield given
    given.close()
    assert set(multiprocessing.active_children()) <= before


def test_all_jobs_are_done_and_tell_their_places(workers):
    found = dict(workers.results(math.hypot, [(3.0, 4.0), (6.0, 8.0), (5.0, 12.0)]))
    assert found == {0: 5.0, 1: 10.0, 2: 13.0}
    assert dict(workers.results(math.sqrt, [(4.0,)])) == {0: 2.0}  # they serve again


def test_they_leave_a_gpu_and_threads_of_linear_algebra_alone(workers, monkeypatch):
    monkeypatch.delenv("JAX_PLATFORMS", raising=False)
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
    names = [("JAX_PLATFORMS",), ("OPENBLAS_NUM_THREADS",)]
    assert dict(workers.results(os.getenv, names)) == {0: "cpu", 1: "1"}
    assert os.environ["OPENBLAS_NUM_THREADS"] == "7"
    assert "JAX_PLATFORMS" not in os.environ


@pytest.mark.skipif(
    not hasattr(os, "sched_setaffinity"), reason="the system shares no processors out"
)
def test_each_keeps_to_its_share_of_the_processors():
    shares = processors.shares(2)
    assert set.union(*shares) == os.sched_getaffinity(0)
    workers = Workers(1, [{min(shares[0])}])
    try:
        own = {0: {min(shares[0])}}
        assert dict(workers.results(os.sched_getaffinity, [(0,)])) == own
    finally:
        workers.close()


def test_jobs_begin_before_anybody_listens(workers, tmp_path):
    results = workers.results(Path.touch, [(tmp_path / "done",)])
    for _ in range(200):
        if (tmp_path / "done").exists():
            break
        time.sleep(0.1)
    assert (tmp_path / "done").exists()
    assert dict(results) == {0: None}


def test_an_error_of_one_ends_the_others(workers):
    with pytest.raises(ValueError, match="non-negative"):
        list(workers.results(time.sleep, [(600.0,), (-1.0,)]))


def test_who_stops_listening_ends_them_all(workers):
    results = workers.results(time.sleep, [(600.0,), (0.0,)])
    assert next(results) == (1, None)
    results.close()


def test_a_process_that_the_system_kills_is_told(workers):
    with pytest.raises(BrokenProcessPool, match="memory ran out"):
        list(workers.results(os._exit, [(1,)]))


def test_one_that_was_killed_while_it_waited_is_told(workers):
    (found,) = workers.results(os.getpid, [()])
    os.kill(found[1], signal.SIGKILL)
    pool: Any = workers._pool
    while not pool._broken:
        time.sleep(0.01)
    with pytest.raises(BrokenProcessPool, match="memory ran out"):
        workers.results(os.getpid, [()])


def test_one_that_ends_while_it_tells_something_leaves_nobody_waiting():
    """The first bytes of a result have come, and the rest never will."""
    workers = Workers(1)
    workers.results(time.sleep, [(600.0,)])
    assert workers._pool is not None
    started = struct.pack("!i", 1000) + b"x" * 10  # as Connection.send_bytes begins
    os.write(workers._pool._result_queue._writer.fileno(), started)
    time.sleep(0.5)
    closing = threading.Thread(target=workers.close, daemon=True)
    closing.start()
    closing.join(30.0)
    assert not closing.is_alive()


def test_a_stop_while_they_begin_ends_them(monkeypatch):
    """They are known before all of their jobs are given."""
    before = set(multiprocessing.active_children())
    submit, given = ProcessPoolExecutor.submit, []

    def stopped(self, *job):
        if given:
            raise KeyboardInterrupt
        given.append(submit(self, *job))
        return given[0]

    monkeypatch.setattr(ProcessPoolExecutor, "submit", stopped)
    with pytest.raises(KeyboardInterrupt):
        Workers(2).results(time.sleep, [(600.0,), (600.0,)])
    assert set(multiprocessing.active_children()) <= before


SCRIPT = """
import math
from gatjax.workers import Workers
workers = Workers(2)
print(dict(workers.results(math.sqrt, [(4.0,), (9.0,)])))
workers.close()
"""


def test_a_script_needs_no_guard_and_runs_once(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    asked = [sys.executable, script]
    told = subprocess.run(asked, capture_output=True, text=True, timeout=120)
    assert told.stdout in ("{0: 2.0, 1: 3.0}\n", "{1: 3.0, 0: 2.0}\n"), told.stderr


LASTING = """
import math
import jax  # with it modules end in another order
from gatjax.workers import Workers
workers = Workers(1)
print(dict(workers.results(math.sqrt, [(4.0,)])))
"""


def test_a_script_that_does_not_close_them_ends_without_a_word(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(LASTING)
    asked = [sys.executable, script]
    told = subprocess.run(asked, capture_output=True, text=True, timeout=120)
    assert (told.stdout, told.stderr) == ("{0: 2.0}\n", "")


PARENT = """
import os, sys, time
from gatjax.workers import Workers

if __name__ == "__main__":
    workers = Workers(1)
    print(dict(workers.results(os.getpid, [()]))[0], flush=True)
    list(workers.results(time.sleep, [(600.0,)]))
"""


def test_they_end_when_whoever_began_them_is_killed(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE) as parent:
        child = int(parent.stdout.readline())
        os.kill(child, 0)
        parent.kill()
    for _ in range(100):
        if gone(child):
            return
        time.sleep(0.1)
    os.kill(child, 9)
    pytest.fail("the worker outlived its parent by ten seconds")


def gone(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    stat = Path(f"/proc/{process}/stat")  # where nobody reaps orphans it stays, dead
    return stat.exists() and stat.read_text().split(") ")[1][0] == "Z"
