"""A cause means the same to the diagnosis and to the World: one joint in both.

The World plays a cause and logs it; the diagnosis reads the log as if it were measured,
weighs the arm along it and simulates the joint with the hypothesis's numbers, which
become the World's by `extend.world_values`. Both start at rest.
What is left between them is a share of what the cause does: servos and friction are
stepped at 1 ms in the diagnosis, and at 0.5 ms in MuJoCo.
"""

import types

import jax
import numpy as np
import pytest

import gatjax.surrogate.hidden
from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import drops, extend, joint, loads, motion
from gatjax.diagnosis.bank import CAUSES
from gatjax.diagnosis.hypotheses import COUNT, tolerated
from gatjax.robot.model import joint_names
from gatjax.sim.replay import replay_many
from gatjax.sim.world import add_cause, nominal, stacked
from gatjax.task import Task

PERIOD, ROWS = 0.01, 400
TIME = PERIOD * np.arange(ROWS)
FAST = np.sin(2.0 * np.pi * (0.4 + 0.15 * TIME) * TIME)
COMMAND = 0.4 * FAST + 0.5 * (TIME > 1.0) - 0.7 * (TIME > 2.5)
NAMES = {f"{each.cause} {each.variant}".strip(): each for each in CAUSES}
OWN = {  # coordinates that are not the middle one of the bank's starts
    "torque_ripple": (0.1, 0.05, np.log(12.0)),
    "com_shift": (0.0, 0.008, -0.006),
    "gravity_tilt": (0.1, 0.0),
    "clock_drift": (0.01,),
    "thermal_derating": (-1.0, 3.0),
    "supply_sag": (np.log(0.4),),
    "command_quantization": (np.log(0.08),),
    "stiction": (np.log(0.3), np.log(0.2)),
    "asymmetric_friction": (-0.1,),
}


@pytest.fixture(scope="module")
def world():
    folder = gatjax.surrogate.hidden.__path__[0]
    return nominal(Task(control_period=PERIOD), f"{folder}/arm_servo.xml", 0.0005)


def logged(world):
    """What the World's encoder says of COMMAND, [N] rad, begun at rest."""
    state = np.zeros(1), np.zeros(1)
    played = replay_many(world, stacked([world.values]), COMMAND[:, None], *state)
    return played.reading.angle[0, :, 0]


def built(world, angle):
    """The joint that the diagnosis makes of a log."""
    run = JointRun(0, TIME, COMMAND[:, None], angle[:, None])
    tree = loads.Tree(world.model, world.model.actuator_trnid[:, 0])
    fine = motion.grid_time([run], joint.STEP)[:: motion.FINE]
    moved = [motion.smoothed(run, run.angle, fine)]
    draw = np.random.default_rng(0)
    others = [loads.perturbed(world.model, draw) for _ in range(loads.TERMS)]
    weighed = [loads.weigh(tree, moved[0], others)]
    names = joint_names(world.model)
    return joint.build(world.model, tree, names, [run], moved, weighed)[0]


def simulated(ready, hypothesis, own):
    """Readings [N] rad of the diagnosis's joint, tolerances and transport at zero."""
    drive = tolerated(ready, np.zeros(COUNT)) | {"delay": 0.0, "stiction": 0.0}
    if hypothesis is not None:
        hypothesis.put(drive, ready, np.array(own))
    geared = hypothesis is not None and hypothesis.geared
    with jax.numpy_rank_promotion("allow"):  # the diagnosis broadcasts [R, S] by [S]
        return ready.simulate([drive], geared)[0, :, 0]


@pytest.fixture(scope="module")
def plain(world):
    """The log of the nominal world, its joint, and what the diagnosis makes of it."""
    angle = logged(world)
    ready = built(world, angle)
    return angle, ready, simulated(ready, None, ())


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def test_the_nominal_joint_moves_the_same(plain):
    angle, _, ours = plain
    assert rms(ours - angle) < 1e-3
