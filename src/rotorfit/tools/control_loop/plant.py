"""Responses between the controller's output and the rate that it hears: vehicle and filters."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from jaxtyping import Complex, Float

    Response = Complex[np.ndarray, " f"]
    """The response of one filter at some frequencies."""


def delays(frequency: Float[np.ndarray, " f"], period: float) -> Response:
    """Compute z = exp(i 2 pi f T) at frequencies [Hz] for a sample period [s]."""
    return np.exp(2j * np.pi * frequency * period)


def smoothing(cutoff: float, period: float) -> float:
    """Compute the share of the new sample in a first-order low-pass: T / (T + 1 / (2 pi fc)).

    `calc_lowpass_alpha_dt` of ArduPilot, `AlphaFilter::setCutoffFreq` of PX4; 1 without a cut-off.
    """
    return 1.0 if cutoff <= 0.0 else period / (period + 1.0 / (2.0 * np.pi * cutoff))


def first_order(z: Response, cutoff: float, period: float) -> Response:
    """Compute the response of a first-order low-pass with a cut-off [Hz]; 1 if that is 0."""
    alpha = smoothing(cutoff, period)
    return alpha / (1.0 - (1.0 - alpha) / z)


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


@frozen_dataclass
class GyroFilter:
    """A filter on board between the gyro and the rate controller; it runs at the gyro's rate.

    `LowPassFilter2p` and `NotchFilter` of PX4 and ArduPilot, in continuous time: what their samples
    add is in the delay that the log shows (`controller_response`).

    - `frequency`: cut-off of a low-pass, middle of a notch [Hz].
    - `order`: of a low-pass: 1, or 2 (Butterworth); 0 is a notch.
    - `width`: of a notch [Hz].
    - `floor`: share that a notch leaves in its middle.
    """

    frequency: float
    order: int
    width: float = 0.0
    floor: float = 0.0

    def response(self, frequency: Float[np.ndarray, " f"]) -> Response:
        """Compute its response at frequencies [Hz]."""
        s = 1j * frequency / self.frequency
        if self.order == 1:
            return 1.0 / (1.0 + s)
        if self.order == 2:
            return 1.0 / (1.0 + np.sqrt(2.0) * s + s * s)
        damped = self.width / self.frequency * s
        return (1.0 + self.floor * damped + s * s) / (1.0 + damped + s * s)


def from_lag(
    lag: Float[np.ndarray, " D"], delay: Float[np.ndarray, " D"]
) -> tuple[Float[np.ndarray, " D"], Float[np.ndarray, " D"]]:
    """Take from the lag what a delay is below zero [s]; their sum stays."""
    less = np.minimum(np.maximum(-delay, 0.0), np.maximum(lag, 0.0))
    return lag - less, delay + less


@frozen_dataclass
class Plant:
    """One axis of D vehicles, the nominal one first, hovering.

    - `gain`: angular acceleration per output [rad/s^2].
    - `damping`: rate that air drag takes off per time [1/s].
    - `lag`, `delay`: of the motors, without what the filter of the gyro adds [s].
    """

    gain: Float[np.ndarray, " D"]
    damping: Float[np.ndarray, " D"]
    lag: Float[np.ndarray, " D"]
    delay: Float[np.ndarray, " D"]

    @property
    def spread(self) -> Float[np.ndarray, "2 D"]:
        """Logarithm of the gain, and lag with delay [s], each over those of the nominal one."""
        late = self.lag + self.delay
        return np.stack([np.log(self.gain / self.gain[0]), late - late[0]])

    @property
    def nominal(self) -> Plant:
        """The first of them alone."""
        first = slice(0, 1)
        return Plant(
            gain=self.gain[first],
            damping=self.damping[first],
            lag=self.lag[first],
            delay=self.delay[first],
        )

    def moved(self, gain: Float[np.ndarray, " D"], late: Float[np.ndarray, " D"]) -> Plant:
        """Return the vehicles with the logarithm of their gain and their delay [s] changed."""
        lag, delay = from_lag(self.lag, self.delay + late)
        return replace(self, gain=self.gain * np.exp(gain), lag=lag, delay=delay)

    def response(
        self, frequency: Float[np.ndarray, " f"], period: float
    ) -> Complex[np.ndarray, "D f"]:
        """Compute the rate [rad/s] over an output that is held for a period [s]."""
        s = 2j * np.pi * frequency[None, :]
        gain, damping, lag, delay = (
            values[:, None] for values in (self.gain, self.damping, self.lag, self.delay)
        )
        return (
            hold(frequency, period) * gain * np.exp(-s * delay) / ((s + damping) * (1.0 + lag * s))
        )
