"""From the flights of an experiment to factors: read, prepare, reduce, check, find the delay."""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy import optimize

from rotorfit.estimation.factors import Factors, stack_factors
from rotorfit.flight.data import FlightData
from rotorfit.flight.log import FlightLog
from rotorfit.flight.mocap import prepare_mocap
from rotorfit.flight.prepare import MotorModel, PreparedFlight, prepare, with_motors
from rotorfit.identification.experiment import (
    ConfigurationEntry,
    FlightEntry,
    MotorsEntry,
    Source,
    read_options_of,
)
from rotorfit.identification.frame_check import check_frame
from rotorfit.identification.rows import PILOT_BAND, fit_rows
from rotorfit.logs import read_log
from rotorfit.model.reduce import BandPlan, band_factors
from rotorfit.model.regressor import Regressor
from rotorfit.model.vehicle import Vehicle

EDGES = (0.0, 0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0, 5.5, 8.0, 11.0, 15.0, 20.0, 25.0, 30.0)
"""Of the frequency bands [Hz]. A band must not end inside the control bandwidth; above 30 Hz the
resolution of rotor speed takes over."""
STRETCH = 5.0
"""Longest stretch of one noise level [s]."""
DELAYS_TRIED: Mapping[Source, tuple[float, float, int]] = {
    "imu": (-0.012, 0.012, 7),
    "mocap": (-0.01, 0.1, 12),
}
"""The search for the delay of the motion against the motor data: from, to [s], and in how many
trials. Motion capture comes late by cameras, network and, with commands, the motors' own lag."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UsedFlight:
    """A flight as it enters the estimate."""

    entry: FlightEntry
    log: FlightLog
    prepared: PreparedFlight


@dataclass(frozen=True, slots=True, kw_only=True)
class Configured:
    """One configuration with its flights, ready for an estimator."""

    entry: ConfigurationEntry
    flights: list[UsedFlight]

    @property
    def mass(self) -> float:
        """[kg]; 1 where it is unknown, and everything is then per kilogram."""
        return 1.0 if self.entry.mass == "unknown" else self.entry.mass


@dataclass(frozen=True, slots=True, kw_only=True)
class Flown:
    """All that was flown, and with what.

    Attributes
    ----------
    vehicle, model
        The geometry and its tensor.
    motors
        As declared.
    configurations
        In the order of the experiment.
    motor_delay
        Delay of the motion against the motor data with its standard deviation [s], where it was
        found.
    source
        What measured the motion.
    """

    vehicle: Vehicle
    model: Regressor
    motors: MotorsEntry
    configurations: tuple[Configured, ...]
    motor_delay: tuple[float, float] | None = None
    source: Source = "imu"

    @property
    def searches_delay(self) -> bool:
        """Whether the delay of the motor data is to be found from the flights."""
        on_one_clock = self.source == "imu" and self.motors.speed == "commanded"
        return self.motors.delay is None and not on_one_clock

    @property
    def delay(self) -> float | None:
        """The delay that was found [s]; None leaves the flights as they were prepared."""
        return None if self.motor_delay is None else self.motor_delay[0]

    def bands(self, delay: float | None = None) -> tuple[Factors, ...]:
        """Return the band factors of each configuration, motor data moved by `delay`."""
        return tuple(flight_bands(c.flights, self.vehicle, delay) for c in self.configurations)


def load_flight(
    entry: FlightEntry,
    motors: MotorsEntry,
    vehicle: Vehicle,
    motor_model: MotorModel,
    *,
    source: Source = "imu",
) -> UsedFlight:
    """Read and prepare one flight, its motion from the IMU or from motion capture.

    Raises
    ------
    LogError, FlightError, FrameError
        If it cannot be used; the message names the file.
    """
    log = read_log(Path(entry.file), options=read_options_of(entry, motors))
    prepare_flight = prepare_mocap if source == "mocap" else prepare
    prepared = prepare_flight(
        log,
        rotor_count=len(vehicle.rotors),
        arm=vehicle.arm,
        motors=motor_model,
        window=(entry.start, entry.end),
    )
    return UsedFlight(entry=entry, log=log, prepared=prepared)


def flight_bands(flights: list[UsedFlight], vehicle: Vehicle, delay: float | None) -> Factors:
    """Return the band factors of all flights, calm and lively phases apart.

    Parameters
    ----------
    flights
        Of one configuration.
    vehicle
        Its geometry.
    delay
        Time by which the motor data lead [s]; None leaves each flight as it was prepared.
    """
    return stack_factors([_bands(flight.prepared, vehicle, delay) for flight in flights])


def _bands(prepared: PreparedFlight, vehicle: Vehicle, delay: float | None) -> Factors:
    data = dataclasses.replace(retimed(prepared, delay), segments=prepared.phases)
    top = min(EDGES[-1], 0.4 * prepared.slowest_rate)
    edges = (*(edge for edge in EDGES if edge < top), top)
    return band_factors(data, vehicle, plan=BandPlan(edges=edges, longest=STRETCH))


def retimed(prepared: PreparedFlight, delay: float | None) -> FlightData:
    """Return a flight with its motor data moved by `delay` [s]; None leaves it."""
    if delay is None:
        return prepared.data
    return with_motors(prepared.data, prepared.motor_channel, lag=0.0, delay=delay)


def check_flights(flights: list[UsedFlight], vehicle: Vehicle) -> None:
    """Refuse the declared rotors if a flight contradicts them.

    Raises
    ------
    FrameError
        With the declaration that would fit.
    """
    for flight in flights:
        check_frame(_bands(flight.prepared, vehicle, None), vehicle)


def find_delay(flown: Flown) -> tuple[float, float] | None:
    """Return the delay of the motion against the motor data, and its standard deviation [s].

    By profile likelihood of the three angular accelerations. A positive delay: the motion shows
    what the rotors did that much later (the gyro's own filter, late motion capture, early motor
    data). None where the best lies at the edge of the search: the flights do not determine it. The
    autopilot's answer to gusts, later than the gusts, looks like a delay: the deviation holds what
    the best place moves by where only frequencies are used at which the pilot moves the vehicle.
    """
    found = _best_delay(flown, np.inf)
    if found is None:
        return None
    slow = _best_delay(flown, PILOT_BAND[1])
    shift = 0.0 if slow is None else slow[0] - found[0]
    return found[0], float(np.hypot(found[1], shift))


def _best_delay(flown: Flown, top: float) -> tuple[float, float] | None:
    """Return the best delay by the bands that begin below `top` [Hz]."""

    def cost(delay: float) -> float:
        total = 0.0
        for factors, configured in zip(flown.bands(delay), flown.configurations, strict=True):
            below = factors.select(factors.band[:, 0] < top)
            total -= fit_rows(below, flown.model, mass=configured.mass).log_likelihood
        return total

    first, last, trials = DELAYS_TRIED[flown.source]
    return _minimum(cost, np.linspace(first, last, trials))


def _minimum(
    cost: Callable[[float], float], grid: Float[np.ndarray, " t"]
) -> tuple[float, float] | None:
    """Return place and width of the minimum of a smooth function, None if it is at an edge."""
    values = [cost(float(x)) for x in grid]
    best = int(np.argmin(values))
    if best in (0, len(grid) - 1):
        return None
    found = optimize.minimize_scalar(
        cost,
        bounds=(float(grid[best - 1]), float(grid[best + 1])),
        method="bounded",
        options={"xatol": 1e-4},
    )
    place, h = float(found.x), 1e-3
    curvature = (cost(place - h) - 2.0 * float(found.fun) + cost(place + h)) / h**2
    return place, float(1.0 / np.sqrt(max(curvature, 1e-6)))
