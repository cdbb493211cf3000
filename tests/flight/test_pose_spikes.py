"""Single frames that jump: put back, and nothing else touched."""

import numpy as np
import pytest

from rotorfit.flight.mocap.spikes import without_spikes

RATE = 100.0
TIME = np.arange(2000) / RATE


def lively(seed=1, *, noise=1e-3):
    """Return a motion with up to 300 rad/s^2 (as of a Crazyflie's), and noise."""
    rng = np.random.default_rng(seed)
    swings = np.stack([0.3 * np.sin(2 * np.pi * 5.0 * TIME + k) for k in range(3)], axis=1)
    return swings + noise * rng.normal(size=swings.shape)


def test_motion_and_noise_are_left_alone():
    values = lively()
    clean, mended = without_spikes(TIME, values)
    assert not mended.any()
    assert clean is values


@pytest.mark.parametrize("size", [0.03, 0.07, 0.5])
def test_a_jump_of_one_frame_is_put_on_its_neighbours_cubic(size):
    values, at = lively(), [50, 333, 1200, 1206, 1990]
    jumped = values.copy()
    jumped[at, 1] += size
    clean, mended = without_spikes(TIME, jumped)
    assert np.flatnonzero(mended).tolist() == at
    np.testing.assert_allclose(clean, values, atol=6e-3)
    untouched = np.delete(np.arange(2000), at)
    np.testing.assert_array_equal(clean[untouched], values[untouched])


def test_what_jumps_and_stays_is_left():
    values = lively()
    values[700:] += 0.2
    values[1500:1504] += 0.2
    assert not without_spikes(TIME, values)[1].any()


def test_next_to_a_gap_nothing_is_judged():
    values = lively()
    values[1000] += 0.2
    time = TIME + np.where(np.arange(2000) > 1001, 0.5, 0.0)
    assert not without_spikes(time, values)[1][990:1010].any()
