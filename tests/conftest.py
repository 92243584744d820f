"""Every test runs on the CPU, in float64, and with strict broadcasting.

Each worker keeps to a core: pools of threads on all cores take an eighth more time.
"""

import os

os.environ.setdefault("JAX_PLATFORMS", "cpu")
import hypothesis
import jax
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")

CORES = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []

# The same examples on every machine, and no example fails for being slow: the first
# call of a jitted function compiles it.
hypothesis.settings.register_profile(
    "gatjax", deadline=None, derandomize=True, print_blob=True
)
hypothesis.settings.load_profile("gatjax")


def pytest_configure(config):
    """Share compiled functions between runs and workers; a core for each worker."""
    folder = config.rootpath / ".pytest_cache" / "jax"
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")  # gw0, gw1, ...
    if worker and CORES:
        os.sched_setaffinity(0, {CORES[int(worker[2:]) % len(CORES)]})


@pytest.fixture
def all_cores():
    """The test may use every core, as it could without workers."""
    mine = os.sched_getaffinity(0)
    os.sched_setaffinity(0, CORES)
    yield
    os.sched_setaffinity(0, mine)


@pytest.fixture(scope="module")
def short_walks():
    """Runs of the loop have the task SHORT, whatever their settings say."""
    from short_walks import SHORT  # not before the checks of types are in place

    from gatjax.loop import stages

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stages, "task_at", lambda rate_hz: SHORT)
        yield
