"""Frequency responses of the filters that autopilots run, exact for samples."""

import numpy as np
from jaxtyping import Complex, Float

Response = Complex[np.ndarray, " f"]
"""Of one filter at some frequencies."""


def delays(frequency: Float[np.ndarray, " f"], period: float) -> Response:
    """Compute z = exp(i 2 pi f T) at frequencies [Hz] for a sample period [s]."""
    return np.exp(2j * np.pi * frequency * period)


def smoothing(cutoff: float, period: float) -> float:
    """Compute the share of the new sample in a first-order low-pass: T / (T + 1 / (2 pi fc)).

    `calc_lowpass_alpha_dt` of ArduPilot, `AlphaFilter::setCutoffFreq` of PX4; 1 without a cut-off.
    """
    return 1.0 if cutoff <= 0.0 else period / (period + 1.0 / (2.0 * np.pi * cutoff))


def first_order(z: Response, cutoff: float, period: float) -> Response:
    """Compute the response of a first-order low-pass with a cut-off [Hz]; 1 where that is 0."""
    alpha = smoothing(cutoff, period)
    return alpha / (1.0 - (1.0 - alpha) / z)


def second_order(z: Response, cutoff: float, period: float) -> Response:
    """Compute the response of a Butterworth low-pass of two poles, by the bilinear transform.

    `LowPassFilter2p` of PX4 and ArduPilot alike; 1 where the cut-off [Hz] is 0.
    """
    if cutoff <= 0.0 or cutoff >= 0.5 / period:
        return np.ones_like(z)
    k = np.tan(np.pi * cutoff * period)
    c = 1.0 + np.sqrt(2.0) * k + k * k
    top = k * k * (1.0 + 2.0 / z + 1.0 / z**2)
    return top / (c + 2.0 * (k * k - 1.0) / z + (1.0 - np.sqrt(2.0) * k + k * k) / z**2)


def integral(z: Response, period: float, *, late: bool) -> Response:
    """Compute the response of a running sum times the period [s]; late: of earlier samples only."""
    return period / (z - 1.0) if late else period / (1.0 - 1.0 / z)


def difference(z: Response, period: float) -> Response:
    """Compute the response of the difference of two samples over the period [1/s]."""
    return (1.0 - 1.0 / z) / period


def hold(frequency: Float[np.ndarray, " f"], period: float) -> Response:
    """Compute the response of a command that is held from sample to sample [s]."""
    s = 2j * np.pi * frequency * period
    return (1.0 - np.exp(-s)) / s
