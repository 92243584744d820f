"""Limbs of standing robots that touch nothing show by themselves what is wrong."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from test_diagnosis_floor import (
    NAMES,
    PERIOD,
    XML,
    commands,
    logged,
    quadruped,
    recorded,
    silent,
)

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import assembly
from gatjax.diagnosis.diagnose import diagnose
from gatjax.diagnosis.floor import standing
from gatjax.diagnosis.floor.limbs import free
from gatjax.diagnosis.floor.observed import observe
from gatjax.diagnosis.given import Logs
from gatjax.diagnosis.hypotheses import COUNT, numbers
from gatjax.diagnosis.loads import Tree
from gatjax.diagnosis.start import Start


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(XML)


def test_a_limb_is_free_that_touches_nothing(
    model: mujoco.MjModel, tmp_path: Path
) -> None:
    """Nor a wall, in any log; legs all bear."""
    time, command = commands()
    run = JointRun(0, time, command, command)
    assert free(Tree(model, model.actuator_trnid[:, 0]), [run]) == {0}
    wall = '<geom type="box" pos="0.12 0 0.3" size="0.02 0.1 0.1" contype="1"/>'
    head = '<geom type="capsule" fromto="0 0 0 0 0 0.08" size="0.03" mass="0.4"'
    xml = XML.replace('<body name="torso"', wall + '<body name="torso"')
    xml = xml.replace(head, head + ' conaffinity="1"')
    assert xml.count('conaffinity="1"') == XML.count('conaffinity="1"') + 1
    near = mujoco.MjModel.from_xml_string(xml)
    tree = Tree(near, near.actuator_trnid[:, 0])
    deep = command + 4.0 * command[:, :1] * (np.arange(5) == 0)
    assert free(tree, [run]) == {0}
    assert free(tree, [run, JointRun(1, time, deep, deep)]) == frozenset()
    dog = quadruped(tmp_path / "quad.xml", 'type="plane" size="5 5 .1"')
    still = JointRun(0, time, np.zeros((len(time), 4)), np.zeros((len(time), 4)))
    assert free(Tree(dog, dog.actuator_trnid[:, 0]), [still]) == frozenset()


def test_a_free_limb_is_no_channel_of_the_whole(model: mujoco.MjModel) -> None:
    run, channels = logged(model)
    robot = standing.prepare(model, [run], [channels], PERIOD, silent)
    names = observe(robot).names
    assert "Neck" not in names and {"LHip", "RAnkle", "gyro.x"} <= set(names)


def test_a_free_limb_moves_as_measured(model: mujoco.MjModel) -> None:
    """Its loads are those of its measured motion, on the simulated base."""
    run, channels = logged(model, "gain_error", "Neck", {"scale": 0.3})
    robot = standing.prepare(model, [run], [channels], PERIOD, silent)
    (motion,), (load,) = robot.weigh([], [])
    plain = robot._replace(free=frozenset())
    (simulated,), (other,) = plain.weigh([], [])
    stamps = run.time - run.time[0]
    path, told = (
        np.interp(stamps, each.time, each.position[:, 0])
        for each in (motion, simulated)
    )
    assert np.sqrt(np.mean(np.square(path - run.angle[:, 0]))) < 2e-3
    assert np.sqrt(np.mean(np.square(told - run.angle[:, 0]))) > 4e-3
    assert motion.position[:, 1:] == pytest.approx(simulated.position[:, 1:])
    assert load.nominal.rest[:, 1:] == pytest.approx(other.nominal.rest[:, 1:])
    joint = assembly.build(model, robot.tree, NAMES, [run], [motion], [load])[0]
    for scale, least, most in ((1.0, 4e-3, 1.0), (0.3, 0.0, 1e-3)):
        drive = numbers(joint, None, np.zeros(COUNT))
        drive["kp"] *= scale
        left = joint.simulate([drive], False)[0, joint.valid[0], 0] - run.angle[:, 0]
        assert least < np.sqrt(np.mean(np.square(left))) < most


def test_a_fault_of_a_free_limb_is_named_beside_another(
    model: mujoco.MjModel, tmp_path: Path
) -> None:
    (tmp_path / "robot.xml").write_text(XML)
    run, channels = logged(
        model, "coulomb_friction", "Neck", {"torque": 0.1}, askew=(0.045, 0.04, 0.0)
    )
    log = recorded(run, channels)
    start = Start(str(tmp_path / "robot.xml"))
    found = diagnose(start, Logs([log], [log]), tmp_path / "out", 0, silent)
    causes = {row["cause"]: row for row in found["causes"]}
    assert causes.keys() == {"imu_misalignment", "coulomb_friction"}
    friction = causes["coulomb_friction"]
    assert friction["where"] == ["Neck"] and found["verdict"] == "named"
    torque = friction["parameters"]["torque"]
    assert torque["value"] == pytest.approx(0.1, rel=0.2)
    assert torque["low"] < 0.1 < torque["high"]
    assert found["gain"]["after"] < 0.5 * found["gain"]["before"]
