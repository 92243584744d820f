"""The bench: equal work in all its loops, parts that add up, words for people."""

import dataclasses

import numpy as np
import pytest
from matplotlib.axes import Axes

from gatjax import speed
from gatjax.cli import main
from gatjax.runs import read_json
from gatjax.sim.native import Native
from gatjax.sim.world import nominal
from gatjax.speed import bench, peers
from gatjax.speed.stages import Held, hung
from gatjax.speed.worlds import recorded, stepped_as, world_of
from gatjax.task import Task

SHORT = Task(duration=0.2, settle=0.1, longest_delay=0.0)


@pytest.fixture(scope="module")
def walk():
    return recorded(world_of("plain", SHORT), 4)


def test_all_worlds_walk_alike(walk):
    given = walk.policies, walk.keys
    for kind in ("grounded", "explained"):
        world = world_of(kind, SHORT)
        told = Native(world).rollout(world.values, *given)[0].command
        np.testing.assert_allclose(np.swapaxes(told, 0, 1), walk.command, atol=1e-3)


def test_the_same_walk_in_other_steps(walk):
    finer = stepped_as(walk, nominal(timestep=0.002))
    assert (finer.world.substeps, walk.world.substeps) == (10, 5)
    assert finer.command is walk.command


def test_the_grounded_world_computes_its_networks():
    world = world_of("grounded", SHORT)
    networks = world.values.command["grounding"]
    assert networks.alpha == 0.0
    sizes = [weight.shape for weight in networks.inverse.weights]
    assert sizes == [(130, 200), (200, 180), (180, 26)]
    assert all(np.abs(weight).min() > 0.0 for weight in networks.inverse.weights)


def test_what_is_held_is_told_everything_and_never_moves(walk):
    world, keys = walk.world, walk.keys
    native = Native(world, Held)
    still = native.rollout(world.values, walk.policies, keys)[0]
    assert np.ptp(still.base.position, axis=1).max() == 0.0
    assert np.ptp(still.command, axis=1).max() > 0.01


def test_the_environment_loop_walks(walk):
    assert not peers.environment_loop(walk)().any()
    lying = walk.qpos.copy()
    lying[1, 3:7] = [np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]
    fell = peers.environment_loop(walk._replace(qpos=lying))()
    assert fell.tolist() == [False, True, False, False]


@pytest.mark.parametrize(
    ("count", "parts"), [(3000, (150, 20)), (256, (16, 16)), (4, (4, 1))]
)
def test_worlds_are_policies_times_rollouts(count, parts):
    assert bench.shared(count) == parts


@dataclasses.dataclass
class Hanging:
    ctrl: np.ndarray
    sensordata: np.ndarray
    replace = dataclasses.replace


@pytest.mark.parametrize("told", [0.3, np.nan])
def test_what_a_hanging_robot_is_told_is_not_left_out(told):
    """Or its stage would be timed without the walk engine."""
    later = hung(None, Hanging(np.array([0.1, told]), np.array([9.8])))
    np.testing.assert_array_equal(later.sensordata, [9.8 + 0.0 * told])


def test_too_few_worlds_are_refused():
    with pytest.raises(ValueError, match="a search needs 4 policies"):
        bench.shared(3)


def row(**more):
    stages = {"physics": 1.0, "control": 0.5, "search": 0.1, "rest": 0.4}
    return {
        "backend": "native", "world": "plain", "model": "full", "worlds": 256,
        "generation_s": 2.0,
        "closed_steps_per_s": 1000.0, "bare_steps_per_s": 2000.0,
        "closed_robot_s_per_s": 5.0, "bare_robot_s_per_s": 8.0,
        "closed_over_bare": 2.0, "compile_s": 3.0, "stages_s": stages,
    } | more  # fmt: skip


def test_the_table_says_where_the_time_goes(tmp_path):
    loop = row(backend="environment", bare_robot_s_per_s=None,
               closed_over_bare=None, stages_s=None)  # fmt: skip
    _, first, second = speed.table([row(), loop]).splitlines()
    assert "physics 50%, control 25%, search 5%, rest 20%" in first
    assert first.split()[3:8] == ["256", "1,000", "5", "8", "2.00"]
    assert "environment" in second
    speed.draw([row(), loop], tmp_path / "bench.png")
    assert (tmp_path / "bench.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("counter", "each"), [((10.0, 70.0), 20.0), ((90.0, 5.0), None), ((None,), None)]
)
def test_energy_is_that_of_one_call(monkeypatch, counter, each):
    """None where a counter ran over or there is none: then nothing is run."""
    reads, calls = iter(counter), []
    monkeypatch.setattr(bench.machine, "joules", lambda: next(reads))
    assert bench.energy(lambda: calls.append(1)) == each
    assert len(calls) == (0 if counter == (None,) else bench.REPEATS)


def test_the_picture_compares_what_robots_live_through(monkeypatch, tmp_path):
    """A light world's steps are longer: steps a second are no measure."""
    seen = []
    barh = Axes.barh
    monkeypatch.setattr(
        Axes,
        "barh",
        lambda *given, **more: seen.append(given[2]) or barh(*given, **more),
    )
    speed.draw([row()], tmp_path / "bench.png")
    assert seen[0] == 5.0


def test_the_verb_measures_and_writes(tmp_path, capsys):
    out = tmp_path / "new" / "bench.json"
    size = ["--worlds", "4", "--seconds", "0.1", "--kinds", "plain"]
    assert main(["bench", *size, "--models", "full", "light", "--json", str(out)]) == 0
    assert "native       plain" in capsys.readouterr().out
    found = read_json(out)
    assert found["schema"] == "gatjax.bench/3"
    assert found["machine"]["cores"] >= 1 and found["machine"]["versions"]["jax"]
    for only, steps in zip(found["rows"], (5, 4), strict=True):
        assert sum(only["stages_s"].values()) == pytest.approx(only["generation_s"])
        bare, closed = only["bare_robot_s_per_s"], only["closed_robot_s_per_s"]
        assert only["closed_over_bare"] == pytest.approx(bare / closed)
        assert only["closed_steps_per_s"] == pytest.approx(closed * steps / 0.02)
        assert only["bare_steps_per_s"] == pytest.approx(bare * 5 / 0.02)
    assert out.with_suffix(".png").is_file()


@pytest.mark.parametrize("name", ["there.json", "bench.png", "bench"])
def test_a_file_that_will_not_do_is_refused_first(name, tmp_path, capsys, monkeypatch):
    (tmp_path / "there.json").mkdir()
    monkeypatch.setattr(speed, "measure", None)
    assert main(["bench", "--json", str(tmp_path / name)]) == 1
    assert "name a file FILE.json" in capsys.readouterr().err


def test_what_cannot_run_here_is_said_before_anything_is_measured(monkeypatch, capsys):
    def lacking(impl):
        if impl == "warp":
            raise ValueError("impl 'warp' needs an NVIDIA GPU")

    monkeypatch.setattr(bench, "check_machine", lacking)
    monkeypatch.setattr(bench, "recorded", lambda *_: pytest.fail("measured"))
    asked = ["bench", "--worlds", "4", "--backends", "native", "mjx-warp"]
    assert main(asked) == 1
    assert "needs an NVIDIA GPU" in capsys.readouterr().err
