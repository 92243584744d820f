"""The best policies of a generation walk again, in worlds that are in doubt."""

import dataclasses
from types import SimpleNamespace

import jax
import mujoco
import numpy as np
import pytest

from gatjax.diagnosis.loads import copied
from gatjax.loop import recheck, resolved
from gatjax.loop.candidates import Job
from gatjax.search import GenerationInfo
from gatjax.settings import DEMO
from gatjax.sim.backend import prepare
from gatjax.sim.derived import write
from gatjax.sim.world import add_causes, fields_applied, nominal
from gatjax.task import Task
from gatjax.walk.parameters import THETA0

COUNT = 8
TILTED = [
    ("payload", ["LHand"], {"mass": 0.3}),
    ("gravity_tilt", ["all"], {"pitch": 0.1}),
    ("ground_friction", ["ground"], {"mu": 0.5}),
]


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
        costs = np.array([outcome[number] for number in policies[:, 0]])
        return SimpleNamespace(cost=np.repeat(costs[:, None], len(keys), 1))

    def run(costs, again, *numbers):
        seen.clear()
        native = SimpleNamespace(outcome=again)
        monkeypatch.setattr(recheck, "in_doubt", lambda world, count, seed: native)
        monkeypatch.setattr(recheck, "pairs", pairs)
        job = Job(None, "gat", 0, nominal(), None, None, jax.random.key(3))
        find = recheck.rechecking(job)
        found = [find(number, generation(costs))[0] for number in numbers or [0]]
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


def test_each_walk_of_a_policy_is_in_another_world_the_same_for_all(monkeypatch):
    made = []

    def watched(model, count, seed):
        made.append((count, seed))
        return doubted(model, count, seed)

    doubted = recheck.doubted
    monkeypatch.setattr(recheck, "doubted", watched)
    world = add_causes(nominal(), TILTED)
    physics = recheck.in_doubt(world, 3, 8).batch(world.values, 6)
    assert made == [(3, 8)]
    drawn = doubted(fields_applied(world), 3, 8)
    for name, rows in drawn.items():
        np.testing.assert_array_equal(physics.expand(name)[:3], rows)
        np.testing.assert_array_equal(physics.expand(name)[3:], rows)
        assert len(np.unique(rows.reshape(3, -1), axis=0)) == 3


def test_worlds_in_doubt_differ_in_bodies_and_grip_around_what_causes_make_of_them():
    model = fields_applied(add_causes(nominal(), TILTED))
    drawn, heavy = recheck.doubted(model, 400, 0), model.body_mass > 0
    mass = drawn["body_mass"][:, heavy] / model.body_mass[heavy]
    np.testing.assert_allclose(mass.mean(0), 1.0, atol=0.01)
    np.testing.assert_allclose(mass.std(0), 0.05, rtol=0.15)
    inertia = drawn["body_inertia"][:, heavy] / model.body_inertia[heavy]
    np.testing.assert_allclose(inertia.std(0), 0.05, rtol=0.15)
    moved = (drawn["body_ipos"] - model.body_ipos)[:, heavy]
    np.testing.assert_allclose(moved.mean(0), 0.0, atol=0.001)
    np.testing.assert_allclose(moved.std(0), 0.005, rtol=0.15)
    downward = drawn["opt.gravity"] / np.linalg.norm(model.opt.gravity)
    np.testing.assert_allclose(downward.mean(0), model.opt.gravity / 9.81, atol=0.001)
    np.testing.assert_allclose(downward[:, 1].std(), np.deg2rad(0.2), rtol=0.15)
    grip = drawn["geom_friction"][:, :, 0] / model.geom_friction[:, 0]
    assert np.ptp(grip, axis=1).max() < 1e-12  # one for all soles
    assert 0.6 <= grip.min() < 0.62 and 1.18 < grip.max() <= 1.2


def test_a_robot_in_doubt_is_the_one_whose_model_has_its_numbers():
    world = add_causes(nominal(Task(duration=1.5)), TILTED[:2])
    policies, keys = np.tile(THETA0, (2, 1)), jax.random.split(jax.random.key(1), 2)
    told = recheck.in_doubt(world, 2, 5).outcome(world.values, policies, keys)
    plain = prepare(world).outcome(world.values, policies, keys)
    for number in range(2):
        model = copied(fields_applied(world))
        for name, rows in recheck.doubted(model, 2, 5).items():
            write(model, {name: rows[number]})
        mujoco.mj_setConst(model, mujoco.MjData(model))
        bare = nominal(world.task)
        other = dataclasses.replace(bare, model=model)
        made = prepare(other).outcome(bare.values, policies, keys)
        np.testing.assert_allclose(told.cost[number], made.cost[number], rtol=1e-9)
        assert abs(told.cost[number] - plain.cost[number]) > 1e-5


def test_the_robot_itself_has_no_simulation_to_recheck_in():
    settings = dataclasses.replace(
        DEMO, methods=("gat", "oracle"), candidates=("rechecked",)
    )
    with pytest.raises(ValueError, match="no simulation to recheck in"):
        resolved(settings)
    resolved(dataclasses.replace(settings, methods=("gat",)))
