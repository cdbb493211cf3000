"""The sum of lag and delay is told where their split is not, and quick turns tell both."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.fit.motors import motor_time_split
from rotorfit.fit.motors.motor_time_split import allow_for_noise_feedback, times_covariance
from rotorfit.fit.reduction.motor_timing import MotorTiming
from rotorfit.fit.sensors.sensor_response import BandRatio, FoundFilter, best_filter
from rotorfit.flight.motors.motor_model import MotorResponse

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


TIMING = MotorTiming(
    response=MotorResponse(lag=0.03, delay=0.002),
    lag_std=1e-3,
    delay_std=2e-3,
    total_std=3e-4,
    free=BOTH,
)


def on_a_mount(resonance):
    """Return the ratios of turns by an IMU on springs."""
    found = []
    for one in ratios(1.0, 2.5, 4.0, 6.0, 9.0, std=0.02):
        u = one.frequency / resonance
        found.append(one._replace(log=-np.log(1.0 - u**2 + 0.3j * u)))
    return found


def widened_lag(monkeypatch, measured):
    """Return the deviation of the lag after the step [s]."""
    monkeypatch.setattr(motor_time_split, "flight_ratios", lambda fit: measured)
    dataset = replace(made_fit.dataset(made_fit.prepared()), motor_timing=TIMING)
    return allow_for_noise_feedback(made_fit.fit(dataset)).dataset.motor_timing.lag_std


def test_a_lag_is_as_open_as_a_soft_mount_makes_it(monkeypatch):
    rigid = widened_lag(monkeypatch, ratios(1.0, 2.5, 4.0, 6.0, 9.0, std=0.02))
    swinging = on_a_mount(20.0)
    bent = best_filter(swinging, lagging=True)
    assert bent.shape == "soft mount"
    assert bent.cutoff == pytest.approx(20.0, rel=0.05)
    assert bent.lag > 1e-3  # without the mount the lag looks shorter
    assert widened_lag(monkeypatch, swinging) == pytest.approx(np.hypot(rigid, bent.lag / 1.96))


def test_the_times_are_widened_by_half_of_that(monkeypatch):
    monkeypatch.setattr(motor_time_split, "flight_ratios", lambda fit: ratios(1.0, 3.0, 8.0))
    timing = TIMING
    dataset = replace(made_fit.dataset(made_fit.prepared()), motor_timing=timing)
    found = allow_for_noise_feedback(made_fit.fit(dataset)).dataset.motor_timing
    lag, delay, total = 0.5 * np.array(stds(1.0, 3.0, 8.0))
    assert found.lag_std == pytest.approx(np.hypot(1e-3, lag))
    assert found.delay_std == pytest.approx(np.hypot(2e-3, delay))
    assert found.total_std == pytest.approx(np.hypot(3e-4, total))
    measured = replace(timing, free=("motor_delay",), lag_std=None)
    kept = made_fit.fit(replace(dataset, motor_timing=measured))
    assert allow_for_noise_feedback(kept).dataset.motor_timing == measured


@pytest.mark.parametrize(("gain", "opened"), [(40.0, 0.0102), (1.0, 0.0)])
def test_a_filter_that_is_seen_leaves_the_delay_open(gain, opened):
    """Of a Betaflight log, whose delay was given as 4.9 +- .9 ms beside a filter of 10 ms."""
    found = FoundFilter(
        shape="speeds low-passed twice",
        cutoff=24.0,
        interval=(21.0, 28.0),
        gain=gain,
        factors={3: 0.3, 4: 0.2, 5: 0.1},
        delay=0.0102,
        lag=0.0,
    )
    timing = replace(TIMING, free=("motor_delay",), lag_std=None, delay_std=5e-4)
    dataset = replace(made_fit.dataset(made_fit.prepared()), motor_timing=timing)
    fit = allow_for_noise_feedback(made_fit.fit(dataset).with_record(found))
    delay = fit.dataset.motor_timing.delay_std
    assert 1.96 * delay == pytest.approx(np.hypot(1.96 * 5e-4, opened))
