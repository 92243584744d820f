"""A search on several hosts: the same numbers, whoever comes, goes or dies."""

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
from multiprocessing.connection import Client, Listener
from pathlib import Path

import numpy as np
import pytest

from gatjax.cli import main
from gatjax.cli.arguments import Search, Work
from gatjax.cli.sharing import _files, _told, _unpack, prepared
from gatjax.hosts import Crew, Task, address_of, serve, wire
from gatjax.sim.stored import read_world, write_world
from gatjax.sim.world import nominal
from gatjax.task import Task as TaskHere

TASK = Task({"any": 1}, {"world.json": b"{}"})
POLICIES = np.arange(105.0).reshape(7, 15)
KEYS = np.arange(6, dtype=np.uint32).reshape(3, 2)


def costs(policies, keys):
    """[N, R] of [N, 15] and [R, 2]."""
    return policies[:, :1] + keys[:, 0]


@contextlib.contextmanager
def crew_of(*runs, expected=None):
    """A crew with a host a run, and all that was said."""
    said, results = [], []
    crew = Crew(0, TASK, said.append)

    def host(run):
        def prepare(task):
            assert task == TASK
            return run

        with contextlib.suppress(ValueError):  # nobody leads any more
            results.append(serve(("localhost", crew.port), prepare, 1.0, said.append))

    threads = [threading.Thread(target=host, args=(run,), daemon=True) for run in runs]
    for thread in threads:
        thread.start()
    crew.wait(len(runs) if expected is None else expected, 20.0)
    try:
        yield crew, said, results
    finally:
        crew.close()
        for thread in threads:
            thread.join(20.0)


@contextlib.contextmanager
def linked():
    """Both ends of a connection: the leader's, the host's."""
    with (
        Listener(("localhost", 0), "AF_INET") as door,
        Client(door.address, "AF_INET") as host,
        door.accept() as leader,
    ):
        yield leader, host


def test_hosts_share_the_policies_of_a_generation():
    shares = {"a": [], "b": []}

    def noted(name):
        def run(policies, keys):
            shares[name].append(len(policies))
            return costs(policies, keys)

        return run

    with crew_of(noted("a"), noted("b")) as (crew, said, results):
        for _ in range(2):
            found = crew.evaluate(costs, POLICIES, KEYS)
            np.testing.assert_array_equal(found, costs(POLICIES, KEYS))
    assert shares == {"a": [2, 2], "b": [2, 2]}  # and three for the leader
    assert results == [2, 2]
    assert sum("joined" in line for line in said) == 2


def test_hosts_wait_for_a_search_that_is_not_done():
    with crew_of(costs) as (crew, said, results):
        crew.evaluate(costs, POLICIES, KEYS)
        crew.close(done=False)
    assert results == []
    assert "is gone; waiting 1 s" in said[-1]


def test_a_search_begins_without_hosts_that_do_not_come():
    said = []
    crew = Crew(0, TASK, said.append)
    crew.wait(2, 0.1)
    crew.close()
    assert said == ["begins with 0 of 2 hosts; others may still join"]


def test_more_hosts_than_policies_have_nothing_to_do():
    sizes = []

    def noted(policies, keys):
        sizes.append(len(policies))
        return costs(policies, keys)

    with crew_of(noted, noted, noted) as (crew, _, _):
        found = crew.evaluate(noted, POLICIES[:2], KEYS)
        np.testing.assert_array_equal(found, costs(POLICIES[:2], KEYS))
        found = crew.evaluate(noted, POLICIES, KEYS)
        np.testing.assert_array_equal(found, costs(POLICIES, KEYS))
    assert sorted(sizes) == [1, 1, 1, 2, 2, 2]


