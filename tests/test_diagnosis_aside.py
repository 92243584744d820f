"""Pieces of a log that no cause explains do not count, and the user is told."""

import mujoco
import numpy as np
import pytest

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import result
from gatjax.diagnosis.case import held, left_aside, prepare
from gatjax.diagnosis.drops import with_commands
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.verdict import conclude

ARM = """
<mujoco>
  <option timestep="0.0005"/>
  <worldbody><body>
    <joint name="arm" axis="0 1 0" damping="0.1" armature="0.004"/>
    <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.4"/>
  </body></worldbody>
  <actuator><position joint="arm" kp="20" kv="1" forcerange="-6 6"/></actuator>
</mujoco>
"""
PIECES, PERIOD = 8, 0.01


def piece(model: mujoco.MjModel, number: int) -> JointRun:
    """3 s of an arm with a first second at rest, all of them different."""
    data, draw = mujoco.MjData(model), np.random.default_rng(number)
    time = PERIOD * np.arange(300)
    tones = draw.uniform(0.4, 1.6, 3)
    wave = 0.15 * np.sin(2.0 * np.pi * tones[:, None] * time).sum(0)
    command, angle = wave * np.minimum(time, 1.0), np.empty(len(time))
    mujoco.mj_step(model, data, 4000)
    for tick in range(len(time)):
        angle[tick] = data.qpos[0] + draw.normal(scale=5e-4)
        data.ctrl[:] = command[tick]
        mujoco.mj_step(model, data, round(PERIOD / model.opt.timestep))
    return JointRun(number, time, command[:, None], angle[:, None], within=True)


@pytest.fixture(scope="module")
def runs():
    """Of a robot whose gain is 11, not 20 N m/rad; in one piece it does nonsense."""
    robot = mujoco.MjModel.from_xml_string(ARM)
    robot.actuator_gainprm[0, 0], robot.actuator_biasprm[0, 1] = 11.0, -11.0
    every = [piece(robot, number) for number in range(PIECES)]
    odd = every[3]
    hung = odd.angle + 0.3 * np.sin(40.0 * odd.time)[:, None]
    return [*every[:3], odd._replace(angle=hung), *every[4:]]


def test_a_piece_waits_where_it_was_measured(runs):
    """So does the world that plays it; a command in force there moves it later."""
    model = mujoco.MjModel.from_xml_string(ARM)
    late = runs[0]._replace(command=runs[0].command + 0.3)
    (joint,) = prepare(held(model, [late], 0), [late], lambda *_: None).joints
    lost = with_commands(joint, [late.command[:, 0]], [np.zeros(len(late.time))])
    for target in (joint.grid.target[:, 0], lost.grid.target[:, 0]):
        assert joint.lead > 1
        np.testing.assert_allclose(target[: joint.lead], late.angle[0, 0], atol=1e-6)
        assert target[joint.lead + 1] == pytest.approx(late.command[0, 0], abs=1e-3)


def judged(runs):
    """A judge of pieces."""
    model = mujoco.MjModel.from_xml_string(ARM)
    return Judge(prepare(held(model, runs, 0), runs, lambda *_: None), lambda *_: None)


def test_a_piece_that_nothing_explains_is_left_aside(runs):
    verdict = conclude(judged(runs))
    assert verdict.judge.case.aside == {0: (3,)}
    [cause] = verdict.causes
    assert cause.claim.hypothesis.cause == "gain_error"
    size = result.cause_row(verdict, cause, 0)["parameters"]["scale"]["value"]
    assert size == pytest.approx(0.55, rel=0.1)
    logs = [f"logs/{number}.csv" for number in range(PIECES)]
    numbered = [run._replace(trajectory=10 + run.trajectory) for run in runs]
    said = result.told(verdict, logs, numbered, [{} for _ in runs], 0)
    (row,) = said["left_aside"]
    assert (row["joint"], row["log"]) == ("arm", "logs/3.csv")
    assert (row["from"], row["to"]) == pytest.approx((0.0, 3.0), abs=0.02)
    words = "at arm nothing explains 1 of 8 pieces, left aside: 0 to 3 s of "
    assert words + "trajectory 13 of 3.csv." in said["sentence"]


@pytest.mark.parametrize(("within", "strays"), [(True, (3,)), (False, ())])
def test_of_logs_that_are_whole_everything_counts(runs, within, strays):
    judge = judged([run._replace(within=within) for run in runs])
    assert judge.strays(0, judge.known[0]) == strays


def test_what_is_left_aside_stays_so(runs):
    judge = judged(runs)
    case = left_aside(left_aside(judge.case, {0: (1,)}), {0: (3, 5)})
    assert case.aside == {0: (3, 5)}
    counts = case.joints[0].valid.sum(1)
    assert list(np.flatnonzero(counts == 0)) == [3, 5]
    assert judge.case.joints[0].valid.sum(1).min() > 0


def test_many_pieces_that_nothing_explains_are_a_misfit(runs):
    swung = 0.3 * np.sin(40.0 * runs[0].time)[:, None]
    judge = judged(
        [run._replace(angle=run.angle + swung) for run in runs[:3]] + runs[4:]
    )
    assert judge.strays(0, judge.known[0]) == ()
