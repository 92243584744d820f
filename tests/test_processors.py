"""What a process may use of its machine."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import jax
import pytest

from gatjax import processors
from gatjax.sim.compiled import host, on_cpu


@pytest.mark.skipif(
    not hasattr(os, "sched_setaffinity"), reason="this system binds no process"
)
def test_only_processors_that_the_process_was_given_are_used():
    given = max(os.sched_getaffinity(0))
    ask = (
        "import os, threading, time\n"
        "from gatjax.diagnosis.case import mapped\n"
        f"os.sched_setaffinity(0, {{{given}}})\n"
        "from gatjax.surrogate import make_robot\n"
        "busy = lambda _: time.sleep(0.01) or threading.get_ident()\n"
        "print(len(set(mapped(busy, range(9)))), make_robot('stiff').workers)\n"
    )
    told = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True)
    assert told.stdout.strip() == "1 1"


@pytest.fixture
def groups(tmp_path, monkeypatch):
    """Where the system tells a process its control groups, and where they are."""
    monkeypatch.setattr(processors, "TOLD", tmp_path / "cgroup")
    monkeypatch.setattr(processors, "GROUPS", tmp_path / "groups")
    return tmp_path / "cgroup", tmp_path / "groups"


@pytest.mark.parametrize(
    ("line", "file"),
    [("0::{}", "memory.max"), ("4:cpu,memory:{}", "memory/memory.limit_in_bytes")],
)
def test_a_job_has_no_more_memory_than_its_cluster_gives_it(groups, line, file):
    told, root = groups
    assert processors.memory() > 5e8  # nothing is told: that of the machine
    own = (root / file).parent / "slurm" / "job_7"
    own.mkdir(parents=True)
    told.write_text(f"1:cpuset:/other\n{line.format('/slurm/job_7')}\n")
    whole = processors.memory()
    (own / file.split("/")[-1]).write_text("max\n")
    assert processors.memory() == whole
    (own.parent / file.split("/")[-1]).write_text("300000000\n")  # of all its steps
    assert processors.memory() == 3e8
    (own / file.split("/")[-1]).write_text("200000000\n")
    assert processors.memory() == 2e8


@pytest.mark.parametrize(
    ("line", "files"),
    [
        ("0::{}", {"cpu.max": "{} 100000"}),
        (
            "4:cpu,cpuacct:{}",
            {"cpu/cpu.cfs_quota_us": "{}", "cpu/cpu.cfs_period_us": "100000"},
        ),
    ],
)
def test_a_containers_limit_of_processor_time_counts(groups, monkeypatch, line, files):
    """1.5 processors' time keep two busy, and none of them is one's own."""
    told, root = groups
    monkeypatch.setattr(processors, "_given", lambda: [*range(16)])
    assert processors.usable() == 16 and len(processors.shares(4)) == 4
    told.write_text(line.format("/pod/box") + "\n")
    for folder, limit in (("pod", "150000"), ("pod/box", "400000")):
        for name, text in files.items():
            file = (root / name).parent / folder / name.split("/")[-1]
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text.format(limit) + "\n")
    assert processors.usable() == 2 and processors.shares(2) == []
    for name, text in files.items():
        file = (root / name).parent / "pod" / name.split("/")[-1]
        file.write_text(text.format("max" if len(files) == 1 else "-1") + "\n")
    assert processors.usable() == 4


def test_all_threads_compute_on_the_cpu_and_only_inside():
    before = jax.config.jax_default_device
    with pytest.raises(KeyError), on_cpu(), ThreadPoolExecutor(1) as pool:
        assert pool.submit(lambda: jax.config.jax_default_device).result() == host()
        raise KeyError
    assert jax.config.jax_default_device is before


def test_a_cpu_that_jax_was_told_to_leave_out_is_asked_for(monkeypatch):
    def none(backend):
        raise RuntimeError(f"Unknown backend {backend}")

    monkeypatch.setattr(jax, "local_devices", none)
    with pytest.raises(RuntimeError, match="JAX_PLATFORMS=cuda,cpu"):
        host()
