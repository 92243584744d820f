"""Faults of a joint that is told torques or voltages, from an integrator of its own."""

import json
from pathlib import Path

import numpy as np
import pytest

from gatjax.cli import main
from gatjax.data.recording import Recording, write_recording

MODEL = """
<mujoco><option timestep="0.002"/><worldbody><body>
<joint name="arm" axis="0 1 0" damping="0.03" frictionloss="0.08" armature="0.01"/>
<inertial pos="0 0 -0.3" mass="0.6" diaginertia="0.002 0.002 0.0002"/></body>
</worldbody><actuator><general name="arm" joint="arm" gainprm="{gain}"
 biasprm="0 0 {back}" biastype="affine"/></actuator></mujoco>"""
FINE, RATE = 2e-4, 200.0


def swing(seed, fault, gain=1.0, back=0.0, seconds=9.0):
    """Command and reading of a pendulum under a controller; friction by Karnopp.

    What the robot really has differs a little from the model: mass, friction, gain.
    """
    draw = np.random.default_rng(seed)
    mass, friction = 0.6 * (1 + 0.01 * draw.normal()), 0.08 * (1 + 0.1 * draw.normal())
    true = gain * (1 + 0.02 * draw.normal()) * fault.get("gain", 1.0)
    mass, friction = mass + fault.get("mass", 0.0), friction + fault.get("dry", 0.0)
    inertia, weight = 0.012 + 0.09 * mass, mass * 9.81 * 0.3
    rates, phases = draw.uniform(0.3, 2.5, 4), draw.uniform(0.0, 2.0 * np.pi, 4)
    q = v = 0.0
    rows = []
    for tick in range(round(seconds * RATE)):
        t = tick / RATE
        waves = np.sin(2.0 * np.pi * rates * t + phases) / (1.0 + rates)
        aim = min(t, 1.0) * 0.45 * waves.sum()
        told = np.clip(6.0 * (aim - q) - 0.5 * v, -6.0, 6.0) / gain
        rows.append((told, q + 4e-4 * draw.normal()))
        for _ in range(round(1.0 / RATE / FINE)):
            push = true * told - (back + 0.03) * v - weight * np.sin(q)
            if abs(v) < 1e-3 and abs(push) <= friction:
                v = 0.0
                continue
            side = np.sign(v) if abs(v) >= 1e-3 else np.sign(push)
            faster = v + FINE * (push - friction * side) / inertia
            v = 0.0 if faster * v < 0.0 else faster
            q += FINE * v
    return np.array(rows).T


def verdict(folder: Path, unit, fault, gain=1.0, back=0.0):
    model = folder / "arm.xml"
    model.write_text(MODEL.format(gain=gain, back=-back))
    for name, seed in (("fit", 1), ("held", 2)):
        told, seen = swing(seed, fault, gain, back)
        time = np.arange(len(told)) / RATE
        columns = {"command.arm": told, "position.arm": seen}
        about = {"robot": "arm", "base": "fixed", "command_unit": unit}
        zero = np.zeros(len(told), int)
        log = Recording(name, time, zero, columns, about)
        write_recording(folder / f"{name}.parquet", log)
    fit, held = folder / "fit.parquet", folder / "held.parquet"
    words = ["--model", model, "--data", fit, "--held-out", held, "--out", folder]
    assert main(["diagnose", *map(str, words)]) == 0
    return json.loads((folder / "diagnosis.json").read_text())


@pytest.mark.parametrize(
    ("unit", "gain", "back", "fault", "cause", "size"),
    [
        ("N m", 1.0, 0.0, {}, None, 0.0),
        ("N m", 1.0, 0.0, {"dry": 0.25}, "coulomb_friction", 0.25),
        ("V", 0.4, 0.05, {"mass": 0.25}, "payload", 0.25),
    ],
)
def test_the_fault_of_a_motor_is_named(tmp_path, unit, gain, back, fault, cause, size):
    found = verdict(tmp_path, unit, fault, gain, back)
    assert [row["cause"] for row in found["causes"]] == ([cause] if cause else [])
    if cause:
        first = next(iter(found["causes"][0]["parameters"].values()))
        assert first["value"] == pytest.approx(size, rel=0.25)
        assert found["gain"]["after"] < 0.2 * found["gain"]["before"]
    assert found["next_experiment"] is None and found["fallback"] is None
