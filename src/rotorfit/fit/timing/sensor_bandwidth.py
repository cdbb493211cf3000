"""The bandwidth of the sensors of all flights, and up to where each of their errors counts."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.fit.dataset.dataset import ConfigurationData, LoadedFlight, with_flights
from rotorfit.fit.reduction.bandwidth import LEAST_FOLLOWED, LOWEST, Sensor, bandwidths
from rotorfit.fit.reduction.frequency_bands import EDGES, retimed
from rotorfit.flight.on_board import MOST_RESTORED, response_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

    from rotorfit.estimation.factors import Factors
    from rotorfit.fit.timing.timed_dataset import TimedDataset
    from rotorfit.logs.firmware import Filter

GRID: Final = np.arange(LOWEST, EDGES[-1], 0.05)
"""Frequencies at which a sensor is judged [Hz]."""
PLACES: Final[dict[Sensor, slice]] = {"accel": slice(0, 3), "gyro": slice(3, 6)}
"""Which of the six accelerations each sensor measures."""


def measure_bandwidths(dataset: TimedDataset) -> TimedDataset:
    """Measure the bandwidth of the sensors of every flight, at the timing of its motors."""

    def measured(flight: LoadedFlight) -> LoadedFlight:
        prepared = flight.prepared
        data = retimed(prepared, dataset.timing)
        top = 0.4 * prepared.slowest_rate
        return dataclasses.replace(flight, bandwidths=bandwidths(data, dataset.vehicle, top=top))

    return with_flights(dataset, measured).keeping_bands(dataset)


def flight_reach(flight: LoadedFlight) -> Float[np.ndarray, " 6"]:
    """Return up to which frequency each acceleration of a flight follows the model [Hz]."""
    reach = np.full(6, np.inf)
    reach[PLACES["accel"]] = _known_reach(flight.prepared.data.filters)
    for sensor, found in flight.bandwidths.items():
        reach[PLACES[sensor]] = np.minimum(
            # The timing of the motors is that of the gyro: its delay is in it, the accelerometer's
            # is not.
            reach[PLACES[sensor]],
            found.follows(GRID, in_phase=sensor == "accel"),
        )
    return reach


def _known_reach(filters: Sequence[Filter]) -> float:
    """Return up to which frequency the accelerometer has the gyro's filters, as the rotors do."""
    accel, gyro = (response_of(filters, name, GRID) for name in ("accel", "gyro"))
    # The accelerometer's own filters are taken off where they left enough of it
    # (`on_board.with_filters`).
    if any(one.channel == "accel" for one in filters):
        unlike = np.flatnonzero(np.abs(accel / gyro) * MOST_RESTORED < 1.0)
    else:
        unlike = np.flatnonzero(np.real(accel / gyro) < LEAST_FOLLOWED)
    return float(GRID[unlike[0]]) if len(unlike) else np.inf


def sensor_reach(configured: ConfigurationData, factors: Factors) -> Float[np.ndarray, "b 6"]:
    """Return the highest frequency that counts, of every block and acceleration [Hz]."""
    flights = np.array([flight_reach(flight) for flight in configured.flights])
    return flights[factors.recording]
