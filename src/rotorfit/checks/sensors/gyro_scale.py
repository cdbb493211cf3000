"""Widen intervals by the uncertainty of the gyro's scale, by a velocity of another source.

Inertia goes with the inverse of the gyro's scale. An autopilot's estimate of its velocity is made
with that gyro and no reference; where the log has no other, the scale is an assumption.
"""

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.checks.sensors.sensor_faults import is_estimate
from rotorfit.findings import Evidence, Finding, doubt_or_passed
from rotorfit.fit.dataset.dataset import with_prepared
from rotorfit.fit.dataset.gyro_by_velocity import GyroScale, gyro_scale
from rotorfit.fit.fit import Fit, shift_of
from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.flight.flight_data import FlightData
from rotorfit.flight.prepare import PreparedFlight

KIND: Final = "gyro-scale"
SAID: Final = 0.95
"""Probability of a scale that is off, from which it is said."""
STEP: Final = 0.01
"""Step of a scale, by which the slopes of the numbers are taken."""
AXES: Final = ("roll", "pitch", "yaw")


def allow_for_gyro_scale(fit: Fit) -> Fit:
    """Append the uncertainty of the gyro's scale, and report a wrong scale."""
    found = None if fit.dataset.source != "imu" else _gyro_scale(fit)
    if found is None:
        return fit
    slopes = np.array([_shift_by_scale(fit, axis) / STEP for axis in range(3)])
    term = IntervalTerm(
        name="gyro scale",
        half_width=found.half_widths(slopes),
        source="the gyro against a velocity that it did not make",
    )
    return fit.with_terms(term).found(scale_finding(found))


def _gyro_scale(fit: Fit) -> GyroScale | None:
    """Estimate the scale of the gyro from all flights whose velocity is not made with it."""
    place = fit.dataset.vehicle.imu_position
    flights = [
        flight.prepared.data
        for c in fit.dataset.configurations
        for flight in c.flights
        if not is_estimate(flight.log.format)
    ]
    return gyro_scale(flights, np.zeros(3) if place is None else np.asarray(place))


def _shift_by_scale(fit: Fit, axis: int) -> Float[np.ndarray, " q"]:
    """Compute the shift of the numbers where the gyro reads `STEP` too much about an axis."""
    factor: Float[np.ndarray, 3] = np.ones(3)
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


def scale_finding(found: GyroScale) -> Finding:
    """Name the axes about which the scale is off."""
    off = [k for k in range(3) if found.probability(k) > SAID]
    checked = doubt_or_passed(KIND, _explain_scale(found, off) if off else None)
    measured = [
        Evidence(
            name=f"gyro_scale_{AXES[k]}", value=float(found.value[k]), interval=found.interval(k)
        )
        for k in range(3)
    ]
    return replace(checked, evidence=tuple(measured))


def _explain_scale(found: GyroScale, off: list[int]) -> str:
    """Explain about which axes the gyro reads too much or too little."""
    return (
        f"the gyro reads {', '.join(_axis_error(found, axis) for axis in off)}: turned by it, what "
        "the "
        "accelerometer reads does not add up to the logged velocity; the intervals of inertia, kd "
        "and Jr cover that: calibrate the gyro on a turntable, or check the scale by which its "
        "counts were read"
    )


def _axis_error(found: GyroScale, axis: int) -> str:
    """Return the error about one axis, with its interval."""
    value = float(found.value[axis])
    low, high = sorted(100.0 * abs(edge) for edge in found.interval(axis))
    way = "much" if value > 0.0 else "little"
    return f"{100.0 * abs(value):.1f} % ({low:.1f} to {high:.1f}) too {way} about {AXES[axis]}"
