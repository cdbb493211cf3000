"""A timing that is searched again begins where the last one ended, at what still holds there."""

import pytest

from rotorfit.fit.reduction.motor_timing import MotorTiming
from rotorfit.flight.motors.motor_model import MotorResponse

BOTH = ("motor_lag", "motor_delay")


def timing(free, *, lag=0.0, lag_std=None, reached=None):
    return MotorTiming(
        response=MotorResponse(lag=lag, delay=1e-3),
        total_std=1e-3,
        lag_std=lag_std,
        free=free,
        reached=reached,
    )


@pytest.mark.parametrize(
    ("found", "frees"),
    [
        (timing(BOTH, lag_std=0.01), True),
        (timing((*BOTH, "motor_skew"), lag_std=0.01), True),
        (timing(("motor_delay",), lag_std=5e-4), True),  # motors without lag
        (timing(("motor_delay",), lag=0.016, lag_std=0.03), False),  # a lag that was lost
        (timing(("motor_delay",)), False),  # a lag that was given then, and is asked for now
        (timing(()), False),
    ],
)
def test_a_timing_without_lag_answers_a_search_for_both(found, frees):
    assert found.frees(BOTH) is frees


def test_a_bias_of_another_law_is_no_start():
    """A wrong expo ended in 2.4 m/s^2; from there the right one found thrust a third too small."""
    found = timing(BOTH, reached={"kt": 7.3, "accel_bias_z@A": 2.4, "Ixx@A": 0.02})
    assert found.without_biases == {"kt": 7.3, "Ixx@A": 0.02}
    assert timing(BOTH).without_biases is None


def test_motors_without_lag_stay_so():
    lagless = timing(("motor_delay",), lag_std=5e-4)
    assert timing(("motor_delay",)).with_lag_of(lagless).lag_std == 5e-4
    assert timing(BOTH, lag_std=0.01).with_lag_of(lagless).lag_std == 0.01
