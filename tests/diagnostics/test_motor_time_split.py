"""The sum of lag and delay is told where their split is not, and quick turns tell both."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.diagnostics.motors import motor_time_split
from rotorfit.diagnostics.motors.motor_time_split import allow_for_noise_feedback, times_covariance
from rotorfit.diagnostics.sensors.sensor_response import BandRatio
from rotorfit.preprocessing.motors.motor_model import MotorResponse
from rotorfit.reduction.motor_timing import MotorTiming

BOTH = ("motor_lag", "motor_delay")


def ratios(*frequencies, std=0.1):
    return [BandRatio(0, axis, f, 0j, std) for axis in (3, 4, 5) for f in frequencies]


def stds(*frequencies, std=0.1, free=BOTH):
    found = times_covariance(ratios(*frequencies, std=std), free, lag=0.03, prior=0.03)
    return (*np.sqrt(np.diagonal(found)), np.sqrt(found.sum()))


def test_slow_turns_show_the_sum_and_quick_ones_the_split():
    lag, delay, total = stds(1.0, 2.0, 3.0)
    assert total < 0.35 * lag
    assert total < 0.5 * delay
    quick = stds(1.0, 2.0, 3.0, 8.0, 15.0)
    assert quick[0] < 0.4 * lag
    assert stds(1.0, 2.0, 3.0, std=10.0)[0] == pytest.approx(0.03, rel=0.05)  # known beforehand
    alone = stds(1.0, 2.0, 3.0, free=("motor_lag",))
    assert alone[0] == alone[1] < 0.5 * lag


def test_the_times_are_widened_by_half_of_that(monkeypatch):
    monkeypatch.setattr(motor_time_split, "flight_ratios", lambda fit: ratios(1.0, 3.0, 8.0))
    timing = MotorTiming(
        response=MotorResponse(lag=0.03, delay=0.002),
        lag_std=1e-3,
        delay_std=2e-3,
        total_std=3e-4,
        free=BOTH,
    )
    dataset = replace(made_fit.dataset(made_fit.prepared()), motor_timing=timing)
    found = allow_for_noise_feedback(made_fit.fit(dataset)).dataset.motor_timing
    lag, delay, total = 0.5 * np.array(stds(1.0, 3.0, 8.0))
    assert found.lag_std == pytest.approx(np.hypot(1e-3, lag))
    assert found.delay_std == pytest.approx(np.hypot(2e-3, delay))
    assert found.total_std == pytest.approx(np.hypot(3e-4, total))
    measured = replace(timing, free=("motor_delay",), lag_std=None)
    kept = made_fit.fit(replace(dataset, motor_timing=measured))
    assert allow_for_noise_feedback(kept) is kept
