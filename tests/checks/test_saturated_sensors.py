"""A gyro or an accelerometer that ends within the flight is named."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.checks.sensors.sensor_faults import saturated_sensors
from rotorfit.flight.signals import saturation


def check(*, rate_end=np.inf, force_end=np.inf):
    prepared = made_fit.prepared()
    n = len(prepared.data.time)
    swing = np.sin(np.linspace(0.0, 200.0, n))[:, None] * np.ones(3)
    data = replace(
        prepared.data,
        angular_velocity=np.clip(10.0 * swing, -rate_end, rate_end),
        specific_force=np.clip(80.0 * swing, -force_end, force_end),
    )
    fit = made_fit.fit(made_fit.dataset(replace(prepared, data=data)))
    return list(saturated_sensors(fit))


def warned(**ends):
    return made_fit.only(check(**ends))


@pytest.mark.parametrize(("end", "doubtful"), [(np.inf, False), (7.0, True)])
def test_much_cut_off_makes_numbers_doubtful(end, doubtful):
    """Of the flight 0 and 51 %: k_t was 3.4 half-widths off at 18 %, and `identified`."""
    [found] = check(rate_end=end)
    assert (found.severity == "passed") is (end == np.inf)
    assert (found.doubtful_because is not None) is doubtful


def test_an_end_below_any_sensors_is_none():
    assert warned(rate_end=3.0) is None


def spikes(*, held, end=np.inf):
    """Return hard turns of a sensor that a log writes several times each."""
    values = 20.0 * np.random.default_rng(1).standard_normal((3000, 3))
    return np.repeat(np.clip(values, -end, end), held, axis=0)


@pytest.mark.parametrize("held", [1, 3, 5])
def test_a_slow_sensor_in_a_fast_log_is_at_no_end(held):
    assert saturation(spikes(held=held), "gyro").share == 0.0


@pytest.mark.parametrize("held", [1, 3])
def test_the_end_of_a_slow_sensor_is_found(held):
    clipped = np.cumsum(np.ones((40, 3)), axis=0)
    clipped[10:30] = 20.0 + 0.1 * np.random.default_rng(2).standard_normal((20, 3))
    clipped[12:24, 0] = 50.0
    assert saturation(np.repeat(clipped, held, axis=0), "gyro").share == 12 / 40
