"""Lines moved to another timing, against signals made anew there."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

import made_fit
from rotorfit.fit.reduction.frequency_bands import prepared_lines
from rotorfit.fit.reduction.line_moves import lines_at
from rotorfit.fit.reduction.motor_timing import FreeTiming
from rotorfit.flight.flight_data import Segment
from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.model.signals import rotor_columns, signal_layout

RATE = 200.0
AT = MotorResponse(lag=0.04, delay=0.01)
NAMES = ("motor_lag", "motor_delay", "motor_skew")
LAYOUT = signal_layout(made_fit.QUAD)


def slow_noise(rng, *shape):
    b, a = signal.butter(4, 4.0 / (RATE / 2))
    return np.asarray(signal.filtfilt(b, a, rng.normal(size=shape), axis=0))


def moving(seed):
    """A flight of 20 s that turns, its four rotors at 500 +- 30 rad/s."""
    rng = np.random.default_rng(seed)
    n = round(20.0 * RATE)
    flight = made_fit.prepared(rate=RATE, segments=(Segment(start=100, stop=n - 100),))
    data = replace(
        flight.data, angular_velocity=5.0 * slow_noise(rng, n, 3), differentiation="central"
    )
    return replace(flight, data=data, motor_channel=500.0 + 150.0 * slow_noise(rng, n, 4))


def errors(seed, by, *, at=AT, names=NAMES):
    """Return what moved lines, and straight slopes, leave of the change of the rotors' lines."""
    flight, free = moving(seed), FreeTiming(at=at, names=names)
    (here,) = prepared_lines(flight, made_fit.QUAD, at, free=free)
    to = free.moved(by)
    there = FreeTiming(at=to, names=names)
    (anew,) = prepared_lines(flight, made_fit.QUAD, to, free=there)
    (moved,) = lines_at([here], LAYOUT, free, to)
    z, rotors = len(LAYOUT), rotor_columns(LAYOUT, sloped=True)
    straight = here.lines[:, rotors].copy()
    for t, name in enumerate(names):
        first = z + t * len(rotors)
        straight += by.get(name, 0.0) * here.lines[:, first : first + len(rotors)]

    def away(lines):
        return float(np.linalg.norm(lines - anew.lines[:, rotors]))

    slopes = np.linalg.norm(moved.lines[:, z:] - anew.lines[:, z:])
    change = away(here.lines[:, rotors])
    share = float(slopes / np.linalg.norm(anew.lines[:, z:]))
    return away(moved.lines[:, rotors]) / change, away(straight) / change, share


@settings(max_examples=10, deadline=None)
@given(
    seed=st.integers(0, 100),
    lag=st.floats(-0.02, 0.04),
    delay=st.floats(-0.02, 0.02).filter(lambda d: abs(d) > 0.005),
)
def test_lines_follow_a_lag_and_a_delay_over_20_ms(seed, lag, delay):
    along, straight, slopes = errors(seed, {"motor_lag": lag, "motor_delay": delay})
    assert along < 0.05
    assert along < 0.2 * straight
    assert slopes < 0.1


@pytest.mark.parametrize("name", NAMES)
def test_small_moves_go_along_the_slopes(name):
    along, straight, slopes = errors(3, {name: 1e-4}, names=(name,))
    assert along < 1e-2 and straight < 1e-2
    assert slopes < 1e-2


def test_other_lines_and_those_at_their_own_timing_stay():
    flight, free = moving(1), FreeTiming(at=AT, names=NAMES)
    (here,) = prepared_lines(flight, made_fit.QUAD, AT, free=free)
    (same,) = lines_at([here], LAYOUT, free, AT)
    np.testing.assert_allclose(same.lines, here.lines, rtol=1e-12, atol=0.0)
    (moved,) = lines_at([here], LAYOUT, free, free.moved({"motor_delay": 0.01}))
    still = np.delete(np.arange(len(LAYOUT)), rotor_columns(LAYOUT, sloped=True))
    np.testing.assert_array_equal(moved.lines[:, still], here.lines[:, still])


def test_motors_without_lag_move_by_their_delay():
    along, straight, _ = errors(
        2, {"motor_delay": 0.01}, at=MotorResponse(delay=0.002), names=("motor_delay",)
    )
    assert along < 0.05 * straight
