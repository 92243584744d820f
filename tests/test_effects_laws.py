"""Laws that every effect obeys, and what each of them is."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from gatjax.effects import body, drive, sensor
from gatjax.effects.catalogue import CATALOGUE, cause
from gatjax.effects.cause import complete, spread
from gatjax.effects.effect import Effect, chain
from gatjax.records import Reading, Sensed, Signal
from gatjax.robot.model import joint_names
from gatjax.sim import derived as derived_fields
from gatjax.sim.world import add_cause, nominal

PERIOD, TICKS, JOINTS = 0.004, 60, 3
SIGNALS = ("command", "motor")  # slots of effects that act on a Signal
DRIVE = sorted(
    name
    for name, entry in CATALOGUE.items()
    if any(part.slot in SIGNALS for part in entry.parts)
)
BODY = [
    "armature", "coulomb_friction", "damping_error", "gain_error", "torque_limit",
    "viscous_friction",
]  # fmt: skip
STEPPED = {"dropped_commands", "command_quantization"}  # slopes mean nothing there
SMOOTH = [name for name in DRIVE if name not in STEPPED]
drives = pytest.mark.parametrize("name", DRIVE)
bodies = pytest.mark.parametrize("name", BODY)


def part_of(name):
    return next(part for part in CATALOGUE[name].parts if part.slot in SIGNALS)


def params_of(name, value):
    """Params of an effect with a main value [J] or a number for all."""
    takes, entry = part_of(name).takes, CATALOGUE[name]
    if len(takes) == 1:
        return value
    full = complete(name, entry, {entry.main.name: 1.0})
    return {key: 0.0 * value + full[key] for key in takes} | {takes[0]: value}


def typical(name):
    """A value in the plausible range, another for each joint."""
    main = CATALOGUE[name].main
    return (main.low + 0.6 * (main.high - main.low)) * np.array([0.8, 1.0, 1.1])


def build(name, period=PERIOD):
    """The effect, with the main parameter alone as its params."""
    effect = part_of(name).build(period)
    return Effect(
        lambda value, signal: effect.init(params_of(name, value), signal),
        lambda value, state, signal: effect.apply(
            params_of(name, value), state, signal
        ),
    )


def signals(seed=0, shape=()):
    """A restless run [*shape, T, J]: every effect has something to change in it."""
    draw = np.random.default_rng(seed).normal(size=(4, *shape, TICKS, JOINTS))
    return Signal(
        target=np.cumsum(0.1 * draw[0], axis=-2),
        angle=np.cumsum(0.1 * draw[1], axis=-2),
        velocity=draw[2],
        noise=draw[3],
    )


def at(run, tick):
    return Signal(*(leaf[..., tick, :] for leaf in run))


def play(effect, params, run):
    """Targets [..., T, J] that leave an effect, in numpy."""
    state, out = effect.init(params, at(run, 0)), []
    for tick in range(run.target.shape[-2]):
        state, signal = effect.apply(params, state, at(run, tick))
        out.append(signal.target)
    return np.stack(out, axis=-2)


def scan(effect, params, run):
    """The same for one robot in jax; differentiable in params."""

    def step(state, signal):
        state, signal = effect.apply(params, state, signal)
        return state, signal.target

    run = jax.tree.map(jnp.asarray, run)
    return jax.lax.scan(step, effect.init(params, at(run, 0)), run)[1]


# Laws of the family


@drives
def test_the_neutral_value_changes_nothing(name):
    run = signals()
    out = play(build(name), np.full(JOINTS, CATALOGUE[name].neutral), run)
    np.testing.assert_allclose(out, run.target, rtol=0, atol=1e-12)


@drives
def test_a_typical_value_changes_something(name):
    run = signals()
    assert np.abs(play(build(name), typical(name), run) - run.target).max() > 1e-3


@drives
def test_only_the_target_changes(name):
    effect, run = build(name), signals()
    state = effect.init(typical(name), at(run, 0))
    _, out = effect.apply(typical(name), state, at(run, 1))
    for field in ("angle", "velocity", "noise"):
        np.testing.assert_array_equal(getattr(out, field), getattr(at(run, 1), field))


@drives
def test_numpy_and_jax_agree(name):
    run, params = signals(), typical(name)
    compiled = jax.jit(lambda p: scan(build(name), p, run))(jnp.asarray(params))
    expected = play(build(name), params, run)
    np.testing.assert_allclose(np.asarray(compiled), expected, rtol=0, atol=1e-12)


@drives
@pytest.mark.parametrize("own", [False, True], ids=["shared", "own"])
def test_a_batch_equals_one_by_one(name, own):
    """Leading axes of the signal, and of the parameters where robots differ."""
    run, effect = signals(shape=(4,)), build(name)
    scale = np.linspace(0.6, 1.0, 4)[:, None] if own else np.ones((4, 1))
    params = scale * typical(name)
    batch = play(effect, params if own else typical(name), run)
    for row in range(4):
        alone = play(effect, params[row], Signal(*(leaf[row] for leaf in run)))
        np.testing.assert_allclose(batch[row], alone, rtol=0, atol=1e-13)


@drives
def test_a_scalar_parameter_holds_for_every_joint(name):
    run, effect, value = signals(), build(name), typical(name)[0]
    each = play(effect, np.full(JOINTS, value), run)
    np.testing.assert_allclose(play(effect, value, run), each, rtol=0, atol=1e-13)


@drives
def test_what_starts_at_rest_stays_at_rest(name):
    rest = np.broadcast_to([0.3, -0.2, 0.7], (TICKS, JOINTS))
    run = Signal(rest, rest, 0.0 * rest, 0.0 * rest)
    out = play(build(name), typical(name), run)
    elsewhere = name in ("encoder_offset", "encoder_scale", "command_quantization")
    expected = out[:1] if elsewhere else rest
    np.testing.assert_allclose(out - expected, 0.0, rtol=0, atol=1e-13)


@drives
def test_the_past_does_not_depend_on_the_future(name):
    run, when = signals(), 20
    other = jax.tree.map(lambda leaf: leaf.copy(), run)
    for leaf in other:
        leaf[when:] += 0.5
    before, after = (play(build(name), typical(name), each) for each in (run, other))
    np.testing.assert_array_equal(before[:when], after[:when])
    assert np.abs(before[when:] - after[when:]).max() > 0.1


def test_a_chain_of_neutrals_is_neutral():
    everything = chain(**{name: build(name) for name in DRIVE})
    neutral = {name: np.full(JOINTS, CATALOGUE[name].neutral) for name in DRIVE}
    run = signals()
    out = play(everything, neutral, run)
    np.testing.assert_allclose(out, run.target, rtol=0, atol=1e-12)


def test_a_chain_without_parts_is_nothing():
    run = signals()
    np.testing.assert_array_equal(play(chain(), {}, run), run.target)


def test_a_chain_applies_its_parts_in_order():
    first, second = drive.dead_band(), drive.lag(PERIOD)
    band, tau = np.full(JOINTS, 0.05), np.full(JOINTS, 0.02)
    run = signals()
    together = play(chain(a=first, b=second), {"a": band, "b": tau}, run)
    between = run._replace(target=play(first, band, run))
    np.testing.assert_array_equal(together, play(second, tau, between))
    swapped = play(chain(b=second, a=first), {"a": band, "b": tau}, run)
    assert np.abs(together - swapped).max() > 1e-3


def test_a_chain_rests_from_the_first_tick():
    """A lag after an offset starts at the offset target, not at the bare one."""
    offset = Effect(
        init=lambda params, signal: (),
        apply=lambda params, state, signal: (
            state, signal._replace(target=signal.target + params),
        ),
    )  # fmt: skip
    rest = np.zeros((TICKS, JOINTS))
    both = chain(offset=offset, lag=drive.lag(PERIOD))
    params = {"offset": np.full(JOINTS, 0.2), "lag": np.full(JOINTS, 0.1)}
    out = play(both, params, Signal(rest, rest, rest, rest))
    np.testing.assert_allclose(out, 0.2, rtol=0, atol=1e-13)


# Gradients


def weighed(name, period=PERIOD, seed=0):
    """A scalar function of one parameter [J] of an effect, with a restless input."""
    run = signals(seed)
    weights = jnp.asarray(np.random.default_rng(9).normal(size=run.target.shape))
    effect = build(name, period)
    return jax.jit(lambda params: (weights * scan(effect, params, run)).sum())


def forward_difference(function, params, step=1e-7):
    """One-sided slopes, because people start at values that are a kink."""
    base = function(params)
    each = step * jnp.eye(JOINTS)
    return jnp.stack([(function(params + row) - base) / step for row in each])


@pytest.mark.parametrize("name", SMOOTH)
def test_gradients_equal_finite_differences(name):
    function, params = weighed(name), jnp.asarray(typical(name))
    slope = forward_difference(function, params)
    np.testing.assert_allclose(jax.grad(function)(params), slope, rtol=1e-5, atol=1e-5)
    # A delay far from the signal's kinks, a lag, ... always has a slope.
    assert float(jnp.abs(slope).max()) > 1e-4


@drives
def test_gradients_are_finite_at_the_neutral_value(name):
    neutral = jnp.full(JOINTS, CATALOGUE[name].neutral)
    assert np.isfinite(jax.grad(weighed(name))(neutral)).all()


@pytest.mark.parametrize("name", ["command_delay", "dead_band"])
def test_gradients_are_right_where_a_fit_begins(name):
    """At 0, the neutral value, only the slope towards larger values makes sense."""
    function, zero = weighed(name), jnp.zeros(JOINTS)
    slope = forward_difference(function, zero)
    np.testing.assert_allclose(jax.grad(function)(zero), slope, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("period", [0.02, 0.004])
@pytest.mark.parametrize("seconds", [0.02, 0.04])
def test_the_delays_gradient_is_right_at_whole_calls(period, seconds):
    function = weighed("command_delay", period)
    params = jnp.full(JOINTS, seconds)
    slope = forward_difference(function, params)
    np.testing.assert_allclose(jax.grad(function)(params), slope, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("seconds", [0.0, 0.02, 0.03, 0.04, 0.1])
def test_a_delayed_ramp_has_the_same_slope_at_every_delay(seconds):
    time = 0.02 * np.arange(20.0)[:, None] * np.ones(JOINTS)
    run = Signal(3.0 * time, time, time, time)

    def last(params):
        return scan(drive.delay(0.02, 0.1), params, run)[-1].sum()

    slope = jax.grad(last)(jnp.full(JOINTS, seconds))
    np.testing.assert_allclose(slope, -3.0, rtol=0, atol=1e-9)


# What each effect is


def targets(values):
    """A run in which only the target moves, [T] -> [T, 1]."""
    values = np.asarray(values, float)[:, None]
    return Signal(values, 0.0 * values, 0.0 * values, 0.0 * values)


@pytest.mark.parametrize("seconds", [0.0, 0.02, 0.0137, 0.036, 0.0999, 0.1])
@pytest.mark.parametrize("period", [0.02, 0.004])
def test_delay_shifts_a_ramp_by_exactly_the_delay(seconds, period):
    time = period * np.arange(60)
    out = play(drive.delay(period, 0.1), np.array([seconds]), targets(2.0 * time))
    settled = time >= 0.1 + period
    expected = 2.0 * (time[settled] - seconds)
    np.testing.assert_allclose(out[settled, 0], expected, rtol=0, atol=1e-12)


def test_delay_holds_its_first_target_until_it_has_passed():
    out = play(drive.delay(0.02, 0.1), np.array([0.06]), targets([0, 1, 1, 1, 1, 1]))
    np.testing.assert_allclose(out[:, 0], [0, 0, 0, 0, 1, 1], atol=1e-12)


@pytest.mark.parametrize("tau", [0.02, 0.1])
def test_lag_covers_63_percent_of_a_step_after_its_time_constant(tau):
    steps = np.concatenate([[0.0], np.ones(80)])
    out = play(drive.lag(PERIOD), np.array([tau]), targets(steps))
    time = PERIOD * np.arange(81)
    np.testing.assert_allclose(out[:, 0], 1.0 - np.exp(-time / tau), atol=1e-12)
    assert out[round(tau / PERIOD), 0] == pytest.approx(0.632, abs=1e-3)


def test_speed_limit_is_reached_and_never_exceeded():
    limit = np.array([4.5])
    run = targets(np.concatenate([[0.0], np.ones(70), -np.ones(150)]))
    out = play(drive.speed_limit(PERIOD), limit, run)[:, 0]
    speed = np.abs(np.diff(out)) / PERIOD
    assert speed.max() == pytest.approx(4.5, rel=1e-9)
    assert out[70] == pytest.approx(1.0)  # and it arrives
    assert out[-1] == pytest.approx(-1.0)
    assert np.abs(out).max() <= 1.0


def test_quantization_rounds_to_the_nearest_step():
    run = targets([0.0, 0.049, 0.051, -0.049, -0.051, 0.31])
    out = play(drive.quantization(), np.array([0.1]), run)[:, 0]
    np.testing.assert_allclose(out, [0.0, 0.0, 0.1, 0.0, -0.1, 0.3], atol=1e-12)


def test_losses_have_their_share_come_in_bursts_and_hold_the_last_target():
    ticks = 40_000
    drawn = np.random.default_rng(5).normal(size=(ticks, 1))
    count = np.arange(1.0, ticks + 1.0)[:, None]
    params = {"probability": np.array([0.1]), "burst": np.array([4.0])}
    out = play(drive.loss(), params, Signal(count, count, count, drawn))[:, 0]
    lost = out < count[:, 0]
    assert lost.mean() == pytest.approx(0.1, abs=0.01)
    begins = (lost[1:] & ~lost[:-1]).sum()
    assert lost.sum() / begins == pytest.approx(4.0, rel=0.1)
    held = np.maximum.accumulate(np.where(lost, 0.0, count[:, 0]))
    np.testing.assert_array_equal(out, held)


@pytest.mark.parametrize(("share", "burst"), [(0.7, 2.0), (0.9, 2.0), (0.5, 1.0)])
def test_a_great_share_of_targets_is_lost_whatever_the_burst(share, burst):
    drawn = np.random.default_rng(5).normal(size=(20_000, 1))
    count = np.arange(1.0, 20_001.0)[:, None]
    params = {"probability": np.array([share]), "burst": np.array([burst])}
    out = play(drive.loss(), params, Signal(count, count, count, drawn))
    assert (out < count).mean() == pytest.approx(share, abs=0.02)


@pytest.mark.parametrize(
    ("share", "alike"), [([0.3, 0.3, 0.3], True), ([0.3, 0.3, 0.0], False),
                         ([0.3, 0.2, 0.3], False)],
)  # fmt: skip
def test_a_message_that_is_lost_is_lost_to_all_joints(share, alike):
    """Where some joints lose targets, or each its own share, each draws by itself."""
    count = np.arange(1.0, 501.0)[:, None] + np.zeros(3)
    drawn = np.random.default_rng(6).normal(size=count.shape)
    params = {"probability": np.array(share), "burst": np.full(3, 2.0)}
    out = play(drive.loss(), params, Signal(count, count, count, drawn))
    lost = out < count
    np.testing.assert_allclose(lost.mean(0), share, atol=0.08)
    assert (lost[:, 0] == lost[:, 1]).all() == alike


def test_draws_can_tell_which_targets_are_lost():
    draw = np.array([0.0, -9.0, -9.0, 0.0, 9.0, -9.0])[:, None]
    count = np.arange(6.0)[:, None]
    params = {"probability": np.array([0.05]), "burst": np.array([2.0])}
    out = play(drive.loss(), params, Signal(count, count, count, draw))[:, 0]
    np.testing.assert_array_equal(out, [0.0, 0.0, 0.0, 3.0, 4.0, 4.0])


def test_dead_band_ignores_small_errors_and_shortens_large_ones():
    target = np.array([0.14, 0.16, 0.06, 0.04, 0.1])
    signal = Signal(target, np.full(5, 0.1), np.zeros(5), np.zeros(5))
    _, out = drive.dead_band().apply(np.full(5, 0.05), (), signal)
    np.testing.assert_allclose(out.target, [0.1, 0.11, 0.1, 0.09, 0.1], atol=1e-15)


def test_noise_has_its_deviation_and_no_mean():
    draw = np.random.default_rng(1).normal(size=(20000, 2))
    still = np.zeros_like(draw)
    signal = Signal(still + 0.4, still, still, draw)
    _, out = drive.noise().apply(np.array([0.01, 0.05]), (), signal)
    # 20,000 draws know a deviation to 0.5 %.
    np.testing.assert_allclose(out.target.std(0), [0.01, 0.05], rtol=0.02)
    np.testing.assert_allclose(out.target.mean(0), 0.4, rtol=0, atol=0.002)


def readings(seed):
    draw = np.random.default_rng(seed)
    return Reading(*(draw.normal(size=(5000, size)) for size in (4, 3, 3, 8)))


def test_sensor_noise_is_a_share_of_the_force_and_adds_to_the_rest():
    reading, draw = readings(0), readings(1)
    reading.force[:, 2] = 0.0
    params = Reading(angle=0.01, gyro=0.02, accelerometer=0.3, force=0.05)
    _, out = sensor.noise().apply(params, (), Sensed(reading, draw))
    for field in ("angle", "gyro", "accelerometer"):
        added = getattr(out.reading, field) - getattr(reading, field)
        assert added.std() == pytest.approx(getattr(params, field), rel=0.05)
    assert (out.reading.force[:, 2] == 0.0).all()  # a foot in the air
    loaded = np.abs(reading.force) > 0.0
    share = out.reading.force[loaded] / reading.force[loaded] - 1.0
    assert share.std() == pytest.approx(0.05, rel=0.05)


def test_sensor_noise_of_zero_is_neutral_and_jax_equals_numpy():
    signal = Sensed(readings(0), readings(1))
    _, out = sensor.noise().apply(Reading(0.0, 0.0, 0.0, 0.0), (), signal)
    for got, given in zip(out.reading, signal.reading, strict=True):
        np.testing.assert_array_equal(got, given)
    params = Reading(0.01, 0.02, 0.3, 0.05)
    _, plain = sensor.noise().apply(params, (), signal)
    _, other = sensor.noise().apply(params, (), jax.tree.map(jnp.asarray, signal))
    for ours, theirs in zip(plain.reading, other.reading, strict=True):
        np.testing.assert_allclose(np.asarray(theirs), ours, rtol=0, atol=1e-14)


# Body effects: two hinges that don't feel each other, 0.02 kg m^2 each

WHEEL = """
<mujoco><option timestep="0.0002" gravity="0 0 0" integrator="implicitfast"/>
  <worldbody>{wheels}</worldbody><actuator>{motors}</actuator></mujoco>"""
INERTIA, GAIN = 0.02, 5.0


def wheels(motor='<position joint="{name}" kp="5" forcerange="-3 3"/>'):
    link = (
        '<body pos="{x} 0 0"><joint name="{name}" axis="0 0 1"/>'
        '<inertial pos="0 0 0" mass="1" diaginertia="0.02 0.02 0.02"/></body>'
    )
    names = ("a", "b")
    text = WHEEL.format(
        wheels="".join(link.format(name=name, x=x) for x, name in enumerate(names)),
        motors="".join(motor.format(name=name) for name in names),
    )
    return mujoco.MjModel.from_xml_string(text)


def spin(model, fields, seconds, velocity=0.0, target=0.0, load=0.0):
    """Speeds [T, 2] and motor torques [T, 2] of the wheels, and where they end."""
    for field, value in fields.items():
        getattr(model, field)[...] = value
    data = mujoco.MjData(model)
    data.qvel[:], data.ctrl[:], data.qfrc_applied[:] = velocity, target, load
    speeds, torques = [], []
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
        speeds.append(data.qvel.copy())
        torques.append(data.actuator_force.copy())
    return np.array(speeds), np.array(torques), data.qpos.copy()


def wheels_params(name, value):
    """What the first part of a cause takes, alike at both wheels."""
    entry = CATALOGUE[name]
    values = complete(name, entry, {entry.main.name: value})
    return spread(entry, entry.parts[0], ("a", "b"), ["all"], values)


@bodies
def test_a_neutral_body_effect_leaves_every_field_as_it_is(name):
    model, entry = wheels(), CATALOGUE[name]
    fields = entry.parts[0].build(model, {}, wheels_params(name, entry.neutral))
    assert fields
    for field, value in fields.items():
        np.testing.assert_array_equal(value, getattr(model, field), err_msg=field)


@bodies
def test_a_body_effect_writes_neither_the_model_nor_its_input(name):
    model, entry = wheels(), CATALOGUE[name]
    model.actuator_biasprm[:, 2] = -0.1
    change, size = entry.parts[0].build, min(0.05 * entry.main.high, 1.5)
    once = change(model, {}, wheels_params(name, size))
    before = {field: np.array(value) for field, value in once.items()}
    kept = {field: np.array(getattr(model, field)) for field in once}
    twice = change(model, once, wheels_params(name, 0.5 * size))
    for field, value in before.items():
        np.testing.assert_array_equal(once[field], value)
        np.testing.assert_array_equal(getattr(model, field), kept[field])
        same = field in ("dof_solimp", "dof_solref")  # no more than still
        assert same or (np.abs(twice[field] - value) > 1e-9).any()


def test_body_effects_compose_with_each_other():
    model, two = wheels(), np.ones(2)
    fields = body.gain_error(model, body.gain_error(model, {}, 0.5 * two), 3.0 * two)
    np.testing.assert_allclose(fields["actuator_gainprm"][:, 0], 1.5 * GAIN)
    np.testing.assert_allclose(fields["actuator_biasprm"][:, 1], -1.5 * GAIN)
    for limit in (2.0, 2.5):
        params = {"limit": limit * two, "raised": 0.0 * two}
        fields = body.torque_limit(model, fields, params)
    np.testing.assert_allclose(fields["actuator_forcerange"], [[-2.0, 2.0]] * 2)
    fields = body.viscous_friction(model, fields, 0.1 * two)
    fields = body.viscous_friction(model, fields, 0.2 * two)
    np.testing.assert_allclose(fields["dof_damping"], 0.3)
    assert set(fields) == {
        "actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "dof_damping",
    }  # fmt: skip


def test_torque_limit_limits_what_the_servo_pulls_with():
    model = wheels()
    params = {"limit": np.array([0.5, np.inf]), "raised": np.zeros(2)}
    fields = body.torque_limit(model, {}, params)
    speeds, torques, _ = spin(model, fields, 0.05, target=1.0)
    assert np.abs(torques[:, 0]).max() == pytest.approx(0.5, abs=1e-12)
    assert torques[0, 1] == pytest.approx(3.0)  # the motor's own limit stays
    assert speeds[-1, 0] == pytest.approx(0.5 / INERTIA * 0.05, rel=1e-6)


def test_a_servo_may_be_stronger_than_its_model_says():
    params = {"limit": np.array([3.5, np.inf]), "raised": np.array([1.0, 1.0])}
    fields = body.torque_limit(wheels(), {}, params)
    expected = [[-3.5, 3.5], [-3.0, 3.0]]  # no limit is neutral, whatever is raised
    np.testing.assert_allclose(fields["actuator_forcerange"], expected)


def test_viscous_friction_slows_a_wheel_down_exponentially():
    model = wheels('<motor joint="{name}"/>')
    fields = body.viscous_friction(model, {}, np.array([0.05, 0.0]))
    speeds, _, _ = spin(model, fields, 0.4, velocity=3.0)
    expected = 3.0 * np.exp(-0.05 * 0.4 / INERTIA)
    assert speeds[-1, 0] == pytest.approx(expected, rel=1e-3)  # first-order stepping
    assert speeds[-1, 1] == pytest.approx(3.0, rel=1e-12)


def test_coulomb_friction_slows_a_wheel_down_linearly_and_stops_it():
    model = wheels('<motor joint="{name}"/>')
    fields = body.coulomb_friction(model, {}, np.array([0.1, 0.0]))
    speeds, _, _ = spin(model, fields, 1.0, velocity=3.0)
    time = model.opt.timestep * np.arange(1, len(speeds) + 1)
    expected = np.maximum(3.0 - 0.1 / INERTIA * time, 0.0)  # it stops after 0.6 s
    np.testing.assert_allclose(speeds[:, 0], expected, rtol=0, atol=2e-3)
    assert abs(speeds[-1, 0]) < 1e-6
    assert speeds[-1, 1] == pytest.approx(3.0, rel=1e-12)


def test_coulomb_friction_holds_a_wheel_against_a_smaller_torque():
    model = wheels('<motor joint="{name}"/>')
    fields = body.coulomb_friction(model, {}, np.array([0.1, 0.1]))
    speeds, _, _ = spin(model, fields, 0.5, load=np.array([0.08, 0.15]))
    assert abs(speeds[-1, 0]) < 1e-6  # it does not creep
    assert speeds[-1, 1] == pytest.approx((0.15 - 0.1) / INERTIA * 0.5, rel=0.02)


def test_gain_error_changes_how_far_a_servo_gives_way():
    model = wheels()
    model.dof_damping[:] = 0.6  # near critical, so that it settles
    fields = body.gain_error(model, {}, np.array([0.5, 1.0]))
    _, _, angle = spin(model, fields, 4.0, load=0.1)
    np.testing.assert_allclose(angle, [0.1 / (0.5 * GAIN), 0.1 / GAIN], rtol=1e-4)


# The catalogue


SLOTS = {"command", "motor", "joint", "gear", "sensor", "body", "log"}


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_entries_are_complete(name):
    entry = CATALOGUE[name]
    names = [each.name for each in entry.parameters]
    assert len(set(names)) == len(names) and set(entry.direction) <= set(names)
    for part in entry.parts:
        assert part.slot in SLOTS and part.takes and set(part.takes) <= set(names)
        assert part.variant is None or part.variant[0] in names
    for each in entry.parameters:
        assert each.low < each.high and each.unit
        given = each.default is not None and np.isfinite(each.default)
        assert (
            not given
            or each.name in entry.direction
            or (each.low <= each.default <= each.high)
        )
    assert entry.main.default is None
    assert not np.isfinite(entry.neutral) or (
        entry.main.low <= entry.neutral <= entry.main.high
    )
    assert all((entry.equation, entry.source))
    assert entry.place in {"joint", "all", "imu", "ground", "foot"}
    assert cause(name) is entry


def test_an_unknown_cause_is_named_with_those_that_exist():
    with pytest.raises(ValueError, match=r"'gremlin' is unknown; .*'backlash'"):
        cause("gremlin")


JOINTWISE = sorted(n for n, e in CATALOGUE.items() if e.place == "joint")


@pytest.mark.parametrize("name", JOINTWISE)
def test_a_cause_at_one_joint_is_neutral_at_the_others(name):
    world, entry = nominal(), CATALOGUE[name]
    names = joint_names(world.model)
    main = entry.main
    value = max(0.9 * main.low + 0.1 * main.high, 0.01)
    changed = add_cause(world, name, ["RKneePitch"], value)
    here = np.array(names) == "RKneePitch"
    for slot in ("command", "motor", "sensor"):
        for key, params in getattr(changed.values, slot).items():
            if key == "noise":
                continue
            params = params[main.name] if isinstance(params, dict) else params
            np.testing.assert_array_equal(params, np.where(here, value, entry.neutral))
    knee, body_of = world.model.joint("RKneePitch"), world.model.jnt_bodyid
    moved = {knee.dofadr[0], names.index("RKneePitch"), body_of[knee.id]}
    for field, new in changed.values.body.items():
        old = getattr(world.model, field)
        rows = set(np.flatnonzero((new != old).reshape(len(old), -1).any(1)))
        derived = field in derived_fields.CONSTANTS
        assert derived or rows <= moved, field
