"""Laws of what a motor pulls with and a gear hands on, against their equations."""

import numpy as np
import pytest

from gatjax.effects.joint import current_limit, load_friction, pull, supply, thermal
from gatjax.records import Drive, Servo

PERIOD, DRY, VISCOUS, ROTOR = 0.001, 0.2, 0.5, 0.03


def driven(pulled, speed=0.0):
    """A drive whose servo pulls with torques [J] N m."""
    pulled, one = np.asarray(pulled, float), np.ones(np.shape(pulled))
    servo = Servo(
        one, 0.0 * one, 0.0 * one, -9.0 * one, 9.0 * one, DRY * one, VISCOUS * one,
        ROTOR * one, 0.0 * one,
    )  # fmt: skip
    none = 0.0 * one
    return Drive(
        target=pulled, angle=none, velocity=speed * one, seen=none, turned=none,
        turning=speed * one, servo=servo, rated=servo.high, load=none, lean=none,
        lean_apart=none, torque=none, stiffness=one, geared=none, handed=none,
        apart=none,
    )  # fmt: skip


def against(coefficient, drive, before=0.0, of_link=1.0):
    """Friction N m against motion forwards and backwards, [J] each."""
    params = {"coefficient": coefficient, "of_link": of_link}
    start = before + 0.0 * drive.velocity
    _, out = load_friction(PERIOD).apply(params, start, drive)
    return out.servo.friction - out.load, out.servo.friction + out.load


PULLED = np.linspace(-3.0, 3.0, 25)


@pytest.mark.parametrize("coefficient", [0.1, 0.5, 0.9])
@pytest.mark.parametrize(("speed", "before"), [(0.0, 0.0), (0.8, 0.79), (-0.8, -0.83)])
def test_friction_goes_with_what_is_left_for_the_link(coefficient, speed, before):
    sides = against(coefficient, driven(PULLED, speed), before)
    left = PULLED - VISCOUS * speed - ROTOR * (speed - before) / PERIOD
    for side, friction in zip((1.0, -1.0), sides, strict=True):
        link = side * left - friction
        assert friction == pytest.approx(DRY + coefficient * np.abs(link), abs=1e-12)


def test_a_gear_is_harder_to_drive_from_its_link():
    ahead, back = against(0.5, driven([2.0]))
    assert ahead == pytest.approx((DRY + 1.0) / 1.5)
    assert back == pytest.approx((DRY + 1.0) / 0.5)


def test_a_gear_with_a_coefficient_of_one_locks_itself():
    _, back = against(1.0, driven([2.0]))
    assert back > 50.0


def test_behind_a_gear_with_play_it_goes_with_what_that_hands_on():
    drive = driven(PULLED, 0.5)
    drive = drive._replace(geared=1.0 + drive.geared, handed=0.3 * PULLED)
    for friction in against(0.5, drive):
        assert friction == pytest.approx(DRY + 0.5 * np.abs(0.3 * PULLED))


def test_of_the_servo_it_is_the_same_both_ways():
    for friction in against(0.5, driven(PULLED), of_link=0.0):
        assert friction == pytest.approx(DRY + 0.5 * np.abs(PULLED))


def test_without_a_coefficient_there_is_no_load_friction():
    for of_link in (0.0, 1.0):
        for friction in against(0.0, driven(PULLED, 0.5), of_link=of_link):
            assert friction == pytest.approx(DRY)


@pytest.mark.parametrize("speed", [-4.0, -0.6, 0.0, 0.6, 4.0])
def test_a_current_limit_is_of_torque_less_back_emf(speed):
    drive = driven(PULLED, speed)
    _, out = current_limit().apply(np.full(len(PULLED), 1.5), (), drive)
    current = PULLED - VISCOUS * speed
    assert pull(out) - VISCOUS * speed == pytest.approx(np.clip(current, -1.5, 1.5))
    assert out.load == pytest.approx(drive.load)
    _, free = current_limit().apply(np.full(len(PULLED), np.inf), (), drive)
    assert pull(free) == pytest.approx(PULLED)


def test_beyond_both_limits_the_torque_limit_holds_in_either_direction():
    """Back EMF of 5 N m, a current for 1 N m: the drivers give no more than 3 N m."""
    torques = []
    for speed in (5.0, -5.0):
        drive = driven([0.0], speed)
        strong = drive.servo._replace(
            low=np.array([-3.0]), high=np.array([3.0]), viscous=np.array([1.0])
        )
        _, out = current_limit().apply(
            np.array([1.0]), (), drive._replace(servo=strong)
        )
        torques.append(pull(out)[0])
    assert torques == pytest.approx([3.0, -3.0])


def test_a_motor_that_its_load_turns_back_brakes_within_its_current_limit():
    """Back EMF adds to what the servo asks for; a torque limit alone lets it."""
    _, out = current_limit().apply(np.array([1.5]), (), driven([1.4], -1.0))
    assert pull(out) == pytest.approx([1.0])  # and 0.5 of back EMF


@pytest.mark.parametrize("law, begin", [(thermal(PERIOD), 30.0), (supply(), ())])
def test_what_a_motor_bears_is_not_what_is_left_of_it(law, begin):
    params = {"lost_fraction": 0.5, "cooling": 20.0, "heat": np.nan,
              "max_drop": 0.5, "total": np.nan}  # fmt: skip
    left = []
    for limit in (9.0, 1.0):
        drive = driven([6.0, 5.0])
        servo = drive.servo._replace(high=limit + 0.0 * drive.rated)
        drive = drive._replace(servo=servo, torque=np.array([6.0, 5.0]))
        _, out = law.apply(params, begin, drive)
        left.append(out.servo.gain / drive.servo.gain)
    np.testing.assert_array_equal(*left)
    assert (left[0] < 0.9).all()
