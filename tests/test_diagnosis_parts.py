"""Pieces of the diagnosis that have an answer on paper."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from test_diagnosis_plant import joint, wave

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import (
    accepting,
    bank,
    drops,
    lost,
    motion,
    noise,
    outage,
    patterns,
    quantum,
    ripple,
)
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.aliases import UPSIDE_DOWN
from gatjax.diagnosis.assembly import TRANSPORT
from gatjax.diagnosis.case import Case
from gatjax.diagnosis.claims import (
    PLACE,
    PRICE,
    Claim,
    occam,
    price,
    shared_value,
    uncertainty,
)
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import (
    COUNT,
    Hypothesis,
    combined,
    information,
    numbers,
    pinned,
)
from gatjax.diagnosis.joint import GRAVITY, STEP
from gatjax.diagnosis.known import Known
from gatjax.diagnosis.loads import tilted
from gatjax.diagnosis.pruning import pruned
from gatjax.effects.body import gravity_tilt
from gatjax.effects.catalogue import CATALOGUE


def by_cause(name):
    return next(h for h in bank.CAUSES if h.cause == name)


def test_every_hypothesis_names_a_cause_of_the_catalogue_and_starts_inside():
    for hypothesis in bank.CAUSES:
        assert hypothesis.cause in CATALOGUE
        for start in hypothesis.starts:
            assert np.all(np.array(start) >= hypothesis.low), hypothesis.name
            assert np.all(np.array(start) <= hypothesis.high), hypothesis.name
    assert all(not hypothesis.cause for hypothesis in bank.OTHERS)


def test_all_causes_that_a_joint_can_show_are_in_the_bank():
    floor = {
        "imu_misalignment",
        "ground_friction",
        "ground_compliance",
        "sole_geometry",
    }
    known = {h.cause for h in bank.CAUSES} | {"dropped_commands"}
    assert known == set(CATALOGUE) - floor - {"command_noise", "current_limit"}


def test_two_causes_keep_their_own_coordinates():
    lag, offset = by_cause("first_order_lag"), by_cause("encoder_scale")
    both = combined(lag, offset)
    drive: dict = {}
    one = joint(wave)
    both.put(drive, one, np.array([np.log(0.03), 0.1]))
    assert drive["lag"] == pytest.approx(0.03)
    assert drive["scale"] == pytest.approx(1.1)
    assert both.parts == (lag, offset)
    assert len(information(both)) == COUNT + 2
    fixed = pinned(lag, np.array([np.log(0.05)]))
    fixed.put(drive, one, np.zeros(0))
    assert drive["lag"] == pytest.approx(0.05) and fixed.low == ()


def test_cells_hold_a_command_until_the_next_stamp():
    time = np.array([0.0, 0.1, 0.25])
    command = np.array([[1.0], [3.0], [2.0]])
    grid = np.arange(-5, 40) * 0.01
    mean = motion.cells(time, command, grid)[:, 0]
    assert mean[:15] == pytest.approx(1.0)
    assert mean[15:30] == pytest.approx(3.0)
    assert mean[30:] == pytest.approx(2.0)
    shifted = motion.cells(time + 0.005, command, grid)[:, 0]
    assert shifted[15] == pytest.approx(2.0)  # half a step of each


def test_a_joint_at_rest_has_the_rounding_error_of_its_encoder():
    time, step = 0.01 * np.arange(400), 0.002
    angle = step * np.round(0.3 * np.sin(2.0 * time) / step)[:, None]
    moving = JointRun(0, time, angle, angle)
    resting = moving._replace(angle=np.zeros_like(angle))
    assert noise.noise_of([moving, resting])[0] > 0.99 * step / np.sqrt(12.0)
    assert noise.noise_of([resting])[0] == 1e-5  # nothing tells its encoder


def test_a_joint_that_never_moves_by_a_step_has_the_noise_of_one_that_does():
    time, step = 0.01 * np.arange(400), 0.002
    swung = step * np.round(0.3 * np.sin(2.0 * time) / step)
    angle = np.stack([swung, 0.0 * time, 0.5 * swung], -1)
    found = noise.of_joints([JointRun(0, time, angle, angle)])
    assert found[1] == pytest.approx(found[[0, 2]].min())


@pytest.mark.parametrize(("neighbours", "expected"), [(2, 7e-4), (0, None)])
def test_a_joint_that_hunts_has_the_noise_of_those_that_do_not(neighbours, expected):
    rng, time = np.random.default_rng(0), 0.01 * np.arange(1000)
    bounces = 0.15 * np.abs((9.3 * time) % 1.0 - 0.5)  # between teeth, 9 Hz
    calm = 0.3 * np.sin(2.0 * time)
    angle = np.stack([bounces + calm, *[calm] * neighbours], -1)
    angle += 7e-4 * rng.normal(size=angle.shape)
    found = noise.of_joints([JointRun(0, time, angle, angle)])
    assert noise.noise_of([JointRun(0, time, angle, angle)])[0] > 1.5e-3
    assert found[0] == pytest.approx(expected or found[0], rel=0.2)
    assert expected or found[0] > 1.5e-3  # nobody to ask


@pytest.mark.parametrize("rows", [4, 7, 18, 22])
def test_runs_of_a_few_rows_have_noise(rows):
    rng = np.random.default_rng(0)
    few = 7e-4 * rng.normal(size=(rows, 2))
    many = 7e-4 * rng.normal(size=(200, 2))
    runs = [JointRun(0, 0.3 * np.arange(len(each)), each, each) for each in (few, many)]
    found = noise.of_joints(runs)
    assert (3e-4 < found).all() and (found < 1.2e-3).all()


def test_a_lively_motion_at_50_hz_is_no_noise():
    """Third differences alone tell 1.6 times as much."""
    time, rng = 0.02 * np.arange(1000), np.random.default_rng(2)
    rates = 2.0 * np.pi * np.array([0.31, 1.1, 2.3, 3.1])
    moved = np.sin(np.outer(time, rates)) @ np.array([0.4, 0.2, 0.1, 0.1])
    angle = (moved + 7e-4 * rng.normal(size=1000))[:, None]
    found = noise.of_joints([JointRun(0, time, angle, angle)])
    assert found[0] == pytest.approx(7e-4, rel=0.25)


def test_a_joint_of_a_noisier_encoder_keeps_its_noise():
    rng, time = np.random.default_rng(0), 0.01 * np.arange(1000)
    calm = 0.3 * np.sin(2.0 * time)
    swings = np.exp(-8.0 * (time % 1.57)) * np.sin(60.0 * time)  # rings now and then
    angle = np.stack([calm + 0.5 * swings, calm, calm], -1)
    angle += np.array([3e-3, 7e-4, 7e-4]) * rng.normal(size=angle.shape)
    found = noise.of_joints([JointRun(0, time, angle, angle)])
    assert found[0] > 2.5e-3


def test_rows_of_a_fast_log_within_a_tenth_of_a_second_count_as_one():
    one = joint(wave)
    fast = one._replace(
        time=np.arange(0.0, 2.5, 0.002)[None], valid=np.ones((1, 1250), bool)
    )
    usual = fits.INFLATION * one.noise
    assert fits.spread(one) == pytest.approx(np.sqrt(10.0) * one.noise)
    assert fits.spread(fast) == pytest.approx(np.sqrt(50.0) * one.noise)
    slow = one._replace(time=5.0 * one.time)
    assert fits.spread(slow) == pytest.approx(usual)


def test_gravity_of_a_tilted_mounting():
    down = np.array([0.0, 0.0, -9.81])
    assert tilted(down, np.zeros(2)) == pytest.approx(down)
    for angles in ([0.3, 0.0], [0.0, 0.3]):
        turned = tilted(down, np.array(angles))
        assert np.linalg.norm(turned) == pytest.approx(9.81)
        assert turned[2] == pytest.approx(-9.81 * np.cos(0.3))


def test_a_tilt_about_two_axes_is_that_of_the_catalogue():
    model = SimpleNamespace(opt=SimpleNamespace(gravity=np.array([0.0, 0.0, -9.81])))
    params = {"roll": np.array(0.2), "pitch": np.array(-0.3)}
    expected = gravity_tilt(model, {}, params)["opt.gravity"]
    assert tilted(model.opt.gravity, np.array([0.2, -0.3])) == pytest.approx(expected)


@pytest.mark.parametrize("variant", ["", UPSIDE_DOWN])
@pytest.mark.parametrize("size", [(0.0, 0.0), (0.3, -0.2), (-0.1, 0.2)])
@pytest.mark.parametrize("was", [(0.0, 0.0, -9.81), (9.81, 0.0, 0.0), (0.0, -9.6, 2.0)])
def test_a_joint_feels_the_gravity_that_its_tilt_says(variant, size, was):
    (tilt,) = (h for h in bank.CAUSES if h.law == ("gravity_tilt", variant))
    one, gravity = joint(wave), np.array(was)
    one = one._replace(nominal=one.nominal | dict(zip(GRAVITY, was, strict=True)))
    drive = {}
    tilt.put(drive, one, np.array(size))
    said = tilt.values(one, np.array(size))
    params = {name: np.array(said[name]) for name in ("roll", "pitch")}
    model = SimpleNamespace(opt=SimpleNamespace(gravity=gravity))
    felt = gravity_tilt(model, {}, params)["opt.gravity"]
    assert np.array(list(drive.values())) == pytest.approx(felt - gravity)
    assert np.sign(felt @ gravity) == (-1.0 if variant else 1.0)
    assert np.linalg.norm(felt + gravity if variant else felt - gravity) < 4.0
    for parameter in CATALOGUE["gravity_tilt"].parameters:
        assert parameter.low <= said[parameter.name] <= parameter.high


def losing(rng, lost, drive=None):
    """A noisy joint [1, 250] whose servo misses lost commands [250], and commands."""
    bare = joint(wave)
    command = np.array([wave(t) for t in bare.time[0]])
    held = drops.with_commands(bare, [command], [lost])
    angle = held.simulate([drive or {}], False)[..., 0]
    return bare._replace(measured=angle + rng.normal(0.0, 7e-4, (1, 250))), command


def often(rng, share):
    """Lost commands [250], this share of them, but for the first one."""
    lost = rng.uniform(size=250) < share
    lost[0] = False
    return lost


@pytest.mark.parametrize("share", [0.03, 0.2, 0.5])
def test_lost_targets_are_found_in_the_motion_without_them(share):
    rng = np.random.default_rng(3)
    noisy, command = losing(rng, often(rng, share))
    known = fits.start(noisy, [(None, np.zeros(COUNT))])[0]
    found = drops.find(noisy, known, [command])
    assert known.rms() > 5.0 * noisy.noise and found.fit.rms() < 1.2 * noisy.noise
    told = patterns.statistics(found.lost, [command])
    assert told["probability"] == pytest.approx(share, abs=0.1)
    assert found.price == pytest.approx(patterns.length(found.lost) / 10.0)
    left = pruned(found, noisy, [command])
    assert patterns.length(left.lost) <= patterns.length(found.lost)
    told = patterns.statistics(left.lost, [command])
    assert told["probability"] == pytest.approx(share, abs=0.1)
    assert left.price == pytest.approx(patterns.length(left.lost) / 10.0)


def test_a_few_losses_are_told_from_many_that_explain_nothing():
    rng, lost = np.random.default_rng(3), np.zeros(250, bool)
    lost[[60, 61, 62, 63, 150, 151, 152]] = True
    noisy, command = losing(rng, lost)
    many = lost | (rng.uniform(size=len(lost)) < 0.15)
    many[[0, 59, 64, 149, 153]] = False  # the two bursts stand alone
    now = drops.with_commands(noisy, [command], [many])
    first = fits.start(now, [(drops.LOST, np.zeros(COUNT))])
    fit = fits.improve(now, first, 6)[0]
    found = drops.Losses([many], now, fit, drops.price(noisy, [command], [many]))
    left = pruned(found, noisy, [command])
    assert (left.lost[0] & ~lost).sum() <= 2 and (left.lost[0] & lost).sum() == 7
    assert left.fit.rms() < 1.1 * noisy.noise < 0.8 * fit.rms()


def test_losses_of_a_robot_off_its_nominal_numbers_need_another_start():
    rng = np.random.default_rng(0)  # from nominal numbers, 1.8 times the noise is left
    lost = often(rng, 0.35)
    drive = numbers(joint(wave), None, 1.2 * rng.normal(size=COUNT))
    noisy, command = losing(rng, lost, drive)
    known = fits.start(noisy, [(None, np.zeros(COUNT))])[0]
    found = drops.find(noisy, known, [command])
    assert found.fit.rms() < 1.3 * noisy.noise


def slowed(cause, own, seed, share):
    """A joint with a cause that loses commands, these, and its fit without losses."""
    rng, law = np.random.default_rng(seed), by_cause(cause)
    lost = often(rng, share)
    x = np.append(rng.normal(size=COUNT), own)
    noisy, command = losing(rng, lost, numbers(joint(wave), law, x))
    plain = fits.start(noisy, [(None, np.zeros(COUNT))])
    return noisy, command, fits.improve(noisy, plain, 12)[0]


def beside(noisy, known, cause):
    """The fit of a cause beside what is known about a joint."""
    law = by_cause(cause)
    begins = law.begins(noisy, known.residual)
    points = [(law, np.append(known.x, own)) for own in begins]
    found = fits.improve(noisy, fits.start(noisy, points), 8)
    return min(found, key=lambda fit: fit.cost)


def test_losses_are_found_beside_the_right_cause_only():
    noisy, command, plain = slowed("first_order_lag", np.log([0.06]), 0, 0.4)
    known = Known.__new__(Known)
    known.joints, known.known, known.accepted = [noisy], [plain], []
    known.case = Asked(command)
    lag, friction = (
        beside(noisy, plain, cause) for cause in ("first_order_lag", "coulomb_friction")
    )
    assert lag.rms() > 4.0 * noisy.noise
    nats, fit = lost.second(known, 0, noisy, lag)
    assert fit.rms() < 1.3 * noisy.noise
    assert np.exp(fit.x[-1]) == pytest.approx(0.06, rel=0.1)
    paid = drops.heated(noisy, lag, [command]).price
    assert paid > 10.0 and nats == pytest.approx(known.score(0, fit) - paid - PLACE)
    assert lost.second(known, 0, noisy, friction) is None
    lossy = Claim(drops.LOST, np.zeros(0), (0,), {0: plain}, 9.0, lost={0: []})
    known.accepted = [lossy]
    assert lost.second(known, 0, noisy, lag) is None


def test_losses_of_a_drawn_joint_are_looked_for_from_what_it_tells_there(monkeypatch):
    noisy, command, _ = slowed("coulomb_friction", np.log([0.5]), 19, 0.6)
    drawn, friction = noisy.drawn(30.0), by_cause("coulomb_friction")
    begin = fits.start(drawn, [(friction, np.append(np.zeros(COUNT), np.log(0.5)))])
    known, seen = Known.__new__(Known), []
    known.joints, known.known, known.case = [drawn], begin, Asked(command)
    object.__setattr__(known.case, "pulled", {0: 30.0})

    def find(joint, base, commands, rival):
        seen.append((base.x, rival, "pull" in joint.nominal))
        return drops.Losses([np.zeros(250, bool)], joint, base, 0.0)

    monkeypatch.setattr(drops, "find", find)
    assert lost._decoded(known, 0, 1e-3) is None
    ((x, rival, pulled),) = seen
    assert x is begin[0].x and rival == np.inf and not pulled


def test_a_search_for_losses_that_is_stuck_goes_on_with_more_freedom(monkeypatch):
    noisy, command, plain = slowed("coulomb_friction", np.log([0.5]), 19, 0.6)
    friction = beside(noisy, plain, "coulomb_friction")
    left = drops.heated(noisy, friction, [command]).fit.rms()
    monkeypatch.setattr(drops, "HOTTER", ())
    assert left < 0.7 * drops.heated(noisy, friction, [command]).fit.rms()


def test_the_step_of_a_rounded_target_is_read_from_what_it_leaves():
    bare, rng = joint(wave), np.random.default_rng(3)
    command = np.array([wave(t) for t in bare.time[0]])
    bare = drops.with_commands(bare, [command], [np.zeros(len(command), bool)])
    angle = bare.simulate([{"quantum": 0.0371}], False)[..., 0]
    noisy = bare._replace(measured=angle + rng.normal(0.0, 7e-4, (1, 250)))
    left = fits.residuals(noisy, [(None, np.zeros(COUNT))])[:, 0]
    assert quantum.steps(noisy, left)[0] == pytest.approx(0.0371, rel=2e-3)


@pytest.mark.parametrize("cycles", [9.7, 17.3, 25.2, 37.5])
def test_the_rate_of_a_ripple_is_read_from_what_it_leaves(cycles):
    """Between the rates of the bank, 14 % apart, no slope leads to it."""
    bare, rng = joint(wave), np.random.default_rng(3)
    law = {"ripple": 0.25, "cycles": cycles, "ripple_phase": 1.0}
    angle = bare.simulate([law], False)[..., 0]
    path = np.interp(np.asarray(bare.grid.clock)[:, 0], bare.time[0], angle[0])
    noisy = bare._replace(
        measured=angle + rng.normal(0.0, 7e-4, (1, 250)),
        grid=bare.grid._replace(path=path[:, None]),
    )
    left = fits.residuals(noisy, [(None, np.zeros(COUNT))])[:, 0]
    assert ripple.rates(noisy, left)[0] == pytest.approx(cycles, abs=0.3)


@pytest.mark.parametrize("rate", [0.0, 31.0])
def test_what_a_tick_does_to_a_servo_is_what_its_simulation_says(rate):
    bare, tick = joint(wave), 0.01
    here = np.asarray(bare.grid.clock)[:, 0]
    pulse = (0.1 * ((here >= 0.0) & (here < tick)))[:, None].astype(np.float32)
    one = bare._replace(grid=bare.grid._replace(target=pulse)).drawn(rate)
    simulated = one.simulate([{}], False)[0, :35, 0] / 0.1
    answer = quantum._tick(one, tick)
    assert np.abs(answer - simulated).max() < 0.12 * np.abs(simulated).max()


def entropy(chance):
    return -chance * np.log(chance) - (1.0 - chance) * np.log(1.0 - chance)


def chain(count, begin, end, seed=5):
    """Losses in bursts, as they are drawn."""
    draws, lost = np.random.default_rng(seed).uniform(size=count), np.zeros(count, bool)
    for tick in range(1, count):
        chance = 1.0 - end if lost[tick - 1] else begin
        lost[tick] = draws[tick] < chance
    return lost


def test_a_pattern_of_losses_costs_the_entropy_of_its_bursts():
    count, begin, end = 20_000, 0.1, 0.3  # a quarter of them lost
    lost = chain(count, begin, end)
    share = begin / (begin + end)
    nats = count * ((1.0 - share) * entropy(begin) + share * entropy(end))
    assert patterns.length([lost]) == pytest.approx(nats, rel=0.03)
    assert patterns.chances([lost]) == pytest.approx((begin, end), rel=0.1)
    alone = np.random.default_rng(0).permutation(lost)  # as many, one by one
    assert patterns.length([alone]) == pytest.approx(count * entropy(share), rel=0.03)
    assert patterns.length([alone]) > 1.2 * patterns.length([lost])


@pytest.mark.parametrize(("begin", "end"), [(0.06, 0.33), (0.4, 0.6), (0.02, 0.33)])
def test_nine_in_ten_logs_hold_the_probability_of_a_loss_in_its_interval(begin, end):
    rng = np.random.default_rng(1)
    share, inside = begin / (begin + end), 0
    for seed in range(200):
        command = np.cumsum(rng.normal(size=1000))
        low, high = patterns.within([chain(1000, begin, end, seed)], [command])
        assert 0.0 <= low < high <= 1.0
        inside += low <= share <= high
    assert 170 <= inside <= 196  # 180, and three deviations of a binomial


def test_of_a_few_steps_every_one_tells_what_gets_lost():
    command = np.repeat(np.arange(12.0) ** 2, 50)  # larger and larger
    lost = np.zeros(600, bool)
    lost[[50, 51, 52, 100, 250, 251, 350]] = True  # four of eleven steps come late
    told = patterns.statistics([lost], [command])
    assert told == {"probability": pytest.approx(4 / 11), "burst": pytest.approx(7 / 4)}
    low, high = patterns.within([lost], [command])
    assert low < 0.25 and high > 0.5
    assert patterns.statistics([lost], [np.zeros(600)])["probability"] == 0.0


def test_losses_of_a_motion_that_lost_nothing_are_not_worth_their_price():
    rng = np.random.default_rng(3)
    bare = joint(wave)
    command = np.array([wave(t) for t in bare.time[0]])
    angle = bare.simulate([{}], False)[..., 0] + rng.normal(0.0, 7e-4, (1, 250))
    quiet = bare._replace(measured=angle)
    known = fits.improve(quiet, fits.start(quiet, [(None, np.zeros(COUNT))]), 6)[0]
    found = drops.find(quiet, known, [command])
    gain = fits.evidence(quiet, found.fit) - fits.evidence(quiet, known)
    assert gain < found.price


def unpowered(joint, command, windows):
    """A joint whose motor has no power at some ticks [N] bool."""
    off = motion.cells(
        joint.time[0], np.where(windows, 1.0, 0.0)[:, None],
        (np.arange(len(joint.grid.target)) - joint.lead) * STEP,
    )  # fmt: skip
    plain = drops.with_commands(joint, [command], [np.zeros(len(command), bool)])
    return plain._replace(
        grid=plain.grid._replace(supply=jnp.asarray(off, jnp.float32))
    )


@pytest.mark.parametrize("powerless", [True, False])
def test_a_loss_of_power_is_no_loss_of_commands(powerless):
    rng, bare = np.random.default_rng(3), joint(wave, rest=0.3)
    bare = bare._replace(nominal=bare.nominal | {"delay": TRANSPORT})
    command = np.array([wave(t) for t in bare.time[0]])
    gone = np.zeros(len(command), bool)
    for first in (40, 97, 180):
        gone[first : first + 12] = True
    if powerless:
        played, drive = unpowered(bare, command, gone), {"sag": 1.0}
    else:
        played, drive = drops.with_commands(bare, [command], [gone]), {}
    angle = played.simulate([drive], False)[..., 0] + rng.normal(0.0, 7e-4, (1, 250))
    noisy = bare._replace(measured=angle)
    known = fits.start(noisy, [(None, np.zeros(COUNT))])[0]
    losses = drops.find(noisy, known, [command])
    limp = outage.outage(noisy, known, [command], losses)
    assert (limp.fit.rms() < losses.fit.rms()) == powerless
    if powerless:
        told = limp.fit.hypothesis.values(noisy, np.zeros(0))
        assert told == {"times": 3.0, "duration": pytest.approx(0.12, abs=0.02)}


def test_a_motor_that_always_had_power_keeps_a_window_to_be_refused():
    rng = np.random.default_rng(3)
    bare = joint(wave)
    command = np.array([wave(t) for t in bare.time[0]])
    bare = drops.with_commands(bare, [command], [np.zeros(len(command), bool)])
    angle = bare.simulate([{}], False)[..., 0] + rng.normal(0.0, 7e-4, (1, 250))
    noisy = bare._replace(measured=angle)
    known = fits.start(noisy, [(None, np.zeros(COUNT))])[0]
    burst = (np.arange(250) >= 100) & (np.arange(250) < 100 + outage.LONG)
    losses = drops.Losses([burst], noisy, known, 0.0)
    found = outage.outage(noisy, known, [command], losses)
    assert found.lost[0].any() and found.fit.cost > known.cost


def test_short_losses_are_no_loss_of_power():
    bare = joint(wave)
    gone = np.arange(250) % 10 < outage.LONG - 1
    losses = drops.Losses([gone], bare, fit_of(0.0, 1.0), 0.0)
    assert outage.outage(bare, fit_of(0.0, 1.0), [np.zeros(250)], losses) is None


def fit_of(value, information_of_it):
    square = np.eye(COUNT + 1)
    square[-1, -1] = information_of_it
    x = np.append(np.zeros(COUNT), value)
    return Fit(
        None, x, 100.0, np.zeros(100), np.zeros((100, COUNT + 1)), square, 0, True
    )


def test_joints_agree_on_a_value_by_their_information():
    found = [fit_of(1.0, 300.0), fit_of(2.0, 100.0)]
    free = Hypothesis("", "", None, (), (0.1,), (-3.0,), (3.0,), None)
    assert shared_value(found, free)[0] == pytest.approx(1.25, rel=1e-3)
    assert shared_value(found, free._replace(high=(1.1,)))[0] == 1.1
    alone, both = uncertainty(found[:1], 1), uncertainty(found, 1)
    assert both[0, 0] == pytest.approx(alone[0, 0] * 300.0 / 400.0)


def test_a_coordinate_costs_what_of_its_prior_it_rules_out():
    """Uniform over a width w, known to sigma: ln(w / (sigma sqrt(2 pi)))."""
    scale, own = by_cause("encoder_scale"), np.array([0.02])
    sharp = occam(scale, own, np.array([[1e-6]]))
    assert sharp == pytest.approx(np.log(0.8 / (1e-3 * np.sqrt(2.0 * np.pi))), rel=1e-3)
    assert occam(scale, own, np.array([[1e4]])) == PRICE  # the data say nothing
    shift, sure = by_cause("com_shift"), np.eye(3) * 1e-8
    near, far = (occam(shift, np.array([0.0, 0.0, z]), sure) for z in (0.01, 0.1))
    assert far - near == pytest.approx(0.5 * (3.0 / 0.17) ** 2 * (0.1**2 - 0.01**2))


def test_losses_that_change_nothing_do_not_count():
    rng = np.random.default_rng(0)
    command = np.sin(np.arange(2000) * 0.05)
    lost = rng.uniform(size=2000) < 0.3
    lost[np.abs(np.gradient(command)) < 0.03] = False  # not to be seen
    found = patterns.statistics([lost], [command])
    assert found["probability"] == pytest.approx(0.3, abs=0.04)
    assert found["burst"] == pytest.approx(1.0 / 0.7, abs=0.15)
    square = np.where(np.arange(2000) % 20 < 10, 0.5, 0.0)
    even = patterns.statistics([rng.uniform(size=2000) < 0.3], [square])
    assert even["probability"] == pytest.approx(0.3, abs=0.08)  # all changes are equal


def test_a_cause_of_a_fit_is_put_last_with_all_that_is_its_own():
    rows = [by_cause(name) for name in ("dead_band", "speed_limit", "gain_error")]
    owner, x = fits.put_together(
        np.arange(COUNT),
        [(h, 100.0 * n + np.arange(len(h.low))) for n, h in enumerate(rows)],
    )
    slopes = np.arange(3.0 * len(x)).reshape(3, -1)
    fit = Fit(owner, x, 1.0, np.zeros(3), slopes, slopes.T @ slopes, 1.0, True)
    moved = fits.with_last(fit, rows[0].cause)
    causes = [part.cause for part, _ in fits.parts_of(moved)]
    assert causes == [rows[1].cause, rows[2].cause, rows[0].cause]
    assert moved.x[-1] == 0.0 and sorted(moved.x) == sorted(x)
    np.testing.assert_array_equal(moved.slopes[:, -1], slopes[:, COUNT])
    np.testing.assert_allclose(moved.information, moved.slopes.T @ moved.slopes)


class Asked(Case):
    """A case of which no more is known than the commands."""

    def __init__(self, command):
        object.__setattr__(self, "given", command)

    def commands(self, index):
        return [self.given]


def test_a_value_that_joints_share_stays_when_it_is_looked_for_again():
    lag, own = by_cause("first_order_lag"), np.array([np.log(0.05)])
    one = joint(wave)
    angle = one.simulate([{"lag": 0.05}], False)[..., 0]
    known = Known.__new__(Known)
    known.case = Asked(np.zeros(1))
    known.joints = [one._replace(measured=angle, index=k) for k in range(2)]
    known.known = [fits.start(j, [(None, np.zeros(COUNT))])[0] for j in known.joints]
    alone = Claim(lag, own, (0,), {0: known.known[0]}, 10.0)
    both = alone._replace(where=(0, 1), fits=dict(enumerate(known.known)))
    for claim, count in ((alone, COUNT + 1), (both, COUNT)):
        found = known.refitted(claim)
        assert all(fit.rms() < one.noise for fit in found.fits.values())
        assert [len(fit.x) for fit in found.fits.values()] == [count] * len(claim.fits)


@pytest.mark.parametrize(("shake", "follows"), [(0.0, True), (0.02, False)])
def test_a_joint_is_followed_undrawn_where_one_cause_more_explains_it(
    monkeypatch, shake, follows
):
    lag = by_cause("first_order_lag")
    few = tuple(h for h in bank.CAUSES if h.cause in ("speed_limit", "gain_error"))
    monkeypatch.setattr(accepting, "CAUSES", few)
    one, own = joint(wave), np.array([np.log(0.05)])
    angle = one.simulate([{"lag": 0.05, "speed": 1.8}], False)[..., 0]
    angle = angle + shake * np.random.default_rng(0).normal(size=angle.shape)
    known = accepting.Accepting.__new__(accepting.Accepting)
    known.joints, known.accepted = [one._replace(measured=angle)], []
    first = fits.start(known.joints[0], [(lag, np.append(np.zeros(COUNT), own))])
    known.known = fits.improve(known.joints[0], first, 6)
    assert known.known[0].rms() > 5.0 * one.noise
    assert known._followed(0) is follows


def test_lost_commands_that_are_looked_at_alone_forget_what_was_known_beside_them():
    lag, bare = by_cause("first_order_lag"), joint(wave)
    command = np.array([wave(t) for t in bare.time[0]])
    gone = np.random.default_rng(3).uniform(size=250) < 0.2
    gone[0] = False
    angle = drops.with_commands(bare, [command], [gone]).simulate([{}], False)[..., 0]
    known = Known.__new__(Known)
    known.joints = [bare._replace(measured=angle)]
    known.known = [fits.start(known.joints[0], [(None, np.zeros(COUNT))])[0]]
    known.case = Asked(command)
    beside = fits.start(bare, [(combined(lag, drops.LOST), np.zeros(COUNT + 1))])[0]
    claim = Claim(drops.LOST, np.zeros(0), (0,), {0: beside}, 9.0, lost={0: [gone]})
    (alone,) = known.refitted(claim).fits.values()
    assert len(alone.x) == COUNT and alone.rms() < bare.noise


@pytest.mark.parametrize(("chance", "low", "high"), [
    (lambda change: 0.3, -3.0, patterns.SELECTIVE),  # on the way
    (lambda change: np.where(change < 0.01, 0.0, 0.3), -99.0, 0.0),  # and not all seen
    # and as a joint that sticks looks like
    (lambda change: np.where(change < 0.02, 0.6, 0.0), patterns.SELECTIVE, 99.0),
])  # fmt: skip
def test_losses_on_the_way_do_not_depend_on_what_is_lost(chance, low, high):
    rng = np.random.default_rng(1)
    command = np.sin(np.arange(1500) * 0.05)
    share = chance(np.abs(np.diff(command, prepend=command[0])))
    lost = rng.uniform(size=1500) < share
    assert low < patterns.selective([lost], [command]) < high


def bursts(share, rng, ticks=400, mean=4):
    """A mask with bursts of losses, a share of all ticks on average."""
    ends = rng.uniform(size=ticks) < 1.0 / mean
    begins = rng.uniform(size=ticks) < share / ((1.0 - share) * mean)
    mask = np.zeros(ticks, bool)
    for k in range(1, ticks):
        mask[k] = not ends[k] if mask[k - 1] else begins[k]
    return mask


def test_losses_on_the_way_do_not_depend_on_the_motion():
    rng = np.random.default_rng(2)
    fast, slow = (np.sin(np.arange(400) * each) for each in (0.3, 0.05))
    even = [
        patterns.evenly([bursts(0.2, rng), bursts(0.2, rng)], [fast, slow], 1e-3)
        for _ in range(100)
    ]
    assert np.mean(np.array(even) < 0.05) < 0.12
    assert min(even) > patterns.UNLIKELY
    apart = patterns.evenly([bursts(0.4, rng), bursts(1e-9, rng)], [fast, slow], 1e-3)
    assert apart < patterns.UNLIKELY
    assert patterns.evenly([bursts(0.4, rng)] * 2, [fast, 0.0 * slow], 1e-3) == 1.0


def test_a_command_that_never_moves_loses_nothing():
    still = np.zeros(100)
    assert patterns.selective([still > 1.0], [still]) == 0.0


@pytest.mark.parametrize(("count", "joints", "cost"), [
    (1, 12, PLACE), (12, 12, PLACE), (2, 12, np.log(66.0)), (11, 12, 11.0 * PLACE),
    (2, 2, PLACE),
])  # fmt: skip
def test_a_group_of_joints_costs_what_chooses_it(count, joints, cost):
    """Two of twelve can be taken in 66 ways, one of which suits noise."""
    law = by_cause("coulomb_friction")
    claim = Claim(law, np.zeros(1), tuple(range(count)), {}, 0.0)
    assert price(claim, joints) == pytest.approx(cost + PRICE)
