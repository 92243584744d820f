"""What is asked of the robot, the pilot that answers, and the bookkeeping of a run."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gatjax import task as tasks
from gatjax.effects.effect import memoryless
from gatjax.records import JOINTS, Base, Reading
from gatjax.robot import nao
from gatjax.sim.backend import prepare
from gatjax.sim.world import nominal
from gatjax.task import Task, task_at
from gatjax.walk.parameters import HIGH, LOW, NAMES, THETA0

MAX_FORWARD, MAX_TURN = NAMES.index("max_forward"), NAMES.index("max_turn")
TASK = Task()
GO = 5


def reading(yaw_rate=0.0):
    """A robot that stands in its ready pose, its weight on eight equal corners."""
    return Reading(
        angle=tasks.pose(THETA0),
        gyro=np.array([0.0, 0.0, yaw_rate]),
        accelerometer=np.array([0.0, 0.0, 9.81]),
        force=np.full(8, 6.6),
    )


def drive(yaw_rates, go=GO, task=TASK):
    """Play yaw rates [T] to the pilot; return states and targets of every tick."""
    state, states, targets = tasks.begin(THETA0), [], []
    for rate in yaw_rates:
        state, target = tasks.pilot(task, THETA0, go, state, reading(rate))
        states.append(state)
        targets.append(target)
    return states, np.array(targets)


@pytest.fixture
def asked(monkeypatch):
    """Every request that the engine gets, in order."""
    requests, tick = [], tasks.gait.tick

    def spy(policy, constants, dt, state, request, *sensors):
        requests.append(request)
        return tick(policy, constants, dt, state, request, *sensors)

    monkeypatch.setattr(tasks.gait, "tick", spy)
    return requests


# The pilot


def test_the_walk_is_requested_at_the_tick_go_and_not_before(asked):
    _, targets = drive(np.zeros(GO + 30))
    forward = np.array([request.forward for request in asked])[:: TASK.engine_ticks]
    np.testing.assert_array_equal(forward[:GO], 0.0)
    np.testing.assert_allclose(forward[GO:], 0.75 * THETA0[MAX_FORWARD])
    # It stands in its pose until then, and moves afterwards.
    still = np.broadcast_to(tasks.pose(THETA0), (GO, len(JOINTS)))
    np.testing.assert_allclose(targets[:GO], still, atol=1e-12)
    assert np.abs(targets[GO + 5 :] - targets[0]).max() > 0.05


def test_the_engine_ticks_twice_in_a_control_tick_of_50_hz(asked):
    drive(np.zeros(3))
    assert len(asked) == 6
    drive(np.zeros(3), task=task_at(100.0))
    assert len(asked) == 6 + 3


def test_turning_before_the_request_does_not_count():
    states, _ = drive(np.full(GO + 1, 0.5))
    assert states[GO - 1].heading == 0.0
    assert states[GO].heading == pytest.approx(0.5 * TASK.control_period)


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["left", "right"])
def test_the_pilot_turns_back_past_five_degrees_and_until_one(asked, side):
    """Heading in degrees, tick by tick; a left turn is answered to the right."""
    heading = side * np.array([0, 4.9, 5.1, 4.0, 2.0, 1.1, 0.9, 2.0, 4.9, 5.1, -0.9])
    expected = [0, 0, 1, 1, 1, 1, 0, 0, 0, 1, 0]
    rates = np.deg2rad(np.diff(heading, prepend=0.0)) / TASK.control_period
    states, _ = drive(rates, go=0)
    assert [bool(state.turning) for state in states] == [bool(x) for x in expected]
    turn = np.array([request.turn for request in asked])[:: TASK.engine_ticks]
    asked_for = -side * TASK.turn * THETA0[MAX_TURN] * np.array(expected)
    np.testing.assert_allclose(turn, asked_for, atol=1e-12)
    assert all(request.left == 0.0 for request in asked)


def test_it_keeps_walking_on_while_it_turns(asked):
    drive(np.full(20, np.deg2rad(20.0)), go=0)
    assert {float(request.forward) for request in asked} == {0.75 * THETA0[MAX_FORWARD]}


def test_the_robot_itself_turns_against_the_error():
    """A gyro that drifts to the left makes a simulated robot walk to the right."""

    def drift(rate, sensed):
        gyro = sensed.reading.gyro + rate * jnp.array([0.0, 0.0, 1.0])
        return sensed._replace(reading=sensed.reading._replace(gyro=gyro))

    world = nominal(Task(duration=4.0))
    sensors = {"drift": memoryless(drift)}
    world = dataclasses.replace(world, sensor=sensors)
    run, key = prepare(world).rollout, jax.random.split(jax.random.key(0), 1)
    for rate in (0.1, -0.1):
        values = world.values._replace(sensor={"drift": rate})
        walk, outcome = run(values, THETA0[None], key)
        w, _, _, z = walk.base.quaternion[0, int(walk.alive[0].sum()) - 1]
        yaw = 2.0 * np.arctan2(z, w)
        assert np.isinf(outcome.fell_at[0])
        # The error stays within the five degrees, so the drift is turned away.
        assert -np.sign(rate) * yaw == pytest.approx(0.4, abs=2 * TASK.turn_from)


def policies():
    generator = np.random.default_rng(0)
    draws = generator.uniform(LOW, HIGH, size=(30, 15))
    return np.concatenate([[LOW, HIGH, THETA0], draws])


def stormy(seed, ticks, shape):
    """Readings of a robot that is thrown about."""
    draw = np.random.default_rng(seed)
    return [
        Reading(
            angle=draw.uniform(nao.LOW, nao.HIGH, size=(*shape, len(JOINTS))),
            gyro=draw.normal(size=(*shape, 3)),
            accelerometer=9.81 + draw.normal(size=(*shape, 3)),
            force=draw.uniform(0.0, 25.0, size=(*shape, 8)),
        )
        for _ in range(ticks)
    ]


def test_targets_of_any_policy_lie_within_the_joint_limits():
    batch = policies()
    state, moved = tasks.begin(batch), np.zeros(len(JOINTS))
    first = tasks.pose(batch)
    assert ((first >= nao.LOW) & (first <= nao.HIGH)).all()
    for now in stormy(0, 150, (len(batch),)):
        state, target = tasks.pilot(TASK, batch, np.full(len(batch), GO), state, now)
        assert np.isfinite(target).all()
        assert ((target >= nao.LOW) & (target <= nao.HIGH)).all()
        moved = np.maximum(moved, np.abs(target - first).max(0))
    assert (moved[nao.WALKING] > 0.01).all()


def test_a_batch_of_pilots_equals_one_by_one():
    batch, go = policies()[:4], np.array([0, 3, 5, 8])
    stream = stormy(1, 60, (4,))
    together, alone = tasks.begin(batch), [tasks.begin(policy) for policy in batch]
    for now in stream:
        together, target = tasks.pilot(TASK, batch, go, together, now)
        for row in range(4):
            mine = Reading(*(leaf[row] for leaf in now))
            alone[row], own = tasks.pilot(TASK, batch[row], go[row], alone[row], mine)
            np.testing.assert_allclose(target[row], own, rtol=0, atol=1e-12)


def test_numpy_and_jax_pilots_agree():
    stream = stormy(2, 120, ())
    state, expected = tasks.begin(THETA0), []
    for now in stream:
        state, target = tasks.pilot(TASK, THETA0, GO, state, now)
        expected.append(target)

    def step(state, now):
        return tasks.pilot(TASK, jnp.asarray(THETA0), jnp.asarray(GO), state, now)

    rows = jax.tree.map(lambda *leaves: jnp.stack(leaves), *stream)
    final, targets = jax.jit(
        lambda: jax.lax.scan(step, tasks.begin(jnp.asarray(THETA0)), rows)
    )()
    np.testing.assert_allclose(np.asarray(targets), expected, rtol=0, atol=1e-11)
    assert bool(final.turning) == bool(state.turning)
    assert float(final.heading) == pytest.approx(float(state.heading), abs=1e-12)


# The score


def base(x, height=0.3, pitch=0.0, shape=()):
    """Ground truth of a torso at x, leaning forward by `pitch` rad."""
    x = np.broadcast_to(np.asarray(x, float), shape)
    half = np.broadcast_to(0.5 * pitch, shape)
    zero = np.zeros(shape)
    return Base(
        position=np.stack([x, zero, np.broadcast_to(height, shape)], -1),
        quaternion=np.stack([np.cos(half), zero, np.sin(half), zero], -1),
    )


SHORT = Task(duration=0.2)  # ten ticks


def follow(bases, go=2, task=SHORT):
    score, scores = tasks.open_score(bases[0]), []
    for tick, now in enumerate(bases):
        score = tasks.keep_score(task, go, tick, score, now)
        scores.append(score)
    return scores


def walk(ticks=20, step=0.004):
    return [base(step * tick) for tick in range(ticks)]


def test_distance_and_time_count_from_the_request():
    scores = follow(walk())
    verdict = tasks.outcome(SHORT, scores[-1])
    # go is tick 2 and the run ends ten ticks later, 0.2 s: 0.04 m in 0.2 s.
    assert verdict.velocity == pytest.approx(10 * 0.004 / 0.2)
    assert verdict.cost == pytest.approx(-verdict.velocity)
    assert np.isinf(verdict.fell_at)
    assert verdict.ok
    assert [bool(score.alive) for score in scores] == [True] * 12 + [False] * 8


@pytest.mark.parametrize("fall", [{"pitch": 1.0}, {"pitch": -1.0}, {"height": 0.19}])
def test_a_fall_ends_the_run_and_costs_fifteen(fall):
    bases = walk()
    bases[7] = base(0.028, **fall)
    bases[8:] = [base(9.0)] * 12  # whatever comes later does not count
    scores = follow(bases)
    verdict = tasks.outcome(SHORT, scores[-1])
    assert verdict.fell_at == pytest.approx((7 - 2) * 0.02)
    assert verdict.velocity == pytest.approx((0.028 - 0.008) / 0.2)
    assert verdict.cost == pytest.approx(15.0 - verdict.velocity)
    assert verdict.ok
    assert not scores[7].alive
    assert scores[6].alive


@pytest.mark.parametrize("near", [{"pitch": 0.78}, {"height": 0.21}])
def test_leaning_a_lot_is_not_a_fall(near):
    assert not tasks.fallen(base(0.0, **near))


def test_a_fall_before_the_request_is_a_fall_too():
    bases = walk()
    bases[1] = base(0.0, height=0.1)
    verdict = tasks.outcome(SHORT, follow(bases)[-1])
    assert verdict.cost == pytest.approx(15.0)
    assert verdict.velocity == 0.0


def test_a_fall_after_the_end_does_not_count():
    bases = walk()
    bases[12] = base(0.048, pitch=1.5)  # the last tick that is looked at
    fell = tasks.outcome(SHORT, follow(bases)[-1])
    assert fell.fell_at == pytest.approx(0.2)
    bases = walk()
    bases[13] = base(0.052, pitch=1.5)
    assert np.isinf(tasks.outcome(SHORT, follow(bases)[-1]).fell_at)


@pytest.mark.parametrize("broken", ["position", "quaternion"])
@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_a_run_that_diverged_costs_infinity_and_is_not_ok(broken, number):
    bases = walk()
    leaf = getattr(bases[6], broken).copy()
    leaf[1] = number
    bases[6] = bases[6]._replace(**{broken: leaf})
    scores = follow(bases)
    verdict = tasks.outcome(SHORT, scores[-1])
    assert verdict.cost == np.inf
    assert not verdict.ok
    assert np.isfinite(verdict.velocity)
    assert not scores[6].alive


def test_one_diverged_row_leaves_the_others_alone():
    good = [base([0.004 * tick] * 3, shape=(3,)) for tick in range(20)]
    bad = [Base(*(leaf.copy() for leaf in now)) for now in good]
    bad[6].position[1] = np.nan
    expected = tasks.outcome(SHORT, follow(good)[-1])
    verdict = tasks.outcome(SHORT, follow(bad)[-1])
    np.testing.assert_array_equal(verdict.ok, [True, False, True])
    np.testing.assert_array_equal(verdict.cost[[0, 2]], expected.cost[[0, 2]])
    assert verdict.cost[1] == np.inf


def test_rows_may_have_their_own_request():
    go = np.array([0, 2, 5])
    bases = [base([0.004 * tick] * 3, shape=(3,)) for tick in range(20)]
    scores = follow(bases, go=go)
    np.testing.assert_allclose(scores[-1].origin, 0.004 * go)
    np.testing.assert_allclose(scores[-1].reached, 0.004 * (go + 10))


# The task


@pytest.mark.parametrize("rate", [50.0, 100.0, 83.3])
def test_a_task_fits_its_rate(rate):
    task = task_at(rate, duration=2.0)
    assert 1.0 / task.control_period == pytest.approx(rate, rel=1e-3)
    engine = task.control_period / task.engine_ticks
    assert engine in (0.01, 0.012)
    waits = (task.settle, task.longest_delay)
    latest = sum(round(wait / task.control_period) for wait in waits)
    left = (task.ticks - 1 - latest) * task.control_period
    assert task.duration - 1e-9 <= left < task.duration + task.control_period
    assert task.duration == 2.0


def test_an_unknown_rate_is_named_with_those_that_exist():
    with pytest.raises(ValueError, match=r"60\.0 Hz is unknown; .*50.*83\.3.*100"):
        task_at(60.0)
