"""Every test runs on the CPU, in float64, and with strict broadcasting."""

import os
import pkgutil

os.environ.setdefault("JAX_PLATFORMS", "cpu")

import hypothesis
import jax
import jaxtyping
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")

# The same examples on every machine, and no example fails for being slow: the first
# call of a jitted function compiles it.
hypothesis.settings.register_profile(
    "gatjax", deadline=None, derandomize=True, print_blob=True
)
hypothesis.settings.load_profile("gatjax")


INNERMOST = ("coordinates", "fit", "hypotheses", "joint", "tolerances", "valleys")


def pytest_configure(config):
    """Keep compiled functions between runs and share them between workers.

    Types are checked at run time in the rooms that pyproject.toml names, and in the
    diagnosis but for what its fits call a million times.
    """
    room = config.rootpath / "gatjax" / "diagnosis"
    modules = [each.name for each in pkgutil.iter_modules([str(room)])]
    jaxtyping.install_import_hook(
        [f"gatjax.diagnosis.{name}" for name in modules if name not in INNERMOST],
        "beartype.beartype",
    )
    folder = config.rootpath / ".pytest_cache" / "jax"
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)


@pytest.fixture(scope="module")
def short_walks():
    """Runs of the loop have the task SHORT, whatever their settings say."""
    from short_walks import SHORT  # not before the checks of types are in place

    from gatjax.loop import stages

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stages, "task_at", lambda rate_hz: SHORT)
        yield
