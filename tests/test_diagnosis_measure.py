"""Predictions that start from a measured state."""

import numpy as np
import pytest

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import measure
from gatjax.sim.world import add_cause, nominal
from gatjax.task import Task

MODEL = """
<mujoco><option timestep="0.002"/><worldbody><body><joint name="a" axis="0 1 0"
  armature="0.01" damping="0.4"/><geom size="0.05" pos="0 0 -0.15" mass="0.5"/></body>
</worldbody><actuator><position joint="a" kp="20" kv="0.2"/></actuator></mujoco>"""
PERIOD = 0.01
TIME = PERIOD * np.arange(300)
COMMAND = 0.6 * np.sin(5.0 * TIME)[:, None]


@pytest.mark.parametrize("loop", [0.0, 1.0])
def test_a_joint_starts_where_its_encoder_says_what_was_measured(tmp_path, loop):
    path = tmp_path / "arm.xml"
    path.write_text(MODEL)
    plain = nominal(Task(control_period=PERIOD), path)
    askew = add_cause(plain, "encoder_offset", ["a"], {"offset": 0.1, "in_loop": loop})
    askew = add_cause(askew, "encoder_scale", ["a"], {"scale": 0.8, "in_loop": loop})
    run = JointRun(0, TIME, COMMAND, 0.0 * COMMAND)
    run = run._replace(angle=measure.whole_log(askew, [run])[0])
    cut = measure.windows([run], PERIOD)
    assert cut is not None
    played = measure.windowed(askew, cut, PERIOD)
    for horizon in measure.HORIZONS:
        error = measure.window_errors(cut, played, horizon, PERIOD).rmse()
        assert error < 2e-3
