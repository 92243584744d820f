"""The best policies of a generation walk again in simulation."""

import dataclasses
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from gatjax.loop import recheck, resolved
from gatjax.loop.candidates import Job
from gatjax.search import GenerationInfo
from gatjax.settings import DEMO
from gatjax.sim.world import nominal

COUNT = 8


def generation(costs):
    """A generation whose policy k is all k; the mean is all 100."""
    policies = np.repeat(np.arange(COUNT, dtype=float)[:, None], 15, 1)
    best = int(np.argmin(costs))
    return GenerationInfo(
        policies=policies, costs=np.array(costs), best_policy=policies[best],
        best_cost=min(costs), mean_policy=np.full(15, 100.0), sigma=0.5,
    )  # fmt: skip


@pytest.fixture
def walked(monkeypatch):
    """What was walked again, with costs of a policy by its first number."""
    seen = []

    def pairs(outcome, values, policies, keys):
        seen.append((policies[:, 0].tolist(), jax.random.key_data(keys).tolist()))
        costs = np.array([outcome(number) for number in policies[:, 0]])
        return SimpleNamespace(cost=np.repeat(costs[:, None], len(keys), 1))

    def run(costs, again, *numbers):
        seen.clear()
        monkeypatch.setattr(recheck, "pairs", pairs)
        job = Job(None, "gat", 0, nominal(), None, None, jax.random.key(3))
        find = recheck.rechecking(again.__getitem__)
        found = [find(job, number, generation(costs))[0] for number in numbers or [0]]
        return found[-1], list(seen)

    return run


def test_the_best_of_few_rollouts_gives_way_to_one_that_is_best_again(walked):
    costs = [0.5, 0.1, 0.4, 0.2, 0.9, 0.3, 0.8, 0.7]
    again = {1.0: 5.0, 3.0: 0.25, 5.0: 0.2, 2.0: 0.4, 0.0: 0.5, 100.0: 0.3}
    found, ((policies, keys),) = walked(costs, again)
    assert found == 5.0
    assert policies == [1.0, 3.0, 5.0, 2.0, 0.0, 100.0]  # five best, and the mean
    assert len(keys) == recheck.AGAIN
    assert walked(costs, again | {100.0: 0.1})[0] == 100.0


def test_each_generation_is_rechecked_with_random_numbers_of_its_own(walked):
    again = dict.fromkeys([*map(float, range(COUNT)), 100.0], 0.0)
    first, second = (keys for _, keys in walked(np.arange(COUNT) * 1.0, again, 0, 1)[1])
    checked = jax.random.key_data(jax.random.split(jax.random.key(3), 20)).tolist()
    drawn = [tuple(key) for keys in (first, second, checked) for key in keys]
    assert len(set(drawn)) == len(drawn)


def test_the_robot_itself_has_no_simulation_to_recheck_in():
    settings = dataclasses.replace(
        DEMO, methods=("gat", "oracle"), candidates=("rechecked",)
    )
    with pytest.raises(ValueError, match="no simulation to recheck in"):
        resolved(settings)
    resolved(dataclasses.replace(settings, methods=("gat",)))
