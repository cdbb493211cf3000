r"""Find the low-pass of an accelerometer in its noise, which passes it as the motion does.

Flights that move thrust little above 2 Hz do not show a low-pass at 10 Hz by their motion. Their
noise does: behind a low-pass of second order it falls with the fourth power of frequency. Its power
is

.. math:: P(f) = |H(f; f_c)|^2 (s_0 f^{-2} + s_1 + s_2 f^2), \qquad s_j \ge 0

with gusts, white noise and vibration, whose sum without H neither falls so steeply nor bends
downwards. So a filter of first order is not shown. The coefficients are those of Whittle's
likelihood, by updates that keep them positive (Fevotte, Bertin and Durrieu 2009, eq. 2.12 and
2.13). Spectra of real vehicles have peaks: a filter is judged by the scatter of log P about the
model, whose size is unknown, and a band counts once for all three axes, which share their peaks.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from rotorfit.fit.reduction.windows import WINDOW, transform_rows, window_starts

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from jaxtyping import Bool, Complex, Float

    from rotorfit.flight.flight_data import FlightData
    from rotorfit.model.vehicle import Vehicle

    Shape = Callable[[Float[np.ndarray, " l"]], Complex[np.ndarray, " l"]]
    """Gain of a low-pass by frequency over its cut-off."""

LOWEST: Final = 2.0
"""Frequency below which what is flown outdoes the noise of a sensor [Hz]."""
THIRD: Final = float(2.0 ** (1.0 / 3.0))
"""Width of a band, a third of an octave, as a factor."""
LEAST_POWER: Final = 1e-5
"""Share of an axis' largest power, below which the digits of a log may be what is left."""
FEWEST_BANDS: Final = 12
"""Bands of noise that a flight must show: four octaves, of which a filter bends one or two."""
UNEVENNESS: Final = 0.1
"""Least scatter of log power about a smooth spectrum: .4 dB."""
LEAST_SCATTER: Final = 0.3
"""Scatter of log power below which noise without a filter explains a spectrum: 1.3 dB. A filter
leaves 3 dB or more of it from its cut-off to twice that."""
MOST_SCATTER: Final = 0.25
"""Scatter of log power about the best model, above which a spectrum is too uneven to show a filter:
1.1 dB. A cut-off that is off by 20 % moves the power above it by 3 dB, and peaks of vibration are
octaves wide: the 30 Hz of a Crazyflie's firmware would be found at 19 to 32, leaving .3 to .8."""
LEAST_GAIN: Final = 1e-4
"""Least gain of a low-pass that is told from none left."""
NYQUIST_SHARE: Final = 0.9
"""Share of half the sample rate, up to which a filter of the log's own rate can have a cut-off."""
UPDATES: Final = 60
"""Updates of the coefficients."""
TINY: Final = float(np.finfo(float).tiny)


class NoiseSpectrum(NamedTuple):
    """Power of what an accelerometer shows beside the motion.

    - `frequency`: middle of each band [Hz].
    - `power`: by axis, over the largest of the axis.
    """

    frequency: Float[np.ndarray, " b"]
    power: Float[np.ndarray, "3 b"]


def judge_noise(
    data: FlightData,
    vehicle: Vehicle,
    shapes: Mapping[str, Shape],
    cutoffs: Float[np.ndarray, " c"],
    *,
    top: float,
) -> dict[str, Float[np.ndarray, " c"]] | None:
    """Compute by how much log-likelihood each low-pass explains the noise better than none.

    None where the log names filters of the accelerometer, which are taken off it, and where the
    noise needs no filter, is too uneven, or there is too little of it below `top` [Hz].
    """
    if any(one.channel == "accel" for one in data.filters):
        return None
    spectrum = measure_noise_spectrum(data, vehicle, top=top)
    if spectrum is None:
        return None
    f, rate = spectrum.frequency, data.sample_rate
    (scatter,) = measure_scatter(spectrum, np.ones((1, len(f))))
    if scatter < LEAST_SCATTER:
        return None
    left: dict[str, Float[np.ndarray, " c"]] = {}
    for name, shape in shapes.items():
        gains = np.abs([shape(f / cutoff) for cutoff in cutoffs])
        # Made at the log's own rate, filters fall to nothing at half of it (bilinear transform).
        warped = np.tan(np.pi * f / rate)
        own = cutoffs < 0.5 * NYQUIST_SHARE * rate
        gains_of_rate = gains.copy()
        gains_of_rate[own] = np.abs(
            [shape(warped / np.tan(np.pi * cutoff / rate)) for cutoff in cutoffs[own]]
        )
        either = [measure_scatter(spectrum, one) for one in (gains, gains_of_rate)]
        left[name] = np.min(either, axis=0)
    if min(one.min() for one in left.values()) > MOST_SCATTER:
        return None
    return {name: len(f) * np.log(scatter / one) for name, one in left.items()}


