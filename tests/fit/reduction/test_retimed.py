"""A flight at the timing of its motors: made once for all who ask for the same one."""

from dataclasses import replace

import numpy as np

import made_fit
from rotorfit.fit.reduction.frequency_bands import retimed
from rotorfit.flight.motors.motor_model import MotorResponse, with_motors

EARLY, LATE = MotorResponse(lag=0.02), MotorResponse(lag=0.05, delay=0.01)


def moving_flight():
    flight = made_fit.prepared()
    channel = flight.motor_channel * (1.0 + 0.1 * np.sin(np.arange(len(flight.data.time)))[:, None])
    return replace(flight, motor_channel=channel)


def test_a_timing_is_applied_once_for_as_long_as_it_is_asked_for():
    flight = moving_flight()
    first = retimed(flight, LATE)
    assert retimed(flight, LATE) is first
    assert retimed(flight, EARLY) is not first
    expected = with_motors(flight.data, flight.motor_channel, LATE)
    np.testing.assert_array_equal(retimed(flight, LATE).rotor_speed, expected.rotor_speed)


def test_another_flight_keeps_nothing_of_the_first():
    flight = moving_flight()
    first = retimed(flight, LATE)
    other = replace(flight, motor_channel=2.0 * flight.motor_channel)
    np.testing.assert_allclose(retimed(other, LATE).rotor_speed, 2.0 * first.rotor_speed)
