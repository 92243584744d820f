"""A walker without the joints that its walk never moves."""

import jax
import mujoco
import numpy as np
import pytest

from gatjax.effects.catalogue import CATALOGUE
from gatjax.effects.effect import Effect
from gatjax.records import JOINTS
from gatjax.robot.model import Held, joint_names, load, slots
from gatjax.robot.nao import WALKING, WALKING_JOINTS
from gatjax.sim import episode
from gatjax.sim.contact import Law, law_of
from gatjax.sim.lighter import HELD, WEIGHING, lighter
from gatjax.sim.native import Native
from gatjax.sim.world import (
    add_cause,
    add_causes,
    add_command,
    fields_applied,
    nominal,
    with_contact,
)
from gatjax.task import Task, begin, pose, task_at
from gatjax.walk.parameters import HIGH, LOW, STEP, THETA0

BENT = """
<mujoco><worldbody><light pos="0 0 3"/><camera name="eye" pos="1 0 1"/>
  <body pos="0 0 1" quat="0.9 0.1 0.3 0.2"><joint name="a" axis="0 1 0"/>
    <geom size="0.1" mass="1"/>
    <body pos="0.2 0.1 0" quat="0.8 -0.2 0.1 0.5">
      <joint name="b" axis="1 2 0" pos="0.05 -0.1 0.2" ref="10"/>
      <geom size="0.1" mass="1" contype="0" conaffinity="0"/>
      <body pos="0.3 0 0.1"><joint name="c" axis="0 0 1"/>
        <geom size="0.1" pos="0.1 0 0" mass="1"/><site name="tip" pos="0.2 0 0"/>
      </body>
    </body>
  </body>
</worldbody><actuator>
  <position name="of_a" joint="a" kp="1"/><position name="of_b" joint="b" kp="1"/>
  <position name="of_c" joint="c" kp="1"/>
</actuator><keyframe><key qpos="1 2 3"/></keyframe></mujoco>
"""


def test_a_welded_hinge_is_where_it_stood(tmp_path):
    (tmp_path / "bent.xml").write_text(BENT)
    whole = load(tmp_path / "bent.xml")
    held = load(tmp_path / "bent.xml", held=Held({"b": 0.7}, whole))
    assert joint_names(held) == ("a", "c")
    assert (whole.ncam, whole.nlight, held.ncam, held.nlight) == (1, 1, 0, 0)
    tips = []
    for model, angles in ((whole, [0.3, 0.7, -0.4]), (held, [0.3, -0.4])):
        data = mujoco.MjData(model)
        data.qpos[:] = angles
        mujoco.mj_forward(model, data)
        tips.append([data.site("tip").xpos, data.site("tip").xmat, data.qfrc_bias[0]])
    assert (held.nbody, held.ngeom) == (whole.nbody - 1, whole.ngeom - 1)
    for one, other in zip(*tips, strict=True):
        np.testing.assert_allclose(other, one, atol=1e-12)


def test_what_is_held_still_weighs():
    full, light = nominal(), lighter(nominal())
    assert joint_names(light.model) == WALKING_JOINTS
    assert set(HELD) == set(JOINTS) - set(WALKING_JOINTS)
    stand, found = np.asarray(pose(THETA0)), []
    for world, angles in ((full, stand), (light, stand[WALKING])):
        data = mujoco.MjData(world.model)
        data.qpos[slots(world.model).position] = angles
        mujoco.mj_forward(world.model, data)
        found.append([*data.subtree_com[0], world.model.body_mass.sum()])
    np.testing.assert_allclose(found[1], found[0], atol=1e-9)


TO_MOTOR = ("command_delay", ["all"], {"delay": 0.01})
IN_GEAR = ("backlash", ["LKneePitch"], {"width": 0.01})
TO_BODY = ("gravity_tilt", ["all"], {"pitch": 0.1})


