"""A motor's laws go by the motor where a gap parts it from its link.

The link is held still, the motor turns in a gap and comes to rest; what its servo then
gives, warms with and rubs by has closed forms. That a joint moves the same in the
diagnosis is in test_diagnosis_world.py.
"""

import numpy as np
import pytest

from gatjax.records import Signal
from gatjax.sim.actuation import actuation
from gatjax.sim.world import add_cause, nominal
from gatjax.task import Task

MODEL = """
<mujoco><option timestep="0.001"/><worldbody><body><joint name="a" axis="0 1 0"
  range="-3 3" armature="0.01" damping="0.04"/>
  <geom size="0.05" pos="0 0 -0.15" mass="0.5"/></body></worldbody><actuator>
  <position joint="a" kp="10" kv="0.6" forcerange="-5 5"/></actuator></mujoco>"""
GAP = {"width": 0.2, "encoder_on_motor": 1.0, "link_share": 0.5}
STEP, KP = 0.001, 10.0
AGAINST_TEETH, IN_GAP = 0.11, 0.05  # rad, targets


def geared(folder, cause=None, values=None, where="a", **gap):
    """An arm with a gap of 0.2 rad, its encoder on the motor, and a cause."""
    path = folder / "arm.xml"
    path.write_text(MODEL)
    world = nominal(Task(control_period=0.01), path)
    world = add_cause(world, "backlash", ["a"], GAP | gap)
    return world if cause is None else add_cause(world, cause, [where], values)


def held_still(world, target, steps=3000):
    """Servo torque N m, encoder rad and friction of the link N m [steps], memory."""
    servos, none = actuation(world), np.zeros(1)
    signal = Signal(np.full(1, target), none, none, none)
    state, rows = servos.init(world.values, signal._replace(target=none)), []
    for _ in range(steps):
        state, push = servos.apply(world.values, state, signal)
        seen = servos.seen(world.values, state, none)
        rows.append((state.torque[0], seen[0], push.friction[0]))
    return (*np.array(rows).T, state)


def memory(state, cause):
    (found,) = (own for name, own in state.joint.items() if name.startswith(cause))
    return float(found[0])


def test_a_motor_warms_with_the_torque_that_it_gives(tmp_path):
    warm = {"lost_fraction": 1e-6, "cooling": 3600.0, "heat": 1.0}
    hot = geared(tmp_path, "thermal_derating", warm)
    torque, seen, _, state = held_still(hot, AGAINST_TEETH)
    assert torque[-1] == pytest.approx(KP * (AGAINST_TEETH - seen[-1]), rel=1e-3)
    given = np.sum(np.square(torque)) * STEP
    assert memory(state, "thermal") == pytest.approx(given, rel=0.05)


def test_a_torque_falls_short_by_what_the_motor_is_asked_for(tmp_path):
    soft = geared(tmp_path, "torque_saturation", 0.5)
    torque, seen, *_ = held_still(soft, AGAINST_TEETH)
    asked = KP * (AGAINST_TEETH - seen[-1])
    assert asked > 0.05
    assert torque[-1] == pytest.approx(asked / (1.0 + asked / 0.5), rel=1e-3)


def test_the_supply_is_loaded_by_what_motors_give(tmp_path):
    sag = {"max_drop": 0.5, "total": 0.4}
    sagging = geared(tmp_path, "supply_sag", sag, where="all")
    torque, seen, *_ = held_still(sagging, AGAINST_TEETH)
    asked = KP * (AGAINST_TEETH - seen[-1])
    left = 1.0 - 0.5 * torque[-1] / 0.4
    assert torque[-1] == pytest.approx(asked * left, rel=1e-3)
    assert torque[-1] == pytest.approx(asked / (1.0 + 0.5 * asked / 0.4), rel=0.02)


def test_a_gear_rubs_by_the_torque_that_its_servo_gives(tmp_path):
    rubs = geared(tmp_path, "load_friction", 0.4)
    torque, _, friction, _ = held_still(rubs, AGAINST_TEETH)
    half = 0.5 * 0.4 * np.abs(torque[-1])
    assert friction[-1] == pytest.approx(half, rel=1e-3)


@pytest.mark.parametrize("on_motor", [0.0, 1.0])
def test_a_motor_ripples_with_its_own_angle(on_motor, tmp_path):
    """In the gap nothing else holds it: servo and ripple are in balance."""
    wave = {"amplitude": 0.1, "cycles": 8.0, "phase": 3.2}
    world = geared(tmp_path, "torque_ripple", wave, encoder_on_motor=on_motor)
    drawn = IN_GAP if on_motor else 0.005  # an encoder on the link reads 0
    torque, *_, state = held_still(world, drawn)
    turned = float(state.joint["gear"].twist[0])
    assert 0.04 < turned < 0.07
    ripple = 0.1 * np.sin(8.0 * turned + 3.2)
    assert torque[-1] + ripple == pytest.approx(0.0, abs=1e-4)


def test_a_motor_that_turns_has_left_stiction_and_its_link_has_not(tmp_path):
    """Friction of the link is that of rest; the motor runs as fast as without."""
    sticky = geared(tmp_path, "stiction", {"excess": 0.2, "velocity": 0.01})
    _, seen, friction, _ = held_still(sticky, 0.3, 30)
    _, free, *_ = held_still(geared(tmp_path), 0.3, 30)
    assert 0.02 < free[-1] < 0.1
    assert seen[-1] == pytest.approx(free[-1], rel=0.01)
    assert friction == pytest.approx(np.full(30, 0.1))


def test_a_torque_speed_line_brakes_the_motor_that_turns(tmp_path):
    line = geared(tmp_path, "speed_limit", {"limit": 0.5, "on_motor": 1.0})
    _, seen, *_ = held_still(line, 2.0, 150)
    speed = np.diff(seen) / STEP
    assert speed[:100].max() < 0.55
