"""Which trajectories start in motion."""

import numpy as np
import pytest

from gatjax.data.starts import early, underway, unsettled
from gatjax.data.trajectories import JointRun

TIME = 0.01 * np.arange(400)
DRAW = np.random.default_rng(3)


def run(angle, noise=0.0):
    angle = (angle + noise * DRAW.normal(size=len(angle)))[:, None]
    return JointRun(0, TIME, angle, angle)


def servo(target, start=0.0, speed=0.0):
    """Angle of a second-order servo that follows a target, rad."""
    angle, out = start, []
    for aim in np.repeat(target, 10):
        out.append(angle)
        speed += 1e-3 * (900.0 * (aim - angle) - 45.0 * speed)
        angle += 1e-3 * speed
    return np.array(out[::10])


def test_three_rows_show_no_noise():
    three = np.array([[0.0], [0.4], [0.8]])
    some = JointRun(0, np.array([0.0, 0.1, 0.2]), three, three)
    assert underway(some) == pytest.approx(4.0)
    assert unsettled(some) == [False]


@pytest.mark.parametrize("noise", [0.0, 5e-4, 5e-3])
def test_what_starts_at_rest_is_not_underway(noise):
    for target in (0.0 * TIME, np.full(400, 0.6), np.sin(6.0 * TIME), 2.0 * TIME):
        for step in (1e-9, 0.0015):
            angle = np.round(servo(target) / step) * step
            assert underway(run(angle, noise)) == 0.0


def test_a_sine_cut_in_the_middle_is():
    for phase in (0.0, 2.5):
        angle = np.sin(6.0 * TIME + phase)
        speed = underway(run(angle, 5e-4))[0]
        assert speed == pytest.approx(6.0 * np.cos(phase), rel=0.15)
    assert underway(run(servo(2.0 * TIME, -0.1, 2.0), 5e-4)) != 0.0


@pytest.mark.parametrize("noise", [0.0, 5e-4])
def test_a_joint_that_had_not_settled(noise):
    for speed, away in [(0.0, 0.05), (0.0, -0.3), (3.0, -0.15), (-3.0, -0.15)]:
        target = speed / 6.0 * np.sin(6.0 * TIME)
        late = run(servo(target, away), noise)._replace(command=target[:, None])
        assert unsettled(late) == [True]
    followed = JointRun(0, TIME, TIME[:, None], TIME[:, None] - 0.1)
    assert unsettled(followed) == [False]


def test_what_balances_off_its_command_had_settled():
    for target in (0.5 * np.sin(9.0 * TIME), np.full(400, 0.4), 3.0 * TIME):
        target[0] = target[1]
        for sag in (0.0, 0.1, -0.1):  # a load, or an encoder's offset
            angle = servo(target - target[0]) + target[0] - sag
            settled = run(angle, 5e-4)._replace(command=target[:, None])
            assert unsettled(settled) == [False]


def test_a_start_that_is_off_by_little_or_by_noise_had_settled():
    near = run(servo(0.0 * TIME, 0.015))._replace(command=0.0 * TIME[:, None])
    assert unsettled(near) == [False]
    for seed in range(8):
        noise = 0.02 * np.random.default_rng(seed).normal(size=(400, 1))
        noise[0] = -0.05
        off = JointRun(0, TIME, 0.0 * TIME[:, None], noise)
        assert unsettled(off) == [False]


def test_early_rows_are_the_first_second_or_half_of_a_short_run():
    assert early(run(TIME)).sum() == 101
    short = run(TIME).part(np.arange(101))
    assert early(short).sum() == 51
