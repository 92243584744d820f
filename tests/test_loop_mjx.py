"""On mjx a generation of several trials (ask, all rollouts, tell) is one call.

That of one trial is tested in test_sim_spread.
"""

import dataclasses

import jax
import mujoco
import numpy as np
import pytest

from gatjax import loop
from gatjax.effects.effect import memoryless
from gatjax.loop.optimise import optimise_all, stepping
from gatjax.loop.steps import searched
from gatjax.runs import read_table
from gatjax.settings import LoopSettings, SearchSettings
from gatjax.sim import lighter
from gatjax.sim.world import add_causes, add_command, nominal
from gatjax.task import Task
from gatjax.walk.parameters import STEP, THETA0

SETTINGS = SearchSettings(population=4, rollouts=2, generations=2)
CAUSES = {  # by seed
    1: [("payload", ["LHipPitch"], {"mass": 0.1}), ("dead_band", ["RKneePitch"], 0.01)],
    2: [("torque_limit", ["all"], {"limit": 2.5}), ("dead_band", ["LKneePitch"], 0.01)],
}


def test_trials_are_one_call_and_each_finds_what_it_finds_alone_on_native(tmp_path):
    traces, traced, told = [], [], []

    def change(share, signal):
        traces.append(1)
        return signal._replace(target=(1.0 - share) * signal.target)

    task = Task(settle=0.1, longest_delay=0.04, duration=0.4)
    settings = LoopSettings(
        search=SETTINGS, backend="mjx", impl="jax", candidates=("best",)
    )

    def tell(units):
        traced.append(len(traces))

    progress = loop.Progress(told.append, tell, tell)

    def job(seed, folder):
        (tmp_path / folder / "policies").mkdir(parents=True, exist_ok=True)
        share = np.float64(0.01 * seed)
        world = add_causes(nominal(task), CAUSES[seed])
        world = add_command(world, "weak", memoryless(change), share)
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
    assert told == [f"gat: generation {n} (last: 1), 2 trials" for n in (0, 1)]
    count = len(traces)
    measured = count - traced[-1]  # traces to measure what was found
    assert traced[0] == 0 < traced[1] == traced[-1]  # in the first generation only
    again = optimise_all([job(1, "a"), job(2, "b")], settings, progress)
    assert len(traces) == count  # nothing is left to be done
    native = dataclasses.replace(settings, backend="native")
    alone = [loop.optimise(job(1, "c"), native, progress)]
    assert measured == len(traces) - traced[-1]  # both trials in one program
    alone.append(loop.optimise(job(2, "d"), native, progress))
    for found in zip(both, again, alone, strict=True):
        for one, same, other in zip(*found, strict=True):
            assert one.key == same.key == other.key
            np.testing.assert_allclose(same.policy, one.policy, atol=1e-12)
            np.testing.assert_allclose(other.policy, one.policy, atol=1e-6)
    a, b, c, d = (costs(tmp_path / name) for name in "abcd")
    np.testing.assert_allclose(a, c, rtol=1e-5)
    np.testing.assert_allclose(b, d, rtol=1e-5)
    assert not np.allclose(a, b, rtol=1e-4)
    assert not np.allclose(both[0][1].policy, both[1][1].policy)


def test_trials_with_other_physics_steps_are_searched_apart():
    """A dead band acts once per physics step, a payload does not: 4 ms and 5 ms."""

    gap, payload = CAUSES[2][1], CAUSES[1][0]
    some = (gap,), (payload,), (gap, payload), ()
    worlds = [add_causes(nominal(), causes) for causes in some]
    light = LoopSettings(search=SETTINGS, backend="mjx", impl="jax")
    full = dataclasses.replace(light, model="full")
    assert stepping([searched(light, each) for each in worlds]) == [[0, 2], [1, 3]]
    assert stepping([searched(full, each) for each in worlds]) == [[0, 1, 2, 3]]


def test_a_search_that_another_simulator_began_does_not_go_on(tmp_path, monkeypatch):
    key, quiet = jax.random.key(0), loop.Progress(print, print)
    job = loop.Job(tmp_path, "none", 0, nominal(), THETA0, key, key)
    (tmp_path / "policies").mkdir()
    task = Task(settle=0.1, longest_delay=0.04, duration=0.1)
    job = job._replace(world=nominal(task))
    one = dataclasses.replace(SETTINGS, generations=1)
    settings = LoopSettings(search=one, backend="native", candidates=("best",))
    loop.optimise(job, settings, quiet)
    loop.optimise(job, settings, quiet)  # the same one goes on
    monkeypatch.setattr(lighter, "ITERATIONS", 4)
    said = "started with solver_iterations = 3, now it is 4"
    with pytest.raises(ValueError, match=said):
        loop.optimise(job, settings, quiet)
    with pytest.raises(ValueError, match=said):
        optimise_all([job], dataclasses.replace(settings, backend="mjx"), quiet)
    monkeypatch.undo()
    monkeypatch.setattr(mujoco, "__version__", "9.9.9")
    with pytest.raises(ValueError, match=r"now it is '9\.9\.9'"):
        loop.optimise(job, settings, quiet)
    (job.checkpoints / "simulator.json").unlink()  # as before such files were written
    with pytest.raises(ValueError, match="started with timestep_s = None"):
        loop.optimise(job, settings, quiet)


def costs(folder):
    """Of the candidates in their own worlds."""
    return [row["simulator_cost"] for row in read_table(folder / "metrics.csv")]


def test_trials_that_differ_in_more_than_seeds_are_refused(tmp_path):
    one = LoopSettings(search=SETTINGS)
    other = dataclasses.replace(one, seed=1, evaluations=3)
    robot, quiet = loop.Simulator(nominal()), loop.Progress(print, print)
    with pytest.raises(ValueError, match="may differ in their seeds only"):
        loop.run_all([tmp_path, tmp_path], [one, other], robot, quiet)
