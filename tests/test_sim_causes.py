"""Every cause against a small ordinary differential equation of a pendulum.

The equation is written here from scratch: one joint, servo, gravity, dry friction that
stops the joint exactly, at 25 microseconds. Nothing of gatjax.effects is in it. MuJoCo
steps at 0.25 ms, which is worth 0.4 mrad; an effect moves the joint by 5 and more. A
negligible Coulomb friction beside each makes MuJoCo's own friction hold.
"""

import functools

import numpy as np
import pytest

from gatjax.sim.replay import replay_many
from gatjax.sim.world import add_cause, nominal, stacked
from gatjax.task import Task

MASS, ARM, OWN, ROTOR = 0.6, 0.17, 0.002, 0.012
KP, KV, DAMPING, FRICTION, LIMIT = 20.0, 0.25, 0.5, 0.06, 5.0
MODEL = f"""
<mujoco><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body><joint name="servo" axis="0 1 0" armature="{ROTOR}"
  damping="{DAMPING}" frictionloss="{FRICTION}"/>
  <inertial pos="0 0 -{ARM}" mass="{MASS}" diaginertia="{OWN} {OWN} {OWN}"/></body>
</worldbody><actuator><position joint="servo" kp="{KP}" kv="{KV}"
  forcerange="-{LIMIT} {LIMIT}" ctrlrange="-1.5 1.5"/></actuator></mujoco>"""
PERIOD, ROWS, STEP = 0.01, 150, 2.5e-5
TIME = PERIOD * np.arange(ROWS)
COMMAND = 0.7 * np.sin(5.0 * TIME) + 0.4 * (TIME > 0.3) - 0.5 * (TIME > 0.9)
SUB = round(PERIOD / STEP)
INERTIA, WEIGHT = OWN + MASS * ARM**2 + ROTOR, MASS * 9.81 * ARM
STEPPED = 4.5e-4  # rad; 4.2e-4 without any cause, and half of it at half the step
HELD = np.repeat(COMMAND, SUB)  # target at every step of the equation


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "pendulum.xml"
    path.write_text(MODEL)
    return path


def world_of(file, timestep=0.00025):
    return nominal(Task(control_period=PERIOD), file, timestep)


def replay(world, commands=COMMAND, start=0.0):
    values = stacked([world.values])
    return replay_many(world, values, commands[:, None], np.array([start]), np.zeros(1))


def angles(world):
    return replay(world).reading.angle[0, :, 0]


def swing(
    target=HELD, kp=KP, kv=KV, damping=DAMPING, inertia=INERTIA, encoder=lambda q: q,
    limit=lambda v: (-LIMIT, LIMIT), friction=lambda v, pull: (FRICTION, FRICTION),
    load=lambda q: -WEIGHT * np.sin(q), weaken=None, arrives=lambda pull: pull,
):  # fmt: skip
    """Angles [steps] of the pendulum; friction is (forwards, backwards), N m."""
    q = v = 0.0
    out, share, memory = np.empty(len(target)), 1.0, 0.0
    for step, told in enumerate(target):
        out[step] = q
        low, high = limit(v)
        pull = share * kp * (told - encoder(q)) - kv * v
        pull = arrives(min(max(pull, share * low), share * high))
        if weaken is not None:
            memory, share = weaken(memory, pull)
        forwards, backwards = friction(v, pull)
        free = v + STEP * (pull - damping * v + load(q)) / inertia
        stop = free * inertia / STEP
        v = free - STEP * min(max(stop, -backwards), forwards) / inertia
        q += STEP * v
    return out


