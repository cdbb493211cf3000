"""The low-pass of an accelerometer, by its noise: made flights that are flown slowly."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import butter, sosfilt

import made_fit
from rotorfit.fit.reduction.bandwidth import (
    CUTOFFS,
    ON_BOARD,
    SHAPES,
    bandwidths,
    channel_lines,
    measured_bandwidth,
)
from rotorfit.fit.reduction.noise_rolloff import judge_noise
from rotorfit.flight.flight_data import Segment
from rotorfit.logs.firmware import Filter

RATE = 200.0
SECONDS = 30.0
FASTER = 8
"""Steps of the loop on board for each row of the log."""


def smoothed_noise(rng, rows, *, rate, cutoff, order):
    passed = butter(order, cutoff, fs=rate, output="sos")
    noise = sosfilt(passed, rng.normal(size=(rows, 3)), axis=0)
    return noise / noise.std(axis=0)


def slow_flight(seed, *, cutoff=None, gusts=0.0, on_board=False):
    """Thrust that moves below 1 Hz, and an accelerometer with noise and gusts behind a low-pass.

    `on_board`: filtered in a loop that is faster than the log.
    """
    rng = np.random.default_rng(seed)
    rate = RATE * (FASTER if on_board else 1)
    rows = round(rate * SECONDS)
    motion = smoothed_noise(rng, rows, rate=rate, cutoff=0.7, order=4)[:, :1]
    speed = 500.0 * (1.0 + 0.05 * motion)
    force = 0.4 * np.sqrt(rate / RATE) * rng.normal(size=(rows, 3))
    force += gusts * smoothed_noise(rng, rows, rate=rate, cutoff=0.5, order=1)
    force[:, 2:] += 9.81 * (speed / 500.0) ** 2
    if cutoff is not None:
        force = sosfilt(butter(2, cutoff, fs=rate, output="sos"), force, axis=0)
    kept = slice(None, None, FASTER if on_board else 1)
    force, speed = force[kept], np.repeat(speed[kept], 4, axis=1)
    made = made_fit.prepared(seconds=SECONDS, segments=(Segment(start=1, stop=5),)).data
    still = np.zeros((len(speed), 3))
    return replace(
        made,
        sample_rate=RATE,
        time=np.arange(len(speed)) / RATE,
        specific_force=force,
        angular_velocity=still,
        angular_acceleration=still + rng.normal(size=still.shape),
        rotor_speed=speed,
        rotor_acceleration=np.gradient(speed, 1.0 / RATE, axis=0),
        differentiation="exact",
        segments=(Segment(start=round(RATE), stop=len(speed)),),
        velocity=None,
        carried=None,
        climb=None,
    )


@settings(max_examples=15, deadline=None)
@given(st.floats(8.0, 15.0), st.booleans(), st.floats(0.0, 0.3), st.integers(0, 1000))
def test_noise_shows_a_filter_above_the_motion(cutoff, on_board, gusts, seed):
    """To a fifth: at 18 Hz one in five is 23 to 31 % low, at 6 Hz in gusts 20 to 36 % high."""
    data = slow_flight(seed, cutoff=cutoff, gusts=gusts, on_board=on_board)
    found = bandwidths(data, made_fit.QUAD, top=80.0)["accel"]
    assert found.cutoff == pytest.approx(cutoff, rel=0.2)
    assert found.shape == "second order"


@settings(max_examples=10, deadline=None)
@given(st.floats(6.0, 15.0), st.booleans(), st.floats(0.0, 0.3), st.integers(0, 1000))
def test_the_interval_of_a_filter_holds_its_cutoff(cutoff, on_board, gusts, seed):
    data = slow_flight(seed, cutoff=cutoff, gusts=gusts, on_board=on_board)
    low, high = bandwidths(data, made_fit.QUAD, top=80.0)["accel"].interval
    assert low < cutoff < high


@pytest.mark.parametrize("seed", range(3))
def test_noise_that_tells_a_shape_decides_it(seed):
    """Where motors are timed too late, the motion behind a low-pass looks smoothed both ways."""
    frequency, channels = channel_lines(slow_flight(seed), made_fit.QUAD, top=80.0)
    # The motion, well below, is late by nothing: it leaves more to a shape that is not late.
    peak = np.exp(-(np.log(CUTOFFS / 6.0) ** 2) / 0.02)
    noise = {name: 195.0 * peak for name in SHAPES}
    undecided = measured_bandwidth(frequency, [channels["az"]], noise)
    noise["second order"] = 200.0 * peak
    decided = measured_bandwidth(frequency, [channels["az"]], noise)
    assert undecided is not None
    assert undecided.shape != "second order"
    assert decided is not None
    assert decided.shape == "second order"
    assert decided.cutoff == pytest.approx(6.0, rel=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_noise_that_no_smoothing_leaves_is_of_a_filter_on_board(seed):
    """First and second order are alike by it: J_r was 50 % off, of an accelerometer at 10 Hz."""
    frequency, channels = channel_lines(slow_flight(seed), made_fit.QUAD, top=80.0)
    peak = np.exp(-(np.log(CUTOFFS / 6.0) ** 2) / 0.02)
    noise = {name: (199.0 if name in ON_BOARD else 195.0) * peak for name in SHAPES}
    shown = measured_bandwidth(frequency, [channels["az"]], noise)
    assert shown is not None
    assert shown.shape in ON_BOARD
    assert shown.cutoff == pytest.approx(6.0, rel=0.1)


@settings(max_examples=15, deadline=None)
@given(st.floats(0.0, 2.0), st.integers(0, 1000))
def test_gusts_above_white_noise_are_no_filter(gusts, seed):
    data = slow_flight(seed, gusts=gusts)
    assert bandwidths(data, made_fit.QUAD, top=80.0) == {}


def test_an_uneven_spectrum_shows_no_filter():
    """A vibration of 25 Hz, wide as those of motors that change their speed."""
    data = slow_flight(0, cutoff=8.0)
    peak = butter(1, [20.0, 30.0], fs=RATE, btype="bandpass", output="sos")
    shaken = sosfilt(peak, np.random.default_rng(0).normal(size=data.specific_force.shape), axis=0)
    uneven = replace(data, specific_force=data.specific_force + shaken)
    assert judge_noise(data, made_fit.QUAD, SHAPES, CUTOFFS, top=80.0) is not None
    assert judge_noise(uneven, made_fit.QUAD, SHAPES, CUTOFFS, top=80.0) is None


def test_a_filter_that_the_log_names_is_not_looked_for():
    named = Filter(channel="accel", kind="low-pass", low=8.0, high=8.0, setting="x", passed=True)
    data = replace(slow_flight(0, cutoff=8.0), filters=(named,))
    assert judge_noise(data, made_fit.QUAD, SHAPES, CUTOFFS, top=80.0) is None
