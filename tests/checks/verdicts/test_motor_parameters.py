"""Intervals of the motors' times: a lag ends at zero, a delay does not."""

import pytest

from rotorfit.checks.verdicts.parameters import motor_parameters
from rotorfit.fit.experiment.experiment import MotorsEntry
from rotorfit.fit.reduction.motor_timing import MotorTiming
from rotorfit.flight.motors.motor_model import MotorResponse


@pytest.mark.parametrize(("lag", "low"), [(0.010, 0.0), (0.050, 0.050 - 1.96 * 0.012)])
def test_no_interval_of_a_lag_goes_below_zero(lag, low):
    timing = MotorTiming(
        response=MotorResponse(lag=lag, delay=-0.001, lag_down=lag),
        total_std=0.002,
        lag_std=0.012,
        delay_std=0.004,
    )
    found = {p.name: p for p in motor_parameters(MotorsEntry(speed="commanded"), timing)}
    for name in ("motor_lag", "motor_lag_up", "motor_lag_down"):
        assert found[name].interval == pytest.approx((low, lag + 1.96 * 0.012)), name
        assert found[name].std == 0.012
    assert found["motor_delay"].interval == pytest.approx((-0.001 - 0.00784, -0.001 + 0.00784))


def delay(value, std):
    timing = MotorTiming(response=MotorResponse(delay=value), total_std=std, delay_std=std)
    motors = MotorsEntry(speed="commanded", lag=0.0)
    return next(p for p in motor_parameters(motors, timing) if p.name == "motor_delay")


@pytest.mark.parametrize(
    ("value", "std", "verdict"),
    [
        (0.000, 0.00101, "identified"),  # 1.96 of them are 1.98 ms: a quarter of 8 ms is 2 ms
        (0.000, 0.00103, "weak"),
        (0.020, 0.00254, "identified"),  # a quarter of 20 ms
        (-0.020, 0.00256, "weak"),
    ],
)
def test_a_time_is_sharp_if_known_to_a_quarter_of_it_or_of_8_ms(value, std, verdict):
    assert delay(value, std).verdict == verdict


def test_a_lag_is_the_mean_of_rising_and_falling():
    timing = MotorTiming(
        response=MotorResponse(lag=0.02, lag_down=0.06), total_std=0.001, lag_std=0.001
    )
    found = {p.name: p.value for p in motor_parameters(MotorsEntry(speed="commanded"), timing)}
    assert found == {"motor_lag": 0.04, "motor_lag_up": 0.02, "motor_lag_down": 0.06}