def measure_noise_spectrum(
    data: FlightData, vehicle: Vehicle, *, top: float
) -> NoiseSpectrum | None:
    """Compute the spectrum of an accelerometer's noise up to `top` [Hz]; None if it is too short.

    What thrust and angular acceleration explain of a band is taken off it.
    """
    rows = round(WINDOW * data.sample_rate)
    thrust = data.rotor_speed**2 @ vehicle.axes
    signals = np.column_stack([data.specific_force, thrust[:, 2], data.angular_acceleration])
    window = np.hanning(rows)[:, None]
    every = [
        transform_rows(signals[start : start + rows], window) for start in window_starts(data, rows)
    ]
    if not every:
        return None
    lines = np.array(every)
    bands = list(_split_thirds_of_octaves(np.fft.rfftfreq(rows, 1.0 / data.sample_rate), top))
    if len(bands) < FEWEST_BANDS:
        return None
    found = [
        _measure_noise_power(lines[:, inside].reshape(-1, signals.shape[1])) for _, inside in bands
    ]
    power: Float[np.ndarray, "3 b"] = np.array(found).T
    power = power / power.max(axis=1, keepdims=True).clip(min=TINY)
    lost = np.flatnonzero((power < LEAST_POWER).any(axis=0))
    last = int(lost[0]) if len(lost) else len(bands)
    frequency = np.array([middle for middle, _ in bands])
    if last < FEWEST_BANDS:
        return None
    return NoiseSpectrum(frequency[:last], power[:, :last])


def _split_thirds_of_octaves(
    frequency: Float[np.ndarray, " l"], top: float
) -> Iterator[tuple[float, Bool[np.ndarray, " l"]]]:
    """Yield the middle and the lines of every third of an octave that ends below `top`."""
    low = LOWEST
    while low * THIRD <= top:
        yield low * THIRD**0.5, (frequency >= low) & (frequency < low * THIRD)
        low *= THIRD


def _measure_noise_power(lines: Complex[np.ndarray, "n 7"]) -> Float[np.ndarray, " 3"]:
    """Compute the power of three channels beside what the four causes after them explain."""
    y, x = lines[:, :3], lines[:, 3:]
    x = x / np.linalg.norm(x, axis=0).clip(min=TINY)
    inverse: Complex[np.ndarray, "4 n"] = np.asarray(np.linalg.pinv(x), dtype=complex)
    left = y - x @ (inverse @ y)
    freedom = max(len(lines) - x.shape[1], 1)
    power: Float[np.ndarray, " 3"] = (np.abs(left) ** 2).sum(axis=0) / freedom
    return power


def measure_scatter(
    spectrum: NoiseSpectrum, gains: Float[np.ndarray, "c b"]
) -> Float[np.ndarray, " c"]:
    """Compute the scatter of log power about the model behind each low-pass (its gain by band)."""
    f, P = spectrum.frequency, spectrum.power
    P = P.clip(min=LEAST_POWER)
    u = f / np.sqrt(f[0] * f[-1])
    before = np.stack([u**-2, np.ones_like(u), u**2])
    X: Float[np.ndarray, "c 3 b"] = np.maximum(gains, LEAST_GAIN)[:, None] ** 2 * before
    by_band = np.ascontiguousarray(X.swapaxes(1, 2))
    s = np.tile((P / X.sum(axis=1)[:, None]).mean(axis=2)[:, :, None], (1, 1, 3))
    for _ in range(UPDATES):
        M = s @ X
        more, less = np.stack([P / M**2, 1.0 / M]) @ by_band
        s = s * np.sqrt(more / less)
    off = np.log(P / (s @ X))
    scatter: Float[np.ndarray, " c"] = np.sqrt((off**2).mean(axis=(1, 2)) + UNEVENNESS**2)
    return scatter
