"""Intervals of the motors' times: a lag ends at zero, a delay does not."""

import pytest

from rotorfit.experiment.experiment import MotorsEntry
from rotorfit.fit.motor_timing import MotorTiming
from rotorfit.flight.motors import MotorResponse
from rotorfit.results.parameter_tables import motor_parameters


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
