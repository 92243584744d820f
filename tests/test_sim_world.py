"""Worlds: what they are made of, their file, and runs of them on the native backend."""

import dataclasses
import errno
import json
import os
import re
import shutil

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from gatjax.effects.catalogue import CATALOGUE
from gatjax.effects.effect import memoryless
from gatjax.records import JOINTS
from gatjax.robot import model as robot_model
from gatjax.sim.backend import prepare
from gatjax.sim.contact import Law, law_of
from gatjax.sim.mjxmodel import dropped_by_mjx
from gatjax.sim.native import Native
from gatjax.sim.poses import write_walk
from gatjax.sim.replay import replay_many
from gatjax.sim.stored import read_world, write_world
from gatjax.sim.world import (
    add_cause,
    add_command,
    fields_applied,
    nominal,
    stacked,
    with_contact,
)
from gatjax.task import Task, task_at
from gatjax.walk.parameters import THETA0

SHORT = Task(settle=0.1, longest_delay=0.04, duration=0.4)
CAUSES = {  # a value of every cause that a walking robot can bear
    "command_delay": 0.02, "first_order_lag": 0.02, "speed_limit": 5.0,
    "torque_limit": 6.0, "current_limit": 5.0, "torque_saturation": 20.0,
    "coulomb_friction": 0.1, "viscous_friction": 0.3, "gain_error": 0.8,
    "backlash": 0.02, "dead_band": 0.005, "command_noise": 0.01,
    "measurement_delay": 0.02, "dropped_commands": 0.2, "damping_error": 2.0,
    "stiction": 0.1, "load_friction": 0.1, "command_quantization": 0.02,
    "joint_elasticity": 300.0, "torque_ripple": 0.1, "asymmetric_friction": 0.1,
    "encoder_offset": 0.01, "encoder_scale": 0.98, "payload": 0.05, "com_shift": 0.003,
    "armature": 0.002, "gravity_tilt": 0.02, "thermal_derating": 0.5, "supply_sag": 0.3,
    "clock_drift": 0.001, "imu_misalignment": 0.02, "ground_friction": 0.5,
    "ground_compliance": 0.03, "sole_geometry": 0.001,
}  # fmt: skip
LEGS = ["LKneePitch", "RKneePitch", "LAnkleRoll", "RAnkleRoll"]
CLOSED = [  # some of motor, body, gear and command: each compiles its control loop
    "command_delay", "dead_band", "torque_limit", "backlash", "command_noise",
]  # fmt: skip


def where(name, joints=("all",)):
    """A place where a cause may act."""
    place = CATALOGUE[name].place
    places = {"joint": list(joints), "foot": ["LFoot"]}
    return places.get(place, [place])


def batch(count, seed=0):
    """The same walk with different random starts."""
    keys = jax.random.split(jax.random.key(seed), count)
    return np.tile(THETA0, (count, 1)), keys


def same(left, right):
    """Assert that two results are equal to the last bit."""
    for ours, theirs in zip(jax.tree.leaves(left), jax.tree.leaves(right), strict=True):
        np.testing.assert_array_equal(np.asarray(ours), np.asarray(theirs))


# Causes


def test_what_was_learned_is_known_beside_causes_that_share_an_effect():
    world = nominal(SHORT)
    for joint, share in (("LHipRoll", 0.1), ("RHipRoll", 0.3), ("LHipPitch", 0.2)):
        world = add_cause(world, "dropped_commands", [joint], share)
    assert len(world.command) == 1 and not world.learned
    same = memoryless(lambda params, signal: signal)
    assert add_command(world, "grounding", same, ()).learned


def test_every_cause_is_tried_here():
    assert set(CAUSES) == set(CATALOGUE)


def test_an_unknown_cause_is_refused():
    with pytest.raises(ValueError, match=r"'rust' is unknown; .*'backlash'"):
        add_cause(nominal(), "rust", ["all"], 0.1)


@pytest.mark.parametrize("cause", ["backlash", "torque_limit", "command_noise"])
def test_an_unknown_joint_is_refused_with_those_that_exist(cause):
    with pytest.raises(ValueError, match=r"no joint 'LKnee'; it has .*'LKneePitch'"):
        add_cause(nominal(), cause, ["RKneePitch", "LKnee"], 1.0)


