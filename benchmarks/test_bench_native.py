"""A closed-loop generation on the native backend beside bare steps, equal physics."""

import pytest

from gatjax.sim.backend import prepare
from gatjax.sim.world import nominal
from gatjax.speed.bench import raced
from gatjax.speed.peers import bare_native
from gatjax.speed.worlds import recorded
from gatjax.task import Task

WORLDS = 160  # the demo's generation: 40 policies x 4 rollouts


@pytest.fixture(scope="module")
def walk():
    return recorded(nominal(Task(duration=2.0, longest_delay=0.0)), WORLDS)


def test_native_beside_bare_stepping(benchmark, ratio, walk):
    backend, bare = prepare(walk.world, "native"), bare_native(walk)

    def closed():
        return backend.outcome(walk.world.values, walk.policies, walk.keys)

    bare()
    benchmark.pedantic(closed, rounds=3, warmup_rounds=1)
    ratio("closed_over_bare", benchmark.stats.stats.min, raced({"bare": bare})["bare"])
    steps = WORLDS * (walk.world.task.ticks - 1) * walk.world.substeps
    benchmark.extra_info["steps_per_s"] = steps / benchmark.stats.stats.min
