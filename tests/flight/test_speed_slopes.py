"""Slopes of the rotor speeds by the motors' times, against differences of the speeds themselves."""

import numpy as np
import pytest

from rotorfit.flight.motors.motor_model import MotorResponse, following_speed
from rotorfit.flight.motors.speed_slopes import speed_and_slopes

RATE = 400.0
NAMES = ("motor_delay", "motor_lag", "motor_skew")
STEP = 1e-7


def speed_at(channel, *, delay=0.003, lag=0.03, skew=0.0):
    response = MotorResponse(lag=lag * (1.0 - skew), delay=delay, lag_down=lag * (1.0 + skew))
    return following_speed(channel, RATE, response)


def channel():
    rng = np.random.default_rng(3)
    return 800.0 + np.cumsum(rng.normal(size=(900, 3)), axis=0)


@pytest.mark.parametrize("skew", [0.0, 0.3, -0.2])
@pytest.mark.parametrize("lag", [0.004, 0.03])
def test_slopes_are_those_of_the_speeds(skew, lag):
    down = None if skew == 0.0 else lag * (1.0 + skew)
    response = MotorResponse(lag=lag * (1.0 - skew), delay=0.003, lag_down=down)
    speed, *slopes = speed_and_slopes(channel(), RATE, response, NAMES)
    np.testing.assert_allclose(speed, speed_at(channel(), lag=lag, skew=skew), rtol=1e-12)
    moves = ({"delay": 0.003}, {"lag": lag}, {"skew": skew})
    for slope, move in zip(slopes, moves, strict=True):
        ((name, at),) = move.items()
        others = {"lag": lag, "skew": skew}
        later = speed_at(channel(), **{**others, name: at + STEP})
        earlier = speed_at(channel(), **{**others, name: at - STEP})
        expected = (later - earlier) / (2.0 * STEP)
        # Where rising turns into falling between the two, the difference is of two slopes.
        wrong = np.abs(slope - expected) > 1e-4 * np.abs(expected).max()
        assert wrong.mean() < 0.002


def test_a_delay_alone_needs_no_lag():
    at = 0.0031
    speed, slope = speed_and_slopes(channel(), RATE, MotorResponse(delay=at), ("motor_delay",))
    later, earlier = (
        following_speed(channel(), RATE, MotorResponse(delay=at + side * STEP))
        for side in (1.0, -1.0)
    )
    difference = (later - earlier) / (2.0 * STEP)
    np.testing.assert_allclose(speed, 0.5 * (later + earlier), rtol=1e-9)
    np.testing.assert_allclose(slope, difference, atol=1e-5 * np.abs(difference).max())