def geared(width, stiffness, ratio, on_motor, share=0.1, behind=0.0, kv_on_link=0.0):
    """Angles that the encoder sees of a motor and a link with a gear between them."""
    rotor = (1.0 - behind) * ROTOR
    link = INERTIA - rotor
    reduced = link * rotor / INERTIA
    ring = 2.0 * ratio * np.sqrt(stiffness * reduced)
    motor, arm = [0.0, 0.0], [0.0, 0.0]
    out = np.empty(len(HELD))
    for step, told in enumerate(HELD):
        q = motor[0] if on_motor else arm[0]
        out[step] = q
        seen = motor[1] + kv_on_link * (arm[1] - motor[1])
        pull = min(max(KP * (told - q) - KV * seen, -LIMIT), LIMIT)
        twist = motor[0] - arm[0]
        beyond = np.sign(twist) * max(abs(twist) - 0.5 * width, 0.0)
        torque = stiffness * beyond + ring * (motor[1] - arm[1])
        if width > 0.0 and torque * beyond <= 0.0:
            torque = 0.0
        sides = (
            (motor, pull - torque, rotor, 1.0 - share),
            (arm, torque - WEIGHT * np.sin(arm[0]), link, share),
        )
        for body, push, mass, part in sides:
            free = body[1] + STEP * (push - part * DAMPING * body[1]) / mass
            rub = part * FRICTION
            body[1] = free - STEP * min(max(free * mass / STEP, -rub), rub) / mass
            body[0] += STEP * body[1]
    return out


def late(values, seconds):
    shift = round(seconds / STEP)
    return np.concatenate([np.full(shift, values[0]), values[: len(values) - shift]])


def slewed(limit):
    out, now = np.empty(len(HELD)), HELD[0]
    for step, told in enumerate(HELD):
        now += min(max(told - now, -limit * STEP), limit * STEP)
        out[step] = now
    return out


def filtered(tau):
    out, now = np.empty(len(HELD)), HELD[0]
    for step, told in enumerate(HELD):
        now += (told - now) * STEP / tau
        out[step] = now
    return out


def banded(half):
    """A dead band on the error is a change of what the encoder seems to say."""

    def run():
        q = v = 0.0
        out = np.empty(len(HELD))
        for step, told in enumerate(HELD):
            out[step] = q
            error = told - q
            error = np.sign(error) * max(abs(error) - half, 0.0)
            pull = min(max(KP * error - KV * v, -LIMIT), LIMIT)
            push = pull - DAMPING * v - WEIGHT * np.sin(q)
            free = v + STEP * push / INERTIA
            stop = free * INERTIA / STEP
            v = free - STEP * min(max(stop, -FRICTION), FRICTION) / INERTIA
            q += STEP * v
        return out

    return run()


def line(top):
    def limit(v):
        return (
            -LIMIT * min(max(1.0 + v / top, -1.0), 1.0),
            LIMIT * min(max(1.0 - v / top, -1.0), 1.0),
        )

    return limit


def rubbing(extra):
    """Friction of FRICTION + extra(v, pull) both ways."""
    return lambda v, pull: (FRICTION + extra(v, pull),) * 2


def heating(lost, cooling, heat):
    def weaken(warm, pull):
        warm += STEP * (pull**2 - warm / cooling)
        return warm, max(1.0 - lost * warm / heat, 0.05)

    return weaken


def drooping(drop, total):
    return lambda memory, pull: (0.0, 1.0 - drop * min(1.0, abs(pull) / total))


def rows(dense):
    return dense[::SUB]


def at(dense, time):
    return np.interp(time, STEP * np.arange(len(dense)), dense)


