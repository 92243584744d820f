"""The best policies of a generation walk again, in worlds that are in doubt."""

import dataclasses
from types import SimpleNamespace

import jax
import mujoco
import numpy as np
import pytest

from gatjax.loop import recheck, resolved
from gatjax.loop.candidates import Job
from gatjax.search import GenerationInfo
from gatjax.settings import DEMO
from gatjax.sim.backend import prepare
from gatjax.sim.world import add_causes, fields_applied, nominal
from gatjax.task import Task
from gatjax.walk.parameters import THETA0

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
        drawn = jax.random.key_data(keys).tolist()
        seen.append((policies[:, 0].tolist(), drawn, values))
        costs = np.array([outcome[number] for number in policies[:, 0]])
        return SimpleNamespace(cost=np.repeat(costs[:, None], len(keys), 1))

    def run(costs, again, number=0):
        seen.clear()
        backend = SimpleNamespace(outcome=again)
        monkeypatch.setattr(recheck, "prepare", lambda world, name: backend)
        monkeypatch.setattr(recheck, "pairs", pairs)
        job = Job(None, "gat", 0, nominal(), None, None, jax.random.key(3))
        found = recheck.rechecking(job)(number, generation(costs))[0]
        return found, list(seen)

    return run


def test_the_best_of_few_rollouts_gives_way_to_one_that_is_best_again(walked):
    costs = [0.5, 0.1, 0.4, 0.2, 0.9, 0.3, 0.8, 0.7]
    again = {1.0: 5.0, 3.0: 0.25, 5.0: 0.2, 2.0: 0.4, 0.0: 0.5, 100.0: 0.3}
    found, seen = walked(costs, again)
    assert found == 5.0
    for policies, _, _ in seen:
        assert policies == [1.0, 3.0, 5.0, 2.0, 0.0, 100.0]  # five best, and the mean
    assert sum(len(keys) for _, keys, _ in seen) == recheck.AGAIN
    assert walked(costs, again | {100.0: 0.1})[0] == 100.0


def test_a_policy_has_to_do_well_in_all_worlds(monkeypatch):
    """One that is best in three worlds and falls in the fourth is not taken."""
    worlds = iter([[0.2, 0.5], [0.2, 0.5], [9.0, 0.5], [0.2, 0.5]])

    def pairs(outcome, values, policies, keys):
        first, others = next(worlds)
        costs = np.where(policies[:, 0] == 0.0, first, others)
        return SimpleNamespace(cost=np.repeat(costs[:, None], len(keys), 1))

    monkeypatch.setattr(recheck, "pairs", pairs)
    job = Job(None, "gat", 0, nominal(), None, None, jax.random.key(3))
    info = generation(np.arange(COUNT) * 1.0)
    assert recheck.rechecking(job)(0, info)[0] == 1.0


def test_each_generation_is_rechecked_with_random_numbers_and_worlds_of_its_own(walked):
    again = dict.fromkeys([*map(float, range(COUNT)), 100.0], 0.0)
    seen = [*walked(np.arange(COUNT) * 1.0, again, 0)[1]]
    seen += walked(np.arange(COUNT) * 1.0, again, 1)[1]
    checked = jax.random.key_data(jax.random.split(jax.random.key(3), 20)).tolist()
    drawn = [tuple(key) for _, keys, _ in seen for key in keys] + list(
        map(tuple, checked)
    )
    assert len(set(drawn)) == len(drawn) == 2 * recheck.AGAIN + 20
    masses = {values.body["body_mass"].tobytes() for _, _, values in seen}
    assert len(seen) == len(masses) == 2 * recheck.WORLDS


def test_worlds_in_doubt_differ_in_bodies_and_grip():
    world = add_causes(nominal(), [("payload", ["LHand"], {"mass": 0.3})])
    model = fields_applied(world)
    drawn = recheck.doubted(world, 400, 0)
    assert all(each.body.keys() >= world.values.body.keys() for each in drawn)

    def all_of(name):
        return np.array([each.body[name] for each in drawn])

    heavy = model.body_mass > 0
    mass = all_of("body_mass")[:, heavy] / model.body_mass[heavy]
    np.testing.assert_allclose(mass.mean(0), 1.0, atol=0.01)  # the payload is kept
    np.testing.assert_allclose(mass.std(0), 0.05, rtol=0.15)
    moved = (all_of("body_ipos") - model.body_ipos)[:, heavy]
    np.testing.assert_allclose(moved.std(0), 0.005, rtol=0.15)
    tilt = all_of("opt.gravity")[:, :2] / np.linalg.norm(model.opt.gravity)
    np.testing.assert_allclose(tilt.std(0), np.deg2rad(0.2), rtol=0.15)
    grip = all_of("geom_friction")[:, :, 0] / model.geom_friction[:, 0]
    assert np.ptp(grip, axis=1).max() < 1e-12  # one for all soles
    assert 0.6 <= grip.min() < 0.62 and 1.18 < grip.max() <= 1.2


def test_a_world_in_doubt_is_the_one_whose_model_has_its_numbers():
    world = nominal(Task(duration=1.5))
    (values,) = recheck.doubted(world, 1, 5)
    model = mujoco.MjModel.__copy__(world.model)
    model.body_mass[:] = values.body["body_mass"]
    model.body_inertia[:] = values.body["body_inertia"]
    model.body_ipos[:] = values.body["body_ipos"]
    model.geom_friction[:] = values.body["geom_friction"]
    model.opt.gravity[:] = values.body["opt.gravity"]
    mujoco.mj_setConst(model, mujoco.MjData(model))
    other = dataclasses.replace(world, model=model)
    policies, keys = np.tile(THETA0, (2, 1)), jax.random.split(jax.random.key(1), 2)
    told = prepare(world).outcome(values, policies, keys)
    made = prepare(other).outcome(other.values, policies, keys)
    plain = prepare(world).outcome(world.values, policies, keys)
    np.testing.assert_allclose(told.cost, made.cost, rtol=1e-9)
    assert (np.abs(told.cost - plain.cost) > 1e-4).all()


def test_the_robot_itself_has_no_simulation_to_recheck_in():
    settings = dataclasses.replace(
        DEMO, methods=("gat", "oracle"), candidates=("rechecked",)
    )
    with pytest.raises(ValueError, match="no simulation to recheck in"):
        resolved(settings)
    resolved(dataclasses.replace(settings, methods=("gat",)))
