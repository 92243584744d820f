"""The engine against the recorded original, tick for tick."""

import csv
import json
import os
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gatjax.records import JOINTS
from gatjax.walk import gait
from gatjax.walk.parameters import NAMES, Constants
from gatjax.walk.steps import Request

TRACES = Path(
    os.environ.get("GATJAX_TRACES", Path(__file__).parent / "data" / "walk2014")
)
SPEC = json.loads((TRACES / "scenarios.json").read_text())
SENSORS = ["fsr_l_fl", "fsr_l_fr", "fsr_l_rl", "fsr_l_rr"]
SENSORS += [name.replace("_l_", "_r_", 1) for name in SENSORS]


def read(name):
    with (TRACES / f"{name}.csv").open() as file:
        rows = list(csv.reader(file))
    table = np.array(rows[1:], dtype=float)
    return {column: table[:, index] for index, column in enumerate(rows[0])}


def inputs(trace):
    """Request fields, gyro, force and knee of every tick, [T, ...]."""
    request = Request(
        forward=trace["cmd_forward_mm_s"] / 1000.0,
        left=trace["cmd_left_mm_s"] / 1000.0,
        turn=trace["cmd_turn_rad_s"],
        power=trace["cmd_power"],
        bend=trace["cmd_bend"],
        speed=trace["cmd_speed"],
    )
    gyro = np.stack(
        [trace["gyro_x_rad_s"], trace["gyro_y_rad_s"], 0 * trace["step"]], -1
    )
    force = np.stack([trace[name] for name in SENSORS], -1) * gait.GRAVITY
    return request, gyro, force, trace["sensed_l_knee_rad"]


def policy_of(scenario):
    return np.array([scenario["parameters"][name] for name in NAMES])


def constants_of(scenario):
    return Constants(**scenario["constants"])


def play(name):
    """Run the numpy engine over a trace; return joints [T, J] and states."""
    scenario = SPEC["scenarios"][name]
    policy, constants = policy_of(scenario), constants_of(scenario)
    stream = inputs(read(name))
    state, joints, states = gait.reset(policy), [], []
    for tick in range(len(stream[3])):
        now = jax.tree.map(lambda column, tick=tick: column[tick], stream)
        state, target = gait.tick(policy, constants, 0.01, state, *now)
        joints.append(target)
        states.append(state)
    return np.array(joints), states


@pytest.mark.parametrize("name", sorted(SPEC["scenarios"]))
def test_every_tick_equals_the_recorded_engine(name):
    trace = read(name)
    joints, states = play(name)
    for column in (column for column in trace if column.startswith("q_")):
        index = JOINTS.index(column[2:])
        error = np.abs(joints[:, index] - trace[column]).max()
        assert error <= SPEC["tolerance_rad"], f"{column}: {error:.2e} rad"
    for column in ("option", "walk_state", "left_swing"):
        ours = np.array([getattr(state, column) for state in states]).astype(int)
        np.testing.assert_array_equal(ours, trace[column].astype(int), err_msg=column)
    ticks = np.array([state.ticks for state in states])
    np.testing.assert_array_equal(ticks, np.round(trace["t"] / 0.01))


@pytest.mark.parametrize("name", sorted(SPEC["scenarios"])[:6])
def test_numpy_and_jax_agree(name):
    scenario = SPEC["scenarios"][name]
    constants = constants_of(scenario)
    policy = jnp.asarray(policy_of(scenario))

    def step(state, now):
        return gait.tick(policy, constants, 0.01, state, *now)

    stream = jax.tree.map(jnp.asarray, inputs(read(name)))
    _, joints = jax.jit(lambda: jax.lax.scan(step, gait.reset(policy), stream))()
    np.testing.assert_allclose(np.asarray(joints), play(name)[0], rtol=0, atol=1e-12)
