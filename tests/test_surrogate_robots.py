"""The stand-in robots: what their constants promise is what they do."""

import dartpy
import mujoco
import numpy as np
import pytest

from gatjax import task as tasks
from gatjax.loop.play import Hangable, Player
from gatjax.records import JOINTS
from gatjax.robot import model as robot_model
from gatjax.robot import nao
from gatjax.surrogate import ROBOTS, Robot, make_robot, start
from gatjax.surrogate import dart as darts
from gatjax.surrogate.e1 import E1, draw_body, inertials
from gatjax.surrogate.legs import Chains, Rotors
from gatjax.surrogate.servo import error, servo, torque
from gatjax.surrogate.skeleton import CHAIN, skeleton
from gatjax.surrogate.stiff import Flock, build
from gatjax.task import Task
from gatjax.walk.parameters import NAMES, THETA0

SHORT = Task(settle=0.1, longest_delay=0.04, duration=0.2)
FINE = Task(control_period=0.001, settle=0.5, longest_delay=0.1, duration=0.5)
HEAD, KNEE = JOINTS.index("HeadYaw"), JOINTS.index("LKneePitch")


def machine(name, task):
    body = draw_body(0)
    floor, run = start.draw_floor(body, E1), start.draw_run(body, 0, task, E1)
    pose = tasks.pose(THETA0)
    kind = darts.Flock if name == "dart" else Flock
    return kind(body, floor, [run], pose[None], task)


def stand(robot, ticks, target):
    for _ in range(ticks):
        robot.advance(target[None], np.array([True]))


def same(first, second):
    for one, other in zip(first, second, strict=True):
        if isinstance(one, tuple):
            same(one, other)
        else:
            np.testing.assert_array_equal(one, other)


def test_unknown_robot_is_refused_with_the_names():
    with pytest.raises(ValueError, match=r"'drake' is unknown.*dart.*stiff"):
        make_robot("drake")


@pytest.mark.parametrize("name", ROBOTS)
def test_the_same_seeds_give_the_same_walk_and_others_do_not(name):
    robot = make_robot(name, 0)
    assert isinstance(robot, Robot)
    first = robot.walk(THETA0[None], [3], SHORT)
    same(first, make_robot(name, 0).walk(THETA0[None], [3], SHORT))
    other = make_robot(name, 0).walk(THETA0[None], [4], SHORT)
    assert np.any(first[0].reading.gyro != other[0].reading.gyro)
    another = make_robot(name, 1).walk(THETA0[None], [3], SHORT)
    assert np.any(first[0].base.position != another[0].base.position)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_wants_a_seed_for_each_run(name):
    with pytest.raises(ValueError, match="1 seeds for 2 runs; give one for each"):
        make_robot(name).walk(np.tile(THETA0, (2, 1)), [3], SHORT)


@pytest.mark.parametrize("name", ROBOTS)
def test_walks_do_not_depend_on_the_number_of_workers(name):
    policies = np.tile(THETA0, (3, 1))
    one, two = (make_robot(name, workers=count) for count in (1, 2))
    try:
        alone = one.walk(policies, range(3), SHORT)
        begun = [
            each.begin_walks(policies, range(3), SHORT) for each in (two, two, one)
        ]
        same(alone, two.walk(policies, range(3), SHORT))
        for wait in begun:
            same(alone[1], wait())
    finally:
        two.drop_walks()


@pytest.mark.parametrize("name", ROBOTS)
def test_a_command_is_seen_after_36_milliseconds(name):
    robot, target = machine(name, FINE), tasks.pose(THETA0)
    stand(robot, 600, target)
    before = robot.sense().angle[0, HEAD]
    target[HEAD] += 0.4
    moved = []
    for _ in range(45):
        stand(robot, 1, target)
        moved.append(abs(robot.sense().angle[0, HEAD] - before))
    # Tick t of the list is t + 1 ms after the command; the head needs a step to move.
    first = 1 + np.flatnonzero(np.array(moved) > 1e-5)[0]
    assert 37 <= first <= 39


