import numpy as np
import pytest

from rotorfit.flight.signals import central_difference, hampel, smooth, true_runs

N = 60_000


def motion(seed, std):
    """A flight's worth of motion at 200 Hz with the noise of a sensor."""
    rng = np.random.default_rng(seed)
    t = np.arange(N) / 200
    exact = np.stack([np.sin(2 * np.pi * f * t) for f in (0.7, 1.1, 1.6)], axis=1)
    return exact, exact + std * rng.normal(size=(N, 3)), rng


@pytest.mark.parametrize(("std", "share", "size"), [(0.4, 0.005, 8.0), (0.02, 0.002, 0.5)])
def test_spikes_are_taken_out_and_the_noise_is_as_before(std, share, size):
    exact, noisy, rng = motion(1, std)
    hit = rng.uniform(size=noisy.shape) < share
    spiked = noisy + hit * size * rng.choice([-1.0, 1.0], noisy.shape)
    clean, spikes = hampel(spiked)
    touched = clean != spiked
    assert touched[hit].mean() > 0.995
    assert touched[~hit].mean() < 1e-3
    assert np.array_equal(spikes, touched.any(axis=1))
    assert (clean - exact).std() == pytest.approx(std, rel=0.02)
    assert np.abs(clean - exact).max() < 6 * std


@pytest.mark.parametrize("std", [0.0, 0.02, 0.4])
def test_plain_noise_and_smooth_motion_are_left_alone(std):
    _, noisy, _ = motion(2, std)
    clean, spikes = hampel(noisy)
    assert spikes.mean() < 1e-3
    assert (clean != noisy).mean() < 1e-3


@pytest.mark.parametrize("size", [1e3, 1e6, 9e8])
def test_spikes_of_any_size_are_found(size):
    _, noisy, rng = motion(3, 0.02)
    noisy[rng.choice(N, 30, replace=False), 1] = size
    clean, spikes = hampel(noisy)
    assert np.abs(clean).max() < 1.2
    assert 30 <= spikes.sum() < 30 + N * 1e-3


@pytest.mark.parametrize("share", [0.04, 0.06, 0.1])
def test_lost_values_are_found_however_many(share):
    """One in twenty makes the 95th percentile of the deviations that shows what is usual."""
    _, noisy, rng = motion(8, 0.02)
    rotor = 1500.0 + 300.0 * noisy[:, :1]
    lost = rng.uniform(size=rotor.shape) < share
    clean, _ = hampel(np.where(lost, 0.0, rotor))
    assert (np.abs(clean - rotor) > 60.0).mean() < 0.005


def test_a_spike_in_a_constant_signal_is_found():
    x = np.full((1000, 1), 5.0)
    x[500] = 1e6
    clean, spikes = hampel(x)
    assert (clean == 5.0).all()
    assert spikes.sum() == 1


def test_steps_stay_sharp():
    rng = np.random.default_rng(4)
    x = np.repeat(rng.uniform(300, 900, 200), 50)[:, None] + rng.normal(size=(10_000, 1))
    clean, spikes = hampel(x)
    assert spikes.mean() < 1e-3
    assert np.abs(clean - x).max() < 10


def test_quantised_signals_are_left_alone():
    rng = np.random.default_rng(5)
    quiet = np.round(0.3 * rng.normal(size=(5000, 1)))  # nearly always zero, now and then a step
    moving = np.round(10 * np.sin(np.arange(5000) / 50))[:, None]
    assert hampel(quiet)[1].mean() < 1e-3
    assert hampel(moving)[1].sum() == 0


def test_a_burst_of_motion_after_a_long_rest_is_no_spike():
    rng = np.random.default_rng(6)
    t = np.arange(10_000) / 500
    burst = 20 * np.sin(2 * np.pi * 5 * t) * ((t > 18) & (t < 18.5))
    x = (burst + 0.005 * rng.normal(size=t.size))[:, None]
    clean, spikes = hampel(x)
    assert spikes.mean() < 2e-3
    assert np.abs(clean - x).max() < 0.5


def test_the_crest_of_a_quick_turn_in_a_slow_log_is_no_spike():
    """Flattened crests look as if the gyro ended there."""
    rng = np.random.default_rng(7)
    t = np.arange(1600) / 50
    throw = 7.0 * np.exp(-(((t - 2.5) / 0.08) ** 2))
    x = (throw + 0.3 * np.sin(2 * np.pi * 0.4 * t) + 0.01 * rng.normal(size=t.size))[:, None]
    assert hampel(x)[1].sum() == 0
    x[700] += 1.0
    clean, spikes = hampel(x)
    assert np.flatnonzero(spikes).tolist() == [700]
    assert clean[700] == pytest.approx(x[699], abs=0.1)


def test_short_signals_and_the_argument_are_left_alone():
    x = np.array([[0.0], [1e6], [0.0]])
    assert np.array_equal(hampel(x)[0], x)
    y = np.zeros((100, 1))
    y[50] = 9.0
    hampel(y)
    assert y[50] == 9.0


def test_the_central_difference_of_a_parabola_is_exact():
    t = np.arange(50) / 100
    x = np.stack([3 + 2 * t - 5 * t**2, t], axis=1)
    slope = central_difference(x, 100.0)
    assert slope[1:-1, 0] == pytest.approx(2 - 10 * t[1:-1])
    assert slope[:, 1] == pytest.approx(1)


@pytest.mark.parametrize("n", [2, 5, 40, 4000])
def test_smoothing_keeps_constants_and_halves_power_at_cutoff(n):
    assert smooth(np.full((n, 2), 3.0), 500.0, 8.0) == pytest.approx(3.0)
    if n == 4000:
        x = np.sin(2 * np.pi * 8 * np.arange(n) / 500)[:, None]
        assert smooth(x, 500.0, 8.0)[500:3500].std() == pytest.approx(x.std() / 2, rel=1e-3)


def test_true_runs():
    assert true_runs(np.array([], dtype=bool)) == []
    assert true_runs(np.array([True, True, False, True])) == [(0, 2), (3, 4)]