@pytest.mark.parametrize(
    ("world", "step"),
    [
        (nominal(), 0.005),
        (nominal(task_at(100.0)), 0.005),
        (nominal(task_at(83.3)), 0.004),
        (nominal(timestep=0.002), 0.002),
        (nominal(source="nao_hung"), 0.004),
        (add_causes(nominal(), [TO_BODY]), 0.005),
        (add_causes(nominal(), [TO_MOTOR]), 0.004),
        (add_causes(nominal(), [IN_GEAR]), 0.004),
    ],
)
def test_steps_are_longer_where_nothing_acts_once_a_step(world, step):
    assert lighter(world).model.opt.timestep == pytest.approx(step, rel=1e-3)


@pytest.mark.parametrize(
    ("world", "iterations"),
    [
        (nominal(), 3),
        (add_causes(nominal(), [TO_BODY]), 3),
        (nominal(source="nao_hung"), 4),
        (add_causes(nominal(), [TO_MOTOR]), 4),
        (add_causes(nominal(), [IN_GEAR]), 4),
    ],
)
def test_the_solver_iterates_less_where_nothing_acts_once_a_step(world, iterations):
    assert world.model.opt.iterations == 4
    assert lighter(world).model.opt.iterations == iterations


def test_the_floor_stays_as_sticky():
    law = Law("elliptic", 10.0)
    light = lighter(with_contact(nominal(), law))
    assert light.contact == law_of(light.model) == law


def test_a_supply_without_a_total_sags_as_much():
    """Servos of joints that are held have a share in what the supply can give."""
    full = add_cause(nominal(), "supply_sag", ["all"], {"max_drop": 0.3})
    rated = 0.5 * full.values.servo.high.sum()
    (row,) = lighter(full).causes
    assert row["values"]["total"] == pytest.approx(float(rated))
    told = add_cause(nominal(), "supply_sag", ["all"], {"max_drop": 0.3, "total": 9.0})
    assert lighter(told).causes[0]["values"]["total"] == 9.0


def walked(world, policies, keys):
    """Outcomes of policies [B, 15] on a world and on its lighter one."""
    each = (world, lighter(world))
    return [Native(one).outcome(one.values, policies, keys) for one in each]


def test_the_walk_is_the_same():
    steps = np.random.default_rng(1).normal(size=(6, 15))
    policies = np.clip(THETA0 + 0.5 * STEP * steps, LOW, HIGH)
    keys = jax.random.split(jax.random.key(2), 6)
    full, light = walked(nominal(Task(duration=3.0)), policies, keys)
    assert not np.isfinite([full.fell_at, light.fell_at]).any()
    assert np.std(full.velocity) > 0.01  # m/s, between policies
    np.testing.assert_allclose(light.velocity, full.velocity, atol=0.006)


def test_who_falls_falls_in_both():
    world = add_cause(nominal(Task(duration=2.0)), "gravity_tilt", ["all"], 0.3)
    policies = np.tile(THETA0, (4, 1))
    full, light = walked(world, policies, jax.random.split(jax.random.key(2), 4))
    assert np.isfinite(full.fell_at).all()
    np.testing.assert_allclose(light.fell_at, full.fell_at, atol=0.06)


def test_causes_at_held_joints_are_left_out():
    rows = [
        ("backlash", ["HeadYaw", "LKneePitch"], {"width": 0.01}),
        ("dead_band", ["LElbowRoll"], {"half_width": 0.01}),
        ("command_delay", ["all"], {"delay": 0.01}),
        ("payload", ["RElbowRoll"], {"mass": 0.1}),
    ]
    light = lighter(add_causes(nominal(), rows))
    found = [(row["cause"], row["where"]) for row in light.causes]
    assert found == [("backlash", ["LKneePitch"]), ("command_delay", ["all"])]


