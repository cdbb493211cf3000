"""The flights of an experiment, by configuration, as they enter a fit."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

from rotorfit.fit.dataset.weight_balance import Turning, turning
from rotorfit.fit.experiment.declared_vehicle import motor_model_of
from rotorfit.fit.experiment.experiment import ConfigurationEntry, MotorsEntry
from rotorfit.fit.reduction.bandwidth import Bandwidth, Sensor
from rotorfit.fit.reduction.motor_timing import LAG_PRIOR
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rotorfit.fit.dataset.wind import Wind
    from rotorfit.fit.experiment.flight_entries import FlightEntry, Source
    from rotorfit.fit.experiment.payload import PointMass
    from rotorfit.flight.decimate import AsRecorded
    from rotorfit.flight.motors.battery_sag import BatterySag
    from rotorfit.flight.motors.command_response import MeasuredResponse, MotorLimits
    from rotorfit.flight.motors.motor_model import MotorResponse
    from rotorfit.flight.motors.rotor_telemetry import Telemetry
    from rotorfit.flight.prepare import PreparedFlight
    from rotorfit.logs.flight_log import FlightLog
    from rotorfit.model.regressor import Regressor
    from rotorfit.model.vehicle import Vehicle


@dataclass(frozen=True, kw_only=True)
class LoadedFlight:
    """A flight as it enters the estimate; of its log no channels are kept.

    `prepared`: of a fast log with fewer samples; `recorded`: what is said of all of them.
    `motors`: as declared, completed by the log's parameters.
    `speeds_commanded`: its commands are rotor speeds [rad/s], not shares of full output.
    `telemetry`: how measured speeds go with the commands, where the log has both;
    `limits`: how often its commands stand at their ends; `command_responses`: commands and measured
    speeds themselves, in flight.
    `battery`: mean voltage over what is used [V], where it was logged; `sag`: how far it falls
    under load, where the flight shows it.
    `wind`: that was taken off its velocity, where it shows one.
    `bandwidths`: of the sensors that the flight shows to be behind a low-pass.
    """

    entry: FlightEntry
    log: FlightLog
    prepared: PreparedFlight
    recorded: AsRecorded
    motors: MotorsEntry = field(default_factory=MotorsEntry)
    speeds_commanded: bool = False
    telemetry: Telemetry | None = None
    limits: MotorLimits | None = None
    command_responses: tuple[MeasuredResponse, ...] = ()
    battery: float | None = None
    sag: BatterySag | None = None
    wind: Wind | None = None
    bandwidths: Mapping[Sensor, Bandwidth] = field(default_factory=dict[Sensor, Bandwidth])

    @cached_property
    def turning(self) -> Turning:
        """How its axes turn, for what holds the vehicle up: no timing of the motors changes it."""
        return turning(self.prepared.data)


@frozen_dataclass
class ConfigurationData:
    """One configuration with its flights, ready for an estimator."""

    entry: ConfigurationEntry
    flights: list[LoadedFlight]
    payload: tuple[PointMass, ...] = ()

    @property
    def mass(self) -> float:
        """[kg]; 1 if it is unknown, and everything is then per kilogram."""
        return 1.0 if self.entry.mass == "unknown" else self.entry.mass


@dataclass(frozen=True, kw_only=True)
class Dataset:
    """All that was flown, and with what.

    - `vehicle`, `model`: the geometry and its tensor.
    - `motors`: as declared.
    - `configurations`: in the order of the experiment.
    - `source`: what measured the motion.
    """

    vehicle: Vehicle
    model: Regressor
    motors: MotorsEntry
    configurations: tuple[ConfigurationData, ...]
    source: Source = "imu"

    @property
    def flights(self) -> list[LoadedFlight]:
        """The flights of all configurations, in their order."""
        return [flight for c in self.configurations for flight in c.flights]

    @property
    def declared(self) -> MotorResponse:
        """Lag and delay as the user declared them; zero if undeclared."""
        return motor_model_of(self.motors).response

    @property
    def unknown_times(self) -> tuple[str, ...]:
        """Which of lag and delay are to be found from the flights."""
        unsure = self.motors.lag is None or self.motors.lag_std > 0
        lag = ("lag",) if self.motors.speed == "commanded" and unsure else ()
        return (*lag, "delay") if self.motors.delay is None else lag

    @property
    def speeds_commanded(self) -> bool:
        """Whether the commands are rotor speeds [rad/s]."""
        return any(f.speeds_commanded for f in self.flights)

    @property
    def lag_prior(self) -> tuple[float, float]:
        """Mean and standard deviation of the lag before the flight [s]."""
        if self.motors.lag is None:
            return LAG_PRIOR
        return self.motors.lag, self.motors.lag_std

    def lag_std(self, lag: float, std: float) -> float:
        """Return the deviation of a lag that flights have found to a deviation so large [s]."""
        mean, before = self.lag_prior
        if self.motors.lag is None:
            return min(std, before)
        difference = abs(lag - mean)
        # Where a declared lag contradicts it, one of the two is wrong by what nobody has allowed
        # for: both by as much as they differ (Birge 1932).
        return min(std, max(before, difference)) * max(difference / math.hypot(std, before), 1.0)


Kind = TypeVar("Kind", bound=Dataset)


def with_flights(dataset: Kind, change: Callable[[LoadedFlight], LoadedFlight]) -> Kind:
    """Return the dataset with every flight changed."""
    configurations = tuple(
        dataclasses.replace(c, flights=[change(flight) for flight in c.flights])
        for c in dataset.configurations
    )
    return dataclasses.replace(dataset, configurations=configurations)


def with_motor_settings(dataset: Kind, **settings: object) -> Kind:
    """Return a dataset whose motors, and those of its flights, have other fields."""
    dataset = dataclasses.replace(dataset, motors=dataset.motors.model_copy(update=settings))
    return with_flights(
        dataset,
        lambda flight: dataclasses.replace(
            flight, motors=flight.motors.model_copy(update=settings)
        ),
    )


def with_prepared(dataset: Kind, change: Callable[[PreparedFlight], PreparedFlight]) -> Kind:
    """Return the dataset with every prepared flight changed."""
    return with_flights(
        dataset, lambda flight: dataclasses.replace(flight, prepared=change(flight.prepared))
    )
