"""Spectra of the measured and of the predicted accelerations."""

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Complex, Float
from scipy import stats

from rotorfit.dataset.dataset import ConfigurationData, LoadedFlight
from rotorfit.estimation.banded_problem import solved
from rotorfit.fit.fit import Fit
from rotorfit.fit.joint.joint_problem import theta_of
from rotorfit.model.signals import signal_matrix
from rotorfit.preprocessing.flight_data import FlightData
from rotorfit.reduction.frequency_bands import EDGES, retimed

LOWEST: Final = 1.0
"""Frequency below which the air responds with a phase of its own [Hz]."""
WINDOW: Final = 2.0
"""Length of one window, each overlapping the next by half: about a manoeuvre [s]."""
FED_BACK: Final = 0.6
"""Deviation of the share of the unexplained that goes with the rotors, because the autopilot
responds: over all bands and axes of 13 real flights, of autopilots' and of simulated ones."""
LIFT: Final = (2,)
TURNS: Final = (3, 4, 5)
"""Which of the six accelerations accelerometer and gyro measure best."""


class Spectra(NamedTuple):
    """Lines [Hz] of the six accelerations of every window, measured and predicted."""

    frequency: Float[np.ndarray, " l"]
    measured: Complex[np.ndarray, "w l k"]
    predicted: Complex[np.ndarray, "w l k"]

    def band(self, low: float, high: float) -> "Spectra":
        """Select the lines of a band."""
        inside = (self.frequency >= low) & (self.frequency < high)
        return Spectra(self.frequency[inside], self.measured[:, inside], self.predicted[:, inside])


def flight_spectra(fit: Fit) -> Iterator[tuple[LoadedFlight, Spectra]]:
    """Yield the spectra of every flight that has a window."""
    dataset, estimate = fit.dataset, fit.estimate
    theta = theta_of(estimate.problem.map, estimate.estimate.values, fit.configurations)
    each = solved(dataset.model.tensor, theta, estimate.problem.noisy)[0]
    for configured, G in zip(dataset.configurations, each, strict=True):
        yield from _own_spectra(fit, configured, G)


def _own_spectra(
    fit: Fit, configured: ConfigurationData, G: Float[np.ndarray, "k z"]
) -> Iterator[tuple[LoadedFlight, Spectra]]:
    for flight in configured.flights:
        data = retimed(flight.prepared, fit.dataset.timing)
        rows = round(WINDOW * data.sample_rate)
        frequency = np.fft.rfftfreq(rows, 1.0 / data.sample_rate)
        top = min(EDGES[-1], 0.4 * flight.prepared.slowest_rate)
        inside = (frequency >= LOWEST) & (frequency < top)
        lines = [_lines(fit, data, start, G)[inside] for start in _windows(data, rows)]
        if lines:
            measured, predicted = np.split(np.array(lines), 2, axis=2)
            yield flight, Spectra(frequency[inside], measured, predicted)


def _windows(data: FlightData, rows: int) -> Iterator[int]:
    """Yield the first rows of the windows."""
    for segment in data.segments:
        yield from range(segment.start, segment.stop - rows + 1, rows // 2)


def _lines(
    fit: Fit, data: FlightData, start: int, G: Float[np.ndarray, "k z"]
) -> Complex[np.ndarray, "l k2"]:
    """Transform one window: the accelerations as measured, then as predicted."""
    dataset, noisy = fit.dataset, list(fit.estimate.problem.noisy)
    stop = start + round(WINDOW * data.sample_rate)
    Z = signal_matrix(data, dataset.vehicle, start, stop, added=dataset.model.layout.added)
    both = np.column_stack([Z[:, noisy], Z[:, noisy] - Z @ G.T])
    window = np.hanning(stop - start)[:, None]
    return np.fft.rfft((both - both.mean(axis=0)) * window, axis=0)


def deviation_by_chance(
    score: Float[np.ndarray, " w"], information: Float[np.ndarray, " w"]
) -> float:
    """Compute the deviation of a number by windows, with their effective degrees of freedom.

    `score`, `information`: of each window.
    """
    total = float(information.sum())
    # Windows overlap by half: of three, two are their own.
    shares = information / total
    degrees = max(1.0 / float(shares @ shares) / 1.5, 1.0)
    t = float(stats.t.ppf(0.975, degrees)) / 1.96
    return t * float(np.linalg.norm(score / total))
