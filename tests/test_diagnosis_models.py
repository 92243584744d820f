"""Models of users: what can be diagnosed, what is refused, and ties between joints."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from gatjax.cli import main
from gatjax.cli.engine import heed_engine
from gatjax.data import sampling
from gatjax.data.recording import Recording
from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import loads
from gatjax.diagnosis.assembly import build, nominal_drive
from gatjax.diagnosis.case import held, unfitted
from gatjax.diagnosis.given import control_period
from gatjax.diagnosis.motion import Motion
from gatjax.diagnosis.suitable import cautions, check_replay
from gatjax.diagnosis.tolerances import USUAL
from gatjax.effects.gear import GIVE as TEETH
from gatjax.sim.limbs import put_down
from gatjax.sim.tied import coupled, coupled_speed, ties
from gatjax.sim.world import dividing

PLAIN = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body>
      <joint name="arm" axis="0 1 0" damping="0.1" armature="0.004" stiffness="0.8"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.4"/>
      <body pos="0.2 0 0">
        <joint name="left" axis="0 0 1" damping="0.05" armature="0.002"/>
        <geom type="box" size="0.03 0.01 0.01" mass="0.1" contype="0"/>
      </body>
      <body pos="0.2 0.02 0" gravcomp="1">
        <joint name="right" axis="0 0 1"/>
        <geom type="box" size="0.03 0.01 0.01" mass="0.1" contype="0"/>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="right" joint2="left" polycoef="0.1 -1 0 0 0"/></equality>
  <actuator>
    <position name="arm" joint="arm" kp="20" kv="1" forcerange="-6 6"/>
    <position name="left" joint="left" kp="4" kv="0.2"/>
  </actuator>
</mujoco>
"""


def logged(model: mujoco.MjModel, path: Path, seed: int, seconds: float) -> None:
    """A log at 200 Hz of a model that is played as it is."""
    draw, data, rows = np.random.default_rng(seed), mujoco.MjData(model), []
    fine, period = 10, 0.005
    model.opt.timestep = period / fine
    time = np.arange(0.0, seconds, period)
    tones = draw.uniform(0.3, 1.6, (2, 4))
    wave = np.sin(2.0 * np.pi * tones[..., None] * time).sum(1) * 0.12
    command = wave * np.minimum(time / 0.5, 1.0)
    mujoco.mj_step(model, data, 2000)  # at rest
    for tick in range(len(time)):
        rows.append(data.qpos[[0, 1]] + draw.normal(scale=5e-4, size=2))
        data.ctrl[:] = command[:, tick]
        mujoco.mj_step(model, data, fine)
    angle = np.array(rows).T
    table = {"time": time} | {
        f"{kind}.{name}": values[k]
        for kind, values in (("command", command), ("position", angle))
        for k, name in enumerate(("arm", "left"))
    }
    parquet.write_table(pa.table(table), path)


def test_a_plain_model_is_diagnosed(tmp_path: Path) -> None:
    """Masses from geoms, a spring, a mirrored finger, no limit, 200 Hz."""
    (tmp_path / "robot.xml").write_text(PLAIN)
    robot = mujoco.MjModel.from_xml_string(PLAIN)
    robot.dof_damping[0] += 1.2
    for name, seed in (("fit", 1), ("held", 2)):
        logged(robot, tmp_path / f"{name}.parquet", seed, 8.0)
    out = tmp_path / "out"
    command = ["diagnose", "--model", str(tmp_path / "robot.xml"), "--data"]
    command += [str(tmp_path / "fit.parquet"), "--out", str(out)]
    assert main([*command, "--held-out", str(tmp_path / "held.parquet")]) == 0
    found = json.loads((out / "diagnosis.json").read_text())
    assert found["verdict"] == "named"
    [cause] = found["causes"]
    assert cause["where"] == ["arm"]
    assert cause["cause"] in ("viscous_friction", "damping_error")
    assert found["gain"]["after"] < 0.3 * found["gain"]["before"]
    short = [row for row in found["gain"]["horizons"] if row["horizon_s"] == 0.1]
    assert short and all(row["after"] < 0.002 for row in short)
    mujoco.MjModel.from_xml_path(str(out / "extended.xml"))


