"""The single-joint plants against closed forms and a plain reference integration."""

import jax.numpy as jnp
import numpy as np
import pytest

from gatjax.diagnosis import laws
from gatjax.diagnosis.joint import OBSERVED, Joint
from gatjax.sim.derived import LIGHT

STEP, LEAD, COUNT = 1e-3, 400, 3000
NOMINAL = {
    "kp": 20.0, "hold": 1.0, "kv": 0.25, "limit": 5.0, "damping": 0.5, "friction": 0.0,
    "armature": 0.012, "delay": 0.0, "creep": 0.06, "give": 3e-4, "rate": 1e3,
    "speed": 1e6, "scale": 1.0, "cooling": 20.0, "stiffness": 1e3,
    "ratio": 0.2,
}  # fmt: skip


def joint(target, rest=0.0, inertia=0.018):
    """A joint that follows target(t), with a constant load."""
    time = (np.arange(COUNT) - LEAD) * STEP
    series = jnp.asarray(np.vectorize(target)(time)[:, None], jnp.float32)
    flat = jnp.ones_like(series)
    empty = jnp.zeros((COUNT, 1, 1), jnp.float32)
    grid = laws.Grid(
        target=series, path=0.0 * flat, reading=0.0 * flat, rest=rest * flat,
        slope=0.0 * flat, pull=0.0 * flat,
        inertia=inertia * flat, rest_terms=empty,
        slope_terms=empty, inertia_terms=empty,
        stiffness=flat, supply=flat, running=flat,
        clock=jnp.asarray(time[:, None], jnp.float32),
    )  # fmt: skip
    stamps = np.arange(0.0, 2.5, 0.01)[None]
    return Joint(
        "elbow", 0, NOMINAL, grid, LEAD, stamps, np.zeros_like(stamps),
        np.ones(stamps.shape, bool), 7e-4,
    )  # fmt: skip


def step_up(t):
    return 0.3 if t >= 0.1 else 0.0


def wave(t):
    return 0.4 * np.sin(2 * np.pi * 1.0 * max(t, 0.0))


def seen(one, geared=False, **drive):
    return one.simulate([drive], geared)[0, :, 0]


def test_a_loaded_servo_rests_where_its_spring_carries_the_load():
    angle = seen(joint(lambda t: 0.0, rest=1.0))
    assert angle[-1] == pytest.approx(-1.0 / NOMINAL["kp"], abs=1e-4)


def test_gravity_is_exact_far_from_the_path_along_which_it_was_weighed():
    """A pendulum that falls from 2 rad, weighed where it stands."""
    length, first, h = 0.4, 2.0, 1e-5
    pull, inertia = 9.81 * length, length**2
    one = joint(lambda t: 0.0, rest=float(pull * np.sin(first)), inertia=inertia)
    flat = jnp.ones_like(one.grid.path)
    level = float(pull * np.cos(first)) * flat
    grid = one.grid._replace(
        path=first * flat, reading=first * flat, pull=one.grid.rest, slope=level
    )
    free = {"hold": 0.0, "kp": 1.0, "kv": 0.0, "damping": 0.1}
    angle = seen(one._replace(grid=grid, nominal=NOMINAL | free))
    q, v, out = first, 0.0, []
    for k in range(-LEAD * 100, 250_000):
        if k >= 0 and k % 1000 == 0:
            out.append(q)
        v -= h * (pull * np.sin(q) + 0.1 * v) / (inertia + 0.012)
        q += h * v
    assert min(out) < -1.0 and np.max(np.abs(angle - np.array(out))) < 0.03


def test_a_step_is_the_answer_of_a_damped_oscillator():
    angle = seen(joint(step_up), limit=50.0)
    q, v, h, out = 0.0, 0.0, 1e-5, []
    total, resist = 0.018 + 0.012, 0.25 + 0.5
    for k in range(250_000):
        if k % 1000 == 0:
            out.append(q)
        v += h * (20.0 * (step_up(k * h) - q) - resist * v) / total
        q += h * v
    assert np.max(np.abs(angle - np.array(out[:250]))) < 5e-4  # 1 ms steps, 0.3 rad


def test_a_joint_without_a_servo_is_pushed_by_its_command():
    drive = {"hold": 0.0, "kp": 0.05, "kv": 0.0, "damping": 0.0}
    angle = seen(joint(step_up), **drive)
    t = np.maximum(np.arange(0.0, 2.5, 0.01) - 0.1, 0.0)
    pushed = 0.5 * 0.05 * 0.3 / 0.03 * t**2
    assert np.max(np.abs(angle - pushed)) < 3e-3 * pushed[-1]


