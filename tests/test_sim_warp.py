"""MJX-Warp: what it is given, and that it walks as MuJoCo C does.

Warp runs on CPUs, too, slowly: no GPU is needed for the latter, `gatjax[warp]` is.
"""

import importlib.util
import io
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from gatjax import loop
from gatjax.settings import LoopSettings
from gatjax.sim import mjxmodel
from gatjax.sim.alike import alike
from gatjax.sim.backend import prepare
from gatjax.sim.lighter import lighter
from gatjax.sim.world import add_causes, nominal, stacked
from gatjax.task import Task
from gatjax.walk import gait
from gatjax.walk.parameters import THETA0

TASK = Task(settle=0.1, longest_delay=0.1, duration=0.9)
CAUSES = (
    ("command_delay", ["all"], {"delay": 0.02}),
    ("torque_limit", ["LKneePitch"], {"limit": 3.0}),
    ("backlash", ["LHipPitch", "RHipPitch"], {"width": 0.02}),
    ("load_friction", ["all"], {"coefficient": 0.05}),
    ("ground_friction", ["all"], {"mu": 0.6}),
)


needs_warp = pytest.mark.skipif(
    importlib.util.find_spec("warp") is None,
    reason="warp-lang is not installed (150 MB): pip install 'gatjax[warp]'",
)

SLIPPERY = (
    ("coulomb_friction", ["all"], {"torque": 0.3}),
    ("ground_friction", ["all"], {"mu": 0.3}),
)


@needs_warp
@pytest.mark.parametrize("causes", [(), CAUSES])
def test_warp_walks_as_mujoco_c_does(causes, monkeypatch):
    monkeypatch.setattr(mjxmodel, "check_machine", lambda impl: None)
    world = lighter(add_causes(nominal(TASK), causes))
    option = world.model.opt  # within three iterations each engine stops elsewhere
    option.iterations = max(option.iterations, 20)
    policies = np.tile(THETA0, (3, 1))
    policies[1, 6] *= 0.7
    keys = jax.random.split(jax.random.key(3), 3)
    with jax.enable_x64(False):  # Warp knows no other; draws of float64 are others
        ours = prepare(world).outcome(world.values, policies, keys)
        theirs = prepare(world, "mjx", "warp").outcome(world.values, policies, keys)
    assert (np.abs(ours.velocity) > 0.03).all()  # they walk
    np.testing.assert_array_equal(np.isinf(theirs.fell_at), np.isinf(ours.fell_at))
    np.testing.assert_allclose(theirs.cost, ours.cost, rtol=0, atol=3e-4)


@needs_warp
def test_worlds_of_other_causes_are_one_call_of_warp(monkeypatch):
    monkeypatch.setattr(mjxmodel, "check_machine", lambda impl: None)
    worlds = alike([add_causes(nominal(TASK), some) for some in (CAUSES, SLIPPERY)])
    policies = np.tile(THETA0, (2, 3, 1))
    keys = jax.random.split(jax.random.key(3), (2, 3))
    with jax.enable_x64(False):
        backend = prepare(worlds[0], "mjx", "warp", trials=2)
        values = stacked([world.values for world in worlds])
        theirs = jax.vmap(backend.outcome)(values, policies, keys)
        for place, world in enumerate(worlds):
            ours = prepare(world).outcome(world.values, policies[place], keys[place])
            np.testing.assert_allclose(theirs.cost[place], ours.cost, rtol=0, atol=3e-4)


@pytest.mark.parametrize("light", [False, True])
def test_there_is_room_for_all_constraints(light):
    world = lighter(nominal()) if light else nominal()
    model, data = world.model, mujoco.MjData(world.model)
    draw, seen = np.random.default_rng(0), []
    for _ in range(300):  # thrown down, feet first or not, with joints at their ends
        mujoco.mj_resetData(model, data)
        data.qpos[2] = draw.uniform(0.2, 0.3)
        data.qpos[7:] = draw.uniform(-2.0, 2.0, model.nq - 7)
        mujoco.mj_forward(model, data)
        assert data.ncon <= mjxmodel.most_contacts(model)
        seen.append(data.nefc)
    data.qpos[:], data.qpos[3] = 0.0, 1.0
    data.qpos[2] = 0.32
    mujoco.mj_forward(model, data)
    assert data.ncon == 8 == mjxmodel.most_contacts(model)  # all corners of both soles
    assert max([*seen, data.nefc]) <= mjxmodel.most_rows(model)
    assert mjxmodel.most_rows(model) < 100


BOXES = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
{}</worldbody></mujoco>"""
BOX = """<body pos="0 0 {}"><freejoint/><geom type="{}" size=".1 .1 .1"/></body>"""


@pytest.mark.parametrize(
    ("bodies", "most"),
    [
        ([(0.09, "sphere")], 1),
        ([(0.09, "box")], 8),
        ([(0.09, "box"), (0.27, "sphere")], 10),  # each other, and the floor
        ([(0.09 + 0.18 * number, "box") for number in range(5)], 64),
    ],
)
def test_there_is_room_for_contacts_of_other_shapes(bodies, most):
    text = BOXES.format("".join(BOX.format(*body) for body in bodies))
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert 0 < data.ncon <= mjxmodel.most_contacts(model) == most


def test_auto_takes_warp_where_it_can_run(monkeypatch):
    asked = LoopSettings(backend="mjx")
    assert loop.resolved(asked).impl == "jax"
    board = SimpleNamespace(device_kind="NVIDIA H200")
    monkeypatch.setattr(jax, "devices", lambda: [board])
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name == "warp")
    monkeypatch.setattr(
        mjxmodel, "_printed", io.StringIO("Failed to import warp: no libnvrtc")
    )
    assert loop.resolved(asked).impl == "jax"
    assert "is broken: Failed to import warp: no libnvrtc" in str(
        mjxmodel.lacking_for_warp()
    )
    monkeypatch.setattr(mjxmodel, "_printed", io.StringIO())
    assert loop.resolved(asked).impl == "warp"
    assert loop.resolved(LoopSettings(backend="native")).impl == "jax"
    board.device_kind = "AMD Instinct MI300X"
    assert loop.resolved(asked).impl == "jax"


def test_the_legs_are_solved_once_not_once_for_every_joint():
    """Else XLA takes five minutes to compile the walk for a GPU, which is not here."""
    text = str(jax.make_jaxpr(gait.pose)(jnp.asarray(THETA0)))
    assert text.count("optimization_barrier") == 1
    np.testing.assert_allclose(
        gait.pose(THETA0), jax.jit(gait.pose)(jnp.asarray(THETA0)), atol=1e-6
    )