def test_answers_to_a_generation_that_failed_here_are_not_those_of_the_next():
    orders = []

    def full(policies, keys):
        raise RuntimeError("out of memory")

    def mortal(policies, keys):
        orders.append(policies)
        if len(orders) == 2:
            raise EOFError  # as if it were gone
        return costs(policies, keys)

    with crew_of(costs, mortal) as (crew, said, _):
        with pytest.raises(RuntimeError, match="out of memory"):
            crew.evaluate(full, POLICIES, KEYS)
        for policies in (POLICIES + 1, POLICIES + 2):
            found = crew.evaluate(costs, policies, KEYS)
            np.testing.assert_array_equal(found, costs(policies, KEYS))
    assert sum("is lost" in line for line in said) == 1


def test_a_host_that_hangs_is_not_waited_for_without_end(monkeypatch):
    monkeypatch.setattr("gatjax.hosts.crew.HUNG", 0.2)
    wakes = threading.Event()

    def hangs(policies, keys):
        wakes.wait(60.0)
        return costs(policies, keys)

    with crew_of(hangs) as (crew, said, _):
        found = crew.evaluate(costs, POLICIES, KEYS)
        wakes.set()
    np.testing.assert_array_equal(found, costs(POLICIES, KEYS))
    assert any("lost (it did not answer in time)" in line for line in said)


def test_what_is_no_answer_is_run_again():
    with crew_of(lambda policies, keys: np.zeros((1, 1))) as (crew, said, _):
        found = crew.evaluate(costs, POLICIES, KEYS)
        np.testing.assert_array_equal(found, costs(POLICIES, KEYS))
        assert any("lost (it sent costs (1, 1)" in line for line in said)
        found = crew.evaluate(costs, POLICIES, KEYS)
        np.testing.assert_array_equal(found, costs(POLICIES, KEYS))


def test_costs_that_are_no_numbers_are_run_again():
    with crew_of(lambda p, k: costs(p, k).astype(str)) as (crew, said, _):
        found = crew.evaluate(costs, POLICIES, KEYS)
    np.testing.assert_array_equal(found, costs(POLICIES, KEYS))
    assert any("lost (it sent costs" in line for line in said)


def test_a_host_that_fails_by_itself_does_not_wait_for_a_leader_that_is_there():
    def full(policies, keys):
        raise OSError(28, "No space left on device")

    crew = Crew(0, TASK, lambda line: None)
    found = []

    def work():
        try:
            serve(("localhost", crew.port), lambda task: full, 5.0, lambda line: None)
        except ValueError as error:
            found.append(str(error))

    host = threading.Thread(target=work)
    host.start()
    crew.wait(1, 5.0)
    crew.evaluate(costs, POLICIES, KEYS)
    host.join(10.0)
    crew.close()
    assert not host.is_alive()
    assert found == ["this host failed: [Errno 28] No space left on device"]


@pytest.mark.parametrize("kind", [ValueError, ImportError, RuntimeError, OSError])
def test_who_cannot_do_the_task_is_sent_away_with_a_reason(kind):
    said = []
    crew = Crew(0, TASK, said.append)

    def unable(task):
        raise kind("no such engine here")

    with pytest.raises(ValueError, match="no such engine"):
        serve(("localhost", crew.port), unable, 5.0, said.append)
    crew.wait(1, 1.0)
    np.testing.assert_array_equal(
        crew.evaluate(costs, POLICIES, KEYS), costs(POLICIES, KEYS)
    )
    crew.close()
    assert "sent away: no such engine here" in said[0]


def test_strangers_do_no_harm(monkeypatch):
    said = []
    crew = Crew(0, TASK, said.append)
    with socket.create_connection(("localhost", crew.port)) as stranger:
        stranger.sendall(b"GET / HTTP/1.0\r\n\r\n")
    with monkeypatch.context() as other:
        other.setattr("gatjax.hosts.work.wire.secret", lambda: b"else")
        with pytest.raises(ValueError, match="another GATJAX_SECRET"):
            serve(("localhost", crew.port), lambda task: costs, 1.0, said.append)
    crew.close()
    assert any("another GATJAX_SECRET" in line for line in said)


