"""Logs that a simulator wrote, without noise: the model that made them is right."""

import json

import mujoco
import numpy as np
import pytest

from gatjax.cli import main
from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import noise
from gatjax.diagnosis.given import ahead_of

ARM = """
<mujoco><compiler angle="radian"/><option {option}/><default>
  <joint axis="0 1 0" range="-1.5 1.5"/><geom type="capsule" size="0.02"/>
  <position ctrlrange="-1.5 1.5" {servo}/></default>
<worldbody><body><joint name="a" damping="0.1" armature="0.01"/>
  <geom fromto="0 0 0 0.2 0 0" mass="0.2"/><body pos="0.2 0 0">
  <joint name="b" damping="0.05" armature="0.005" frictionloss="{friction}"/>
  <geom fromto="0 0 0 0.15 0 0" mass="0.1"/></body></body></worldbody>
<actuator><position name="a" joint="a" kp="8"/><position name="b" joint="b" kp="5"/>
</actuator></mujoco>"""
PERIOD = 0.02


def collected(folder, motion, seed, **causes):
    """Record a motion of the simulated arm."""
    effects = [
        {"cause": name, "where": where, "values": values}
        for name, (where, values) in causes.items()
    ]
    world, file = folder / "world.json", folder / f"{motion}.parquet"
    text = {"schema": "gatjax.world/1", "model": "arm.xml", "effects": effects}
    world.write_text(json.dumps(text))
    asked = ["collect", "--motion", motion, "--robot", "simulator", "--runs", "1"]
    asked += ["--world", str(world), "--seed", str(seed), "--out", str(file)]
    assert main(asked) == 0
    return str(file)


def diagnosed(folder, motions, seed, **causes):
    fit, held = (
        collected(folder, motion, seed + k, **causes)
        for k, motion in enumerate(motions)
    )
    command = ["diagnose", "--model", str(folder / "arm.xml"), "--data", fit]
    command += ["--held-out", held, "--out", str(folder / "out")]
    assert main(command) == 0
    return json.loads((folder / "out" / "diagnosis.json").read_text())


@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    ("option", "servo", "friction", "motions"),
    [  # a lively arm ahead of time, and friction that a coarse step lets creep
        ('timestep="0.002"', "", 0.0, ("rich", "multisine")),
        ('timestep="0.004"', 'kv="0.2" forcerange="-2 2"', 0.05,
         ("slow_reversals", "rich")),
    ],
)  # fmt: skip
def test_a_simulation_agrees_with_its_own_logs(
    tmp_path, option, servo, friction, motions
):
    text = ARM.format(option=option, servo=servo, friction=friction)
    (tmp_path / "arm.xml").write_text(text)
    found = diagnosed(tmp_path, motions, 31)
    assert found["verdict"] == "none" and not found["unexplained"]["significant"]
    assert found["made_by"]["tolerances"] == "usual"


@pytest.mark.timeout(300)
def test_a_cause_in_such_logs_is_named(tmp_path):
    text = ARM.format(option='timestep="0.002"', servo='kv="0.2"', friction=0.0)
    (tmp_path / "arm.xml").write_text(text)
    gap = (["a"], {"half_width": 0.02})
    found = diagnosed(tmp_path, ("rich", "multisine"), 41, dead_band=gap)
    assert found["verdict"] == "named"
    [cause] = found["causes"]
    assert (cause["cause"], cause["where"]) == ("dead_band", ["a"])
    assert cause["parameters"]["half_width"]["value"] == pytest.approx(0.02, rel=0.1)


def test_readings_are_exact_without_noise_and_steps():
    time = PERIOD * np.arange(400)
    angle = np.where(time < 4.0, np.sin(3.0 * time), np.sin(12.0))  # and comes to rest
    angle += 0.1 * np.exp(-6.0 * np.maximum(time - 4.0, 0.0)) * (time >= 4.0)
    noisy = angle + np.random.default_rng(0).normal(0.0, 1e-4, len(time))
    stepped = 1e-4 * np.round(angle / 1e-4)
    rounded = np.round(angle, 6)
    columns = np.stack([angle, noisy, stepped, rounded], axis=1)
    runs = [JointRun(0, time, columns, columns)]
    assert noise.exact(runs).tolist() == [True, False, False, True]
    again = runs[0]._replace(angle=noisy[:, None] + 0.0 * columns)
    assert not noise.exact([*runs, again]).any()


@pytest.mark.parametrize(
    ("option", "seconds"),
    [("", 0.001), ('timestep="0.004" integrator="implicitfast"', 0.002),
     ('timestep="0.004" integrator="RK4"', 0.0)],
)  # fmt: skip
def test_a_simulation_is_half_a_step_ahead_of_time(option, seconds):
    """A mass at rest that is pushed evenly moves by t (t + h) / 2, not t^2 / 2."""
    text = f"""<mujoco><option {option} gravity="0 0 0"/><worldbody><body>
      <joint name="a" axis="0 1 0"/><geom size="0.1" mass="1"/></body></worldbody>
      <actuator><motor joint="a"/></actuator></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    assert ahead_of(model) == pytest.approx(seconds)
    data = mujoco.MjData(model)
    data.ctrl[0] = 1.0
    while data.time < 0.4:
        mujoco.mj_step(model, data)
    ahead = data.qpos[0] / data.qvel[0] - 0.5 * data.time
    assert ahead == pytest.approx(seconds, abs=1e-6)
