"""Logs that a simulator wrote, without noise: the model that made them is right."""

import json

import mujoco
import numpy as np
import pytest

from gatjax.cli import main
from gatjax.data.recording import Recording
from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import measure, noise
from gatjax.diagnosis.given import Logs, ahead_of, given
from gatjax.diagnosis.simulated import as_close
from gatjax.diagnosis.start import Start
from gatjax.diagnosis.tolerances import USUAL

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


def resting(time):
    """A sine that comes to rest, rad."""
    late = np.maximum(time - 4.0, 0.0)
    return np.sin(3.0 * np.minimum(time, 4.0)) * np.exp(-6.0 * late)


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
    angle = resting(time)
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


def test_a_model_that_falls_apart_in_its_own_steps_tells_nothing(tmp_path):
    """A light, stiff joint: shorter steps, as the diagnosis takes them, are sound."""
    servo = 'kp="1e6" kv="1e4"'
    text = ARM.format(option='timestep="0.02"', servo="", friction=0.0)
    text = text.replace('kp="8"', servo).replace('kp="5"', servo)
    path = tmp_path / "arm.xml"
    path.write_text(text)
    time = PERIOD * np.arange(400)
    command = np.repeat(resting(time)[:, None], 2, axis=1)
    columns = {
        f"{kind}.{name}": command[:, k]
        for kind in ("command", "position")
        for k, name in enumerate(("a", "b"))
    }
    log = Recording("log", time, np.zeros(400, int), columns, {})
    data = given(Start(str(path)), Logs([log], []), 0)
    assert noise.exact(data.logs).all()
    (coarse,) = measure.replayed(data.start.world(data.period), data.logs)
    assert np.abs(coarse.angle - command).max() > 0.1
    told = as_close(data, USUAL)
    assert [told.close(name) for name in ("a", "b")] == [0.0, 0.0]
    assert told.lasts("a") == USUAL.lasts("a")