def test_a_stranger_that_is_silent_keeps_nobody_out():
    said = []
    crew = Crew(0, TASK, said.append)
    address = ("localhost", crew.port)
    host = threading.Thread(
        target=serve, args=(address, lambda task: costs, 20.0, print), daemon=True
    )
    with socket.create_connection(address):
        host.start()
        crew.wait(1, 20.0)
        joined = list(said)
    crew.close()
    host.join(20.0)
    assert len(joined) == 1
    assert "joined" in joined[0]


@pytest.mark.skipif(
    not hasattr(socket, "TCP_USER_TIMEOUT"), reason="this system can't be told"
)
def test_the_system_gives_a_silent_end_two_minutes():
    def told(link, level, option):
        with socket.socket(fileno=os.dup(link.fileno())) as line:
            return line.getsockopt(level, getattr(socket, option))

    with linked() as (leader, host):
        wire.heed(host)
        wire.hurry(leader)
        assert told(host, socket.SOL_SOCKET, "SO_KEEPALIVE")
        idle, between, count = (
            told(host, socket.IPPROTO_TCP, f"TCP_KEEP{name}")
            for name in ("IDLE", "INTVL", "CNT")
        )
        assert idle + between * count == 120
        assert told(leader, socket.IPPROTO_TCP, "TCP_USER_TIMEOUT") == 120_000
        assert told(host, socket.IPPROTO_TCP, "TCP_USER_TIMEOUT") == 0


def test_half_a_message_is_not_waited_for_without_end(monkeypatch):
    monkeypatch.setattr("gatjax.hosts.wire.SILENCE", 1)
    with linked() as (leader, host):
        wire.hurry(leader)
        os.write(host.fileno(), b"\0\0")
        with pytest.raises(wire.LOST):
            wire.receive(leader)


def test_a_port_that_is_taken_is_said():
    first = Crew(0, TASK, print)
    with pytest.raises(ValueError, match=r"choose another --listen"):
        Crew(first.port, TASK, print)
    first.close()


@pytest.mark.parametrize("text", ["node0", "node0:", ":5123", "node0:x", "node0:70000"])
def test_an_address_has_a_host_and_a_port(text, capsys):
    with pytest.raises(ValueError, match="no HOST:PORT"):
        address_of(text)
    assert main(["work", "--leader", text]) != 0
    assert "no HOST:PORT" in capsys.readouterr().err


def test_nobody_leads(capsys):
    with socket.create_server(("localhost", 0)) as free:
        port = free.getsockname()[1]
    assert main(["work", "--leader", f"localhost:{port}", "--patience", "0"]) != 0
    assert f"--listen {port} there" in capsys.readouterr().err


@pytest.mark.parametrize("patience", ["nan", "-5"])
def test_patience_is_a_time(patience, capsys):
    assert main(["work", "--leader", "localhost:1", "--patience", patience]) == 1
    assert f"--patience is {float(patience)}; use 0 or" in capsys.readouterr().err


def test_hosts_have_the_same_versions():
    task = Task({"versions": {"gatjax": "0.0", "mujoco": "1.0"}}, {})
    with pytest.raises(ValueError, match=r"the leader has .*1\.0"):
        prepared(task, Work(leader="a:1"))


def test_hosts_simulate_the_same():
    """A host whose physics differ would evaluate its share in another simulator."""
    search = Search(out=Path("out"))
    told = json.loads(json.dumps(_told(search).facts))
    assert callable(prepared(Task(told, {}), Work(leader="a:1")))
    told["simulator"]["solver_iterations"] += 1
    with pytest.raises(ValueError, match="install the same gatjax on both"):
        prepared(Task(told, {}), Work(leader="a:1"))


