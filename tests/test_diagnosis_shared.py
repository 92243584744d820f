"""One value at several joints: what all commands have in common is one cause."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gatjax.data.recording import Recording
from gatjax.diagnosis.diagnose import diagnose
from gatjax.diagnosis.given import Logs
from gatjax.diagnosis.start import Start
from gatjax.loop import Simulator
from gatjax.sim.world import add_causes, nominal
from gatjax.task import Task

HEAD = """<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.0005" integrator="implicitfast"/>
  <default><geom contype="0" conaffinity="0" density="0"/></default>
  <worldbody><body pos="0 0 1">
    <joint name="turn" axis="0 0 1" armature="0.007" damping="0.25"
      frictionloss="0.04"/>
    <inertial pos="0 0 0.03" mass="0.2" diaginertia="2e-4 2e-4 1e-4"/>
    <body pos="0 0 0.06">
      <joint name="nod" axis="0 1 0" armature="0.006" damping="0.2"
        frictionloss="0.03"/>
      <inertial pos="0.05 0 0.02" mass="0.4" diaginertia="4e-4 6e-4 5e-4"/>
    </body>
  </body></worldbody>
  <actuator>
    <position joint="turn" kp="8" kv="0.1" forcerange="-1.4 1.4"/>
    <position joint="nod" kp="8" kv="0.1" forcerange="-1.4 1.4"/>
  </actuator></mujoco>"""
PERIOD = 0.01
WORN = (  # within what is usual of numbers of a model
    ("gain_error", ["turn"], 1.07), ("gain_error", ["nod"], 0.94),
    ("coulomb_friction", ["turn"], 0.01), ("viscous_friction", ["nod"], 0.02),
)  # fmt: skip


def tosses(seed: int) -> np.ndarray:
    """Targets [N, 2] rad: sines, then jumps and rests."""
    time, rng = PERIOD * np.arange(600), np.random.default_rng(seed)
    sines = sum(
        0.3 / k * np.sin(2.0 * np.pi * 0.4 * k * time[:, None] + rng.uniform(0, 6, 2))
        for k in (1, 2, 3)
    )
    jumps = np.repeat(rng.uniform(-0.6, 0.6, (10, 2)), 50, axis=0)
    return np.concatenate([sines - sines[:1], jumps])


def test_a_head_of_two_joints_has_one_delay(tmp_path: Path) -> None:
    file = tmp_path / "head.xml"
    file.write_text(HEAD)
    rows = [*WORN, ("command_delay", ["all"], 0.042)]
    world = add_causes(nominal(Task(control_period=PERIOD), file), rows)
    command = tosses(3)
    angle = Simulator(world).play(command[None], 1.0 / PERIOD, [0]).reading.angle[0]
    angle = np.asarray(angle) + 6e-4 * np.random.default_rng(4).normal(size=angle.shape)
    columns = {}
    for k, joint in enumerate(("turn", "nod")):
        columns |= {f"command.{joint}": command[:, k], f"position.{joint}": angle[:, k]}
    time, runs = PERIOD * np.arange(len(command)), np.zeros(len(command), int)
    log = Recording("log", time, runs, columns, {"base": "fixed"})
    found = diagnose(
        Start(str(file)), Logs([log], []), tmp_path / "out", 0, lambda *told: None
    )
    (cause,) = found["causes"]
    assert cause["where"] == ["all"]
    assert {cause["cause"], *cause["equivalent"]} >= {"command_delay"}
    assert cause["parameters"]["delay"]["value"] == pytest.approx(0.042, abs=0.002)
