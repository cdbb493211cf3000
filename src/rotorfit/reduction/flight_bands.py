"""The factors of prepared flights in frequency bands, with their slopes by the motors' times."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from rotorfit.estimation.factors import Factors, stack_recordings
from rotorfit.model.vehicle import Vehicle
from rotorfit.preprocessing.flight_data import FlightData, Velocity
from rotorfit.preprocessing.motors.motor_columns import with_motors
from rotorfit.preprocessing.motors.motor_model import MotorResponse
from rotorfit.preprocessing.prepare import PreparedFlight
from rotorfit.reduction.frequency_bands import EDGES, STRETCH
from rotorfit.reduction.motor_timing import FreeTiming
from rotorfit.reduction.reduce import BandPlan, Lines, band_factors

STEPS: Final[Mapping[str, float]] = {"motor_delay": 1e-3, "motor_lag": 1e-3, "motor_skew": 0.02}
"""To either side, for the slopes of the signals [s, s, share]."""


def flight_bands(
    flights: Sequence[PreparedFlight],
    vehicle: Vehicle,
    response: MotorResponse | None,
    *,
    velocity: Velocity = "none",
    free: FreeTiming | None = None,
    body: Sequence[tuple[Lines, ...]] | None = None,
    top: float = np.inf,
) -> Factors:
    """Return the band factors of all flights, calm and lively phases apart.

    Parameters
    ----------
    flights
        Of one configuration.
    vehicle
        Its geometry.
    response
        Lag and delay of the motors; None leaves each flight as it was prepared.
    velocity
        What of the body's velocity is among the signals.
    free
        What a fit may move of the timing, for the signals' slopes by it.
    body
        Lines of the body's signals (`Dataset.reduced`), of each flight.
    top
        Only bands that begin under this edge are made [Hz].
    """
    return stack_recordings(
        [
            prepared_bands(
                flight,
                vehicle,
                response,
                velocity=velocity,
                free=free,
                body=own,
                top=top,
            )
            for flight, own in zip(flights, body or [None] * len(flights), strict=True)
        ]
    )


def prepared_bands(
    prepared: PreparedFlight,
    vehicle: Vehicle,
    response: MotorResponse | None,
    *,
    velocity: Velocity = "none",
    free: FreeTiming | None = None,
    body: tuple[Lines, ...] | None = None,
    top: float = np.inf,
) -> Factors:
    """Return the band factors of one flight, see `flight_bands`."""
    moved = [] if free is None else _moved(prepared, free)
    data, plan = banded_data(prepared, response)
    return band_factors(
        data, vehicle, plan=plan, velocity=velocity, moved=moved, body=body, top=top
    )


def banded_data(
    prepared: PreparedFlight, response: MotorResponse | None
) -> tuple[FlightData, BandPlan]:
    """Return one flight at a timing of its motors, in its phases, and how these are cut."""
    data = dataclasses.replace(retimed(prepared, response), segments=prepared.phases)
    top = min(EDGES[-1], 0.4 * prepared.slowest_rate)
    edges = (*(edge for edge in EDGES if edge < top), top)
    return data, BandPlan(edges=edges, longest=STRETCH)


def _moved(
    prepared: PreparedFlight, free: FreeTiming
) -> list[tuple[FlightData, FlightData, float]]:
    """Return the flight with each free time a step later and earlier, and how far that is apart."""
    moved: list[tuple[FlightData, FlightData, float]] = []
    for name in free.names:
        later, earlier = (free.moved({name: side * STEPS[name]}) for side in (1.0, -1.0))
        # A lag ends at nothing.
        apart = later.mean_lag - earlier.mean_lag if name == "motor_lag" else 2.0 * STEPS[name]
        moved.append((retimed(prepared, later), retimed(prepared, earlier), apart))
    return moved


def retimed(prepared: PreparedFlight, response: MotorResponse | None) -> FlightData:
    """Return a flight with its motor data at another lag and delay; None leaves it."""
    if response is None:
        return prepared.data
    return with_motors(prepared.data, prepared.motor_channel, response)
