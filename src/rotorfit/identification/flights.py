"""From the flights of an experiment to factors: read, prepare, reduce, check."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path

from rotorfit.errors import FrameError
from rotorfit.estimation.factors import Factors, stack_factors
from rotorfit.flight.align import with_poses
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
    recording_options_of,
)
from rotorfit.identification.frame_check import check_frame
from rotorfit.identification.payload import PointMass
from rotorfit.identification.timing import MotorTiming
from rotorfit.logs import read_log
from rotorfit.model.reduce import BandPlan, band_factors
from rotorfit.model.regressor import Regressor
from rotorfit.model.vehicle import Vehicle

EDGES = (0.0, 0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0, 5.5, 8.0, 11.0, 15.0, 20.0, 25.0, 30.0)
"""Of the frequency bands [Hz]. A band must not end inside the control bandwidth; above 30 Hz the
resolution of rotor speed takes over."""
STRETCH = 5.0
"""Longest stretch of one noise level [s]."""

Timing = tuple[float, float]
"""Lag and delay of the motors [s]."""


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
    payload: tuple[PointMass, ...] = ()

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
    motor_timing
        When the rotors do what the motor data say, where it was found.
    source
        What measured the motion.
    """

    vehicle: Vehicle
    model: Regressor
    motors: MotorsEntry
    configurations: tuple[Configured, ...]
    motor_timing: MotorTiming | None = None
    source: Source = "imu"

    @property
    def searches_delay(self) -> bool:
        """Whether the timing of the motor data is to be found from the flights."""
        declared = (
            self.source == "imu"
            and self.motors.speed == "commanded"
            and (self.motors.lag is not None)
        )
        return self.motors.delay is None and not declared

    @property
    def searches_lag(self) -> bool:
        """Whether the motors' lag is to be found too: commands only, and none given."""
        commanded = self.source == "imu" and self.motors.speed == "commanded"
        return commanded and self.motors.lag is None and self.motors.delay is None

    @property
    def timing(self) -> Timing | None:
        """Lag and delay that were found [s]; None leaves the flights as they were prepared."""
        found = self.motor_timing
        return None if found is None else self.timing_of(found.lag, found.delay)

    def timing_of(self, lag: float | None, delay: float) -> Timing:
        """Return lag and delay [s], the lag as declared where it is None."""
        return (self.motors.lag or 0.0 if lag is None else lag), delay

    def bands(self, timing: Timing | None = None) -> tuple[Factors, ...]:
        """Return the band factors of each configuration, at another timing of the motors."""
        return tuple(flight_bands(c.flights, self.vehicle, timing) for c in self.configurations)


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
    if entry.mocap is not None:
        recording = read_log(Path(entry.mocap.file), options=recording_options_of(entry.mocap))
        log = with_poses(log, recording)
    prepare_flight = prepare_mocap if source == "mocap" else prepare
    prepared = prepare_flight(
        log,
        rotor_count=len(vehicle.rotors),
        arm=vehicle.arm,
        motors=motor_model,
        window=(entry.start, entry.end),
    )
    return UsedFlight(entry=entry, log=log, prepared=prepared)


def flight_bands(flights: list[UsedFlight], vehicle: Vehicle, timing: Timing | None) -> Factors:
    """Return the band factors of all flights, calm and lively phases apart.

    Parameters
    ----------
    flights
        Of one configuration.
    vehicle
        Its geometry.
    timing
        Lag and delay of the motors [s]; None leaves each flight as it was prepared.
    """
    return stack_factors([_bands(flight.prepared, vehicle, timing) for flight in flights])


def _bands(prepared: PreparedFlight, vehicle: Vehicle, timing: Timing | None) -> Factors:
    data = dataclasses.replace(retimed(prepared, timing), segments=prepared.phases)
    top = min(EDGES[-1], 0.4 * prepared.slowest_rate)
    edges = (*(edge for edge in EDGES if edge < top), top)
    return band_factors(data, vehicle, plan=BandPlan(edges=edges, longest=STRETCH))


def retimed(prepared: PreparedFlight, timing: Timing | None) -> FlightData:
    """Return a flight with its motor data at another lag and delay [s]; None leaves it."""
    if timing is None:
        return prepared.data
    lag, delay = timing
    return with_motors(prepared.data, prepared.motor_channel, lag=lag, delay=delay)


def check_flights(flights: list[UsedFlight], vehicle: Vehicle) -> None:
    """Refuse the declared rotors if a flight contradicts them.

    Raises
    ------
    FrameError
        With the declaration that would fit.
    """
    for flight in flights:
        try:
            check_frame(_bands(flight.prepared, vehicle, None), vehicle)
        except FrameError as error:
            raise FrameError(f"{Path(flight.entry.file).name}: {error}") from error