@pytest.mark.parametrize("name", ROBOTS)
def test_offsets_move_the_joint_and_not_the_encoder(name):
    robot, target = machine(name, FINE), tasks.pose(THETA0)
    stand(robot, 500, target)
    true, offset = robot.sense().angle[0], draw_body(0).offset
    # The servo holds the encoder, true - offset, within its play, one encoder step and
    # what dry friction holds: 0.05 N m / 20 N m/rad.
    slack = E1.play + E1.encoder_step + 0.05 / 20.0
    assert abs(true[HEAD] - offset[HEAD] - target[HEAD]) < slack


@pytest.mark.parametrize("name", ROBOTS)
def test_feet_carry_the_weight(name):
    robot, target = machine(name, FINE), tasks.pose(THETA0)
    stand(robot, 500, target)
    carried = []
    for _ in range(100):
        stand(robot, 1, target)
        carried.append(robot.sense().force.sum())
    weight = inertials(draw_body(0)).mass.sum() * 9.81
    # The robot still sways by some mm/s^2; tilted normals take 0.1 %.
    assert np.mean(carried) == pytest.approx(weight, rel=0.01)


def test_accelerometer_of_dart_feels_gravity():
    robot, target = machine("dart", FINE), tasks.pose(THETA0)
    stand(robot, 500, target)
    felt = np.linalg.norm(robot.sense().accelerometer)
    assert felt == pytest.approx(9.81, rel=0.01)


def test_bodies_weigh_what_was_drawn():
    for seed in range(3):
        body = draw_body(seed)
        mass = inertials(body).mass.sum()
        assert mass == pytest.approx(nao.TOTAL_MASS + E1.extra_mass, rel=E1.mass_error)
        assert skeleton(body).getMass() == pytest.approx(mass)
    assert np.any(draw_body(0).offset != draw_body(1).offset)


def test_floor_is_the_same_in_both_engines():
    body = draw_body(0)
    floor, model = start.draw_floor(body, E1), build(body, start.draw_floor(body, E1))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    grid = np.array([[-1.5, 0.6], [2.1, -3.0]])  # m, grid points of 3 cm
    for x, y in grid:
        down, geom = np.array([0.0, 0.0, -1.0]), np.zeros(1, np.int32)
        top = np.array([x, y, 2.0])
        away = mujoco.mj_ray(model, data, top, down, None, 1, -1, geom)
        height, _ = floor.at(np.array([[x, y]]))
        # Single precision of MuJoCo's height data: 1e-7 of some 10 mm.
        assert 2.0 - away == pytest.approx(height[0], abs=1e-6)


def test_servo_keeps_its_limits():
    motors = servo(E1)
    push = error(E1, np.full(len(JOINTS), 2.0), np.zeros(len(JOINTS)))
    for speed in (-20.0, -1.0, 0.0, 1.0, 20.0):
        assert np.all(np.abs(torque(motors, push, np.array(speed))) <= motors.limit)
    assert torque(motors, push, np.array(0.0))[KNEE] == pytest.approx(3.0)
    no_load = motors.push / motors.damping
    assert no_load[KNEE] == pytest.approx(3.76, abs=0.01)
    assert no_load[JOINTS.index("LHipRoll")] == pytest.approx(2.45, abs=0.01)
    small = np.full(len(JOINTS), 0.9 * E1.play)
    assert np.all(error(E1, small, 0.0 * small) == 0.0)


def test_native_motors_keep_the_net_torque_limit_and_reach_it():
    robot, target = machine("stiff", FINE), tasks.pose(THETA0)
    stand(robot, 100, target)
    limit, largest = servo(E1).limit, np.zeros(len(JOINTS))
    target[KNEE] -= 0.6
    for _ in range(80):
        stand(robot, 1, target)
        now = np.abs(robot.arrived[0, : len(JOINTS)])
        largest = np.maximum(largest, now)
    assert np.all(largest <= limit + 1e-9)
    assert largest[KNEE] == pytest.approx(limit[KNEE])


