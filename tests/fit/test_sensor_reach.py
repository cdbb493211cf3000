"""Up to which frequency the accelerometer counts behind filters that the log names."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.fit.timing.sensor_bandwidth import flight_reach
from rotorfit.flight.on_board import MOST_RESTORED
from rotorfit.logs.firmware import Filter


def reach(*filters):
    flight = made_fit.prepared()
    flight = replace(flight, data=replace(flight.data, filters=filters))
    [loaded] = made_fit.dataset(flight).configurations[0].flights
    return flight_reach(loaded)


def low_pass(channel, cutoff):
    return Filter(
        channel=channel, kind="low-pass", low=cutoff, high=cutoff, setting="x", passed=True
    )


def test_filters_taken_off_leave_a_quarter_of_the_motion():
    """A Butterworth of second order leaves a quarter at its cut-off times 15^(1/4)."""
    found = reach(low_pass("accel", 5.0), low_pass("gyro", 1000.0))
    lost = (MOST_RESTORED**2 - 1.0) ** 0.25
    assert found[:3] == pytest.approx([5.0 * lost] * 3, abs=0.1)
    assert np.isinf(found[3:]).all()
    assert np.isinf(reach(low_pass("accel", 20.0), low_pass("gyro", 20.0))).all()


def test_a_filtered_gyro_limits_a_raw_accelerometer():
    """The rotors pass the gyro's: real part of its inverse 1 - (f / 20)^2, .85 at 7.7 Hz."""
    assert reach(low_pass("gyro", 20.0))[:3] == pytest.approx([20.0 * 0.15**0.5] * 3, abs=0.1)
