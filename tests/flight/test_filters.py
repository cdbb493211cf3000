"""Filters and spectral densities agree with scipy.signal."""

import numpy as np
import pytest
from jaxtyping import Float
from scipy import signal

from rotorfit.flight import filters, spectral_density

RATE = 400.0


@pytest.fixture(scope="module")
def records() -> Float[np.ndarray, "n 3"]:
    return np.cumsum(np.random.default_rng(5).normal(size=(1501, 3)), axis=0)


@pytest.mark.parametrize("cutoff", [3.0, 40.0, 180.0, (0.7, 12.0), (20.0, 150.0)])
@pytest.mark.parametrize("order", [1, 2, 3, 4, 6])
def test_butterworth(order: int, cutoff: float | tuple[float, float]) -> None:
    kind = "bandpass" if isinstance(cutoff, tuple) else "lowpass"
    expected = signal.butter(order, cutoff, kind, fs=RATE, output="sos")
    found = filters.butterworth(order, cutoff, RATE)
    assert found.shape == expected.shape
    poles = [np.sort_complex(signal.sos2zpk(sos)[1]) for sos in (found, expected)]
    np.testing.assert_allclose(poles[0], poles[1], rtol=0, atol=1e-12)
    slowest = np.abs(poles[1]).max()
    assert filters.slowest_pole(found) == pytest.approx(slowest, abs=1e-12)
    # Rounded coefficients hold fewer digits of a response far below the sample rate.
    lines = np.linspace(5.0, 0.49 * RATE, 300)
    responses = [signal.sosfreqz(sos, lines, fs=RATE)[1] for sos in (found, expected)]
    np.testing.assert_allclose(responses[0], responses[1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("order", [2, 4])
def test_sections_are_in_the_order_of_scipy(order: int) -> None:
    expected = signal.butter(order, 40.0, fs=RATE, output="sos")
    found = filters.butterworth(order, 40.0, RATE)
    np.testing.assert_allclose(found[:, 3:], expected[:, 3:], rtol=0, atol=1e-12)


@pytest.mark.parametrize("cutoff", [8.0, 60.0, (2.0, 30.0)])
@pytest.mark.parametrize("rows", [16, 40, 1501])
def test_filter_both_ways(
    rows: int, cutoff: float | tuple[float, float], records: Float[np.ndarray, "n 3"]
) -> None:
    sos = filters.butterworth(2, cutoff, RATE)
    pad = 3 * (2 * len(sos) + 1)
    x = records[:rows]
    expected = signal.sosfiltfilt(sos, x, axis=0, padlen=pad)
    scale = 1e-12 * np.abs(records).max()
    np.testing.assert_allclose(filters.filter_both_ways(sos, x), expected, rtol=0, atol=scale)
    np.testing.assert_allclose(
        filters.filter_both_ways(sos, x[:, 0]), expected[:, 0], rtol=0, atol=scale
    )


@pytest.mark.parametrize("rows", [1, 2, 5])
def test_a_record_shorter_than_the_padding_is_filtered(rows: int) -> None:
    sos = filters.butterworth(2, 40.0, RATE)
    x = np.arange(rows, dtype=float)[:, None] + 3.0
    expected = signal.sosfiltfilt(sos, x, axis=0, padlen=rows - 1)
    np.testing.assert_allclose(filters.filter_both_ways(sos, x), expected, rtol=1e-12)


def test_first_order_recursion(records: Float[np.ndarray, "n 3"]) -> None:
    for x in (records, records[:, 0], records[:0], records[:1]):
        expected = signal.lfilter([1.0], [1.0, -0.93], x, axis=0)
        found = filters.first_order_recursion(x, 0.93)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    before = records.copy()
    filters.first_order_recursion(np.asfortranarray(before), 0.93)
    np.testing.assert_array_equal(before, records)


@pytest.mark.parametrize("taper", [0.0, 0.2, 0.35, 1.0])
@pytest.mark.parametrize("count", [0, 1, 2, 3, 10, 101])
def test_tukey_window(count: int, taper: float) -> None:
    np.testing.assert_allclose(
        filters.tukey_window(count, taper), signal.windows.tukey(count, taper), atol=1e-12
    )


def test_kaiser_low_pass() -> None:
    count, beta = signal.kaiserord(100.0, 60.0 / (0.5 * RATE))
    expected = signal.firwin(count | 1, 50.0, window=("kaiser", beta), fs=RATE)
    found = filters.kaiser_low_pass(50.0, 60.0, 100.0, RATE)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("step", [2, 3, 5])
@pytest.mark.parametrize("taps", [3, 41])
def test_thinned_sums(step: int, taps: int, records: Float[np.ndarray, "n 3"]) -> None:
    weights = np.random.default_rng(1).normal(size=taps)
    expected = signal.lfilter(weights[::-1], [1.0], records, axis=0)[taps - 1 :: step]
    found = filters.thinned_sums(weights, records, step)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)


def test_correlate(records: Float[np.ndarray, "n 3"]) -> None:
    x, y = records[:400, 0], records[:151, 1]
    expected = signal.correlate(x, y, mode="full")
    size = float(np.abs(expected).max())
    np.testing.assert_allclose(filters.correlate(x, y), expected, rtol=0, atol=1e-12 * size)


def test_without_line(records: Float[np.ndarray, "n 3"]) -> None:
    np.testing.assert_allclose(
        filters.without_line(records), signal.detrend(records, axis=0), rtol=0, atol=1e-10
    )
    assert not filters.without_line(records[:1]).any()


@pytest.mark.parametrize("window", [64, 63, 2000])
def test_densities(window: int, records: Float[np.ndarray, "n 3"]) -> None:
    rows = min(window, len(records))
    f, expected = signal.welch(records, RATE, nperseg=rows, axis=0)
    found = spectral_density.power_density(records, RATE, window)
    np.testing.assert_allclose(found[0], f, rtol=1e-12)
    np.testing.assert_allclose(found[1], expected, rtol=1e-9, atol=1e-12 * expected.max())
    _, cross = signal.csd(records[:, 0], records[:, 1], RATE, nperseg=rows)
    size = float(np.abs(cross).max())
    _, pairs = spectral_density.cross_densities(records, RATE, window)
    np.testing.assert_allclose(pairs[0, 1], cross, rtol=0, atol=1e-12 * size)
    np.testing.assert_allclose(pairs[1, 0], cross.conj(), rtol=0, atol=1e-12 * size)


def test_windowed_lines_with_zeros_added(records: Float[np.ndarray, "n 3"]) -> None:
    _, _, expected = signal.spectrogram(records.T, 1.0, "hann", 64, 50, nfft=256)
    lines = spectral_density.windowed_lines(records, 64, 14, padded=256)
    power = np.moveaxis(np.abs(lines) ** 2, (0, 1, 2), (2, 1, 0))[:, 1:-1]
    np.testing.assert_allclose(2.0 * power, expected[:, 1:-1], rtol=0, atol=1e-12 * expected.max())


@pytest.mark.parametrize("decimals", [0, 1, 8])
@pytest.mark.parametrize("least", [0.0, 0.7, 3.0])
def test_prominent_peaks(decimals: int, least: float, records: Float[np.ndarray, "n 3"]) -> None:
    """Rounded values have flat tops, whose middle is taken."""
    level = np.round(records[:400, 0], decimals)
    places, about = signal.find_peaks(level, prominence=least)
    found = spectral_density.prominent_peaks(level, least)
    assert [at for at, _ in found] == places.tolist()
    assert [rise for _, rise in found] == pytest.approx(about["prominences"].tolist())