def test_adding_a_cause_leaves_the_world_it_came_from_alone():
    plain = nominal()
    kept = {name: getattr(plain.model, name).copy() for name in ("dof_damping",)}
    world = plain
    for name, value in CAUSES.items():
        world = add_cause(world, name, where(name, LEGS), value)
    assert not plain.causes and not plain.values.motor and not plain.values.body
    assert len(world.causes) == len(CAUSES)
    np.testing.assert_array_equal(plain.model.dof_damping, kept["dof_damping"])
    np.testing.assert_array_equal(world.model.dof_damping, kept["dof_damping"])
    assert (fields_applied(world).dof_damping != kept["dof_damping"]).sum() == 4


def test_the_same_cause_may_act_twice():
    world = add_cause(nominal(), "command_delay", ["all"], 0.02)
    world = add_cause(world, "command_delay", ["LKneePitch"], 0.03)
    assert len(world.motor) == len(world.values.motor) == 2
    assert list(world.motor) == list(world.values.motor)


def test_rows_of_a_cause_at_other_joints_share_an_effect():
    """They act as apart: a delay and a loss of targets of their own for each joint."""
    rows = [
        ("command_delay", "LKneePitch", 0.02),
        ("command_delay", "RKneePitch", 0.04),
    ]
    rows += [("encoder_offset", "LKneePitch", 0.1), ("encoder_offset", "LHipRoll", 0.2),
    ]  # fmt: skip
    shared = apart = nominal(SHORT)
    for name, joint, value in rows:
        shared = add_cause(shared, name, [joint], value)
    for name, joint, value in (rows[0], rows[2], rows[1], rows[3]):
        apart = add_cause(apart, name, [joint], value)
    assert len(shared.causes) == len(apart.causes) == 4
    assert [len(shared.motor), len(shared.sensor)] == [1, 2]  # and its noise
    assert [len(apart.motor), len(apart.sensor)] == [2, 3]
    rng = np.random.default_rng(0)
    commands = 0.02 * rng.standard_normal((1, 40, len(JOINTS))).cumsum(1)
    start = np.array(shared.model.qpos0), np.zeros(shared.model.nv)
    played = [
        replay_many(world, stacked([world.values]), commands, *start)
        for world in (shared, apart)
    ]
    np.testing.assert_array_equal(*(run.reading.angle for run in played))
    both = add_cause(shared, "encoder_offset", ["LHipRoll"], 0.1)
    assert len(both.sensor) == 3  # a second time at one joint: on top


@pytest.mark.parametrize("name", CLOSED)
def test_a_neutral_cause_changes_no_run_and_a_real_one_does(name):
    """1e-3 m/s and not equality: rounding grows in contacts."""
    policies, keys = batch(2)
    plain, everything = nominal(SHORT), ["all"]
    neutral = add_cause(plain, name, everything, CATALOGUE[name].neutral)
    strong = add_cause(plain, name, everything, CAUSES[name])
    walk, _ = prepare(plain).rollout(plain.values, policies, keys)
    run = prepare(neutral)
    none, _ = run.rollout(neutral.values, policies, keys)
    if not strong.motor and not strong.command:
        run = prepare(strong)  # the engine's model is another one
    some, _ = run.rollout(strong.values, policies, keys)
    first = np.s_[:, :6]  # before contacts blow rounding up
    gap = np.abs(none.reading.angle - walk.reading.angle)
    assert gap[first].max() < 1e-9
    assert gap.max() < 1e-4
    assert np.abs(some.reading.angle - walk.reading.angle).max() > 1e-3


# The world file


def test_a_world_read_from_its_file_runs_identically(tmp_path):
    world = nominal(SHORT)
    for index, (name, value) in enumerate(CAUSES.items()):
        joints = LEGS if index % 2 else ["all"]
        world = add_cause(world, name, where(name, joints), value)
    write_world(tmp_path / "world.json", world, {"tool": "test"}, None)
    again, grounding = read_world(tmp_path / "world.json", SHORT)
    assert grounding is None
    assert again.causes == world.causes
    policies, keys = batch(3)
    first = prepare(world).rollout(world.values, policies, keys)
    same(first, prepare(again).rollout(again.values, policies, keys))


