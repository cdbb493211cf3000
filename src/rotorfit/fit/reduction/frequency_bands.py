"""Flights in frequency bands: their factors, and the bands in which a pilot moves the vehicle.

The autopilot responds to disturbances: where no pilot moves an axis, rotor speeds and angular
accelerations are related by its gains, not by the vehicle's inertia. Such bands hold nothing of
the vehicle, and bias every estimate.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Final, TypedDict, Unpack

import numpy as np

from rotorfit.estimation.factors import Factors, stack_recordings
from rotorfit.fit.reduction.reduce import BandLines, BandPlan, band_lines, factors_of_lines
from rotorfit.flight.motors.motor_model import MotorResponse, with_motors
from rotorfit.flight.motors.speed_slopes import flights_with_moved_motors
from rotorfit.model.signals import AddedSignals, signal_layout

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from jaxtyping import Bool, Float

    from rotorfit.fit.reduction.motor_timing import FreeTiming
    from rotorfit.fit.reduction.reduce import Lines
    from rotorfit.flight.flight_data import FlightData
    from rotorfit.flight.prepare import PreparedFlight
    from rotorfit.model.vehicle import Vehicle

EDGES: Final = (0.0, 0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0, 5.5, 8.0, 11.0, 15.0, 20.0, 25.0, 30.0)
"""Of the frequency bands [Hz]. A band must not end inside the control bandwidth; above 30 Hz the
resolution of rotor speed takes over."""
STRETCH: Final = 20.0
"""Longest stretch of one noise level [s]. In 5 s a band holds too few different lines: on simulated
flights the deviation of k_d is a third larger; real ones agree on both."""
PILOT_BAND: Final = (0.3, 3.0)
"""Where explained and residual angular acceleration are compared [Hz]: where a pilot moves the
vehicle. Further up the gyro's own noise, differentiated, would hide a well flown axis."""
LEAST_RATIO: Final = 3.0
"""Explained over residual power of an angular acceleration from which a band counts. About its
bandwidth an autopilot's response alone makes as much as one to three."""
OTHER_RATIOS: Final = (0.5 * LEAST_RATIO, 2.0 * LEAST_RATIO)
"""That could as well be required: of ten lines a ratio of powers is off by up to two."""
WIDE: Final = 3.0
"""Width of a block over that of the band about its middle from which it is judged apart."""

_TINY: Final = float(np.finfo(float).tiny)


def slow_bands(factors: Factors) -> Bool[np.ndarray, "b 3"]:
    """Mark blocks of roll, pitch and yaw that are not above the band in which a pilot flies."""
    return np.repeat((factors.band[:, 0] < PILOT_BAND[1])[:, None], 3, axis=1)


def in_pilot_band(factors: Factors) -> Bool[np.ndarray, " b"]:
    """Mark the blocks that reach into the pilot's band."""
    low, high = PILOT_BAND
    return (factors.band[:, 1] > low) & (factors.band[:, 0] < high)


def excited_bands(
    factors: Factors,
    signal: Float[np.ndarray, "b k"],
    residual: Float[np.ndarray, "b k"],
    *,
    least_ratio: float = LEAST_RATIO,
) -> Bool[np.ndarray, "b k"]:
    """Mark blocks in which a pilot moves an axis; a band is judged over all of a flight.

    `signal`, `residual`: sums of squares of angular accelerations and of their errors, per axis.
    """
    flown = np.zeros(signal.shape, dtype=bool)
    for band in _bands_of_flights(factors):
        flown[band] = signal[band].sum(axis=0) > (1.0 + least_ratio) * residual[band].sum(axis=0)
    return flown


def followed_bands(
    factors: Factors, signal: Float[np.ndarray, "b m"], cause: Float[np.ndarray, "b m"]
) -> Bool[np.ndarray, " b"]:
    """Mark blocks in which a signal follows its cause `cause`, at any gain of the band."""
    followed = np.zeros(len(factors), dtype=bool)
    for band in _bands_of_flights(factors):
        power = float((cause[band] ** 2).sum())
        explained = float((cause[band] * signal[band]).sum()) ** 2 / max(power, _TINY)
        followed[band] = explained > LEAST_RATIO * ((signal[band] ** 2).sum() - explained)
    return followed


def counted_bands(factors: Factors, flown: Bool[np.ndarray, "b k"]) -> Bool[np.ndarray, "b k"]:
    """Mark blocks that count: those flown, and all of an axis that is nowhere flown."""
    # The band with the mean counts always: trim does not depend on who steers, and holds the centre
    # of mass.
    return or_every(flown) | (factors.band[:, 0] == 0.0)[:, None]


def or_every(marked: Bool[np.ndarray, "b k"]) -> Bool[np.ndarray, "b k"]:
    """Mark every block of an axis of which none is marked."""
    return marked | ~marked.any(axis=0)


