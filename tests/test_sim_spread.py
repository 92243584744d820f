"""The same costs on any number of devices."""

import json
import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gatjax import search
from gatjax.loop.memory import frugal
from gatjax.loop.steps import generation
from gatjax.settings import LoopSettings, SearchSettings
from gatjax.sim.backend import Backend
from gatjax.sim.spread import in_turns
from gatjax.sim.world import nominal
from gatjax.walk.parameters import HIGH, LOW, STEP, THETA0

PROGRAM = """
import json, sys
import jax, numpy as np
from gatjax.sim.spread import over_devices

count = int(sys.argv[1])
assert len(jax.devices()) == count
where = []

def one(values, policies, keys):
    where.append(policies.shape)
    return policies @ values + jax.vmap(jax.random.normal)(keys)

run = jax.jit(over_devices(one, jax.devices()))
policies = np.arange(30.0, dtype=np.float32).reshape(6, 5) / 7.0
keys = jax.random.split(jax.random.key(1), 6)
result = run(np.ones(5, np.float32), policies, keys)
told = {"devices": len(result.devices()), "shape": where[0], "sum": result.tolist()}
print(json.dumps(told))
"""
SEARCH = """
import json, sys
import jax, numpy as np
from gatjax import search
from gatjax.effects.effect import memoryless
from gatjax.loop.steps import generation
from gatjax.settings import LoopSettings, SearchSettings
from gatjax.sim.lighter import lighter
from gatjax.sim.world import add_command, nominal
from gatjax.task import Task
from gatjax.walk.parameters import HIGH, LOW, STEP, THETA0

jax.config.update("jax_enable_x64", True)
traces = []

def change(share, signal):
    traces.append(1)  # runs while jax traces, not while the program runs
    return signal._replace(target=(1.0 - share) * signal.target)

task = Task(settle=0.1, duration=0.2, longest_delay=0.0)
world = add_command(lighter(nominal(task)), "weak", memoryless(change), np.float64(0))
weak = world.values._replace(command={"weak": np.float64(0.02)})
space = search.Space(THETA0, STEP, LOW, HIGH)
wanted = SearchSettings(population=5, rollouts=3)
told = {"devices": len(jax.devices()), "traces": []}
for backend in sys.argv[2:]:
    settings = LoopSettings(search=wanted, backend=backend, impl="jax")
    step = generation(settings, world, space)
    state, costs = search.start(space, wanted, jax.random.key(2)), []
    for number, values in enumerate((world.values, weak)):
        state, info = step(state, values, np.int32(number))
        costs.append(info.costs.tolist())
        told["traces"].append(len(traces))
    told[backend] = {"costs": costs, "mean": info.mean_policy.tolist()}
print(json.dumps(told))
"""


def run(devices, program=PROGRAM, *words):
    flags = f"--xla_force_host_platform_device_count={devices}"
    env = os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"}
    done = subprocess.run(
        [sys.executable, "-c", program, str(devices), *words],
        env=env, capture_output=True, text=True, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize(("devices", "part"), [(2, 3), (4, 2)])
def test_robots_are_shared_out_also_where_devices_do_not_divide_them(devices, part):
    alone, many = run(1), run(devices)
    assert alone["shape"] == [6, 5]
    assert many["shape"] == [part, 5]
    np.testing.assert_allclose(many["sum"], alone["sum"], rtol=1e-6)


@pytest.fixture(scope="module")
def searched():
    return run(1, SEARCH, "mjx", "native")


def test_a_search_is_one_program_and_finds_what_native_finds(searched):
    first, second, *_ = searched["traces"]
    assert first == second > 0  # compiled once, whatever the values
    compiled, native = searched["mjx"], searched["native"]
    np.testing.assert_allclose(compiled["costs"], native["costs"], atol=1e-6)
    np.testing.assert_allclose(compiled["mean"], native["mean"], rtol=1e-6)
    assert np.ptp(compiled["costs"]) > 1e-3


@pytest.mark.parametrize("devices", [2, 4])  # 15 robots: eight each, four each
def test_a_search_finds_the_same_on_several_devices(searched, devices):
    found = run(devices, SEARCH, "mjx")
    first, second = found["traces"]
    assert found["devices"] == devices
    assert first == second > 0
    for what in ("costs", "mean"):
        np.testing.assert_allclose(
            found["mjx"][what], searched["mjx"][what], rtol=1e-9, atol=1e-12
        )


@pytest.mark.parametrize("turns", [1, 2, 4, 7])
def test_robots_run_in_turns(turns):
    sizes = []

    def outcome(values, policies, keys):
        sizes.append(len(policies))
        return policies * values, keys + 1

    policies, keys = np.arange(21.0).reshape(7, 3), np.arange(7)
    found = jax.jit(in_turns(outcome, turns))(2.0, jnp.array(policies), jnp.array(keys))
    np.testing.assert_array_equal(found[0], 2.0 * policies)
    np.testing.assert_array_equal(found[1], keys + 1)
    assert sizes == [-(-7 // turns)]


def generation_that_fits(most, robots, message):
    """Build generations whose device takes `most` robots at a time."""

    def build(turns):
        def step(state, values, number):
            if -(-robots // turns) > most:
                raise jax.errors.JaxRuntimeError(message)
            return state, jnp.asarray(turns)

        return step

    return build


def test_a_search_that_does_not_fit_goes_on_in_turns():
    said = []
    message = "RESOURCE_EXHAUSTED: Out of memory while trying to allocate 9 bytes."
    step = frugal(generation_that_fits(30, 100, message), lambda *_: 100, said.append)
    assert step(0, None, 0)[1] == 4
    assert step(0, None, 1)[1] == 4
    assert [line.split(" robots")[0][-2:] for line in said] == ["50", "25"]
    assert all("out of device memory" in line for line in said)


@pytest.mark.parametrize(
    ("message", "tried"), [("RESOURCE_EXHAUSTED: x", 3), ("INTERNAL: y", 0)]
)
def test_what_turns_do_not_help_is_an_error(message, tried):
    said = []
    step = frugal(generation_that_fits(0, 5, message), lambda *_: 5, said.append)
    with pytest.raises(jax.errors.JaxRuntimeError, match=message):
        step(0, None, 0)
    assert len(said) == tried  # two, four, five turns


def test_robots_of_all_trials_are_counted_where_memory_runs_out(monkeypatch):
    def full(values, policies, keys):
        raise RuntimeError("RESOURCE_EXHAUSTED: x")

    backend = Backend(full, full, full, compiled=True)
    monkeypatch.setattr("gatjax.loop.steps.prepare", lambda *_: backend)
    said, world, space = [], nominal(), search.Space(THETA0, STEP, LOW, HIGH)
    settings = LoopSettings(search=SearchSettings(population=4, rollouts=2))
    step = generation(settings, world, space, say=said.append, trials=3)
    state = search.start(space, settings.search, jax.random.key(0))
    states, values = (
        jax.tree.map(lambda leaf: jnp.stack([leaf] * 3), tree)
        for tree in (state, world.values)
    )
    with pytest.raises(RuntimeError, match="RESOURCE_EXHAUSTED"):
        step(states, values, np.int32(0))
    assert "12 robots at a time" in said[0]  # half of 4 x 2 x 3
