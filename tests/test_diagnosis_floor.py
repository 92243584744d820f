"""Standing robots: loads, pushes and claims, on a small robot with two feet."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from gatjax.data.recording import Recording
from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import assembly
from gatjax.diagnosis.diagnose import diagnose
from gatjax.diagnosis.floor import (
    claims,
    played,
    pushes,
    reaction,
    scene,
    standing,
    tolerances,
    weights,
)
from gatjax.diagnosis.floor.causes import feet, suspects
from gatjax.diagnosis.floor.channels import simulated
from gatjax.diagnosis.floor.observed import _stack, binned
from gatjax.diagnosis.floor.reaction import Frame
from gatjax.diagnosis.given import Logs
from gatjax.diagnosis.hypotheses import COUNT, numbers
from gatjax.diagnosis.joint import STEP
from gatjax.diagnosis.loads import Tree
from gatjax.diagnosis.motion import FINE, grid_time
from gatjax.diagnosis.start import Start
from gatjax.robot.model import load
from gatjax.sim.limbs import put_down
from gatjax.sim.stored import read_world
from gatjax.sim.world import add_cause
from gatjax.task import Task

PERIOD = 0.02
LEG = """
<body pos="0 {y} -0.05">
  <joint name="{s}Hip" axis="0 1 0" armature="0.005" damping="0.5" frictionloss="0.02"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.12" size="0.02" mass="0.4"/>
  <body name="{s}Foot" pos="0 0 -0.15">
    <joint name="{s}Ankle" axis="0 1 0" armature="0.005" damping="0.5"
           frictionloss="0.02"/>
    <geom type="box" size="0.07 0.03 0.01" mass="0.2"/>
    <geom class="sole" name="{s}1" pos="0.07 0.03 -0.02"/>
    <geom class="sole" name="{s}2" pos="0.07 -0.03 -0.02"/>
    <geom class="sole" name="{s}3" pos="-0.07 0.03 -0.02"/>
    <geom class="sole" name="{s}4" pos="-0.07 -0.03 -0.02"/>
    <site name="{s}Front" type="sphere" size="0.04" pos="0.07 0 -0.02"/>
    <site name="{s}Rear" type="sphere" size="0.04" pos="-0.07 0 -0.02"/>
  </body>
</body>
"""
XML = f"""
<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default>
    <geom contype="0" conaffinity="0"/>
    <position kp="60" kv="0.3" forcerange="-8 8"/>
    <default class="sole">
      <geom type="sphere" size="0.005" conaffinity="1" friction="1 0.005 0.0001"/>
    </default>
  </default>
  <worldbody>
    <geom type="plane" size="0 0 0.1" contype="1"/>
    <body name="torso" pos="0 0 0.23">
      <freejoint/>
      <geom type="box" size="0.05 0.08 0.05" mass="1.5"/>
      <site name="imu"/>
      <body pos="0 0 0.05">
        <joint name="Neck" axis="0 1 0" armature="0.002" damping="0.1"
               frictionloss="0.01"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.08" size="0.03" mass="0.4"/>
      </body>
      {LEG.format(s="L", y=0.06)}
      {LEG.format(s="R", y=-0.06)}
    </body>
  </worldbody>
  <actuator>
    <position joint="Neck"/> <position joint="LHip"/> <position joint="LAnkle"/>
    <position joint="RHip"/> <position joint="RAnkle"/>
  </actuator>
  <sensor>
    <gyro site="imu"/> <accelerometer site="imu"/>
    <touch name="LFront" site="LFront"/> <touch name="LRear" site="LRear"/>
    <touch name="RFront" site="RFront"/> <touch name="RRear" site="RRear"/>
  </sensor>
