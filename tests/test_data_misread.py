"""Readings that cannot be true are interpolated; faults of a robot are left alone."""

import numpy as np
import pytest

from gatjax.data.misread import mended
from gatjax.data.recording import Recording

TIME = 0.01 * np.arange(800)
RUNS = np.repeat([0, 1], 400)


def moving(noise=5e-4, seed=0):
    """Positions [N, 2] rad of two joints that turn."""
    draw = np.random.default_rng(seed).normal(size=(len(TIME), 2))
    rates = np.array([5.0, 8.0])
    return 0.6 * np.sin(rates * TIME[:, None] + [0.0, 1.0]) + noise * draw


def log(angles):
    columns = {f"position.{k}": angle for k, angle in zip("ab", angles.T, strict=True)}
    return Recording("log", TIME, RUNS, columns | {"gyro.x": 0.0 * TIME}, {})


def read(angles):
    """Positions as mended, and what is said."""
    whole, found = mended(log(angles))
    angles = np.stack([whole.columns[f"position.{k}"] for k in "ab"], -1)
    return angles, [each.text for each in found]


@pytest.mark.parametrize("size", [0.2, -0.5])
def test_a_glitch_is_interpolated_and_told(size):
    true = moving()
    wrong = true.copy()
    wrong[[120, 500], [0, 1]] += size
    angles, (said,) = read(wrong)
    assert np.abs(angles - true).max() < 4 * 5e-4
    assert (angles == true).sum() == true.size - 2
    assert said.startswith("log: row 121, column 'position.a': reads ")
    assert "(2 readings like that)" in said


@pytest.mark.parametrize("step", [0.0, 0.0015])
def test_rows_that_were_not_read_are_interpolated_and_told(step):
    true = moving()
    if step:
        true = np.round(true / step) * step
    wrong = true.copy()
    lost = 10 + 13 * np.arange(58)
    lost = np.concatenate([lost, lost[::3] + 1])
    for row in np.sort(lost):
        wrong[row] = wrong[row - 1]
    angles, (said,) = read(wrong)
    left = np.abs(angles - true)
    before = np.abs(wrong - true)
    assert np.sqrt(np.mean(np.square(before[lost]))) > 0.02
    assert np.sqrt(np.mean(np.square(left[lost]))) < 0.004
    assert left.max() < 0.03 < before.max()
    assert "repeats the row before at all joints" in said


def test_a_log_that_is_right_stays_as_it_is():
    for angles in (moving(), moving(0.0), np.round(moving() / 0.0015) * 0.0015):
        whole = log(angles)
        assert mended(whole) == (whole, [])


def test_one_row_that_repeats_may_come_of_chance():
    angles = moving()
    angles[200] = angles[199]
    whole = log(angles)
    assert mended(whole) == (whole, [])


def test_noise_has_no_glitches():
    draw = np.random.default_rng(4).standard_t(4.0, size=(800, 2))
    whole = log(moving(0.0) + 0.015 * draw)
    assert mended(whole) == (whole, [])


def test_joints_that_stand_for_long_and_catch_up_are_left_alone():
    angles = moving()
    for row in range(40, 700, 90):  # four rows are more than a bus misses
        angles[row : row + 4] = angles[row - 1]
    whole = log(angles)
    assert mended(whole) == (whole, [])


def test_slow_joints_on_a_coarse_encoder_are_left_alone():
    slow = np.linspace([0.0, 0.3], [0.6, 1.1], 800)
    for step in (0.0015, 0.006):
        whole = log(np.round(slow / step) * step)
        assert mended(whole) == (whole, [])


def test_joints_that_stick_or_jump_are_left_alone():
    sticking = moving()
    for row in range(100, 700, 37):  # held for two rows, and not made up for
        sticking[row:] += sticking[row - 1] - sticking[row + 1]
        sticking[row : row + 2] = sticking[row - 1]
    one = moving()
    one[::9, 0] = np.roll(one, 1, axis=0)[::9, 0]  # the other joint is read
    jumped = moving() + 0.3 * (TIME > 2.0)[:, None]
    for angles in (sticking, one, jumped):
        whole = log(angles)
        assert mended(whole) == (whole, [])
