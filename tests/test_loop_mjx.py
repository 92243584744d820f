"""On mjx a whole generation (ask, all rollouts, tell) is one call, compiled once."""

import jax
import numpy as np

from gatjax import search
from gatjax.effects.effect import memoryless
from gatjax.settings import SearchSettings
from gatjax.sim.backend import costs, prepare
from gatjax.sim.world import add_command, nominal
from gatjax.task import Task
from gatjax.walk.parameters import HIGH, LOW, STEP, THETA0

SETTINGS = SearchSettings(population=4, rollouts=2, generations=2)


def test_one_compiled_call_a_generation_whatever_the_values():
    traces = []

    def change(share, signal):
        traces.append(1)  # runs while jax traces, not while the program runs
        return signal._replace(target=(1.0 - share) * signal.target)

    task = Task(settle=0.1, longest_delay=0.04, duration=0.4)
    world = add_command(nominal(task), "weak", memoryless(change), np.float64(0.0))
    backend = prepare(world, "mjx", "jax")
    assert backend.compiled
    space = search.Space(theta0=THETA0, step=STEP, low=LOW, high=HIGH)
    state = search.start(space, SETTINGS, jax.random.key(0))
    step = jax.jit(search.generation(space, SETTINGS, costs(backend)))
    state, first = step(state, world.values, np.int32(0))
    once = len(traces)
    weak = world.values._replace(command={"weak": np.float64(0.02)})
    state, second = step(state, weak, np.int32(1))
    assert len(traces) == once > 0
    assert not np.array_equal(first.policies, second.policies)

    native = prepare(world, "native")
    again = search.start(space, SETTINGS, jax.random.key(0))
    host = search.host_generation(space, SETTINGS, costs(native))
    _, same = host(again, world.values, np.int32(0))
    np.testing.assert_allclose(first.policies, same.policies, rtol=1e-12)
    np.testing.assert_allclose(first.costs, same.costs, atol=1e-3)