def test_dart_falls_as_newton_says():
    world, robot = weightless("fall")
    world.setGravity([0.0, 0.0, -9.81])
    before = robot.getCOM()[2]
    for _ in range(200):
        world.step()
    # Velocity first, then position: exact for g t (t + dt) / 2.
    assert before - robot.getCOM()[2] == pytest.approx(9.81 * 0.2 * 0.201 / 2, rel=1e-6)


def weightless(name):
    world, robot = dartpy.simulation.World(), skeleton(draw_body(0))
    robot.setName(name)
    world.setTimeStep(0.001)
    world.setGravity([0.0, 0.0, 0.0])
    world.addSkeleton(robot)
    return world, robot


def state(robot):
    return robot.getPositions()[None], robot.getVelocities()[None]


def test_rotors_turn_against_their_housings_as_in_mujoco():
    """A torque on the free robot's knee moves all joints alike in both engines."""
    world, robot = weightless("rotors")
    names = [robot.getDof(index).getName() for index in range(robot.getNumDofs())]
    chains, knee = Chains(robot), names.index("LKneePitch")
    rotors = Rotors(chains, *state(robot))
    weights, model = inertials(draw_body(0)), without_servos()
    data = mujoco.MjData(model)
    assert weights.mass.sum() == pytest.approx(model.body_mass.sum())
    force = np.zeros(len(names))
    force[knee] = 0.5
    for _ in range(60):
        position, velocity = state(robot)
        mixed = rotors.act(chains.at(position), velocity, 0.001)
        robot.setForces(force + mixed[0])
        world.step()
        data.qfrc_applied[model.joint("LKneePitch").dofadr[0]] = 0.5
        mujoco.mj_step(model, data)
    turned = robot.getVelocities()
    for joint in ("LHipPitch", "LKneePitch", "LAnklePitch"):
        expected = data.qvel[model.joint(joint).dofadr[0]]
        scale = abs(data.qvel[model.joint("LKneePitch").dofadr[0]])
        got = turned[names.index(joint)]
        # 3 %: rotor torques lag by a step and a half of 60.
        assert got == pytest.approx(expected, abs=0.03 * scale)


def test_legs_lie_where_dart_puts_them_and_rotors_push_their_links():
    """Of a robot that turned and bends; forces by DART's Jacobians of all links."""
    robot, rng = skeleton(draw_body(0)), np.random.default_rng(4)
    count = robot.getNumDofs()
    position = rng.uniform(-0.6, 0.6, count)
    velocities = rng.normal(size=(2, count))
    robot.setPositions(position)
    chains, model = Chains(robot), robot_model.load()
    legs = chains.at(position[None])
    for side, foot in enumerate(("LFoot", "RFoot")):
        frame = robot.getBodyNode(foot).getWorldTransform()
        np.testing.assert_allclose(legs.turn[0, side], frame.rotation(), atol=1e-12)
        np.testing.assert_allclose(legs.place[0, side], frame.translation(), atol=1e-12)
    world, rates = dartpy.dynamics.Frame.World(), []
    for velocity in velocities:
        robot.setVelocities(velocity)
        rates.append([n.getAngularVelocity(world, n) for n in robot.getBodyNodes()])
    rotors = Rotors(chains, position[None], velocities[:1])
    pushed = rotors.act(legs, velocities[1:], 0.001)[0]
    change = dict(zip(links(robot), np.subtract(rates[1], rates[0]), strict=True))
    expected = np.zeros(count)
    for name in (side + joint for side in "LR" for joint in CHAIN):
        child = int(model.joint(name).bodyid[0])
        pair = [model.body(b).name for b in (child, model.body_parentid[child])]
        axis = model.jnt_axis[model.joint(name).id]
        inertia = model.dof_armature[model.joint(name).dofadr[0]]
        for one, other in (pair, pair[::-1]):
            torque_on = inertia * axis * (axis @ change[other]) / 0.002
            node = robot.getBodyNode(one)
            rows = range(node.getNumDependentGenCoords())
            slots = [node.getDependentGenCoordIndex(row) for row in rows]
            expected[slots] += node.getAngularJacobian(node).T @ torque_on
    np.testing.assert_allclose(pushed, expected, atol=1e-9)


