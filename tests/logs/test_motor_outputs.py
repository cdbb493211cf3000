"""Outputs that the vehicle does not follow are no motors."""

import numpy as np
import pytest

from flown import simulated
from rotorfit.logs.flight_log import Channel
from rotorfit.logs.motor_outputs import motor_outputs


@pytest.fixture(scope="module", params=["quad-x", "hexa-x"])
def flight(request):
    return simulated(request.param, "noisy", seed=7, seconds=12.0)


def channels(flight, others):
    values = np.column_stack([flight.command, *others])
    return [
        Channel(time=flight.time, values=some, source="")
        for some in (values, flight.gyro, flight.accel)
    ]


def servo(flight, rate):
    return 0.5 + 0.3 * np.sin(2 * np.pi * rate * flight.time)


@pytest.mark.parametrize("rates", [(0.3,), (1.7,), (0.2, 2.3)])
def test_servos_are_no_motors(flight, rates):
    motors = flight.command.shape[1]
    found = motor_outputs(*channels(flight, [servo(flight, rate) for rate in rates]))
    assert found is not None
    assert found.tolist() == [True] * motors + [False] * len(rates)


def test_noise_is_no_motor(flight):
    noise = 0.5 + 0.1 * np.random.default_rng(1).standard_normal(len(flight.time))
    found = motor_outputs(*channels(flight, [noise]))
    assert found is not None
    assert found.tolist() == [True] * flight.command.shape[1] + [False]


def test_all_motors_stay(flight):
    assert motor_outputs(*channels(flight, [])) is None


def test_one_lazy_motor_of_a_frame_stays(flight):
    command, gyro, accel = channels(flight, [])
    values = command.values.copy()
    values[:, 1] = servo(flight, 0.3)
    lazy = Channel(time=command.time, values=values, source="")
    assert motor_outputs(lazy, gyro, accel) is None


def test_too_little_flight_shows_nothing(flight):
    some = slice(0, 100)
    short = [
        Channel(time=c.time[some], values=c.values[some], source="")
        for c in channels(flight, [servo(flight, 1.7)])
    ]
    assert motor_outputs(*short) is None