TURN = 0.15  # rad, tilt
HEAVY = 0.2 * 0.1**2  # kg m^2, payload of 0.2 kg at 0.1 m
TEETH = LIMIT / 0.003
E2 = "encoder_on_motor"
CASES = {
    "command_delay": ({"delay": 0.013}, lambda: rows(swing(late(HELD, 0.013)))),
    "measurement_delay": (
        {"delay": 0.013}, lambda: at(swing(), np.maximum(TIME - 0.013, 0.0)),
    ),
    "clock_drift": ({"drift": 0.01}, lambda: at(swing(), 0.99 * TIME)),
    "first_order_lag": (
        {"time_constant": 0.03}, lambda: rows(swing(filtered(0.03))),
    ),
    "gain_error": ({"scale": 0.6}, lambda: rows(swing(kp=0.6 * KP))),
    "damping_error": ({"scale": 3.0}, lambda: rows(swing(kv=3.0 * KV))),
    "torque_limit": (
        {"limit": 1.5}, lambda: rows(swing(limit=lambda v: (-1.5, 1.5))),
    ),
    "torque_saturation": (
        {"torque": 3.0},
        lambda: rows(swing(arrives=lambda pull: pull / (1.0 + abs(pull) / 3.0))),
    ),
    "speed_limit": ({"limit": 2.0}, lambda: rows(swing(slewed(2.0)))),
    "speed_limit motor": (
        {"limit": 3.0, "on_motor": 1}, lambda: rows(swing(limit=line(3.0))),
    ),
    "viscous_friction": (
        {"coefficient": 0.4}, lambda: rows(swing(damping=DAMPING + 0.4)),
    ),
    "coulomb_friction": (
        {"torque": 0.3}, lambda: rows(swing(friction=rubbing(lambda v, pull: 0.3))),
    ),
    "stiction": (
        {"excess": 1.5, "velocity": 1.0},
        lambda: rows(swing(friction=rubbing(
            lambda v, pull: 1.5 * np.exp(-(v**2))))),
    ),
    "load_friction": (
        {"coefficient": 0.3},
        lambda: rows(swing(friction=rubbing(lambda v, pull: 0.3 * abs(pull)))),
    ),
    "asymmetric_friction": (
        {"torque": 0.5},
        lambda: rows(swing(friction=lambda v, pull: (FRICTION + 0.5, FRICTION))),
    ),
    "asymmetric_friction back": (
        {"torque": -0.5},
        lambda: rows(swing(friction=lambda v, pull: (FRICTION, FRICTION + 0.5))),
    ),
    "asymmetric_friction with speed": (
        {"torque": 0.2, "viscous": 0.4},
        lambda: rows(swing(
            friction=lambda v, pull: (FRICTION + 0.2 + 0.4 * abs(v), FRICTION))),
    ),
    "asymmetric_friction against": (
        {"torque": 0.2, "viscous": -0.4},
        lambda: rows(swing(
            friction=lambda v, pull: (FRICTION + 0.2, FRICTION + 0.4 * abs(v)))),
    ),
    "dead_band": ({"half_width": 0.04}, lambda: rows(banded(0.04))),
    "command_quantization": (
        {"step": 0.11}, lambda: rows(swing(0.11 * np.floor(HELD / 0.11 + 0.5))),
    ),
    "torque_ripple": (
        {"amplitude": 0.4, "cycles": 12.0, "phase": 1.0},
        lambda: rows(swing(load=lambda q: (
            0.4 * np.sin(12.0 * q + 1.0) - WEIGHT * np.sin(q)))),
    ),
    "encoder_offset": ({"offset": 0.05}, lambda: rows(swing()) + 0.05),
    "encoder_offset loop": (
        {"offset": 0.05, "in_loop": 1},
        lambda: rows(swing(encoder=lambda q: q + 0.05)) + 0.05,
    ),
    "encoder_scale": ({"scale": 0.9}, lambda: 0.9 * rows(swing())),
    "encoder_scale loop": (
        {"scale": 0.9, "in_loop": 1},
        lambda: 0.9 * rows(swing(encoder=lambda q: 0.9 * q)),
    ),
    "payload": (
        {"mass": 0.2, "x": 0.0, "y": 0.05, "z": -0.1},
        lambda: rows(swing(
            inertia=INERTIA + HEAVY,
            load=lambda q: -(WEIGHT + 0.2 * 9.81 * 0.1) * np.sin(q))),
    ),
    "com_shift": (
        {"x": 0.03, "z": -0.02},
        lambda: rows(swing(
            inertia=OWN + ROTOR + MASS * (0.03**2 + 0.19**2),
            load=lambda q: -MASS * 9.81 * (0.19 * np.sin(q) - 0.03 * np.cos(q)))),
    ),
    "armature": ({"inertia": 0.02}, lambda: rows(swing(inertia=INERTIA + 0.02))),
    "gravity_tilt": (
        {"pitch": TURN},
        lambda: rows(swing(load=lambda q: -WEIGHT * np.sin(q + TURN))),
    ),
    "thermal_derating": (
        {"lost_fraction": 0.6, "cooling": 2.0, "heat": 2.0},
        lambda: rows(swing(weaken=heating(0.6, 2.0, 2.0))),
    ),
    "supply_sag": (
        {"max_drop": 0.5, "total": 3.0},
        lambda: rows(swing(weaken=drooping(0.5, 3.0))),
    ),
    "backlash": ({"width": 0.06}, lambda: rows(geared(0.06, TEETH, 0.3, False))),
    "backlash motor": (
        {"width": 0.06, E2: 1}, lambda: rows(geared(0.06, TEETH, 0.3, True)),
    ),
    "backlash bounces": (
        {"width": 0.06, "damping_ratio": 0.1},
        lambda: rows(geared(0.06, TEETH, 0.1, False)),
    ),
    "joint_elasticity": (
        {"stiffness": 40.0}, lambda: rows(geared(0.0, 40.0, 0.05, False)),
    ),
    "backlash wheels": (
        {"width": 0.06, "armature_share": 0.4},
        lambda: rows(geared(0.06, TEETH, 0.3, False, behind=0.4)),
    ),
    "joint_elasticity wheels": (
        {"stiffness": 40.0, "armature_share": 0.4},
        lambda: rows(geared(0.0, 40.0, 0.05, False, behind=0.4)),
    ),
    "backlash seen": (
        {"width": 0.06, "kv_on_link": 1.0},
        lambda: rows(geared(0.06, TEETH, 0.3, False, kv_on_link=1.0)),
    ),
    "joint_elasticity seen": (
        {"stiffness": 40.0, "kv_on_link": 0.7},
        lambda: rows(geared(0.0, 40.0, 0.05, False, kv_on_link=0.7)),
    ),
    "joint_elasticity motor": (
        {"stiffness": 40.0, E2: 1}, lambda: rows(geared(0.0, 40.0, 0.05, True)),
    ),
}  # fmt: skip


