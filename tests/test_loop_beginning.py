"""The simulator that a run begins with, and what becomes of a world of a hung NAO."""

import dataclasses
import shutil

import numpy as np
import pytest
from short_walks import SHORT

from gatjax import loop, runs
from gatjax.cli.inputs import walker_of, world_of
from gatjax.loop.beginning import beginning
from gatjax.robot.model import HUNG
from gatjax.settings import LoopSettings, SearchSettings
from gatjax.sim.stored import write_world
from gatjax.sim.walker import walker
from gatjax.sim.world import add_cause, nominal
from gatjax.walk.parameters import THETA0

SETTINGS = LoopSettings(
    methods=("none",),
    robot_trajectories=4,
    simulator_trajectories=4,
    evaluations=1,
    search=SearchSettings(population=4, rollouts=1, generations=2),
    backend="native",
)


def quiet():
    return loop.Progress(stage=lambda text: None, work=lambda units: None)


def diagnosed(folder):
    """A world file as a diagnosis of a hung NAO leaves it."""
    world = add_cause(nominal(SHORT, HUNG, 0.0005), "command_delay", ["all"], 0.03)
    world = add_cause(world, "gravity_tilt", ["all"], {"roll": 0.02, "pitch": 0.3})
    folder.mkdir()
    write_world(folder / "world.json", world, {}, None)
    return folder


def test_a_world_of_a_hung_nao_walks_without_its_mounting(tmp_path):
    file = diagnosed(tmp_path / "found")
    late = add_cause(nominal(SHORT), "command_delay", ["all"], 0.03)
    found = walker_of(file, SHORT)
    assert found.causes == late.causes
    policies = np.tile(THETA0, (2, 1))
    walks, _ = loop.Simulator(found).walk(policies, range(2))
    expected, _ = loop.Simulator(late).walk(policies, range(2))
    np.testing.assert_array_equal(walks.reading.angle, expected.reading.angle)
    hangs = world_of(file, SHORT)
    assert hangs.source == HUNG and len(hangs.causes) == 2


def test_a_world_of_a_standing_nao_walks_as_it_is():
    world = add_cause(
        nominal(SHORT, "nao", 0.0005), "gravity_tilt", ["all"], {"roll": 0.02}
    )
    assert walker(world) is world


@pytest.mark.usefixtures("short_walks")
def test_a_run_begins_with_the_world_that_it_is_given(tmp_path):
    given = diagnosed(tmp_path / "found")
    robot = loop.Simulator(walker_of(given, SHORT))
    searched = {}
    for world in (None, str(given)):
        settings = dataclasses.replace(SETTINGS, world=world)
        folder = runs.open_run(tmp_path, settings, name=f"with_{world is None}").path
        loop.run(folder, settings, robot, quiet())
        rows = runs.read_table(folder / "metrics.csv")
        searched[world] = {
            row["candidate"]: row["simulator_cost"]
            for row in rows
            if row["method"] == "none" and row["generation"] == 0
        }
        assert (folder / "world.json").exists() == (world is not None)
    ideal, late = searched.values()
    assert ideal.keys() == late.keys()
    assert ideal["mean"] != late["mean"]


def test_a_run_keeps_the_world_that_it_was_given(tmp_path):
    given = diagnosed(tmp_path / "found")
    settings = dataclasses.replace(SETTINGS, world=str(given))
    folder = tmp_path / "run"
    folder.mkdir()
    first = beginning(folder, settings, SHORT)
    shutil.rmtree(given)
    assert beginning(folder, settings, SHORT).causes == first.causes
    assert [row["cause"] for row in first.causes] == ["command_delay"]


def test_settings_name_a_world_that_can_be_grounded(tmp_path):
    given = diagnosed(tmp_path / "found")
    settings = dataclasses.replace(SETTINGS, world=str(given))
    assert loop.resolved(settings).world == str(given)
    with pytest.raises(ValueError, match="world is another one; leave out one"):
        loop.resolved(dataclasses.replace(settings, explain=True))
    with pytest.raises(FileNotFoundError, match="does not exist"):
        loop.resolved(dataclasses.replace(settings, world=str(tmp_path / "no.json")))
    write_world(given / "world.json", nominal(SHORT), {}, "grounding/")
    with pytest.raises(ValueError, match="has a grounding already"):
        loop.resolved(settings)
