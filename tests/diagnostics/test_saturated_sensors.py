"""A gyro or an accelerometer that ends within the flight is named."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.diagnostics.saturated_sensors import saturated_sensors


def flown(*, rate_end=np.inf, force_end=np.inf):
    prepared = made_fit.prepared()
    n = len(prepared.data.time)
    swing = np.sin(np.linspace(0.0, 200.0, n))[:, None] * np.ones(3)
    data = replace(
        prepared.data,
        angular_velocity=np.clip(10.0 * swing, -rate_end, rate_end),
        specific_force=np.clip(80.0 * swing, -force_end, force_end),
    )
    return made_fit.dataset(replace(prepared, data=data))


def test_sensors_that_reach_far_enough_are_not_named():
    assert saturated_sensors(flown()) is None


@pytest.mark.parametrize(
    ("ends", "said"),
    [({"rate_end": 4.5}, "the gyro is at the end of its range (4.5 rad/s)"),
     ({"force_end": 39.2}, "the accelerometer is at the end of its range (39.2 m/s^2)")],
)  # fmt: skip
def test_a_sensor_that_ends_within_the_flight_is_named(ends, said):
    words = saturated_sensors(flown(**ends))
    assert said in words
    assert "set a wider range" in words


def test_an_end_below_any_sensors_is_none():
    assert saturated_sensors(flown(rate_end=3.0)) is None
