"""The same costs on any number of devices."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

PROGRAM = """
import json, sys
import jax, numpy as np
from gatjax import search
from gatjax.loop.optimise import generation
from gatjax.settings import LoopSettings, SearchSettings
from gatjax.sim.lighter import lighter
from gatjax.sim.spread import over_devices
from gatjax.sim.world import nominal
from gatjax.task import Task
from gatjax.walk.parameters import HIGH, LOW, STEP, THETA0

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
if sys.argv[2] == "walk":
    task = Task(settle=0.1, duration=0.2, longest_delay=0.0)
    world = lighter(nominal(task))
    settings = LoopSettings(
        search=SearchSettings(population=5, rollouts=3), backend="mjx"
    )
    space = search.Space(THETA0, STEP, LOW, HIGH)
    state = search.start(space, settings.search, jax.random.key(2))
    step = generation(settings, world, space)
    for number in range(2):
        state, info = step(state, world.values, np.int32(number))
    told |= {"costs": info.costs.tolist(), "mean": info.mean_policy.tolist()}
print(json.dumps(told))
"""


def run(devices, what):
    flags = f"--xla_force_host_platform_device_count={devices}"
    env = os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(devices), what],
        env=env, capture_output=True, text=True, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize(("devices", "part"), [(2, 3), (4, 2)])
def test_robots_are_shared_out_also_where_devices_do_not_divide_them(devices, part):
    alone, many = run(1, ""), run(devices, "")
    assert alone["shape"] == [6, 5]
    assert many["shape"] == [part, 5]
    np.testing.assert_allclose(many["sum"], alone["sum"], rtol=1e-6)


def test_a_search_finds_the_same_on_four_devices():
    alone, many = run(1, "walk"), run(4, "walk")  # 15 robots: four each
    np.testing.assert_allclose(many["costs"], alone["costs"], atol=1e-5)
    np.testing.assert_allclose(many["mean"], alone["mean"], rtol=1e-3, atol=1e-5)
    assert np.ptp(many["costs"]) > 1e-3
