"""theta0 walks in the search model as it did in the feasibility study."""

import jax
import numpy as np
import pytest

from gatjax.sim.backend import prepare
from gatjax.sim.world import nominal
from gatjax.task import Task
from gatjax.walk.parameters import THETA0

RUNS = 100


@pytest.mark.parametrize(("forward", "speed"), [(0.75, 0.207), (1.0, 0.252)])
def test_theta0_walks_at_the_known_speed_and_never_falls(forward, speed):
    """Feasibility study: 20.7 and 25.2 cm/s, 0 of 100 falls (4 ms, 50 Hz, 7.5 s)."""
    world = nominal(Task(forward=forward))
    keys = jax.random.split(jax.random.key(0), RUNS)
    policies = np.tile(THETA0, (RUNS, 1))
    result = prepare(world, "native").outcome(world.values, policies, keys)
    assert not np.isfinite(result.fell_at).any()
    # 0.5 cm/s: other sole corners, steering, sensor noise and hands than there
    assert float(result.velocity.mean()) == pytest.approx(speed, abs=0.005)
