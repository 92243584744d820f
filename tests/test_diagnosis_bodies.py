"""A body whose weight is wrong moves all joints: its size comes of all of them."""

import mujoco
import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis.case import held, prepare, settled
from gatjax.diagnosis.judge import Judge

SCARA = """
<mujoco><compiler autolimits="true"/><option timestep="{step}"/><worldbody>
<body><joint name="one" axis="0 0 1" armature="0.05" damping="1.2" frictionloss="0.3"/>
  <inertial pos="0.15 0 0" mass="3" diaginertia="0.01 0.03 0.03"/>
<body pos="0.3 0 0">
  <joint name="two" axis="0 0 1" armature="0.02" damping="0.5" frictionloss="0.15"/>
  <inertial pos="0.1 0 0" mass="1.5" diaginertia="0.003 0.01 0.01"/>
<body pos="0.25 0 0">
  <joint name="tool" axis="0 0 -1" armature="1e-3" damping="0.02" frictionloss="0.01"/>
  <inertial pos="0.02 0 -0.05" mass="{mass}" diaginertia="3e-4 3e-4 2e-4"/></body>
</body></body></worldbody><actuator>
<position joint="one" kp="200" kv="6" forcerange="-30 30"/>
<position joint="two" kp="90" kv="2.5" forcerange="-15 15"/>
<position joint="tool" kp="4" kv="0.06" forcerange="-1.5 1.5"/></actuator></mujoco>"""
OWN, PAYLOAD = 0.3, 0.6  # kg
PERIOD, FINE = 0.01, 2.5e-4  # s


def log():
    """14 s of quick moves, as a heavier robot does them; the readings have noise."""
    draw = np.random.default_rng(20)
    robot = mujoco.MjModel.from_xml_string(SCARA.format(step=FINE, mass=OWN + PAYLOAD))
    data = mujoco.MjData(robot)
    time, command = PERIOD * np.arange(1400), np.zeros((1400, 3))
    for joint, size in enumerate([0.9, 1.0, 1.5]):
        at, told = 0.5, 0.0
        while at < time[-1]:
            lasts, aim = draw.uniform(0.2, 0.55), size * draw.uniform(-1.0, 1.0)
            share = np.clip((time - at) / lasts, 0.0, 1.0)
            smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
            command[:, joint] += (aim - told) * smooth
            at, told = at + lasts + draw.uniform(0.4, 1.5), aim
    angle = np.zeros_like(command)
    for row, target in enumerate(command):
        angle[row] = data.qpos
        data.ctrl[:] = target
        mujoco.mj_step(robot, data, round(PERIOD / FINE))
    return JointRun(0, time, command, angle + 5e-4 * draw.normal(size=angle.shape))


def test_a_payload_that_jerks_all_joints_has_the_size_that_they_agree_on():
    model, runs = (
        mujoco.MjModel.from_xml_string(SCARA.format(step=1e-3, mass=OWN)),
        log(),
    )
    silent = lambda stage, share: None  # noqa: E731
    case = settled(prepare(held(model, [runs], 0), [runs], silent), silent)
    judge = Judge(case, silent)
    law, every = ("payload", "at the centre of mass"), judge.claims()
    claim = next(c for c in every if (c.hypothesis.law, c.where) == (law, (2,)))
    claim = judge.accept(claim)
    values = claim.hypothesis.values(judge.joints[2], claim.own)
    assert abs(values["mass"] - PAYLOAD) < 0.15 * PAYLOAD  # 0.36 kg without `_sized`