def test_what_causes_make_of_bodies_stays():
    rows = [
        ("payload", ["RElbowRoll", "LKneePitch"], {"mass": 0.2, "x": 0.03}),
        ("com_shift", ["HeadPitch", "RHipRoll"], {"x": 0.01}),
        ("payload", ["all"], {"mass": 0.01}),
    ]
    full = add_causes(nominal(), rows)
    light = lighter(full)
    assert light.causes == ()
    rng, stand, found = np.random.default_rng(3), np.asarray(pose(THETA0)), []
    moved = stand.copy()
    moved[WALKING] += rng.normal(0.0, 0.3, len(WALKING))
    for world, angles in ((full, moved), (light, moved[WALKING])):
        model = fields_applied(world)
        data = mujoco.MjData(model)
        data.qpos[slots(model).position] = angles
        data.qvel[:6] = 0.3
        mujoco.mj_forward(model, data)
        inertia = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        found.append([inertia[:6, :6], data.qfrc_bias[:6], data.subtree_com[0]])
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(other, one, atol=1e-9)


AT_JOINTS = [name for name, cause in CATALOGUE.items() if cause.place == "joint"]


@pytest.mark.parametrize("name", AT_JOINTS)
def test_only_some_causes_change_what_bodies_weigh(name):
    weighs = False
    for part in CATALOGUE[name].parts:
        if part.slot == "body":
            model = load()
            params = {key: np.full(model.nu, 0.01) for key in part.takes}
            params = params[part.takes[0]] if len(part.takes) == 1 else params
            changed = set(part.build(model, {}, params))
            weighs |= bool(changed & {"body_mass", "body_ipos", "body_inertia"})
    assert weighs == (name in WEIGHING)


def test_a_learned_effect_sees_the_joints_that_are_held():
    seen = []

    def apply(params, state, signal):
        seen.append(signal.angle.shape)
        return state, signal._replace(target=signal.target + params)

    shift = np.arange(len(JOINTS)) * 1e-3
    effect = Effect(lambda params, signal: (), apply)
    short = Task(duration=0.1, settle=0.1, longest_delay=0.0)
    light = lighter(add_command(nominal(short), "grounding", effect, shift))
    command, _, _ = light.chains()
    target = np.asarray(pose(THETA0))[WALKING].astype(np.float32)
    signal = episode.Signal(target, target, 0.0 * target, 0.0 * target)
    _, changed = command.apply(
        light.values.command, command.init(light.values.command, signal), signal
    )
    assert set(seen) == {(len(JOINTS),)}
    np.testing.assert_allclose(changed.target - target, shift[WALKING], atol=1e-6)


def test_a_joint_is_disturbed_alike_whatever_joints_are_held():
    noisy = add_cause(nominal(Task()), "command_noise", ["all"], 0.01)
    key, tick, policy = jax.random.key(4), 3, jax.numpy.asarray(THETA0)
    readings, told = [], []
    for world in (noisy, lighter(noisy)):
        where, values = slots(world.model), world.values
        drawn = episode.draw(world.task, policy, key)
        qpos, qvel = episode.placed(world.model, where, drawn)
        sensors = np.zeros(world.model.nsensordata, np.float32)
        plant = episode.observe(where, qpos, qvel, sensors)
        loop, _ = episode.open_loop(world, values, drawn, begin(policy), plant)
        noise = episode.noise(drawn.noise, tick)
        _, reading = episode.sense(world, values, drawn, noise, loop, tick, plant)
        row = episode.Row(drawn.pose, reading, plant.base, True)
        _, signal = episode.tell(world, values, loop.command, plant, row, noise)
        readings.append(reading)
        told.append(signal.target)
    whole, light = readings
    np.testing.assert_array_equal(light.angle[WALKING], whole.angle[WALKING])
    np.testing.assert_array_equal(light.force, whole.force)
    np.testing.assert_array_equal(told[1], told[0][WALKING])
    assert np.ptp(told[1] - drawn.pose[WALKING]) > 0.01
