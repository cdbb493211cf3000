"""A filter of gyro or speeds, or a soft mount, is told by its kind and frequency, or not at all."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

import made_fit
from rotorfit.checks.sensors.sensor_response import sensor_response
from rotorfit.fit.sensors.sensor_response import allow_for_sensor_response, found_filter
from rotorfit.fit.weight.thrust_change import allow_for_thrust_change
from rotorfit.flight.airborne import GRAVITY

RATE, SECONDS = 200.0, 40.0
NAMES = ("kt", "Ixx@A", "Izz@A", "com_x@A")
VALUES = (2e-6, 0.01, 0.02, 0.001)


RATIOS = (*NAMES, "hover_speed@A", "Ixx_over_kt@A", "kd_over_Izz@A")


def numbers():
    return made_fit.no_numbers(*NAMES, values=VALUES, half_width=(1e-8, 1e-4, 1e-3, 1e-3))


def flown(*, seed=1, noise=0.02, measured=None, speeds=None, early=0):
    """Return the fit of brisk random turns, gyro or speeds behind a filter (b, a) of the log.

    `early`: samples by which the fit has taken its delay for one of the motors.
    """
    rng = np.random.default_rng(seed)
    n = round(RATE * SECONDS)
    sos = signal.butter(2, (0.8, 30.0), "bandpass", fs=RATE, output="sos")
    squares = 500.0**2 * (1.0 + 0.1 * signal.sosfiltfilt(sos, rng.standard_normal((n, 4)), axis=0))
    flat, body = made_fit.prepared(seconds=SECONDS, rate=RATE), made_fit.BODY
    places = made_fit.QUAD.positions
    torque = body["kt"] * squares @ np.column_stack([places[:, 1], -places[:, 0]])
    turn = np.zeros((n, 3))
    turn[:, :2] = torque / [body["Ixx"], body["Iyy"]]
    turn[:, :2] += noise * turn.std() * rng.standard_normal((n, 2))
    logged = np.sqrt(squares)
    if measured is not None:
        turn = np.roll(signal.lfilter(*measured, turn, axis=0), -early, axis=0)
    if speeds is not None:
        late = signal.lfilter(*speeds, logged - 500.0, axis=0)
        logged = 500.0 + np.roll(late, -early, axis=0)
    data = replace(flat.data, angular_acceleration=turn, rotor_speed=logged)
    flights = made_fit.dataset(replace(flat, data=data, motor_channel=data.rotor_speed))
    return made_fit.fit(flights, numbers())


def mount(frequency, damping=0.15):
    """Return the filter of an IMU on a spring."""
    w = 2.0 * np.pi * frequency
    return signal.bilinear([2 * damping * w, w * w], [1.0, 2 * damping * w, w * w], fs=RATE)


@pytest.mark.parametrize(
    ("fault", "shape", "frequency"),
    [
        ({"measured": signal.butter(2, 20.0, fs=RATE), "early": 2}, "gyro low-passed", 20.0),
        ({"measured": mount(40.0)}, "soft mount", 40.0),
        ({"speeds": signal.butter(1, 15.0, fs=RATE), "early": 2}, "speeds low-passed", 15.0),
        ({"speeds": signal.butter(2, 15.0, fs=RATE), "early": 3}, "speeds low-passed twice", 15.0),
    ],
)
def test_a_filter_is_named_with_its_frequency(fault, shape, frequency):
    fit = flown(**fault)
    found = found_filter(fit)
    assert (found.shape, found.certain) == (shape, True)
    assert found.cutoff == pytest.approx(frequency, rel=0.15)
    allowed = allow_for_sensor_response(fit)
    [finding] = sensor_response(allowed)
    assert finding.severity == "doubt"
    assert ("gyro unfiltered" in finding.sentence) is (shape == "gyro low-passed")
    wider = allowed.numbers.half_width / fit.numbers.half_width
    assert wider[0] == wider[3] == 1.0
    moved = abs(found.factors[3]) * VALUES[1]
    assert wider[1] == pytest.approx(np.hypot(1.0, moved / 1e-4))


def test_sound_flights_have_no_filter():
    for seed in range(8):
        fit = flown(seed=seed, noise=0.3)
        assert not found_filter(fit).certain
        [finding] = sensor_response(allow_for_sensor_response(fit))
        assert finding.severity == "passed"


def test_where_the_rotors_explain_too_little_nothing_is_reported():
    fit = flown(noise=3.0)
    assert found_filter(fit) is None
    assert allow_for_sensor_response(fit) is fit


@pytest.mark.parametrize("change", [0.0, 0.15])
def test_thrust_that_changes_in_flight_widens_kt_and_inertia(change):
    """Half of the flight lifts 15 % more at the same speed, as near the ground."""
    flat = made_fit.prepared(seconds=40.0, speed=1310.0)
    late = np.arange(len(flat.data.time)) > 0.5 * len(flat.data.time)
    speed = flat.data.rotor_speed / np.sqrt(1.0 + change * late[:, None])
    data = replace(flat.data, rotor_speed=speed)
    dataset = made_fit.dataset(replace(flat, data=data, motor_channel=speed))
    values = (*VALUES, 1310.0, 5e3, 1e-5, 0.1)
    names = (*RATIOS, "accel_bias_z@A")
    numbers = made_fit.no_numbers(*names, values=values, half_width=1e-6 * np.array(values))
    fit = made_fit.fit(dataset, numbers)
    half = allow_for_thrust_change(fit).numbers.half_width / np.abs(values)
    before = fit.numbers.half_width / np.abs(values)
    assert half[3] == before[3]
    assert half[6] == before[6]
    if change:
        assert 0.07 < half[0] < 0.15
        assert 0.07 < half[1] < 0.15
        assert half[4] == pytest.approx(0.5 * half[0], rel=1e-3)
        assert half[5] == pytest.approx(change / (1.0 + change), rel=0.05)
        # A constant force that the thrust does not carry is the bias'.
        assert half[7] * values[7] == pytest.approx(GRAVITY * half[0], rel=1e-3)
    else:
        np.testing.assert_allclose(half, before)
