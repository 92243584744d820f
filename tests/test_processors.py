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
    assert processors.usable() == sorted(os.sched_getaffinity(0))
    given = processors.usable()[-1]
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