def test_the_file_is_the_documented_one(tmp_path):
    world = add_cause(nominal(), "backlash", ["LKneePitch"], 0.018)
    write_world(tmp_path / "world.json", world, {"version": "0"}, "grounding/")
    assert json.loads((tmp_path / "world.json").read_text()) == {
        "schema": "gatjax.world/1",
        "model": "nao",
        "rate_hz": 50.0,
        "timestep_s": 0.004,
        "effects": [
            {"cause": "backlash", "where": ["LKneePitch"], "values": {"width": 0.018}}
        ],
        "grounding": "grounding/",
        "made_by": {"version": "0"},
    }
    _, grounding = read_world(tmp_path / "world.json")
    assert grounding == tmp_path / "grounding"


def test_a_world_may_bring_its_own_model(tmp_path):
    heavy = robot_model.MODEL_FILE.read_text().replace('mass="1.04956"', 'mass="1.5"')
    (tmp_path / "robot.xml").write_text(heavy)
    text = {"schema": "gatjax.world/1", "model": "robot.xml", "effects": []}
    (tmp_path / "world.json").write_text(json.dumps(text))
    world, _ = read_world(tmp_path / "world.json")
    assert world.model.body("torso").mass[0] == 1.5


@pytest.mark.parametrize("change, message", [
    ({"schema": "gatjax.world/9"}, r"schema is 'gatjax.world/9', need"),
    ({"model": "other.xml"}, r"other\.xml does not exist"),
    ({"effects": [{"cause": "rust", "where": ["all"], "values": {}}]}, "'rust' is un"),
    ({"effects": [{"cause": "backlash", "where": ["all"], "values": {"w": 1.0}}]},
     "backlash needs 'width'"),
    ({"effects": [{"cause": "backlash", "where": ["Tail"], "values": {"width": 1.0}}]},
     "no joint 'Tail'"),
    ({"effects": [{"cause": "backlash", "where": ["all"], "values": {"width": 9.0}}]},
     r"width 9.0 rad is out of range; use 0.0 to 0.2"),
    ({"effects": {}}, "effects is {}"),
    ({"contact": "elliptic"}, "contact is 'elliptic'"),
    ({"contact": {"cone": "round", "impratio": 1.0}}, "it has a cone .pyramidal or"),
    ({"contact": {"cone": "elliptic", "impratio": 0.0}}, "and an impratio > 0"),
    ({"contact": {"cone": "elliptic"}}, "and an impratio > 0"),
    ({"model": 3}, "model is 3"),
    ({"grounding": 3}, "grounding is 3"),
    ({"grounding": ".", "rate_hz": "fast"}, "rate_hz is 'fast'"),
    ({"grounding": ".", "rate_hz": 0}, "rate_hz is 0; it is a number > 0"),
    ({"grounding": ".", "rate_hz": 100.0}, "learned at 100 Hz, used at 50 Hz"),
    ({"effects": ["backlash"]}, "effect 1 must be {cause, where, values}"),
    ({"effects": [{"where": ["all"], "values": {}}]}, "effect 1 must be"),
    ({"effects": [{"cause": "backlash", "values": {"width": 0.1}}]}, "where is None"),
    ({"effects": [{"cause": "backlash", "where": "all", "values": {"width": 0.1}}]},
     "where is 'all'; it must be a list"),
    ({"effects": [{"cause": "backlash", "where": ["all"], "values": {"width": 0.1},
                   "role": "hero"}]}, "effect 1, role 'hero' is unknown"),
    ({"effects": [{"cause": "backlash", "where": ["all"], "values": {"width": 0.1},
                   "rôle": "cause"}]}, "'rôle' means nothing here"),
    ({"effects": [{"cause": "encoder_offset", "where": ["all"],
                   "values": {"offset": 0.1, "in_loop": 0.5}}]}, "in_loop is 0.5; it"),
    ({"effects": [{"cause": "gravity_tilt", "where": ["LKneePitch"],
                   "values": {"angle": 0.1}}]}, r"it must be \['all'\]"),
    ({"effects": [{"cause": "backlash", "where": [1], "values": {"width": 0.1}}]},
     r"where is \[1\]"),
    ({"effects": [{"cause": "backlash", "where": ["all"]}]}, "values is None"),
    ({"effects": [{"cause": "backlash", "where": ["all"], "values": {"width": "x"}}]},
     "width is 'x'; it must be a number in rad"),
])  # fmt: skip
def test_a_wrong_file_is_refused_in_one_line(tmp_path, change, message):
    text = {"schema": "gatjax.world/1", "model": "nao", "effects": []} | change
    (tmp_path / "world.json").write_text(json.dumps(text))
    with pytest.raises((ValueError, FileNotFoundError), match=message) as caught:
        read_world(tmp_path / "world.json")
    assert "\n" not in str(caught.value)