def test_a_host_whose_memory_is_full_takes_turns(monkeypatch, capsys):
    def prepare(world, backend, impl, turns):
        def evaluate(values, policies, keys):
            if turns < 4:
                raise RuntimeError("RESOURCE_EXHAUSTED: x")
            return np.zeros((len(policies), len(keys)))

        return evaluate

    monkeypatch.setattr("gatjax.cli.sharing.prepare", prepare)
    monkeypatch.setattr("gatjax.cli.sharing.costs", lambda backend: backend)
    facts = _told(Search(out=Path("out"))).facts
    task = Task(facts, {})
    run = prepared(task, Work(leader="a:1"))
    assert run(POLICIES, KEYS).shape == run(POLICIES, KEYS).shape == (7, 3)
    said = capsys.readouterr().err
    assert said.count("out of device memory") == 2  # two turns, then four for good
    assert "6 robots at a time" in said


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--hosts", "2"], "--listen PORT"),
        (["--listen", "0", "--hosts", "12", "--population", "12"], "nothing to do"),
        (["--listen", "70000"], "65535"),
    ],
)
def test_flags_that_do_not_fit(flags, said, tmp_path, capsys):
    assert main(["search", "--out", str(tmp_path / "out"), *flags]) != 0
    assert said in capsys.readouterr().err


# Real processes: they walk, and they are killed

MAIN = "import sys; from gatjax.cli import main; sys.exit(main())"
SEARCH = ["--population", "6", "--rollouts", "2", "--generations", "3", "--seed", "3"]


def heard(process, pattern):
    """Read what a process says until a line matches."""
    for line in process.stderr:
        found = re.search(pattern, line)
        if found:
            return found
    raise AssertionError(f"{pattern!r} was not said")


def found_by(folder):
    """Costs of a search, generation by generation."""
    rows = (folder / "metrics.csv").read_text().splitlines()
    return [line.rsplit(",", 1)[0] for line in rows]


def test_a_search_survives_the_death_of_a_host_and_of_its_leader(tmp_path):
    alone, led = tmp_path / "alone", tmp_path / "led"
    with socket.create_server(("localhost", 0)) as free:
        port = str(free.getsockname()[1])
    leads = ["search", "--out", str(led), "--listen", port, *SEARCH, "--hosts"]
    works = ["work", "--leader", f"localhost:{port}", "--patience", "60"]
    with contextlib.ExitStack() as stack:

        def begun(*words):
            process = stack.enter_context(
                subprocess.Popen(
                    [sys.executable, "-c", MAIN, *words],
                    stderr=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    text=True,
                )
            )
            stack.callback(process.kill)
            return process

        assert begun("search", "--out", str(alone), *SEARCH).wait(240) == 0
        leader, dying, staying = begun(*leads, "2"), begun(*works), begun(*works)
        heard(leader, r"generation 0 \(last: 2\)")
        dying.send_signal(signal.SIGKILL)
        heard(leader, r"is lost .*run here")
        leader.send_signal(signal.SIGKILL)
        heard(staying, "is gone; waiting")
        assert begun(*leads, "1").wait(240) == 0
        assert staying.wait(60) == 0
        assert "is done; this host ran" in staying.stdout.read()
    assert found_by(led) == found_by(alone)


def test_a_world_travels_with_all_that_its_model_needs(tmp_path):
    (tmp_path / "robot" / "parts").mkdir(parents=True)
    text = '<mujoco><include file="parts/body.xml"/></mujoco>'
    (tmp_path / "robot" / "robot.xml").write_text(text)
    body = (
        '<mujoco><worldbody><body><joint name="a"/><geom size="1"/></body></worldbody>'
        '<actuator><position joint="a" kp="1"/></actuator></mujoco>'
    )
    (tmp_path / "robot" / "parts" / "body.xml").write_text(body)
    world = nominal(TaskHere(), tmp_path / "robot" / "robot.xml")
    write_world(tmp_path / "world.json", world, {}, None)
    files = _files(tmp_path / "world.json")
    (tmp_path / "there").mkdir()
    _unpack({**files, "../out.txt": b"", "model/../../out.txt": b"", "x": b""},
            tmp_path / "there")  # fmt: skip
    found, _ = read_world(tmp_path / "there")
    assert found.model.nu == 1
    assert not (tmp_path / "out.txt").exists()
    assert {each.name for each in (tmp_path / "there").iterdir()} == {
        "model", "world.json"
    }  # fmt: skip
