"""A gyro or an accelerometer that ends within the flight is named."""

from dataclasses import replace

import numpy as np

import made_fit
from rotorfit.checks.sensors.sensor_faults import saturated_sensors


def warned(*, rate_end=np.inf, force_end=np.inf):
    prepared = made_fit.prepared()
    n = len(prepared.data.time)
    swing = np.sin(np.linspace(0.0, 200.0, n))[:, None] * np.ones(3)
    data = replace(
        prepared.data,
        angular_velocity=np.clip(10.0 * swing, -rate_end, rate_end),
        specific_force=np.clip(80.0 * swing, -force_end, force_end),
    )
    fit = made_fit.fit(made_fit.dataset(replace(prepared, data=data)))
    return made_fit.only(saturated_sensors(fit))


def test_an_end_below_any_sensors_is_none():
    assert warned(rate_end=3.0) is None
