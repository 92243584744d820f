"""Races: who drops out, where they stand, and that CMA-ES does not notice."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gatjax.ranking import DIVERGED_COST, finite, judged
from gatjax.search import Space, checked, generation, host_generation, start
from gatjax.settings import SearchSettings

SPACE = Space(np.zeros(4), np.full(4, 0.5), np.full(4, -3.0), np.full(4, 3.0))
RACE = SearchSettings(population=9, rollouts=5, race=2)
WHOLE = SearchSettings(population=9, rollouts=5)


def told(costs):
    """Evaluate that finds the cost [N, R] of policy n (its first number) and key r."""
    costs = jnp.asarray(costs, float)

    def evaluate(values, policies, keys):
        return costs[policies[:, 0].astype(int)][:, keys]

    return evaluate


def noisy(values, policies, keys):
    noise = jax.vmap(lambda key: jax.random.normal(key, (4,)))(keys)
    tilt = policies @ noise.T  # it matters to a policy which key it meets
    return ((policies - values) ** 2).sum(-1)[:, None] + 0.3 * tilt


def search_of(settings, evaluate, build=generation, generations=8):
    step = jax.jit(build(SPACE, settings, evaluate)) if build is generation else None
    step = step or build(SPACE, settings, evaluate)
    state, found = start(SPACE, settings, jax.random.key(3)), []
    for number in range(generations):
        state, info = step(state, 1.0, number)
        found.append(info)
    return state, found


def test_the_worse_half_drops_out_and_who_falls_late_comes_last():
    costs = np.random.default_rng(0).normal(size=(9, 5))
    costs[:, 2:] += 1.0  # harder keys
    costs[4, :2], costs[4, 3] = -9.0, 50.0  # in the better half, until it falls
    policies, keys = np.arange(9.0)[:, None], np.arange(5)
    found = np.asarray(judged(told(costs), RACE)(None, policies, keys))
    early, whole = costs[:, :2].mean(1), costs.mean(1)
    kept, out = np.argsort(early)[:4], np.argsort(early)[4:]
    np.testing.assert_allclose(found[kept], whole[kept], rtol=1e-5)
    harder = np.median(whole[kept] - early[kept])
    np.testing.assert_allclose(found[out], early[out] + harder, rtol=1e-5)
    assert found.argmax() == 4


def test_only_the_better_half_is_rolled_out_again():
    shapes = []

    def evaluate(values, policies, keys):
        shapes.append((len(policies), len(keys)))
        return np.zeros((len(policies), len(keys)))

    search_of(RACE, evaluate, host_generation, 1)
    search_of(WHOLE, evaluate, host_generation, 1)
    assert shapes == [(9, 2), (4, 3), (9, 5)]
    assert RACE.walks == 9 * 2 + 4 * 3
    assert WHOLE.walks == 9 * 5


def test_without_noise_a_race_changes_nothing():
    def plain(values, policies, keys):
        costs = ((policies - values) ** 2).sum(-1)
        return jnp.broadcast_to(costs[:, None], (len(policies), len(keys)))

    raced, whole = search_of(RACE, plain)[0], search_of(WHOLE, plain)[0]
    moved = np.abs(whole.distribution.mean).max()
    assert moved > 0.1
    np.testing.assert_allclose(
        raced.distribution.mean, whole.distribution.mean, atol=1e-6 * moved
    )


def test_compiled_and_on_the_host_it_is_the_same_race():
    on_host = search_of(RACE, noisy, host_generation)[1]
    for one, other in zip(search_of(RACE, noisy)[1], on_host, strict=True):
        np.testing.assert_allclose(one.costs, other.costs, rtol=1e-4, atol=1e-4)
    without = search_of(WHOLE, noisy)[1]
    assert not np.allclose(on_host[0].costs, without[0].costs)


def test_policies_that_diverge_lose_the_race():
    def broken(values, policies, keys):
        bad = jnp.asarray(policies)[:, :1] > 0.0
        return jnp.where(bad, jnp.nan, noisy(values, policies, keys))

    _, (info, *_) = search_of(RACE, broken)
    assert np.isfinite(info.costs).all()
    bad = np.asarray(info.policies[:, 0]) > 0.0
    assert 0 < bad.sum() < len(bad)
    assert info.costs[bad].min() > 0.9 * DIVERGED_COST > info.costs[~bad].max()


@pytest.mark.parametrize("race", [-1, 5, 7])
def test_a_race_that_nobody_can_run_is_refused(race):
    with pytest.raises(ValueError, match=r"race is .*use 1 to rollouts - 1 = 4"):
        checked(SearchSettings(rollouts=5, race=race))


def test_costs_beyond_32_bits_are_those_that_diverged():
    wide = np.array([1.0, 1e55, np.inf, np.nan])
    np.testing.assert_allclose(finite(wide), [1.0, *[DIVERGED_COST] * 3])
