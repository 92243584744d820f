"""On mjx a whole generation (ask, all rollouts, tell) is one call, compiled once.

So is that of several trials.
"""

import dataclasses

import jax
import numpy as np
import pytest

from gatjax import loop, search
from gatjax.effects.effect import memoryless
from gatjax.loop.optimise import optimise_all
from gatjax.settings import LoopSettings, SearchSettings
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


def test_trials_are_one_call_and_each_finds_what_it_finds_alone(tmp_path):
    traces, told = [], []

    def change(share, signal):
        traces.append(1)
        return signal._replace(target=(1.0 - share) * signal.target)

    task = Task(settle=0.1, longest_delay=0.04, duration=0.4)
    settings = LoopSettings(search=SETTINGS, backend="mjx", candidates=("best",))
    progress = loop.Progress(told.append, lambda units: None)

    def job(seed, folder):
        (tmp_path / folder / "policies").mkdir(parents=True, exist_ok=True)
        share = np.float64(0.01 * seed)
        world = add_command(nominal(task), "weak", memoryless(change), share)
        return loop.Job(
            folder=tmp_path / folder,
            method="gat",
            iteration=0,
            world=world,
            theta=THETA0 + 0.1 * seed * STEP,
            key=jax.random.key(seed),
            check_key=jax.random.key(9),
        )

    both = optimise_all([job(1, "a"), job(2, "b")], settings, progress)
    assert told == [f"gat: generation {n} of 2, 2 trials" for n in (1, 2)]
    count = len(traces)
    again = optimise_all([job(1, "a"), job(2, "b")], settings, progress)
    assert len(traces) == count  # nothing is left to be done
    alone = loop.optimise(job(2, "c"), settings, progress)
    for one, same, other in zip(both[1], again[1], alone, strict=True):
        assert one.key == same.key == other.key
        np.testing.assert_allclose(same.policy, one.policy, atol=1e-12)
        np.testing.assert_allclose(other.policy, one.policy, atol=1e-6)
    assert not np.allclose(both[0][1].policy, both[1][1].policy)


def test_trials_that_differ_in_more_than_seeds_are_refused(tmp_path):
    one = LoopSettings(search=SETTINGS)
    other = dataclasses.replace(one, seed=1, evaluations=3)
    robot, quiet = loop.Simulator(nominal()), loop.Progress(print, print)
    with pytest.raises(ValueError, match="may differ in their seeds only"):
        loop.run_all([tmp_path, tmp_path], [one, other], robot, quiet)
