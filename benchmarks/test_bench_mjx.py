"""Closed loop on the mjx backend beside bare MJX; compilation apart."""

import time

import jax
import pytest

from gatjax.sim.backend import prepare
from gatjax.sim.world import nominal
from gatjax.speed.bench import raced
from gatjax.speed.peers import bare_mjx
from gatjax.speed.worlds import recorded
from gatjax.task import Task

SMALL, LARGE = 4, 3000  # worlds on a CPU; the paper's generation on an accelerator


@pytest.fixture(scope="module")
def walk():
    worlds = SMALL if jax.default_backend() == "cpu" else LARGE
    return recorded(nominal(Task(duration=0.5, settle=0.1, longest_delay=0.0)), worlds)


def test_mjx_beside_bare_stepping(benchmark, ratio, walk):
    backend, bare = prepare(walk.world, "mjx", "jax"), bare_mjx(walk, "jax")

    def closed():
        given = walk.world.values, walk.policies, walk.keys
        return jax.block_until_ready(backend.outcome(*given))

    begun = time.perf_counter()
    closed()
    first = time.perf_counter() - begun
    jax.block_until_ready(bare())
    benchmark.pedantic(closed, rounds=3)
    ratio("closed_over_bare", benchmark.stats.stats.min, raced({"bare": bare})["bare"])
    benchmark.extra_info["compile_s"] = first - benchmark.stats.stats.min
