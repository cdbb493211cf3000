import numpy as np
import pytest

from rotorfit.flight.motors.motor_model import (
    MotorResponse,
    first_order_lag,
    following_speed,
    shift_time,
    two_way_lag,
    white_noise_std,
)


def test_the_lag_is_the_exact_recursion_of_a_held_command():
    held = np.random.default_rng(0).uniform(0, 800, (300, 4))
    lagged = first_order_lag(held, 200.0, 0.04)
    speed = held[0].copy()
    for row in range(300):
        assert lagged[row] == pytest.approx(speed, rel=1e-12)
        speed = held[row] + (speed - held[row]) * np.exp(-0.005 / 0.04)


def test_the_lags_step_response_is_the_differential_equations():
    t = np.arange(200) / 500
    held = np.where(t < 0.1, 100.0, 600.0)[:, None]
    expected = np.where(t < 0.1, 100.0, 600.0 - 500.0 * np.exp(-(t - 0.1) / 0.03))
    assert first_order_lag(held, 500.0, 0.03)[:, 0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("lag", [0.0, -1.0])
def test_without_lag_the_command_is_the_speed(lag):
    held = np.ones((3, 4))
    assert first_order_lag(held, 200.0, lag) is held


def test_rising_and_falling_lags_are_the_plain_recursion():
    held = np.abs(np.cumsum(np.random.default_rng(1).normal(0, 20, (600, 3)), axis=0) + 500)
    lagged = two_way_lag(held, 200.0, up=0.03, down=0.08)
    speed = held[0].copy()
    for row in range(600):
        assert lagged[row] == pytest.approx(speed, rel=1e-12)
        left = np.exp(-0.005 / np.where(held[row] > speed, 0.03, 0.08))
        speed = held[row] + (speed - held[row]) * left


def test_equal_lags_both_ways_are_one_lag():
    held = np.random.default_rng(0).uniform(0, 800, (300, 4))
    response = MotorResponse(lag=0.04, delay=0.003, lag_down=0.04)
    one = following_speed(held, 200.0, MotorResponse(lag=0.04, delay=0.003))
    assert following_speed(held, 200.0, response) == pytest.approx(one, rel=1e-12)
    assert two_way_lag(held, 200.0, up=0.04, down=0.04) == pytest.approx(
        first_order_lag(held, 200.0, 0.04), rel=1e-9
    )


def test_motors_start_settled():
    assert first_order_lag(np.full((50, 2), 7.0), 200.0, 0.1) == pytest.approx(7.0, rel=1e-12)


@pytest.mark.parametrize("delay", [0.01, 0.0123, -0.004])
def test_a_delay_shows_a_ramp_as_it_was(delay):
    t = np.arange(400) / 200
    shifted = shift_time(np.stack([3 * t, -t], axis=1), 200.0, delay)
    assert shifted[10:-10, 0] == pytest.approx(3 * (t - delay)[10:-10])
    assert shifted[10:-10, 1] == pytest.approx(-(t - delay)[10:-10])


def test_no_delay_changes_nothing():
    x = np.ones((3, 1))
    assert shift_time(x, 200.0, 0.0) is x


def test_white_noise_is_found_under_slow_motion():
    rng = np.random.default_rng(7)
    t = np.arange(6000) / 200.0
    slow = 900.0 + 80.0 * np.sin(2 * np.pi * 1.3 * t)[:, None] * np.ones((1, 4))
    noisy = slow + 5.0 * rng.normal(size=slow.shape)
    assert white_noise_std(noisy, [(0, len(t))]) == pytest.approx(5.0, rel=0.07)
    assert white_noise_std(slow, [(0, len(t))]) < 0.02
    assert white_noise_std(noisy, [(0, 100)]) == 0.0  # too short to tell