def test_a_world_may_have_another_law_of_contacts(tmp_path):
    law = Law("elliptic", 4.0)
    world = add_cause(with_contact(nominal(), law), "command_delay", ["all"], 0.01)
    assert law_of(world.model) == law != law_of(nominal().model)
    write_world(tmp_path / "world.json", world, {}, None)
    again, _ = read_world(tmp_path / "world.json")
    assert law_of(again.model) == again.contact == law
    assert with_contact(again, law) is again
    with pytest.raises(ValueError, match="cone is 'round'; it is one of pyramidal"):
        with_contact(world, Law("round", 1.0))


def test_a_file_that_holds_no_object_is_refused(tmp_path):
    (tmp_path / "world.json").write_text("[]")
    with pytest.raises(ValueError, match=r"expected \{key: value\}"):
        read_world(tmp_path / "world.json")


def test_a_world_without_a_grounding_runs_at_any_rate(tmp_path):
    write_world(tmp_path / "world.json", nominal(), {}, None)
    read_world(tmp_path / "world.json", task_at(100.0))
    write_world(tmp_path / "world.json", nominal(task_at(83.3)), {}, ".")
    read_world(tmp_path / "world.json", task_at(83.3))
    with pytest.raises(ValueError, match=r"choose --rate-hz 83\.3, or ground at 100"):
        read_world(tmp_path / "world.json", task_at(100.0))


def no_space(_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_world_file_and_a_walk_are_written_whole_or_not_at_all(tmp_path, monkeypatch):
    world = nominal(SHORT)
    walk, _ = prepare(world).rollout(world.values, *batch(1))
    walk = jax.tree.map(lambda leaf: np.asarray(leaf)[0], walk)
    write_world(tmp_path / "world.json", world, {}, None)
    write_walk(tmp_path / "walk.npz", world.model, walk, "one")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    monkeypatch.setattr(os, "fsync", no_space)
    with pytest.raises(OSError, match="nothing was changed"):
        write_world(tmp_path / "world.json", world, {"by": "another"}, None)
    with pytest.raises(OSError, match="nothing was changed"):
        write_walk(tmp_path / "walk.npz", world.model, walk, "another")
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before
    with np.load(tmp_path / "walk.npz", allow_pickle=False) as file:
        assert str(file["label"]) == "one"
        assert len(file["time"]) == len(file["body_position"]) > 5


@pytest.mark.parametrize("key", ["model", "effects"])
def test_a_file_without_a_needed_key_says_which(tmp_path, key):
    text = {"schema": "gatjax.world/1", "model": "nao", "effects": []}
    del text[key]
    (tmp_path / "world.json").write_text(json.dumps(text))
    with pytest.raises(ValueError, match=f"'{key}' is missing"):
        read_world(tmp_path / "world.json")


def test_a_world_file_and_its_model_can_move_together(tmp_path):
    (tmp_path / "a").mkdir()
    shutil.copy(robot_model.MODEL_FILE, tmp_path / "a" / "robot.xml")
    world = nominal(Task(), tmp_path / "a" / "robot.xml")
    write_world(tmp_path / "a" / "world.json", world, {}, None)
    (tmp_path / "a").rename(tmp_path / "b")
    read_world(tmp_path / "b" / "world.json")


def test_a_file_that_is_missing_or_cut_off_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"world\.json does not exist"):
        read_world(tmp_path / "world.json")
    (tmp_path / "world.json").write_text('{"schema": "gatj')
    with pytest.raises(ValueError, match=r"world\.json is not JSON"):
        read_world(tmp_path / "world.json")


# What MJX can't do

