"""What works through a long flight in pieces gives what it would give in one."""

import numpy as np
import pytest
from scipy import ndimage, signal

from rotorfit.flight.clocks import uniform_channels
from rotorfit.flight.motors.motor_model import (
    NOISE_ROWS,
    MotorResponse,
    following_speed,
    shift_time,
    two_way_lag,
    white_noise_std,
)
from rotorfit.flight.signals import hampel, smooth
from rotorfit.logs.flight_log import LONG, Channel, pieces

N = 2 * LONG + 1234
RATE = 500.0


@pytest.fixture(scope="module")
def wander():
    """A slow wander with noise and spikes, two columns."""
    rng = np.random.default_rng(5)
    x = np.cumsum(rng.normal(0, 0.1, (N, 2)), axis=0) + rng.normal(0, 1.0, (N, 2))
    for row in (LONG - 1, LONG, LONG + 2, N - 9):
        x[row, 0] += 300.0
    return x


def test_pieces_cover_all_rows_once():
    rows = np.arange(N)
    assert np.array_equal(np.concatenate([rows[p] for p in pieces(N)]), rows)
    assert pieces(0) == []


def test_spikes_at_the_edges_of_pieces_are_found_as_anywhere(wander):
    clean, spikes = hampel(wander)
    for k in range(2):
        x = wander[:, k]
        median = ndimage.median_filter(x, 7, mode="nearest")
        deviation = np.abs(x - median)
        local = ndimage.median_filter(deviation, 51, mode="nearest")
        low, high = np.percentile(x, [1.0, 99.0])
        floor = max(0.4 * np.percentile(deviation, 95), 1e-3 * (high - low))
        far = deviation > 6.0 * 1.4826 * np.maximum(local, floor)
        bad = clean[:, k] != x  # of those that are far, the sudden ones
        assert not (bad & ~far).any()
        assert np.array_equal(clean[bad, k], median[bad])
    assert spikes[[LONG - 1, LONG, LONG + 2, N - 9]].all()


def test_the_low_pass_in_pieces_is_that_of_the_whole(wander):
    sos = signal.butter(2, 8.0, fs=RATE, output="sos")
    whole = signal.sosfiltfilt(sos, wander, axis=0, padlen=9)
    assert smooth(wander, RATE, 8.0) == pytest.approx(whole, rel=1e-11, abs=1e-9)


def test_a_delay_in_pieces_is_that_of_the_whole(wander):
    late = shift_time(wander, RATE, 0.0033)
    for first in (0, LONG // 10 - 50, LONG - 50, N - 200):
        rows = slice(max(first - 20, 0), first + 200)
        part = shift_time(wander[rows], RATE, 0.0033)[20:-20]
        start = rows.start + 20
        assert late[start : start + len(part)] == pytest.approx(part, rel=1e-12, abs=1e-12)


def test_two_lags_of_several_rotors_are_those_of_each(wander):
    held = 800.0 + wander
    response = MotorResponse(lag=0.03, lag_down=0.06)
    together = following_speed(held, RATE, response)
    short = two_way_lag(held[:5000], RATE, up=0.03, down=0.06)
    assert together[:5000] == pytest.approx(short, rel=1e-9)
    alone = following_speed(held[:, 1:], RATE, response)
    assert np.array_equal(together[:, 1:], alone)


def test_the_noise_of_a_long_flight_is_that_of_its_spectrum(wander):
    spectrum = signal.welch(wander, fs=1.0, nperseg=NOISE_ROWS, axis=0, detrend="constant")[1]
    whole = np.sqrt(0.5 * np.median(spectrum[-NOISE_ROWS // 20 :]))
    assert white_noise_std(wander, [(0, N)]) == pytest.approx(whole, rel=1e-9)


def test_a_long_channel_is_resampled_by_lines(wander):
    time = np.arange(N) / RATE
    slow = time[::3] + 0.0007
    values = np.stack([np.sin(slow), slow], axis=1)
    channels = {
        "gyro": Channel(time=time, values=wander, source="gyro"),
        # A function may stand for a channel, and is called when its turn comes.
        "motor": lambda: Channel(time=slow, values=values, source="motor"),
    }
    uniform = uniform_channels(channels, clock="gyro")
    assert uniform.values["gyro"] is wander
    expected = [np.interp(uniform.time, slow, values[:, k]) for k in range(2)]
    a, b = uniform.stretches[0]
    assert (b - a) > N - 10
    assert uniform.values["motor"][a:b] == pytest.approx(np.array(expected).T[a:b], abs=1e-12)