def links(robot):
    return [node.getName() for node in robot.getBodyNodes()]


def without_servos():
    """The nominal robot with the drawn masses, without weight, damping or servos."""
    body = draw_body(0)
    model = build(body, start.draw_floor(body, E1))
    model.opt.timestep = 0.001
    model.opt.gravity[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    return model


@pytest.mark.parametrize("name", ROBOTS)
def test_theta0_walks_for_three_seconds(name):
    task = Task(duration=3.0)
    trajectory, outcome = make_robot(name, 0).walk(THETA0[None], [0], task)
    assert np.isinf(outcome.fell_at[0])
    assert outcome.velocity[0] > 0.1
    assert trajectory.command.shape == (1, task.ticks, len(JOINTS))
    steps = trajectory.reading.angle / E1.encoder_step
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)


def test_a_fallen_robot_stays_as_it_fell():
    policy = THETA0.copy()
    policy[NAMES.index("max_forward")] = 0.5
    policy[NAMES.index("forward_change")] = 0.35
    trajectory, outcome = make_robot("stiff", 0).walk(policy[None], [0], Task())
    assert np.isfinite(outcome.fell_at[0])
    end = np.flatnonzero(~trajectory.alive[0])[0]
    for field in (trajectory.command, *trajectory.reading, *trajectory.base):
        assert np.all(field[0, end:] == field[0, end])
    assert np.all(trajectory.alive[0, :end])


@pytest.fixture(scope="module")
def hanging():
    """A swing of the left leg and arm by both robots, hung: targets, trajectories."""
    target = np.tile(tasks.pose(THETA0), (100, 1))
    wave = np.sin(2.0 * np.pi * 0.02 * np.arange(100))
    for name in ("LHipPitch", "LKneePitch", "LShoulderPitch"):
        target[:, JOINTS.index(name)] += 0.3 * wave
    robots = {name: make_robot(name) for name in ROBOTS}
    assert all(isinstance(robot, Hangable) for robot in robots.values())
    hung = {name: robot.hung() for name, robot in robots.items()}
    return target, hung, {n: h.play(target[None], 50.0, [3]) for n, h in hung.items()}


@pytest.mark.parametrize("name", ROBOTS)
def test_a_hung_robot_moves_its_joints_and_nothing_else(name, hanging):
    target, hung, played = hanging
    assert isinstance(hung[name], Player) and not isinstance(hung[name], Robot)
    assert not hung[name].limbs().floating
    run = played[name]
    assert run.alive.all() and not run.reading.force.any()
    np.testing.assert_allclose(np.ptp(run.base.position[0], axis=0), 0.0, atol=1e-4)
    np.testing.assert_allclose(np.ptp(run.base.quaternion[0], axis=0), 0.0, atol=1e-6)
    knee = run.reading.angle[0, :, KNEE]
    assert np.ptp(knee) > 0.8 * np.ptp(target[:, KNEE])


def test_a_robot_of_a_flock_that_falls_leaves_the_others_alone():
    task, policies = Task(duration=2.0), np.tile(THETA0, (2, 1))
    policies[0, NAMES.index("max_forward")] = 0.5
    policies[0, NAMES.index("forward_change")] = 0.35
    both, outcome = make_robot("dart", workers=1).walk(policies, [0, 1], task)
    alone, _ = make_robot("dart", workers=1).walk(policies[1:], [1], task)
    assert np.isfinite(outcome.fell_at[0]) and np.isinf(outcome.fell_at[1])
    for one, other in zip(both.reading, alone.reading, strict=True):
        np.testing.assert_array_equal(one[1], other[0])


def test_hung_robots_of_both_engines_move_alike(hanging):
    _, _, played = hanging
    dart, stiff = (played[name].reading.angle[0] for name in ("dart", "stiff"))
    moved = [JOINTS.index(n) for n in ("LHipPitch", "LKneePitch", "LShoulderPitch")]
    apart = np.sqrt(np.mean((dart - stiff)[:, moved] ** 2, axis=0))
    assert np.rad2deg(apart).max() < 0.15