SPECIAL = """
<mujoco><worldbody><body><freejoint/><geom size="0.1"/>
  <body><joint name="a" axis="0 0 1"/><geom size="0.1"/></body></body></worldbody>
  <actuator>{motor}</actuator><sensor>{sensor}</sensor></mujoco>"""
DELAYED = '<position joint="a" kp="1" delay="0.02" nsample="10"/>'
DC = '<dcmotor joint="a" input="voltage" nominal="12 1 5"/>'


LATE = '<jointpos joint="a" delay="0.02" nsample="10"/>'
RARE = '<jointpos joint="a" interval="0.05" nsample="2"/>'


@pytest.mark.parametrize(
    "motor, sensor, word",
    [
        (DELAYED, "", "actuator delay"),
        (DC, "", "dcmotor"),
        ("", LATE, "sensor delay .*measurement_delay"),
        ("", RARE, "sensor interval"),
    ],
)
def test_mjx_names_what_it_would_drop(motor, sensor, word):
    text = SPECIAL.format(motor=motor, sensor=sensor)
    model = mujoco.MjModel.from_xml_string(text)
    (lost,) = dropped_by_mjx(model)
    assert re.match(word, lost)
    world = dataclasses.replace(nominal(), model=model)
    with pytest.raises(ValueError, match=f"{word}.*use --backend native") as caught:
        prepare(world, "mjx").outcome(world.values, *batch(1))
    assert "\n" not in str(caught.value)


def test_an_interval_without_samples_does_nothing_in_either_engine():
    sensor = RARE.replace(' nsample="2"', "")
    text = SPECIAL.format(motor="", sensor=sensor)
    assert dropped_by_mjx(mujoco.MjModel.from_xml_string(text)) == []


def test_mjx_drops_nothing_of_the_nao():
    world = nominal()
    for name, value in CAUSES.items():
        world = add_cause(world, name, where(name), value)
    assert dropped_by_mjx(fields_applied(world)) == []


def test_an_unknown_backend_is_named_with_those_that_exist():
    with pytest.raises(ValueError, match=r"'gazebo' is unknown; .*'native', 'mjx'"):
        prepare(nominal(), "gazebo")


@pytest.mark.parametrize("impl, message", [
    ("cuda", r"impl 'cuda' is unknown; choose from"), ("warp", "impl 'warp' needs"),
])  # fmt: skip
def test_an_implementation_that_is_not_here_is_refused_in_one_line(impl, message):
    world = nominal()
    with pytest.raises(ValueError, match=message) as caught:
        prepare(world, "mjx", impl).outcome(world.values, *batch(1))
    assert "\n" not in str(caught.value)


# Rates


@pytest.mark.parametrize("rate", [50.0, 100.0, 83.3])
def test_the_robot_walks_at_every_control_rate(rate):
    world = nominal(task_at(rate, duration=2.0))
    step = world.model.opt.timestep
    assert world.substeps * step == pytest.approx(world.task.control_period, abs=1e-12)
    assert 0.002 <= step <= 0.005
    walk, outcome = prepare(world).rollout(world.values, *batch(4))
    assert np.isinf(outcome.fell_at).all()
    # 17.8 cm/s over the first two seconds at 50 Hz, standing still included.
    np.testing.assert_allclose(outcome.velocity, 0.178, rtol=0, atol=0.01)
    assert walk.time[0, 1] == world.task.control_period


# Rows


def kicked(native, row, velocity):
    """Make one robot of a batch start with a knee at an impossible speed."""
    begin, knee = native.begin, native.world.model.joint("LKneePitch").dofadr[0]

    def start(*arguments):
        first, *rest = begin(*arguments)
        return (first._replace(qvel=first.qvel.at[row, knee].set(velocity)), *rest)

    native.begin = start
    return native


