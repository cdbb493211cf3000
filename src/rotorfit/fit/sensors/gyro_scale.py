"""Widen intervals by the uncertainty of the gyro's scale, by a velocity of another source.

Inertia goes with the inverse of the gyro's scale. An autopilot's estimate of its velocity is made
with that gyro and no reference; where the log has no other, the scale is an assumption.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.fit.dataset.dataset import with_prepared
from rotorfit.fit.dataset.gyro_by_velocity import GyroScale, gyro_scale
from rotorfit.fit.fit import Fit, shift_of
from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.fit.sensors.known_faults import is_estimate

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.flight.flight_data import FlightData
    from rotorfit.flight.prepare import PreparedFlight

STEP: Final = 0.01
"""Step of a scale, by which the slopes of the numbers are taken."""


def allow_for_gyro_scale(fit: Fit) -> Fit:
    """Append the uncertainty of the gyro's scale, and record the scale."""
    found = None if fit.dataset.source != "imu" else _gyro_scale(fit)
    if found is None:
        return fit
    slopes = np.array([_shift_by_scale(fit, axis) / STEP for axis in range(3)])
    term = IntervalTerm(
        name="gyro scale",
        half_width=found.half_widths(slopes),
        source="the gyro against a velocity that it did not make",
    )
    return fit.with_terms(term).with_record(found)


def _gyro_scale(fit: Fit) -> GyroScale | None:
    """Estimate the scale of the gyro from all flights whose velocity is not made with it."""
    place = fit.dataset.vehicle.imu_position
    flights = [
        flight.prepared.data for flight in fit.dataset.flights if not is_estimate(flight.log.format)
    ]
    return gyro_scale(flights, np.zeros(3) if place is None else np.asarray(place))


def _shift_by_scale(fit: Fit, axis: int) -> Float[np.ndarray, " q"]:
    """Compute the shift of the numbers where the gyro reads `STEP` too much about an axis."""
    factor: Float[np.ndarray, "3"] = np.ones(3)
    factor[axis] -= STEP
    scaled = with_prepared(fit.dataset, lambda prepared: _scale_rates(prepared, factor))
    return shift_of(fit, replace(scaled, body=None).reduced())


def _scale_rates(prepared: PreparedFlight, factor: Float[np.ndarray, "3"]) -> PreparedFlight:
    data: FlightData = prepared.data
    turned = replace(
        data,
        angular_velocity=data.angular_velocity * factor,
        angular_acceleration=data.angular_acceleration * factor,
    )
    return replace(prepared, data=turned)
