"""Worlds with different causes become worlds of one structure, and walk as before."""

import dataclasses

import jax
import numpy as np
import pytest

from gatjax.effects.effect import memoryless
from gatjax.records import Signal
from gatjax.robot.nao import WALKING_JOINTS
from gatjax.sim import mjx
from gatjax.sim.alike import alike
from gatjax.sim.backend import prepare
from gatjax.sim.contact import Law
from gatjax.sim.lighter import lighter
from gatjax.sim.world import (
    add_causes,
    add_command,
    nominal,
    stacked,
    with_contact,
)
from gatjax.task import Task
from gatjax.walk.parameters import THETA0

TASK = Task(settle=0.1, longest_delay=0.04, duration=0.6)
LEFT, RIGHT = ["LHipPitch", "LKneePitch"], ["RHipPitch", "RAnklePitch"]
FRICTION = ("coulomb_friction", ["all"], {"torque": 0.05})
SETS = {
    "nothing": (),
    "delays": (
        ("command_delay", ["all"], {"delay": 0.02}),
        ("command_delay", LEFT, {"delay": 0.01}),  # and later still
        ("encoder_offset", LEFT, {"offset": 0.01}),
        ("dead_band", WALKING_JOINTS, {"half_width": 0.005}),
    ),
    "zeros": (
        ("gravity_tilt", ["all"], {"angle": 0.02}),
        ("command_delay", RIGHT, {"delay": 0.03}),
        ("armature", RIGHT, {"inertia": 0.005}),
        ("command_delay", LEFT, {"delay": 0.01}),
        ("encoder_offset", RIGHT, {"offset": 0.01, "in_loop": 1.0}),
        ("encoder_offset", LEFT, {"offset": -0.01}),
        ("imu_misalignment", ["imu"], {"angle": 0.02}),
    ),
    "torques": (
        FRICTION,
        ("torque_saturation", RIGHT, {"torque": 20.0}),
        ("load_friction", LEFT, {"coefficient": 0.05}),
        ("supply_sag", ["all"], {"max_drop": 0.1}),
    ),
    "gears": (
        ("backlash", LEFT, {"width": 0.01, "encoder_on_motor": 1.0}),
        FRICTION,
        ("payload", ["LHipPitch"], {"mass": 0.1, "x": 0.02, "y": 0.0, "z": 0.0}),
        ("sole_geometry", ["LFoot"], {"wear": 0.002}),
    ),
}


def worlds_of(*names):
    """Light worlds that a grounding was learned for besides."""
    weak = memoryless(lambda share, signal: signal._replace(
        target=(1.0 - share) * signal.target
    ))  # fmt: skip
    made = [add_causes(nominal(TASK), SETS[name]) for name in names]
    return [
        lighter(add_command(world, "weak", weak, np.float64(0.01 * place)))
        for place, world in enumerate(made)
    ]


def cost(world):
    keys = jax.random.split(jax.random.key(1), 2)
    return prepare(world).outcome(world.values, np.tile(THETA0, (2, 1)), keys).cost


@pytest.mark.parametrize(
    "names",
    [
        ("nothing", "nothing"),
        ("delays", "zeros", "gears"),
        ("zeros", "delays"),
        ("torques", "gears"),
    ],
)
def test_each_walks_as_before(names):
    before = worlds_of(*names)
    after = alike(before)
    stacked([world.values for world in after])
    most = max(world.model.opt.iterations for world in before)
    costs = []
    for old, new in zip(before, after, strict=True):
        assert new.model.opt.iterations == most
        old.model.opt.iterations = most
        costs.append(cost(old))
        np.testing.assert_allclose(cost(new), costs[-1], rtol=0, atol=1e-6)
    assert len({float(each[0]) for each in costs}) == len(names)


def test_causes_that_all_have_are_there_once():
    delays, zeros = alike(worlds_of("delays", "zeros"))
    assert [name.rstrip("_0123456789") for name in delays.motor] == [
        "command_delay", "command_delay", "encoder_offset", "dead_band"
    ]  # fmt: skip
    assert list(delays.motor) == list(zeros.motor)


def test_what_was_learned_comes_ahead_of_lost_commands():
    seen = []

    def change(params, signal):
        seen.append(np.asarray(signal.target).max())
        return signal._replace(target=signal.target + params)

    def world(*rows):
        made = add_command(nominal(TASK), "learned", memoryless(change), np.float64(0))
        return add_causes(made, rows)

    lossy = world(("dropped_commands", ["all"], {"probability": 0.3}))
    made = [lossy, lighter(lossy), *alike([world(), lossy])]
    assert len(made) == 4
    for place, each in enumerate(made):
        command, params = each.chains()[0], each.values.command
        rest = np.zeros(each.model.nu, np.float32)
        state = command.init(params, Signal(rest, rest, rest, rest))
        lost = Signal(rest + 1.0, rest, rest, rest - 9.0)
        state, told = command.apply(params, state, lost)
        heard = np.asarray(told.target).max()
        assert seen[-1] == 1.0
        assert heard == (1.0 if place == 2 else 0.0)


def test_a_light_body_is_among_the_values():
    heavy, usual = worlds_of("gears", "torques")
    assert not np.array_equal(heavy.model.body_mass, usual.model.body_mass)
    new = alike([heavy, usual])
    assert new[0].model is new[1].model
    for old, same in zip((heavy, usual), new, strict=True):
        np.testing.assert_array_equal(
            same.values.body["body_mass"], old.model.body_mass
        )


def test_worlds_that_differ_in_more_than_causes_are_left_alone():
    one = nominal(TASK)
    assert alike([one, nominal(Task(settle=0.2))]) is None
    assert alike([one, nominal(TASK, "nao_hung")]) is None
    assert alike([one, nominal(TASK, timestep=0.002)]) is None
    assert alike([one, with_contact(nominal(TASK), Law("elliptic", 10.0))]) is None
    assert alike([one, *worlds_of("nothing")]) is None
    learned = worlds_of("nothing")[0]
    two = {"weak": np.zeros(2)}  # params of another shape
    values = learned.values._replace(command=two)
    assert alike([learned, dataclasses.replace(learned, values=values)]) is None
    taller = nominal(TASK)
    taller.model.geom_size[1] *= 1.1
    assert alike([one, taller]) is None


def test_every_robot_has_a_row_of_the_fields_of_its_trial(monkeypatch):
    """Warp gives robot n row n of a field, modulo its rows."""
    seen = []

    def outcome(world, impl, robots):
        @jax.custom_batching.custom_vmap
        def step(field, policy):
            return field.sum() + policy.sum()

        @step.def_vmap
        def _(count, batched, field, policy):
            seen.append(batched)
            sums = field.sum(tuple(range(1, field.ndim)))
            return sums + policy.sum(tuple(range(1, policy.ndim))), True

        return lambda values, policy, key: step(values.body["mass"], policy)

    monkeypatch.setattr(mjx, "outcome", outcome)
    world = nominal(TASK)
    values = [
        world.values._replace(body={"mass": np.full(4, float(trial))})
        for trial in range(3)
    ]
    backend = prepare(world, "mjx", trials=3)
    keys = jax.random.split(jax.random.key(0), (3, 5))
    policies = np.zeros((3, 5, 15))
    found = jax.vmap(backend.outcome)(stacked(values), policies, keys)
    np.testing.assert_array_equal(found, np.repeat([[0.0], [4.0], [8.0]], 5, axis=1))
    assert all(field for field, _ in seen)