def _bands_of_flights(factors: Factors) -> Iterator[Bool[np.ndarray, " b"]]:
    """Yield the blocks of a flight near the same frequency, wide blocks separately."""
    middle: Float[np.ndarray, " b"] = factors.band.mean(axis=1)
    place = np.digitize(middle, EDGES)
    width = np.diff(EDGES, append=np.inf)[place - 1]
    # The ten lines of a short stretch reach far: about 5 Hz, they hold the pilot's motion at 1 Hz.
    place = np.where(np.ptp(factors.band, axis=1) > WIDE * width, -place, place)
    for number in np.unique(factors.recording):
        own = factors.recording == number
        for one in np.unique(place[own]):
            yield own & (place == one)


STEPS: Final[Mapping[str, float]] = {"motor_delay": 1e-3, "motor_lag": 1e-3, "motor_skew": 0.02}
"""Steps to either side, for the slopes of the signals [s, s, share]."""


def flight_bands(
    flights: Sequence[PreparedFlight],
    vehicle: Vehicle,
    response: MotorResponse | None,
    *,
    added: Sequence[AddedSignals] = (),
    free: FreeTiming | None = None,
    body: Sequence[tuple[Lines, ...]] | None = None,
    top: float = np.inf,
) -> Factors:
    """Reduce all flights of a configuration to band factors, calm and lively phases separately.

    `response`: None leaves each flight as it was prepared; `free`: times by which slopes are made;
    `body`: each flight's lines of the body's signals; `top`: bands begin under this edge [Hz].
    """
    return stack_recordings(
        [
            prepared_bands(flight, vehicle, response, added=added, free=free, body=own, top=top)
            for flight, own in zip(flights, body or [None] * len(flights), strict=True)
        ]
    )


class LineOptions(TypedDict, total=False):
    """Options of `prepared_lines`, as `flight_bands` has them; `body` of the one flight."""

    added: Sequence[AddedSignals]
    free: FreeTiming | None
    body: tuple[Lines, ...] | None
    top: float


def prepared_bands(
    prepared: PreparedFlight,
    vehicle: Vehicle,
    response: MotorResponse | None,
    **options: Unpack[LineOptions],
) -> Factors:
    """Reduce one flight to band factors, see `flight_bands`; with `free`, at its timing."""
    lines = prepared_lines(prepared, vehicle, response, **options)
    return factors_of_lines(lines, signal_layout(vehicle, options.get("added", ())))


def prepared_lines(
    prepared: PreparedFlight,
    vehicle: Vehicle,
    response: MotorResponse | None,
    *,
    added: Sequence[AddedSignals] = (),
    free: FreeTiming | None = None,
    body: tuple[Lines, ...] | None = None,
    top: float = np.inf,
) -> list[BandLines]:
    """Transform one flight to the lines of its bands; as for `prepared_bands`."""
    if free is None:
        timed, moved = retimed(prepared, response), []
    else:
        timed, moved = _retime_both_ways(prepared, free)
    data, plan = _plan_bands(prepared, timed)
    return band_lines(data, vehicle, plan=plan, added=added, moved=moved, body=body, top=top)


def banded_data(
    prepared: PreparedFlight, response: MotorResponse | None
) -> tuple[FlightData, BandPlan]:
    """Retime a flight's motors, and plan how its phases are cut."""
    return _plan_bands(prepared, retimed(prepared, response))


def _plan_bands(prepared: PreparedFlight, timed: FlightData) -> tuple[FlightData, BandPlan]:
    """Cut a retimed flight into its phases, and plan their bands."""
    data = dataclasses.replace(timed, segments=prepared.phases)
    top = min(EDGES[-1], 0.4 * prepared.slowest_rate)
    edges = (*(edge for edge in EDGES if edge < top), top)
    return data, BandPlan(edges=edges, longest=STRETCH)


def _retime_both_ways(
    prepared: PreparedFlight, free: FreeTiming
) -> tuple[FlightData, list[tuple[FlightData, FlightData, float]]]:
    """Retime the flight, and a step later and earlier by each free time, with the step between."""
    steps = {name: STEPS[name] for name in free.names}
    found = flights_with_moved_motors(prepared.data, prepared.motor_channel, free.at, steps)
    if found is not None:
        return found
    moved: list[tuple[FlightData, FlightData, float]] = []
    for name in free.names:
        later, earlier = (free.moved({name: side * STEPS[name]}) for side in (1.0, -1.0))
        # A lag ends at nothing.
        distance = later.mean_lag - earlier.mean_lag if name == "motor_lag" else 2.0 * STEPS[name]
        moved.append((retimed(prepared, later), retimed(prepared, earlier), distance))
    return retimed(prepared, free.at), moved


def retimed(prepared: PreparedFlight, response: MotorResponse | None) -> FlightData:
    """Apply another lag and delay to a flight's motor data; None leaves it."""
    if response is None:
        return prepared.data
    kept = prepared.last_retimed.get(response)
    if kept is None:
        kept = with_motors(prepared.data, prepared.motor_channel, response)
        prepared.last_retimed.clear()
        prepared.last_retimed[response] = kept
    return kept