def test_a_model_that_falls_apart_is_refused(tmp_path, capfd, monkeypatch) -> None:
    """It names the log and the moment, before anything is fitted; MuJoCo is silent."""
    monkeypatch.chdir(tmp_path)  # MuJoCo would write its warnings there
    sound = mujoco.MjModel.from_xml_string(PLAIN)
    logged(sound, tmp_path / "fit.parquet", 1, 8.0)
    light = PLAIN.replace('armature="0.002"', 'armature="0"').replace("0.4", "1e-6")
    light = light.replace('mass="0.1"', 'mass="1e-7"').replace('kv="0.2"', 'kv="9"')
    light = light.replace("<option", '<option integrator="Euler"')
    light = light.replace("<joint name", '<joint frictionloss="0" name')
    (tmp_path / "robot.xml").write_text(light.replace('kp="4"', 'kp="40000"'))
    command = ["diagnose", "--model", str(tmp_path / "robot.xml"), "--data"]
    command += [str(tmp_path / "fit.parquet"), "--out", str(tmp_path / "out")]
    assert main(command) == 1
    said = capfd.readouterr().err
    line = said.strip().splitlines()[-1]
    assert "falls apart" in line and "fit.parquet" in line
    assert "unstable" not in said and not (tmp_path / "MUJOCO_LOG.TXT").exists()


def test_what_the_engine_warns_of_is_told_once(capsys) -> None:
    heed_engine()
    tell = mujoco.get_mju_user_warning()
    for row in (1, 2):
        tell(f"Too many contacts. Increase memory at {row}")
    tell("Nan in QACC at DOF 0. The simulation is unstable. Time = 0.1.")
    assert capsys.readouterr().err.count("warning: MuJoCo: Too many contacts") == 1


def test_a_simulation_that_gave_up_is_told_from_one_at_rest() -> None:
    """Physics that gave up repeat their last row while the command moves on."""
    time = 0.01 * np.arange(300)
    log = Recording("fit.parquet", time, np.zeros(300, int), {}, {})
    command = 0.3 * np.sin(time)[:, None]
    moving = JointRun(0, time, command, command)
    stuck = np.where(time < 1.5, command.T, 0.2).T
    check_replay("arm.xml", [log], [moving], [command], True)
    with pytest.raises(ValueError, match=r"1\.50 s into trajectory 0 of fit"):
        check_replay("arm.xml", [log], [moving], [stuck], True)
    resting = moving._replace(command=np.where(time < 1.5, command.T, 0.3).T)
    check_replay("arm.xml", [log], [resting], [stuck], True)
    broken = command.copy()
    broken[70] = np.nan
    with pytest.raises(ValueError, match=r"0\.70 s into"):
        check_replay("arm.xml", [log], [moving], [broken], True)
    check_replay("wheel.xml", [log], [moving], [command + 300.0], False)
    with pytest.raises(ValueError, match="falls apart"):
        check_replay("wheel.xml", [log], [moving], [broken], False)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('kv="1" ', 'kv="1" gear="3" ', "'arm' has a gear"),
        ('kv="1" ', 'kv="1" damping="0.5" ', "damping or armature of its own"),
        ('kv="1" ', 'kv="1" armature="0.1" ', "damping or armature of its own"),
        ('kv="1" ', 'kv="1" delay="0.02" nsample="20" ', "has a delay; take it out"),
        ('"-6 6"', '"-6 4"', "'arm' has a torque limit (forcerange, or act"),
        ('"left" axis="0 0 1"', '"left" type="slide"', "'left' drives no hinge"),
        ("<equality>", '<equality><connect body1="a" anchor="0 0 0"/>', "closes a"),
        ("0.1 -1 0 0 0", "0.1 -1 0.2 0 0", "'right' follows another one by a curve"),
    ],
)
def test_what_cannot_be_simulated_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture, old: str, new: str, said: str
) -> None:
    """One line that says what to change."""
    text = PLAIN.replace("<body>", '<body name="a">').replace(old, new)
    (tmp_path / "robot.xml").write_text(text)
    (tmp_path / "fit.csv").write_text("time\n0\n")
    command = ["diagnose", "--model", str(tmp_path / "robot.xml"), "--data"]
    assert main([*command, str(tmp_path / "fit.csv"), "--out", str(tmp_path)]) != 0
    error = capsys.readouterr().err
    assert said in error and len(error.strip().split("\n")) == 1