def test_a_joint_without_a_servo_is_drawn_to_its_measured_motion():
    one = joint(lambda t: 0.0, rest=0.06)
    free = one._replace(nominal=NOMINAL | {"hold": 0.0, "kv": 0.0, "damping": 0.0})
    angle = seen(free.drawn(0.0))
    assert angle[-1] == pytest.approx(-0.06 / 0.03 / OBSERVED**2, rel=1e-3)
    assert free.drawn(30.0).nominal["steer"] == 900.0
    assert seen(free.drawn(30.0))[-1] == pytest.approx(angle[-1] / 9.0, rel=1e-2)


def test_dry_friction_holds_a_load_below_its_level():
    drive = {"friction": 0.6, "kp": 1e-6}
    angle = seen(joint(lambda t: 0.0, rest=0.5), **drive)
    assert np.max(np.abs(angle)) < 6e-4  # yields like a spring, does not creep
    assert abs(angle[-1] - angle[len(angle) // 2]) < 1e-6
    slid = seen(joint(lambda t: 0.0, rest=0.7), **drive)
    assert slid[-1] < -0.05


def test_a_delay_shifts_the_answer_and_a_late_reading_looks_the_same():
    one = joint(wave)
    plain = seen(one)
    delayed, late = seen(one, delay=0.03), seen(one, late=0.03)
    assert np.max(np.abs(delayed[3:] - plain[:-3])) < 1e-3
    assert np.max(np.abs(delayed - late)) < 1e-3


def test_a_torque_limit_bounds_the_acceleration():
    angle = seen(joint(step_up), limit=0.5)
    # From 0.1 s on the motor gives 0.5 N m: q'' <= 0.5 / 0.03.
    early = np.arange(0.0, 0.05, 0.01)
    assert np.all(angle[10:15] <= 0.5 * (0.5 / 0.03) * early**2 + 2e-3)
    assert angle[14] > 0.3 * 0.5 * (0.5 / 0.03) * 0.04**2


def test_a_dead_band_leaves_the_joint_anywhere_inside():
    angle = seen(joint(step_up), dead=0.05)
    assert abs(0.3 - angle[-1]) < 0.051
    assert abs(0.3 - angle[-1]) > 0.005  # not driven to the target


def test_a_stiff_gear_without_play_moves_like_a_rigid_one():
    one = joint(wave)
    stiff = seen(one, geared=True, stiffness=5e4, sensed=1.0)
    assert np.max(np.abs(stiff - seen(one))) < 1.5e-3


def test_play_shows_between_motor_and_link_and_is_as_wide_as_it_says():
    one = joint(wave, rest=0.0)
    drive = {"width": 0.05, "stiffness": 2e3}
    link = seen(one, geared=True, sensed=0.0, **drive)
    motor = seen(one, geared=True, sensed=1.0, **drive)
    assert 0.02 < np.max(np.abs(link - motor)) < 0.2
    assert np.max(np.abs(motor - seen(one))) < np.max(np.abs(link - seen(one))) + 0.05


def test_armature_behind_the_gear_swings_with_the_link():
    one = joint(step_up)
    spring = {"stiffness": 10.0, "sensed": 1.0, "kp": 400.0, "limit": 400.0}
    angle = {b: seen(one, geared=True, behind=b, **spring) for b in (0.0, 0.5)}
    link = 0.018 + 0.5 * 0.012
    alone = joint(step_up, inertia=link)
    moved = {"armature": 0.5 * 0.012}
    same = seen(alone, geared=True, behind=0.0, **spring, **moved)
    assert np.max(np.abs(angle[0.5] - same)) < 1e-4
    assert np.max(np.abs(angle[0.5] - angle[0.0])) > 1e-3


def test_a_gear_of_a_joint_without_armature_has_a_light_rotor():
    one = joint(step_up)
    spring = {"stiffness": 10.0, "sensed": 1.0, "kp": 40.0, "limit": 400.0}
    none = seen(one, geared=True, armature=0.0, **spring)
    light = seen(one, geared=True, armature=LIGHT * 0.018, **spring)
    assert np.max(np.abs(none - light)) < 1e-6


def test_heat_takes_gain_away_and_is_told():
    kp = 60.0  # it sags little: the load hardly turns
    one = joint(lambda t: 0.0, rest=1.5)._replace(nominal=NOMINAL | {"kp": kp})
    cool = one.outcome([{}], False)
    assert float(cool.heat[0, 0]) > 0.05
    share = 0.5 / float(cool.heat[0, 0])
    sag = seen(one, heat=share)[-1] - seen(one)[-1]
    # Half of the gain is gone at the end: the load pulls the joint down twice as far.
    assert sag == pytest.approx(-1.5 / kp, rel=0.15)


def test_the_sine_is_right_where_rates_and_times_take_it():
    x = np.linspace(-2000.0, 2000.0, 400_001).astype(np.float32)
    assert np.asarray(laws.sine(x)) == pytest.approx(np.sin(x.astype(float)), abs=1e-5)


@pytest.mark.parametrize(
    "law",
    [
        {"lag": 0.03}, {"quantum": 0.05}, {"rate": 1.0}, {"speed": 2.0},
        {"stiction": 0.5}, {"loaded": 0.5}, {"asymmetric": 0.4}, {"one_sided": 0.4},
        {"ripple": 0.3,
        "cycles": 8.0}, {"zero_in": 0.05}, {"zero_out": 0.05}, {"scale": 1.05},
        {"sag": 0.4}, {"drag": 0.4}, {"spring": 2.0}, {"bias": 0.5},
        {"wave": 0.4, "frequency": 9.0}, {"integral": 5.0}, {"drift": 0.01},
        {"skew": 0.4},
    ],
)  # fmt: skip
def test_every_law_moves_the_reading_and_its_neutral_value_does_not(law):
    one = joint(wave, rest=0.8)
    plain = seen(one)
    assert np.max(np.abs(seen(one, **law) - plain)) > 3e-3 or "zero_in" in law
    neutral = {key: NOMINAL.get(key, 0.0) for key in law}
    assert np.array_equal(seen(one, **neutral), plain)


def test_friction_of_one_direction_acts_in_that_direction_only():
    one = joint(wave)
    error = seen(one, asymmetric=0.8) - seen(one)
    speed = np.gradient(seen(one))
    fast = np.abs(speed) > 0.5 * np.abs(speed).max()
    assert np.mean(error[fast & (speed > 0)]) < -0.01
    assert abs(np.mean(error[fast & (speed < 0)])) < 0.005


def test_damping_of_one_direction_acts_in_that_direction_only():
    one = joint(wave)
    error = seen(one, one_sided=-0.8) - seen(one)
    speed = np.gradient(seen(one))
    fast = np.abs(speed) > 0.5 * np.abs(speed).max()
    assert np.mean(error[fast & (speed < 0)]) > 0.01
    assert abs(np.mean(error[fast & (speed > 0)])) < 0.005


def test_friction_behind_the_gear_lets_the_motor_wind_it_up():
    nudge = joint(lambda t: 0.01 if t >= 0.1 else 0.0)
    gear = {"stiffness": NOMINAL["kp"], "sensed": 1.0, "friction": 0.4}
    stuck = seen(nudge, geared=True, link_share=0.0, **gear)
    wound = seen(nudge, geared=True, link_share=1.0, **gear)
    assert stuck[-1] == pytest.approx(0.0, abs=3e-4)
    assert wound[-1] == pytest.approx(0.005, abs=3e-4)  # two equal springs


def test_kv_goes_by_the_speed_of_the_motor_or_of_the_link():
    """Closed form: the motor of two springs, kv on its own or on the link's speed.

    With x = (motor, link), M x'' = -K x - D x' + (kp told, 0); exact by its modes.
    """
    one, spring, link = joint(step_up), 40.0, 0.018
    drive = {"stiffness": spring, "ratio": 0.0, "kv": 0.2, "limit": 1e3, "damping": 0.0,
             "link_share": 0.0}  # fmt: skip
    kp, rotor, kv = NOMINAL["kp"], NOMINAL["armature"], drive["kv"]
    for linked in (0.0, 0.6):
        rows = [[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0],
                [-spring / rotor, (spring - kp) / rotor, -(1.0 - linked) * kv / rotor,
                 -linked * kv / rotor],
                [spring / link, -spring / link, 0.0, 0.0]]  # fmt: skip
        values, vectors = np.linalg.eig(np.array(rows))
        rest = np.array([0.3, 0.3, 0.0, 0.0])
        later = np.maximum(one.time[0] - 0.1, 0.0)
        shares = np.linalg.solve(vectors, -rest)
        swing = (vectors[1] * shares) @ np.exp(np.outer(values, later))
        read = seen(one, geared=True, sensed=0.0, linked=linked, **drive)
        assert np.abs(read - rest[1] - swing.real).max() < 0.01


@pytest.mark.parametrize("ratio", [0.05, 0.3])
def test_a_link_bounces_off_the_teeth_as_their_damping_says(ratio: float):
    """It falls on them from the middle of the gap; nothing turns the motor.

    A damped spring that never pulls gives back the share e of the speed (Schwager and
    Poeschel 2007, eq. 15).
    """
    width, root = 0.2, np.sqrt(1.0 - ratio**2)
    one = joint(lambda t: 0.0, rest=0.05)
    stamps = np.arange(-0.39, 2.5, 0.001)[None]
    one = one._replace(time=stamps, measured=0.0 * stamps, valid=stamps > -1.0)
    gear = {"width": width, "ratio": ratio, "armature": 100.0, "link_share": 0.0}
    angle = seen(one, geared=True, kp=0.0, damping=0.0, **gear)
    first = int(np.argmin(angle[:700]))
    risen = angle[first : first + 900].max() + width / 2
    leaves = np.pi - np.arctan(2.0 * ratio * root / (1.0 - 2.0 * ratio**2))
    restitution = np.exp(-ratio / root * leaves)
    assert risen == pytest.approx(restitution**2 * width / 2, rel=0.1)


def test_a_pulled_joint_follows_what_was_measured():
    one = joint(step_up, rest=1.0)
    astray, drawn = seen(one), seen(one.drawn(200.0))
    assert abs(astray[-1]) > 0.2
    assert np.abs(drawn).max() < 0.1 * np.abs(astray).max()


def test_drawing_tells_gaps_apart_though_teeth_bounce():
    """A servo that hunts across a gap: drawn, the right one stays with its readings."""

    def to_and_fro(t):
        return 0.3 * np.sign(np.sin(2.0 * np.pi * 0.7 * t)) if t > 0.0 else 0.0

    one = joint(to_and_fro, rest=0.1, inertia=0.003)
    light = {"kp": 42.0, "kv": 0.4, "damping": 0.9, "armature": 0.009, "friction": 0.07}
    one = one._replace(nominal=NOMINAL | light)
    gap = {"width": 0.12, "behind": 0.15}
    read = one.simulate([gap], True)[..., 0]
    read += one.noise * np.random.default_rng(0).normal(size=read.shape)
    clock = np.asarray(one.grid.clock)[:, 0]
    aim = np.interp(clock, one.time[0], read[0])[:, None].astype(np.float32)
    one = one._replace(measured=read, grid=one.grid._replace(reading=aim)).drawn(60.0)
    left = one.residual([gap, gap | {"width": 0.06}], True)
    right, wrong = np.sqrt(np.mean(np.square(left), 0)) / one.noise
    assert right < 3.0 and wrong > 9.0


def test_a_drawn_joint_reads_as_measured_whatever_its_encoder_and_its_clock_do():
    one = joint(lambda t: 0.0)
    clock = np.asarray(one.grid.clock)[:, 0]
    path = jnp.asarray([[wave(t)] for t in clock], jnp.float32)
    one = one._replace(grid=one.grid._replace(reading=path)).drawn(1e3)
    measured = np.array([wave(t) for t in one.time[0]])
    for odd in ({}, {"zero_out": 0.1, "scale": 1.1}, {"late": 0.04, "drift": 0.02}):
        late = slice(20, None)
        assert seen(one, **odd)[late] == pytest.approx(measured[late], abs=0.012)


def test_a_motor_that_is_driven_beyond_its_speed_brakes():
    """With a no-load speed of 2 rad/s, at 4 and more with its full torque."""
    p = laws.Drive(*np.zeros(len(laws.Drive._fields)))._replace(
        kp=1.0, limit=0.5, speed=2.0, scale=1.0, rate=1e3, hold=1.0
    )
    grid = joint(step_up).grid._replace(
        stiffness=jnp.ones(1), supply=jnp.ones(1), running=jnp.ones(1)
    )
    s = laws.Servo(*(jnp.zeros((1, 1)) for _ in range(4)))
    for speed, least, most in ((1.0, -0.5, 0.25), (3.0, -0.5, -0.25), (6.0, -0.5, -0.5),
                               (-6.0, 0.5, 0.5)):  # fmt: skip
        _, push = laws.servo(p, grid, jnp.zeros((1, 1)), s, jnp.zeros((1, 1)),
                             jnp.full((1, 1), speed), 1e-3)  # fmt: skip
        assert float(push.low[0, 0]) == pytest.approx(least)
        assert float(push.high[0, 0]) == pytest.approx(most)
