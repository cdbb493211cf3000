"""The bandwidth of the sensors of all flights, and up to where each of their errors counts."""

from __future__ import annotations

import dataclasses
from itertools import count
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.fit.dataset.dataset import ConfigurationData, LoadedFlight, with_flights
from rotorfit.fit.reduction.bandwidth import LEAST_FOLLOWED, LOWEST, ON_BOARD, Sensor, bandwidths
from rotorfit.fit.reduction.frequency_bands import EDGES, or_every, retimed
from rotorfit.fit.reduction.still_axes import still_axes
from rotorfit.flight.motors.motor_model import clock_jumps
from rotorfit.flight.on_board import MOST_RESTORED, response_of, without_lateness

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Complex, Float

    from rotorfit.estimation.factors import Factors
    from rotorfit.fit.reduction.bandwidth import Bandwidth
    from rotorfit.fit.timing.timed_dataset import TimedDataset
    from rotorfit.logs.firmware import Filter

GRID: Final = np.arange(LOWEST, EDGES[-1], 0.05)
"""Frequencies at which a sensor is judged [Hz]."""
SMALL_MOVE: Final = 0.004
"""Longest move of rotors that leaves a bandwidth as it was measured [s]: delays are tried in such
steps beside it, further to either side than motors are late."""
PLACES: Final[dict[Sensor, slice]] = {"accel": slice(0, 3), "gyro": slice(3, 6)}
"""Which of the six accelerations each sensor measures."""


def measure_bandwidths(dataset: TimedDataset) -> TimedDataset:
    """Measure the bandwidth of the sensors of every flight, at the timing of its motors.

    One whose lateness was taken off the samples stays as it was found.
    """

    def measured(flight: LoadedFlight) -> LoadedFlight:
        prepared = flight.prepared
        data = retimed(prepared, dataset.timing)
        found = bandwidths(data, dataset.vehicle, top=0.4 * prepared.slowest_rate)
        kept = {sensor: one for sensor, one in flight.bandwidths.items() if one.taken_off}
        return dataclasses.replace(flight, bandwidths={**found, **kept})

    return with_flights(dataset, measured).keeping_bands(dataset)


def measured_at_timing(dataset: TimedDataset) -> TimedDataset:
    """Return a dataset whose motors were timed since, with its bandwidths at that timing.

    Of measured speeds that hardly moved nothing but the delay beside a low-pass is another; the lag
    of commands changes what the rotors make of every frequency.
    """
    timing = dataset.timing
    moved = 0.0 if timing is None else timing.delay - dataset.declared.delay
    if dataset.motors.speed == "commanded" or abs(moved) > SMALL_MOVE:
        return measure_bandwidths(dataset)
    if moved == 0.0 or not any(flight.bandwidths for flight in dataset.flights):
        return dataset

    def shifted(flight: LoadedFlight) -> LoadedFlight:
        found = {
            sensor: one if one.taken_off else dataclasses.replace(one, delay=one.delay - moved)
            for sensor, one in flight.bandwidths.items()
        }
        return dataclasses.replace(flight, bandwidths=found)

    return with_flights(dataset, shifted).keeping_bands(dataset)


def take_off_lateness(dataset: TimedDataset) -> TimedDataset:
    """Take the lateness of a low-pass on board off every accelerometer that shows one.

    What is flown moves thrust below the cut-off, where the gain is one, but all of it is late. The
    timing of the motors is that of forces and turns together: with a late force the rotors would
    come early, and J_r would make up for it in yaw.
    """
    late = {k: one.bandwidths["accel"] for k, one in enumerate(dataset.flights) if _is_late(one)}
    return with_force_in_time(dataset, late) if dataset.source == "imu" and late else dataset


def with_force_in_time(dataset: TimedDataset, low_passes: Mapping[int, Bandwidth]) -> TimedDataset:
    """Take the lateness of a low-pass off the accelerometers of some flights, by their number.

    One that was taken off before is replaced by it.
    """
    numbers = count()

    def in_time(flight: LoadedFlight) -> LoadedFlight:
        found = low_passes.get(next(numbers))
        return flight if found is None else _in_time(flight, found)

    return dataclasses.replace(with_flights(dataset, in_time), body=None).reduced()


def _is_late(flight: LoadedFlight) -> bool:
    """Return whether the accelerometer is behind a low-pass with a delay."""
    found = flight.bandwidths.get("accel")
    return found is not None and found.shape in ON_BOARD and not found.taken_off


def _in_time(flight: LoadedFlight, found: Bandwidth) -> LoadedFlight:
    """Take the lateness of the accelerometer's low-pass off a flight."""
    prepared, before = flight.prepared, flight.bandwidths.get("accel")

    def still_late(frequency: Float[np.ndarray, " f"]) -> Complex[np.ndarray, " f"]:
        late = ON_BOARD[found.shape](frequency / found.cutoff)
        if before is None or not before.taken_off:
            return late
        return late / ON_BOARD[before.shape](frequency / before.cutoff)

    data = without_lateness(
        prepared.data,
        still_late,
        jumps=clock_jumps(prepared.data.time, prepared.data.sample_rate),
    )
    return dataclasses.replace(
        flight,
        prepared=dataclasses.replace(prepared, data=data),
        bandwidths={**flight.bandwidths, "accel": dataclasses.replace(found, taken_off=True)},
    )


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
    """Return the highest frequency that counts, of every block and acceleration [Hz].

    Below zero, not even the mean counts: of an axis that is still in one stretch, and not in all.
    """
    flights = np.array([flight_reach(flight) for flight in configured.flights])
    reach = flights[factors.recording]
    still = np.concatenate([still_axes(flight.prepared) for flight in configured.flights])
    begins = (np.diff(factors.segment) != 0) | (np.diff(factors.recording) != 0)
    stretch = np.concatenate([[0], np.cumsum(begins)])
    shown = reach[:, PLACES["accel"]]
    reach[:, PLACES["accel"]] = np.where(or_every(~still)[stretch], shown, -1.0)
    return reach