@functools.cache
def plain():
    return rows(swing())


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def test_the_nominal_pendulum_is_the_equations(file):
    assert rms(angles(world_of(file)) - plain()) < STEPPED


@pytest.mark.parametrize("case", CASES)
def test_a_cause_does_what_its_equation_says(case, file):
    values, equation = CASES[case]
    name = case.split()[0]
    still = add_cause(world_of(file), "coulomb_friction", ["all"], 1e-9)
    world = add_cause(still, name, ["all"], values)
    expected = equation()
    effect = rms(expected - plain())
    assert effect > 5e-3  # the motion shows it
    assert rms(angles(world) - expected) < max(STEPPED, 0.03 * effect)


def test_a_balanced_link_can_lose_its_balance(tmp_path):
    path = tmp_path / "wheel.xml"
    path.write_text("""
<mujoco><worldbody><body><joint name="servo" axis="0 1 0" damping="0.1"/>
  <geom type="sphere" size="0.05" mass="1"/></body></worldbody>
<actuator><position joint="servo" kp="20" kv="1"/></actuator></mujoco>""")
    world = add_cause(world_of(path), "com_shift", ["servo"], {"x": 0.05})
    sag = angles(world)[-1] - angles(world_of(path))[-1]
    assert sag == pytest.approx(9.81 * 0.05 / 20.0, rel=0.1)


@pytest.mark.parametrize(("cause", "parameter", "field", "own"), [
    ("armature", "inertia", "dof_armature", ROTOR),
    ("viscous_friction", "coefficient", "dof_damping", DAMPING),
    ("coulomb_friction", "torque", "dof_frictionloss", FRICTION),
])  # fmt: skip
def test_a_model_may_have_too_much_but_nothing_is_less_than_none(
    file, cause, parameter, field, own
):
    world = add_cause(world_of(file), cause, ["servo"], {parameter: -0.4 * own})
    assert world.values.body[field][0] == pytest.approx(0.6 * own)
    with pytest.raises(ValueError, match="would be negative"):
        add_cause(world_of(file), cause, ["servo"], {parameter: -1.1 * own})