@pytest.mark.parametrize("causes", [[], ["command_delay"]], ids=["plain", "motor"])
@pytest.mark.parametrize("velocity", [np.nan, 1e12])
def test_a_robot_that_diverges_is_not_ok_and_harms_no_other(
    tmp_path, monkeypatch, causes, velocity
):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warning into a file
    world = nominal(SHORT)
    for name in causes:
        world = add_cause(world, name, ["all"], CAUSES[name])
    policies, keys = batch(4)
    walk, expected = Native(world).rollout(world.values, policies, keys)
    native = kicked(Native(world), 1, velocity)
    other, outcome = native.rollout(world.values, policies, keys)
    np.testing.assert_array_equal(outcome.ok, [True, False, True, True])
    assert outcome.cost[1] == np.inf
    assert np.isfinite(outcome.velocity).all()
    rest = [0, 2, 3]
    same([leaf[rest] for leaf in expected], [leaf[rest] for leaf in outcome])
    pick = [walk.reading.angle, walk.command, walk.base.position, walk.alive]
    also = [other.reading.angle, other.command, other.base.position, other.alive]
    same([leaf[rest] for leaf in pick], [leaf[rest] for leaf in also])


def test_a_policy_of_nan_costs_infinity_and_harms_no_other(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    world = nominal(SHORT)
    policies, keys = batch(3)
    expected = prepare(world).outcome(world.values, policies, keys)
    policies[2] = np.nan
    outcome = prepare(world).outcome(world.values, policies, keys)
    np.testing.assert_array_equal(outcome.ok, [True, True, False])
    assert outcome.cost[2] == np.inf
    same([leaf[:2] for leaf in expected], [leaf[:2] for leaf in outcome])


def test_a_result_depends_on_policy_and_key_not_on_the_batch():
    world = add_cause(nominal(SHORT), "command_noise", ["all"], 0.01)
    run = prepare(world)
    policies, keys = batch(5)
    policies = policies * np.linspace(0.97, 1.03, 5)[:, None]
    together = run.outcome(world.values, policies, keys)
    assert len(set(together.cost)) == 5
    order = np.array([3, 0])
    some = run.outcome(world.values, policies[order], keys[order])
    same([leaf[order] for leaf in together], list(some))
    alone = run.outcome(world.values, policies[3:4], keys[3:4])
    same([leaf[3:4] for leaf in together], list(alone))


def test_runs_with_the_same_key_meet_the_same_start_and_request():
    """Common random numbers: what differs between policies is the policy."""
    world = nominal(SHORT)
    policies, keys = batch(2)
    policies[1, 6] *= 0.9  # max_forward: not part of the ready pose
    keys = jnp.stack([keys[0], keys[0]])
    walk, _ = prepare(world).rollout(world.values, policies, keys)
    np.testing.assert_array_equal(walk.reading.angle[0, 0], walk.reading.angle[1, 0])
    hip = walk.command[:, :, JOINTS.index("LHipPitch")]
    begins = (np.abs(hip - hip[:, :1]) > 1e-3).argmax(1)
    assert begins[0] == begins[1] > 0


# What a model file says in a way of its own

ARM = """
<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody>
<body name="base"><joint name="a" axis="0 1 0" {joint}/><site name="s"/>
  <geom type="capsule" size=".03" fromto="0 0 0 0 0 -.3" mass="0.5"/>
  <body name="tip" pos="0 0 -.3"><site name="t"/>
    <geom type="sphere" size=".02" mass="0.1"/></body></body></worldbody>
<actuator><position name="a" joint="a" kp="20" kv="0.2" {servo}/></actuator>
<sensor><gyro site="t"/><accelerometer site="t"/><gyro site="s"/>
  <accelerometer site="s"/><touch site="s"/><force site="s"/><touch site="t"/></sensor>
</mujoco>"""


def arm(path, joint="", servo=""):
    """A link with two inertial units, and limits of torque at joint or servo."""
    path.write_text(ARM.format(joint=joint, servo=servo))
    return nominal(Task(control_period=0.01), path)


@pytest.mark.parametrize("cause", [None, "backlash", "speed_limit", "torque_limit"])
def test_a_joints_limit_of_torque_is_its_servos(cause, tmp_path):
    limited = [
        {"servo": 'forcerange="-1 1"'}, {"joint": 'actuatorfrcrange="-1 1"'},
        {"joint": 'actuatorfrcrange="-1 1"', "servo": 'forcerange="-9 9"'},
    ]  # fmt: skip
    values = {"backlash": {"width": 0.001}, "torque_limit": {"limit": 0.5},
              "speed_limit": {"limit": 5.0, "on_motor": 1.0}}  # fmt: skip
    command = np.where(np.arange(60) > 5, 1.0, 0.0)[None, :, None]
    played = []
    for number, given in enumerate(limited):
        world = arm(tmp_path / f"{number}.xml", **given)
        if cause is not None:
            world = add_cause(world, cause, ["a"], values[cause])
        start = np.zeros(world.model.nq), np.zeros(world.model.nv)
        played.append(replay_many(world, stacked([world.values]), command, *start))
    for each in played[1:]:
        np.testing.assert_array_equal(each.reading.angle, played[0].reading.angle)
        np.testing.assert_array_equal(each.torque, played[0].torque)
    assert np.abs(played[0].torque).max() <= 1.0 + 1e-9


def test_of_several_inertial_units_that_of_the_base_counts(tmp_path):
    model = arm(tmp_path / "arm.xml").model
    where = robot_model.slots(model)
    names = [model.sensor(index).type[0] for index in range(model.nsensor)]
    assert len(names) == 7
    assert where.gyro.tolist() == [6, 7, 8]
    assert where.accelerometer.tolist() == [9, 10, 11]
    assert where.force.tolist() == [12, 16]
    world = add_cause(arm(tmp_path / "arm.xml"), "imu_misalignment", ["imu"], 0.1)
    run = replay_many(
        world, stacked([world.values]), np.zeros((1, 5, 1)), np.zeros(1), np.zeros(1)
    )
    assert run.reading.gyro.shape[-1] == run.reading.accelerometer.shape[-1] == 3


@pytest.mark.parametrize(
    ("cause", "place", "values", "says"),
    [
        ("command_delay", ["all"], {"delay": np.nan}, "delay nan s is out of range"),
        ("gain_error", ["all"], {"scale": np.nan}, "scale nan 1 is out of range"),
        ("thermal_derating", ["all"], {"lost_fraction": 0.1, "cooling": np.nan},
         "cooling nan s is out"),
        ("sole_geometry", ["LFoot"], {"wear": 1e-3, "x": 0.0}, "x and y are both 0"),
        ("com_shift", ["LFoot"], {"distance": 0.01, "x": 0.0}, "x, y, z are all 0"),
        ("sole_geometry", ["all"], {"wear": 1e-3}, "name bodies, the feet"),
    ],
)  # fmt: skip
def test_numbers_that_are_none_are_refused(cause, place, values, says):
    with pytest.raises(ValueError, match=says):
        add_cause(nominal(), cause, place, values)


@pytest.mark.parametrize("odd", ['gear="2"', 'timeconst="0.1"'])
def test_causes_of_drives_are_for_drives_at_their_joint(tmp_path, odd):
    text = f"""<mujoco><worldbody><body><joint name="a" axis="0 1 0"/><geom size="0.1"/>
    </body></worldbody><actuator><position name="arm" joint="a" kp="20" {odd}/>
    </actuator></mujoco>"""
    (tmp_path / "arm.xml").write_text(text)
    world = nominal(Task(), tmp_path / "arm.xml")
    add_cause(world, "payload", ["a"], 0.1)
    add_cause(world, "command_delay", ["a"], 0.02)  # what it is told, however it acts
    with pytest.raises(ValueError, match="actuator 'arm' has a gear or an activation"):
        add_cause(world, "torque_saturation", ["a"], 2.0)


@pytest.mark.parametrize("pair", ["", '<pair geom1="floor" geom2="box"/>'])
def test_the_floor_is_as_slippery_between_pairs(tmp_path, pair):
    text = f"""<mujoco><worldbody><geom name="floor" type="plane" size="5 5 1"/>
    <body pos="0 0 0.05"><freejoint/>
    <geom name="box" type="box" size="0.05 0.05 0.05"/><body pos="0 0 0.05">
    <joint name="j" armature="0.01" damping="0.1"/>
    <geom size="0.01" mass="0.01" contype="0" conaffinity="0"/></body>
    </body></worldbody><contact>{pair}</contact>
    <actuator><position joint="j" kp="1"/></actuator></mujoco>"""
    (tmp_path / "box.xml").write_text(text)
    world = nominal(Task(), tmp_path / "box.xml")
    model = fields_applied(add_cause(world, "ground_friction", ["ground"], 0.05))
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    mujoco.mj_step(model, data, 250)
    assert data.qvel[0] == pytest.approx(1.0 - 0.05 * 9.81 * 0.5, abs=0.05)