def test_files_of_one_rate(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Two rates in one diagnosis: every horizon would be wrong."""
    (tmp_path / "robot.xml").write_text(PLAIN)
    logged(mujoco.MjModel.from_xml_string(PLAIN), tmp_path / "a.parquet", 1, 6.0)
    table = parquet.read_table(tmp_path / "a.parquet")
    parquet.write_table(table.take(np.arange(0, len(table), 2)), tmp_path / "b.parquet")
    command = ["diagnose", "--model", str(tmp_path / "robot.xml"), "--data"]
    files = [str(tmp_path / "a.parquet"), "--held-out", str(tmp_path / "b.parquet")]
    assert main([*command, *files, "--out", str(tmp_path / "o")]) != 0
    assert "diagnose files of one rate together" in capsys.readouterr().err


def test_short_trajectories_are_left_out() -> None:
    """A trajectory needs a second and 30 rows; the others stay as they are."""
    time, run = np.arange(300) * 0.01, np.repeat([3, 5, 7], [200, 90, 10])
    log = Recording("a.csv", time, run, {"command.arm": time}, {})
    kept, [finding] = sampling.lasting(log)
    assert set(kept.trajectory) == {3}
    assert np.array_equal(kept.columns["command.arm"], time[:200])
    assert "2 of 3 trajectories" in finding.text
    with pytest.raises(ValueError, match="no trajectory lasts 1 s"):
        sampling.lasting(log._replace(trajectory=np.arange(300) // 20))


def test_tied_joints_follow_their_polynomial() -> None:
    """Follower = 0.1 - leader, at rest and moving, where the engine holds it."""
    model = mujoco.MjModel.from_xml_string(PLAIN)
    qpos = put_down(model, np.array([0.2, 0.3]))
    assert np.allclose(qpos, [0.2, 0.3, -0.2])
    address, position = coupled(model, np.array([[0.0, 0.5, 9.0]]))
    assert np.array_equal(address, [2]) and np.allclose(position, [[-0.4]])
    place, speed = coupled_speed(model, qpos, np.array([1.0, 2.0, 9.0]))
    assert np.array_equal(place, [2]) and np.allclose(speed, [-2.0])


TIED = """
<mujoco>
  <worldbody>
    <body>
      <joint name="arm" axis="0 1 0" stiffness="0.8"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.4"/>
      <body pos="0.2 0 0">
        <joint name="level" axis="0 0.8 0.6"/>
        <geom type="box" pos="0.04 0 0.02" size="0.03 0.01 0.01" mass="0.2"/>
        <body pos="0.1 0 0">
          <joint name="hand" axis="0.6 0 0.8"/>
          <geom type="box" pos="0.05 0.02 0" size="0.03 0.01 0.01" mass="0.1"/>
          <body pos="0.05 0 0">
            <joint name="slide" type="slide" axis="0.8 0.6 0"/>
            <geom type="box" pos="0.01 0.02 0" size="0.01 0.01 0.01" mass="0.05"/>
          </body>
        </body>
        <body pos="0.1 0.02 0" gravcomp="0.5">
          <joint name="finger" axis="0 0 1"/>
          <geom type="box" pos="0.05 0.02 0" size="0.03 0.01 0.01" mass="0.1"/>
        </body>
      </body>
    </body>
  </worldbody>
  <equality>
    <joint joint1="level" joint2="arm" polycoef="0.1 -0.7 0 0 0"/>
    <joint joint1="finger" joint2="hand" polycoef="0.1 -1 0 0 0"/>
    <joint joint1="slide" joint2="hand" polycoef="0 0.04 0 0 0"/>
  </equality>
  <actuator>
    <position name="arm" joint="arm" kp="20" kv="1"/>
    <position name="hand" joint="hand" kp="4" kv="0.2"/>
  </actuator>
</mujoco>
"""


@pytest.mark.parametrize("flag", ["", '<option><flag gravity="disable"/></option>'])
def test_what_gravity_pulls_grows_as_inverse_dynamics_says(flag: str) -> None:
    """Of a heavier body, a moved one and another gravity; in a chain two are tied."""
    model = mujoco.MjModel.from_xml_string(TIED.replace("<world", f"{flag}<world", 1))
    tree = loads.Tree(model, model.actuator_trnid[:, 0])
    draw = np.random.default_rng(3)
    position = draw.uniform(-2.0, 2.0, (5, 2))
    moved = Motion(np.arange(5.0), position, *[0.0 * position] * 2)
    rows = np.arange(5)
    bodies, gravity = tree.turning(moved, rows)
    before = tree.slopes(moved, rows)

    def slope(other: mujoco.MjModel, size: float) -> np.ndarray:
        again = loads.Tree(other, model.actuator_trnid[:, 0])
        return (again.slopes(moved, rows) - before) / size

    for joint, body in enumerate(tree.body):
        heavy, size = loads.copied(model), 0.1 * model.body_subtreemass[body]
        heavy.body_mass[body] += size
        expected = [slope(heavy, size)]
        for axis in range(3):
            moved_on = loads.copied(model)
            moved_on.body_ipos[body, axis] += 1e-4
            expected.append(slope(moved_on, 1e-4))
        told = np.moveaxis(bodies[:, :, joint], -1, 0)
        np.testing.assert_allclose(told[:4], expected, atol=2e-4)
        assert not told[4].any()  # a spin weighs nothing
    seen = np.abs(bodies[:, :, 1, :4]).max(0).min()
    assert seen == 0.0 if flag else seen > 0.01
    for term in range(3):
        other = loads.copied(model)
        other.opt.gravity[term] += 1.0
        np.testing.assert_allclose(gravity[..., term], slope(other, 1.0), atol=2e-4)


def test_loads_of_changed_bodies_are_those_of_models_with_such_bodies() -> None:
    """Inverse dynamics of each; the arm and the hand move a tied joint each."""
    model, draw = mujoco.MjModel.from_xml_string(TIED), np.random.default_rng(4)
    tree, joints = loads.Tree(model, model.actuator_trnid[:, 0]), (17, 2)
    position = draw.uniform(-1.0, 1.0, joints)
    moved = Motion(np.arange(17.0), position, *draw.normal(size=(2, *joints)))
    others = [loads.perturbed(model, USUAL, draw) for _ in range(loads.TERMS)]
    weighed, few = loads.weigh(tree, moved, others), slice(None, None, loads.COARSE)

    def change(other: mujoco.MjModel) -> np.ndarray:
        load = loads.Tree(other, model.actuator_trnid[:, 0]).loads(moved)
        rest = load.rest - weighed.nominal.rest
        return np.stack([rest, load.inertia - weighed.nominal.inertia])[:, few]

    for k, other in enumerate(others):
        (rest, inertia), told = weighed.draws[..., k], change(other)
        close = 0.01 * float(np.abs(rest).max())  # tilt times change is left out
        np.testing.assert_allclose(rest, told[0], atol=close)
        np.testing.assert_allclose(inertia, told[1], atol=1e-9)
    for joint, body in enumerate(tree.body):
        heavy = loads.copied(model)
        heavy.body_mass[body] += 0.1
        found = 0.1 * weighed.bodies[::2, :, :, joint, 0]
        np.testing.assert_allclose(found, change(heavy), atol=1e-9)
    for axis in range(3):
        other = loads.copied(model)
        other.opt.gravity[axis] += 1.0
        found = weighed.gravity[::2, ..., axis]
        np.testing.assert_allclose(found, change(other), atol=1e-9)


def test_loads_of_bodies_and_gravity_reach_the_simulated_joints() -> None:
    """Each column, those of another joint's body and those of gravity among them."""
    robot = mujoco.MjModel.from_xml_string(TIED)
    time = 0.01 * np.arange(300)
    wave = np.stack([0.8 * np.sin(5.0 * time), 0.4 * np.sin(8.0 * time)], axis=1)
    run = JointRun(0, time, wave, wave)
    case = unfitted(held(robot, [run], 0), [run])
    arm, gravity = case.joints[0], loads.TERMS + len(loads.BODY_TERMS)
    (weighed,) = case.loads
    for joint, body in ((arm, 0), (case.carrying(arm, 1), 1)):
        for field, kind in (("rest", 0), ("slope", 1), ("inertia", 2)):
            series = np.asarray(getattr(joint.grid, f"{field}_terms"))[:, 0]
            of_body = weighed.bodies[kind, :, 0, body]
            expected = np.hstack([of_body, weighed.gravity[kind, :, 0]])
            assert series.shape[1] == gravity + len(loads.GRAVITY_TERMS)
            for seen, was in zip(series.T[loads.TERMS :], expected.T, strict=True):
                assert np.ptp(seen) == pytest.approx(np.ptp(was), rel=0.02, abs=1e-6)
                assert seen.max() == pytest.approx(was.max(), rel=0.02, abs=1e-6)
    pull = np.asarray(arm.grid.pull)
    assert np.ptp(pull) == pytest.approx(np.ptp(weighed.pull[:, 0]), rel=0.02)


def test_joints_of_one_motor_are_known_by_the_model() -> None:
    """A limit that the logs had to tell, and a joint that is drawn, do not count."""
    text = PLAIN.replace('kp="20" kv="1" forcerange="-6 6"', 'kp="4" kv="0.2"')
    text = text.replace('0.1" armature="0.004"', '0.05" armature="0.002"')
    for model, same in ((text, True), (PLAIN, False)):
        robot = mujoco.MjModel.from_xml_string(model)
        time = 0.01 * np.arange(300)
        wave = np.stack([0.3 * np.sin(5.0 * time), 0.1 * np.sin(8.0 * time)], axis=1)
        run = JointRun(0, time, wave, 0.9 * wave)
        base = held(robot, [run], 0)
        moved, weighed = base.weigh([], [])
        arm, left = build(robot, base.tree, ("arm", "left"), [run], moved, weighed)
        assert arm.nominal["limit"] != left.nominal["limit"]
        assert (arm.drawn(30.0).motor == left.motor) == same


@pytest.mark.parametrize(
    ("period", "step", "expected"),
    [(0.02, 0.005, 0.005), (0.005, 0.002, 0.005 / 3), (0.001, 0.002, 0.001),
     (0.012, 0.002, 0.002)],
)  # fmt: skip
def test_physics_steps_divide_the_period(
    period: float, step: float, expected: float
) -> None:
    """A control tick is a whole number of steps, none longer than asked for."""
    assert dividing(period, step) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("rate", [50.0, 250.0 / 3.0, 100.0, 240.0, 400.0, 1000.0])
def test_period_of_logs(rate: float) -> None:
    """A rate of whole Hz is found in spite of jitter; 83.3 Hz is the NAO's."""
    draw = np.random.default_rng(0)
    time = np.arange(400) / rate + draw.normal(scale=1e-3 / rate, size=400)
    run = JointRun(0, time, np.zeros((400, 1)), np.zeros((400, 1)))
    assert control_period([run]) == pytest.approx(1.0 / rate, rel=1e-9)


def test_period_of_logs_at_another_rate_does_not_run_away() -> None:
    """Rows that are late now and then, and a gap: the mean tick, not the median one."""
    draw = np.random.default_rng(0)
    tick = 1.0 / 62.5
    time = tick * np.arange(3000) + 2e-3 * draw.uniform(size=3000) ** 4
    run = JointRun(0, time, np.zeros((3000, 1)), np.zeros((3000, 1)))
    gap = run.part(np.r_[0:1000, 1050:3000])
    assert abs(control_period([run, gap]) - tick) * 3000 < 0.1 * tick
    odd = 1.0 / 60.3  # stamps in whole ms: 17 more often than 16
    run = run._replace(time=np.round(odd * np.arange(3000), 3))
    assert abs(control_period([run]) - odd) * 3000 < 0.1 * odd


@pytest.mark.parametrize("rate", [49.5, 98.5, 50.1])
def test_a_rate_near_a_usual_one_is_not_that(rate: float) -> None:
    """Its last row would come ticks off."""
    run = JointRun(0, np.arange(600) / rate, np.zeros((600, 1)), np.zeros((600, 1)))
    assert control_period([run]) == pytest.approx(1.0 / rate, rel=1e-9)


def test_files_of_nearly_one_rate(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Half a second ahead would be 15 ms off."""
    (tmp_path / "robot.xml").write_text(PLAIN)
    logged(mujoco.MjModel.from_xml_string(PLAIN), tmp_path / "a.parquet", 1, 6.0)
    table = parquet.read_table(tmp_path / "a.parquet")
    time = pa.array(1.03 * table["time"].to_numpy())
    parquet.write_table(table.set_column(0, "time", time), tmp_path / "b.parquet")
    command = ["diagnose", "--model", str(tmp_path / "robot.xml"), "--data"]
    files = [str(tmp_path / "a.parquet"), "--held-out", str(tmp_path / "b.parquet")]
    assert main([*command, *files, "--out", str(tmp_path / "o")]) != 0
    assert "diagnose files of one rate together" in capsys.readouterr().err


def test_of_a_tie_who_is_driven_leads_whoever_is_written_first() -> None:
    """right - 0 = 0.1 - left, said the other way round."""
    line = 'joint1="left" joint2="right" polycoef="0.1 -1 0 0 0"'
    other = PLAIN.replace('joint1="right" joint2="left" polycoef="0.1 -1 0 0 0"', line)
    models = [mujoco.MjModel.from_xml_string(text) for text in (PLAIN, other)]
    for followers, leaders, lines in map(ties, models):
        assert (followers.tolist(), leaders.tolist()) == ([2], [1])
        np.testing.assert_allclose(lines, [[0.1, -1.0, 0.0, 0.0, 0.0]])
    time = 0.01 * np.arange(50)
    angle = np.stack([np.sin(time), 0.3 * time], 1)
    motion = Motion(time, angle, np.gradient(angle, 0.01, axis=0), 0.0 * angle)
    trees = [loads.Tree(model, model.actuator_trnid[:, 0]) for model in models]
    for part in ("rest", "inertia"):
        one, two = (getattr(tree.loads(motion), part) for tree in trees)
        np.testing.assert_allclose(one, two, rtol=0, atol=1e-12)
    both = [put_down(model, np.array([0.2, 0.3])) for model in models]
    np.testing.assert_allclose(both[0], [0.2, 0.3, -0.2], atol=1e-12)
    np.testing.assert_allclose(both[1], both[0], atol=1e-12)


CHAIN = """<mujoco><compiler angle="radian"/><worldbody>
<body name="a"><joint name="first" axis="0 1 0"/><geom size="0.05"/>
<body name="b" pos="0 0 -0.2"><joint name="second" axis="0 1 0"/><geom size="0.04"/>
<body name="c" pos="0 0 -0.2"><joint name="third" axis="0 1 0"/><geom size="0.03"/>
</body></body></body></worldbody><equality>{}</equality>
<actuator><position name="first" joint="first" kp="20" kv="1"/></actuator></mujoco>"""
SECOND = '<joint joint1="second" joint2="first" polycoef="0.1 2 0 0 0"/>'
BACK = '<joint joint1="first" joint2="second" polycoef="-0.05 0.5 0 0 0"/>'
THIRD = '<joint joint1="third" joint2="second" polycoef="0.3 -1 0 0 0"/>'


@pytest.mark.parametrize("equality", [SECOND + THIRD, THIRD + SECOND, BACK + THIRD])
def test_a_chain_of_ties_is_led_by_the_joint_that_is_driven(equality: str) -> None:
    """third = 0.3 - second = 0.2 - 2 first."""
    model = mujoco.MjModel.from_xml_string(CHAIN.format(equality))
    followers, leaders, lines = ties(model)
    told = sorted(
        zip(followers.tolist(), leaders.tolist(), lines.tolist(), strict=True)
    )
    assert [(one, other) for one, other, _ in told] == [(1, 0), (2, 0)]
    np.testing.assert_allclose(told[0][2], [0.1, 2.0, 0.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(told[1][2], [0.2, -2.0, 0.0, 0.0, 0.0], atol=1e-12)
    tree = loads.Tree(model, model.actuator_trnid[:, 0])
    np.testing.assert_allclose(tree.moves[:, 0], [1.0, 2.0, -2.0], atol=1e-12)
    assert not list(cautions(model))


def test_a_tie_to_a_joint_that_nothing_drives_is_told() -> None:
    model = mujoco.MjModel.from_xml_string(CHAIN.format(THIRD))
    assert any("second, third is not driven" in line for line in cautions(model))


def test_the_encoder_of_a_tied_joint_is_not_needed(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    (tmp_path / "robot.xml").write_text(PLAIN)
    logged(mujoco.MjModel.from_xml_string(PLAIN), tmp_path / "a.parquet", 1, 6.0)
    table = parquet.read_table(tmp_path / "a.parquet")
    name = "position.right"
    assert name not in table.column_names
    right = pa.array(0.1 - table["position.left"].to_numpy())
    parquet.write_table(table.append_column(name, right), tmp_path / "a.parquet")
    command = ["diagnose", "--model", str(tmp_path / "robot.xml"), "--data"]
    out = tmp_path / "o"
    assert main([*command, str(tmp_path / "a.parquet"), "--out", str(out)]) == 0
    told = json.loads((out / "diagnosis.json").read_text())
    assert told["verdict"] == "none"
    assert any("position.right not used" in row["text"] for row in told["data_checks"])


def test_a_joint_that_stays_where_the_model_says_is_no_error(tmp_path: Path) -> None:
    """A balanced pan that is told 0 and reads 0 throughout."""
    pan = PLAIN.replace('gravcomp="1"', "").replace("0 0.02 0", "0.2 0 0")
    model = mujoco.MjModel.from_xml_string(pan)
    (tmp_path / "robot.xml").write_text(pan)
    logged(model, tmp_path / "fit.parquet", 1, 6.0)
    table = parquet.read_table(tmp_path / "fit.parquet")
    still = pa.array(np.zeros(len(table)))
    for name in ("command.left", "position.left"):
        table = table.set_column(table.column_names.index(name), name, still)
    parquet.write_table(table, tmp_path / "fit.parquet")
    command = ["diagnose", "--model", str(tmp_path / "robot.xml"), "--data"]
    out = tmp_path / "out"
    assert (
        main([*command, str(tmp_path / "fit.parquet"), "--out", str(out), "--debug"])
        == 0
    )
    text = (out / "diagnosis.json").read_text()
    assert "NaN" not in text
    told = {joint["name"]: joint for joint in json.loads(text)["joints"]}
    assert told["left"]["beyond_tolerance"] == 0.0


def test_teeth_are_those_of_the_simulation() -> None:
    strong = PLAIN.replace('forcerange="-6 6"', 'forcerange="-90 90"')
    model = mujoco.MjModel.from_xml_string(strong)
    model.actuator_forcerange[1] = -np.inf, np.inf
    tree = loads.Tree(model, model.actuator_trnid[:, 0])
    limited, free = (nominal_drive(model, tree, k)["stiffness"] for k in (0, 1))
    assert limited == pytest.approx(90.0 / TEETH)
    assert free == pytest.approx(1e5)
