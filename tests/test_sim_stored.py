"""World files, and the models that go with them."""

import shutil

import numpy as np
import pytest

from gatjax.sim import backend
from gatjax.sim.stored import carried, read_world, write_world
from gatjax.sim.world import add_cause, nominal
from gatjax.task import Task

TASK = Task(control_period=0.01)
WEDGE = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
PARTS = """<mujoco><asset><mesh name="wedge" file="wedge.obj" inertia="convex"/></asset>
</mujoco>"""
ARM = """<mujoco><compiler meshdir="../meshes"/><include file="parts.xml"/>
<worldbody><body><joint name="a" axis="0 1 0"/><geom type="mesh" mesh="wedge"/></body>
</worldbody><actuator><position joint="a" kp="20" kv="0.2"/></actuator></mujoco>"""


@pytest.fixture
def robot(tmp_path):
    """A model that needs two more files, one of them beside its folder."""
    for name, text in (("meshes/wedge.obj", WEDGE), ("xml/parts.xml", PARTS),
                       ("xml/arm.xml", ARM)):  # fmt: skip
        (tmp_path / "robot" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "robot" / name).write_text(text)
    world = nominal(TASK, tmp_path / "robot" / "xml" / "arm.xml")
    return add_cause(world, "coulomb_friction", ["a"], 0.2)


def test_a_world_that_is_carried_can_be_moved(robot, tmp_path):
    for _ in range(2):  # again into the same folder
        world = carried(robot, tmp_path / "found")
        write_world(tmp_path / "found" / "world.json", world, {}, None)
    assert len(list((tmp_path / "found").glob("model_*"))) == 1
    shutil.rmtree(tmp_path / "robot")
    shutil.move(tmp_path / "found", tmp_path / "elsewhere")
    found, _ = read_world(tmp_path / "elsewhere", TASK)
    np.testing.assert_array_equal(found.model.body_mass, robot.model.body_mass)
    assert found.causes == robot.causes
    assert carried(found, tmp_path / "elsewhere") is found
    assert carried(nominal(), tmp_path / "elsewhere").source == "nao"


@pytest.mark.parametrize("change", ["../../robot/meshes", "strippath"])
def test_a_model_that_cannot_be_copied_stays_where_it_is(robot, tmp_path, change):
    """Its paths lead through a folder that no file of it is in, or drop folders."""
    file = tmp_path / "robot" / "xml" / "arm.xml"
    text = ARM.replace("../meshes", change)
    if change == "strippath":
        text = ARM.replace("<compiler", '<compiler strippath="true"')
        parts = PARTS.replace("wedge.obj", "package/else/wedge.obj")
        (tmp_path / "robot" / "xml" / "parts.xml").write_text(parts)
    file.write_text(text)
    world = carried(nominal(TASK, file), tmp_path / "found")
    write_world(tmp_path / "found" / "world.json", world, {}, None)
    found, _ = read_world(tmp_path / "found", TASK)
    assert found.model.nmesh == 1
    assert not list((tmp_path / "found").glob("model_*"))


def test_a_world_file_may_lie_behind_a_link(robot, tmp_path):
    (tmp_path / "deep" / "er").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "deep" / "er")
    write_world(tmp_path / "link" / "world.json", robot, {}, None)
    for folder in ("link", "deep/er"):
        found, _ = read_world(tmp_path / folder, TASK)
        assert found.causes == robot.causes


def test_a_cache_that_cannot_be_written_is_done_without(tmp_path, monkeypatch):
    told = []
    monkeypatch.setattr(backend.jax.config, "update", lambda *said: told.append(said))
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    backend.use_compile_cache()
    assert told == []
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    backend.use_compile_cache()
    assert told[0][1] == str(tmp_path / "cache" / "gatjax" / "xla")