</mujoco>
"""
NAMES = ("Neck", "LHip", "LAnkle", "RHip", "RAnkle")


def silent(stage: str, share: float) -> None:
    """Nobody listens."""


@pytest.mark.parametrize("stamps", [
    np.delete(0.01 * np.arange(200), np.arange(101, 145)), 0.15 * np.arange(40),
    0.1 * np.arange(40), 3.0 + 0.01 * np.arange(200),
], ids=["gap", "slow", "even", "late"])  # fmt: skip
def test_a_bin_has_rows(stamps: np.ndarray) -> None:
    """What was measured and what was simulated have the same bins."""
    run = JointRun(0, stamps, np.zeros((len(stamps), 1)), np.zeros((len(stamps), 1)))
    measured, simulated = (
        binned(run, each) for each in (stamps, np.stack([stamps] * 2))
    )
    assert np.isfinite(measured).all() and (np.diff(measured) > 0.0).all()
    assert simulated == pytest.approx(np.stack([measured] * 2))
    nearest = np.abs(stamps[:, None] - measured).argmin(1)
    for number, mean in enumerate(measured):
        rows = stamps[nearest == number]
        assert len(rows) and np.ptp(rows) <= 0.1 + 1e-9
        assert mean == pytest.approx(rows.mean(), abs=0.011)


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(XML)


def recorded(run: JointRun, channels: dict[str, np.ndarray]) -> Recording:
    """The same as a file would hold it."""
    columns = dict(channels)
    for name, command, angle in zip(NAMES, run.command.T, run.angle.T, strict=True):
        columns |= {f"command.{name}": command, f"position.{name}": angle}
    rows = np.zeros(len(run.time), int)
    return Recording("log", run.time, rows, columns, {"base": "floating"})


def commands() -> tuple[np.ndarray, np.ndarray]:
    """Stamps [N] s and a bow [N, 5] rad with a nod."""
    time = PERIOD * np.arange(150)
    bow = 0.08 * np.sin(2.0 * np.pi * 0.7 * time) ** 2
    nod = 0.3 * np.sin(2.0 * np.pi * 1.1 * time) ** 2
    return time, np.stack([nod, -bow, bow, -bow, bow], -1)


def logged(
    model: mujoco.MjModel,
    cause: str | None = None,
    where: str = "",
    values: dict[str, float] | float = 0.0,
    asked: tuple[np.ndarray, np.ndarray] | None = None,
    askew: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> tuple[JointRun, dict[str, np.ndarray]]:
    """A log of the robot with a cause, with a little noise; a bow if not asked."""
    time, command = asked or commands()
    world = tolerances.timed(played.world_of(model, PERIOD, 0.001))
    if cause:
        world = add_cause(world, cause, [where], values)
    blind = JointRun(0, time, command, 0.0 * command)
    row = played.replayed(world, [blind], [world.values])[0]
    row = scene.askew(row, np.array(askew))
    rng = np.random.default_rng(1)
    angle = row.at(time, row.angle)[0] + 3e-4 * rng.normal(size=command.shape)
    seen = simulated(model, row, time)
    noise = {"gyro": 0.005, "accelerometer": 0.05, "orientation": 0.002, "force": 0.1}
    channels = {
        name: series[0] + noise[name.partition(".")[0]] * rng.normal(size=len(time))
        for name, series in seen.items()
    }
    return JointRun(0, time, command, angle), channels


def test_reaction_is_the_answer_to_a_slow_push(model: mujoco.MjModel) -> None:
    loose = mujoco.MjModel.__copy__(model)
    loose.dof_frictionloss[:] = 0.0
    data = mujoco.MjData(loose)
    data.qpos[:] = put_down(loose, np.zeros(5))
    for _ in range(500):
        mujoco.mj_step(loose, data)
    mujoco.mj_forward(loose, data)
    tree = Tree(loose, loose.actuator_trnid[:, 0])
    answer = reaction.Frame(tree).answer(loose, data)
    rate = reaction.SLOW
    for joint in (0, 1, 2):
        given = _swing(loose, data, joint, rate)
        expected = answer.slope[joint] - rate**2 * answer.inertia[joint]
        assert given == pytest.approx(expected, abs=0.05 * (60.0 + abs(expected)))
    assert answer.slope[1] > 5.0  # the other leg resists


def _swing(
    model: mujoco.MjModel, data: mujoco.MjData, joint: int, rate: float
) -> float:
    """Real part of the impedance that a joint sees beside its own servo."""
    other = mujoco.MjData(model)
    other.qpos[:] = data.qpos
    time = 0.002 * np.arange(round(2.0 * 2.0 * np.pi / rate / 0.002))
    angle = np.empty(len(time))
    for k, t in enumerate(time):
        other.qfrc_applied[6 + joint] = 0.1 * np.cos(rate * t)
        mujoco.mj_step(model, other)
        angle[k] = other.qpos[7 + joint]
    last = slice(len(time) // 2, None)
    wave = np.exp(-1j * rate * (time[last] + 0.002))
    answer = 2.0 * np.mean((angle[last] - angle[last].mean()) * wave) / 0.1
    return float((1.0 / answer).real - 60.0)


def test_single_joints_move_as_in_the_full_simulation(model: mujoco.MjModel) -> None:
    run, channels = logged(model)
    robot = standing.prepare(model, [run], [channels], PERIOD, silent)
    moved, loads = robot.weigh([], [])
    ready = assembly.build(model, robot.tree, NAMES, [run], moved, loads)
    time = grid_time([run], STEP)[::FINE]
    trace = weights.trace(robot.tree, run, time)
    for joint in ready:
        path = np.interp(run.time, time, trace.motion.position[:, joint.index])
        nominal = numbers(joint, None, np.zeros(COUNT))
        alone = joint.simulate([nominal], False)[0, joint.valid[0], 0]
        assert np.sqrt(np.mean(np.square(alone - path))) < 6e-4
        assert np.ptp(path) > 0.02  # it did move


def test_a_push_is_told_by_the_other_joints(model: mujoco.MjModel) -> None:
    run, _ = logged(model)
    time = grid_time([run], STEP)[::FINE]
    tree = Tree(model, model.actuator_trnid[:, 0])
    moments = weights.trace(tree, run, time).moments
    answers = [moment.answer for moment in moments]
    push = np.zeros(12)
    push[[0, 6]] = 1.5, -1.5  # N, feet apart along x
    load = np.stack([one.share @ one.pushes @ push for one in answers])
    wave = np.sin(np.arange(len(answers)))[:, None]
    left = wave * load * np.stack([one.gives for one in answers])
    felt = pushes.felt(answers, left, 1e-8 * np.eye(5))
    wanted = -(wave * load)
    legs = slice(1, 5)
    assert np.abs(wanted[:, legs]).max() > 0.02
    assert np.linalg.norm((felt - wanted)[:, legs]) < 0.3 * np.linalg.norm(
        wanted[:, legs]
    )
    alone = np.zeros_like(left)
    alone[:, 1] = left[:, 1]
    assert np.abs(pushes.felt(answers, alone, 1e-8 * np.eye(5))[:, 1]).max() < 1e-9


@pytest.mark.parametrize(
    ("cause", "where", "values", "size"),
    [
        ("imu_misalignment", "imu", {"angle": 0.06, "roll": 1.0, "pitch": 1.0}, 0.06),
        ("gravity_tilt", "all", {"angle": 0.05, "roll": 0.0, "pitch": 1.0}, 0.05),
    ],
)
def test_causes_of_the_floor_are_named(
    model: mujoco.MjModel, cause: str, where: str, values: dict[str, float], size: float
) -> None:
    run, channels = logged(model, cause, where, values)
    robot = standing.prepare(model, [run], [channels], PERIOD, silent)
    best = claims.claims(scene.prepare(robot, silent), silent)[0]
    assert (best.cause, best.where) == (cause, where)
    assert best.gain > 10.0
    first = next(iter(best.values.values()))
    assert first == pytest.approx(size, rel=0.25)
    assert best.low < best.high


def test_a_healthy_robot_has_no_claim(model: mujoco.MjModel) -> None:
    run, channels = logged(model)
    robot = standing.prepare(model, [run], [channels], PERIOD, silent)
    assert claims.claims(scene.prepare(robot, silent), silent)[0].gain < 10.0


def test_two_causes_of_a_standing_robot_are_named(
    model: mujoco.MjModel, tmp_path: Path
) -> None:
    """An inertial unit that is askew hides no weak hip, nor the hip the unit."""
    (tmp_path / "robot.xml").write_text(XML)
    askew = (0.045, 0.04, 0.0)
    run, channels = logged(model, "gain_error", "LHip", {"scale": 0.5}, askew=askew)
    log = recorded(run, channels)
    start = Start(str(tmp_path / "robot.xml"))
    found = diagnose(start, Logs([log], [log]), tmp_path / "out", 0, silent)
    assert found["verdict"] == "named"
    sizes = {row["cause"]: row["parameters"] for row in found["causes"]}
    assert sizes.keys() == {"imu_misalignment", "gain_error"}
    assert sizes["gain_error"]["scale"]["value"] == pytest.approx(0.5, rel=0.2)
    for axis, angle in zip(("roll", "pitch"), askew[:2], strict=True):
        turned = sizes["imu_misalignment"][axis]["value"]
        assert turned == pytest.approx(angle, rel=0.2)
    assert found["gain"]["after"] < 0.5 * found["gain"]["before"]
    assert found["gain"]["compared_share"] == 1.0
    world, _ = read_world(tmp_path / "out", Task(control_period=PERIOD))
    own = [row for row in world.causes if "role" not in row]
    causes = {row["cause"]: row["where"] for row in own}
    assert causes["gain_error"] == ["LHip"] and causes["imu_misalignment"] == ["imu"]


def test_positions_alone_of_a_healthy_robot_are_enough(
    model: mujoco.MjModel, tmp_path: Path
) -> None:
    (tmp_path / "robot.xml").write_text(XML)
    log = recorded(logged(model)[0], {})
    found = diagnose(
        Start(str(tmp_path / "robot.xml")), Logs([log], []), tmp_path / "out", 0, silent
    )
    assert (found["verdict"], found["causes"]) == ("none", [])


def test_what_comes_after_a_fall_is_left_out(model: mujoco.MjModel) -> None:
    run, channels = logged(model)
    down = np.where(run.time > 2.6, 1.2, 0.0)
    runs, cut = standing.upright(
        model, [run], [channels | {"orientation.pitch": down}], PERIOD
    )
    assert runs[0].time[-1] == pytest.approx(2.3, abs=0.03)
    assert len(cut[0]["gyro.x"]) == len(runs[0].time) == len(runs[0].angle)
    with pytest.raises(ValueError, match="falls within 2 s"):
        standing.upright(
            model, [run], [channels | {"orientation.pitch": 1.2 + down}], PERIOD
        )


QUADRUPED = """
<mujoco><option timestep="0.002"/><worldbody><geom {floor} solref="{soft}"/>
<body name="torso" pos="0 0 0.45"><freejoint/>
<geom type="box" size=".08 .08 .08" mass="3" contype="0" conaffinity="0"/>{legs}
</body></worldbody><actuator>{servos}</actuator></mujoco>"""


def quadruped(path: Path, floor: str, soft: str = "0.02 1") -> mujoco.MjModel:
    """Four straight legs with spheres as feet."""
    legs = "".join(
        f'<body name="l{k}" pos="{x} {y} 0"><joint name="h{k}" axis="0 1 0"'
        f' damping=".1" armature=".005"/><geom type="capsule" size=".02" mass=".3"'
        f' fromto="0 0 0 0 0 -.35" contype="0" conaffinity="0"/><geom type="sphere"'
        f' pos="0 0 -.4" size=".03" mass=".05" solref="{soft}"/></body>'
        for k, (x, y) in enumerate(((0.1, 0.1), (0.1, -0.1), (-0.1, 0.1), (-0.1, -0.1)))
    )
    servos = "".join(
        f'<position joint="h{k}" kp="60" kv="2" forcerange="-10 10"/>' for k in range(4)
    )
    path.write_text(QUADRUPED.format(floor=floor, soft=soft, legs=legs, servos=servos))
    return load(path)


def test_a_floor_may_be_written_as_a_box(tmp_path: Path) -> None:
    """MuJoCo then has the foot as the first geom of a contact."""
    told = []
    for floor in (
        'type="plane" size="5 5 .1"', 'type="box" size="5 5 .1" pos="0 0 -.1"'
    ):  # fmt: skip
        model = quadruped(tmp_path / "quad.xml", floor)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 1500)
        mujoco.mj_forward(model, data)
        answer = Frame(Tree(model, model.actuator_trnid[:, 0])).answer(model, data)
        told.append((answer.slope, answer.inertia))
    np.testing.assert_allclose(told[1], told[0], rtol=1e-3)


def test_contacts_that_are_springs_have_no_time_to_be_wrong(tmp_path: Path) -> None:
    floor = 'type="plane" size="5 5 .1"'
    for soft, there in (("0.02 1", True), ("-8000 -150", False)):
        model = quadruped(tmp_path / "quad.xml", floor, soft)
        names = [suspect.cause for suspect in suspects(model)]
        assert ("ground_compliance" in names) is there


def test_a_robot_that_faces_south_turns_no_round(model: mujoco.MjModel) -> None:
    time = 0.02 * np.arange(500)
    yaw = np.pi - 0.002 + 0.004 * np.sin(2.0 * time)
    wrapped = np.angle(np.exp(1j * yaw))
    (seen,) = _stack({"orientation.yaw": wrapped}, ("orientation.yaw",))
    np.testing.assert_allclose(seen, yaw - yaw.mean(), atol=1e-9)


PAIRED = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 1" contype="0" conaffinity="0"/>
  <body name="foot" pos="0 0 0.3"><freejoint/>
    <geom name="sole" type="box" size="0.1 0.05 0.02" mass="1" contype="0"
      conaffinity="0"/>
  </body></worldbody><contact>
  <pair geom1="floor" geom2="sole" friction="0.6 0.6 0.005 0.0001 0.0001"
    solref="0.01 1"/></contact></mujoco>"""


def test_contacts_of_named_pairs_alone_are_contacts():
    model = mujoco.MjModel.from_xml_string(PAIRED)
    assert feet(model) == ["foot"]
    axes = {each.cause: each.nodes[0, 0] for each in suspects(model)}
    assert axes["ground_friction"] == pytest.approx(0.7 * 0.6)
    assert axes["ground_compliance"] == pytest.approx(0.6 * 0.01)
    assert put_down(model, np.zeros(0))[2] == pytest.approx(0.02, abs=1e-6)
