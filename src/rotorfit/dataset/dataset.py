"""From the flights of an experiment to factors: read, prepare, reduce."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from rotorfit.dataset.weight_balance import Turning, turning
from rotorfit.errors import ExperimentError, RotorfitError
from rotorfit.estimation.factors import Factors, stack_recordings
from rotorfit.experiment.declared_vehicle import (
    imu_tilt_of,
    motor_model_of,
    read_options_of,
    recording_options_of,
    vehicle_of,
)
from rotorfit.experiment.experiment import (
    ConfigurationEntry,
    Experiment,
    FlightEntry,
    MotorsEntry,
    Source,
)
from rotorfit.experiment.law_table import law_entry_of
from rotorfit.experiment.payload import PointMass
from rotorfit.logs import read_log
from rotorfit.logs.flight_log import Channel, FlightLog
from rotorfit.model.regressor import Regressor
from rotorfit.model.vehicle import Vehicle
from rotorfit.preprocessing.decimate import AsRecorded, as_recorded, decimated
from rotorfit.preprocessing.imu_tilt import ImuTilt, levelled
from rotorfit.preprocessing.mocap.align import with_poses
from rotorfit.preprocessing.mocap.prepare_mocap import prepare_mocap
from rotorfit.preprocessing.motors.command_response import (
    MeasuredResponse,
    command_responses,
    responses_within,
)
from rotorfit.preprocessing.motors.motor_limits import MotorLimits, motor_limits
from rotorfit.preprocessing.motors.motor_model import MotorResponse
from rotorfit.preprocessing.motors.rotor_telemetry import State, Telemetry, telemetry
from rotorfit.preprocessing.prepare import PreparedFlight, on_one_clock, prepared_from
from rotorfit.reduction.frequency_bands import EDGES, banded_data, flight_bands
from rotorfit.reduction.motor_timing import LAG_PRIOR, FreeTiming, MotorTiming, TimedBands
from rotorfit.reduction.reduce import Lines, body_lines, yaw_factors

UNRESPONSIVE: Final[tuple[State, ...]] = ("dead", "swapped", "apart", "stuck")
"""States of a measured speed from which no law can be learnt."""


@dataclass(frozen=True, kw_only=True)
class LoadedFlight:
    """A flight as it enters the estimate; of its log no channels are kept.

    `prepared`: of a fast log with fewer samples; `recorded`: what is said of all of them.
    `motors`: as declared, completed by the log's parameters.
    `speeds_commanded`: its commands are rotor speeds [rad/s], not shares of full output.
    `telemetry`: how measured speeds go with the commands, where the log has both;
    `limits`: how often its commands stand at their ends; `command_responses`: commands and measured
    speeds themselves, in flight.
    `battery`: mean voltage over what is used [V], where it was logged.
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

    @cached_property
    def turning(self) -> Turning:
        """How its axes turn, for what holds the vehicle up: no timing of the motors changes it."""
        return turning(self.prepared.data)


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfigurationData:
    """One configuration with its flights, ready for an estimator."""

    entry: ConfigurationEntry
    flights: list[LoadedFlight]
    payload: tuple[PointMass, ...] = ()

    @property
    def mass(self) -> float:
        """[kg]; 1 where it is unknown, and everything is then per kilogram."""
        return 1.0 if self.entry.mass == "unknown" else self.entry.mass


@dataclass(frozen=True, kw_only=True)
class Dataset:
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
    body
        Lines of the signals that the rotors have no part in, of each flight of each configuration:
        made once (`reduced`), they serve every timing of the motors.
    """

    vehicle: Vehicle
    model: Regressor
    motors: MotorsEntry
    configurations: tuple[ConfigurationData, ...]
    motor_timing: MotorTiming | None = None
    source: Source = "imu"
    body: tuple[tuple[tuple[Lines, ...], ...], ...] | None = None

    @property
    def declared(self) -> MotorResponse:
        """Lag and delay as the user gave them; none where she did not."""
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
        return any(f.speeds_commanded for c in self.configurations for f in c.flights)

    @property
    def lag_prior(self) -> tuple[float, float]:
        """Mean and standard deviation of the lag before the flight [s]."""
        if self.motors.lag is None:
            return LAG_PRIOR
        return self.motors.lag, self.motors.lag_std

    def lag_std(self, lag: float, std: float) -> float:
        """Return the deviation of a lag that flights have found to a deviation so large [s].

        That of before the flight at most. Where a declared lag contradicts it, one of the two is
        wrong by what nobody has allowed for: both by as much as they differ (Birge 1932).
        """
        mean, before = self.lag_prior
        if self.motors.lag is None:
            return min(std, before)
        apart = abs(lag - mean)
        return min(std, max(before, apart)) * max(apart / float(np.hypot(std, before)), 1.0)

    @property
    def timing(self) -> MotorResponse | None:
        """Lag and delay that were found; None leaves the flights as they were prepared."""
        return None if self.motor_timing is None else self.motor_timing.response

    @property
    def timing_identifiable(self) -> bool:
        """Whether lag and delay are given, or the flights tell them."""
        return self.motor_timing is None or self.motor_timing.identifiable

    @property
    def reached(self) -> Mapping[str, float] | None:
        """Where the fit that found the timing ended; None where none did."""
        return None if self.motor_timing is None else self.motor_timing.reached

    @property
    def free_timing(self) -> FreeTiming | None:
        """What a joint fit may move of the timing; None where it is given, or untold."""
        found = self.motor_timing
        if found is None or not found.free:
            return None
        bands = self._timed_already
        at = found.response if bands is None else bands.at
        return FreeTiming(at=at, names=found.free, lag_prior=self.lag_prior)

    @property
    def _timed_already(self) -> TimedBands | None:
        """The bands that the timing was found with, where they are of these flights."""
        bands = None if self.motor_timing is None else self.motor_timing.bands
        return bands if bands is not None and bands.matches(self._made_of) else None

    @property
    def _made_of(self) -> tuple[object, ...]:
        return self.vehicle, self.configurations, self.model.layout

    def at(
        self,
        response: MotorResponse,
        free: tuple[str, ...] = (),
        *,
        additional: tuple[str, ...] = (),
    ) -> "Dataset":
        """Return the same with the motors timed so, and what a fit may move of it.

        With `additional`, what it may move after a call of `freed`.
        """
        timing = MotorTiming(response=response, total_std=0.0, free=free, additional=additional)
        return dataclasses.replace(self, motor_timing=timing)

    def freed(self) -> "Dataset":
        """Return the same where a fit moves the times beside, too; no signals are made anew."""
        found, free = self.motor_timing, self.free_timing
        assert found is not None and free is not None
        bands = TimedBands(at=free.at, inputs=self._made_of, factors=self._every_slope)
        names = (*found.free, *found.additional)
        timing = dataclasses.replace(found, free=names, additional=(), bands=bands)
        return dataclasses.replace(self, motor_timing=timing)

    def reduced(self) -> "Dataset":
        """Return the same with the body's lines made, for bands at many timings."""
        body = tuple(
            tuple(
                body_lines(data, plan=plan, added=self.model.layout.added)
                for data, plan in (banded_data(f.prepared, None) for f in c.flights)
            )
            for c in self.configurations
        )
        return dataclasses.replace(self, body=body)

    def bands(
        self,
        response: MotorResponse | None = None,
        *,
        free: FreeTiming | None = None,
        top: float = np.inf,
    ) -> tuple[Factors, ...]:
        """Return the band factors of each configuration, at another timing of the motors.

        With `free`, their slopes by the times that a fit may move; only of the bands that begin
        under `top` [Hz].
        """
        body = self.body or [None] * len(self.configurations)
        return tuple(
            flight_bands(
                [f.prepared for f in c.flights],
                self.vehicle,
                response,
                added=self.model.layout.added,
                free=free,
                body=own,
                top=top,
            )
            for c, own in zip(self.configurations, body, strict=True)
        )

    @cached_property
    def timed_bands(self) -> tuple[Factors, ...]:
        """The same at the timing that was found, with what a fit may move of it."""
        bands, found = self._timed_already, self.motor_timing
        if bands is not None:
            return bands.factors
        if found is None or not found.additional:
            return self.bands(self.timing, free=self.free_timing)
        return tuple(one.first_slopes(len(found.free)) for one in self._every_slope)

    @cached_property
    def _every_slope(self) -> tuple[Factors, ...]:
        """The same with the slopes by the times beside, too."""
        found, free = self.motor_timing, self.free_timing
        assert found is not None and free is not None
        names = (*found.free, *found.additional)
        return self.bands(free.at, free=dataclasses.replace(free, names=names))

    def found_with(self) -> TimedBands:
        """Return the timed bands for other fits of the same flights."""
        free = self.free_timing
        assert free is not None
        return TimedBands(at=free.at, inputs=self._made_of, factors=self.timed_bands)

    def yaw_bands(self) -> tuple[Factors, ...]:
        """Return the band factors of yaw alone at that timing, every rotor for itself."""
        return tuple(
            stack_recordings(
                [
                    yaw_factors(data, len(self.vehicle.rotors), plan=plan)
                    for data, plan in (banded_data(f.prepared, self.timing) for f in c.flights)
                ]
            )
            for c in self.configurations
        )


def load_flight(entry: FlightEntry, experiment: Experiment) -> LoadedFlight:
    """Read and prepare one flight, its motion from the IMU or from motion capture.

    Parameters
    ----------
    entry
        The flight; it need not be one of the experiment's own.
    experiment
        Whose vehicle, motors and source of motion it has.

    Raises
    ------
    LogError, FlightError, FrameError
        If it cannot be used; the message names the file.
    """
    try:
        return _loaded(entry, experiment)
    except RotorfitError as error:
        name = Path(entry.file).name
        if name in str(error):
            raise
        raise type(error)(f"{name}: {error}") from error


def _loaded(entry: FlightEntry, experiment: Experiment) -> LoadedFlight:
    motors, source = experiment.motors, experiment.identification.source
    vehicle = vehicle_of(experiment.airframe, source)
    log = read_log(Path(entry.file), options=read_options_of(entry, motors))
    log, speeds_commanded = with_commanded_speeds(log, motors)
    motors = motors if speeds_commanded else completed_motors(motors, log)
    motor_model = motor_model_of(motors)
    seen = telemetry(log) if motors.speed == "measured" else None
    responses = () if seen is None else command_responses(log, excluded=_unresponsive_rotors(seen))
    if entry.mocap is not None:
        recording = read_log(Path(entry.mocap.file), options=recording_options_of(entry.mocap))
        log = with_poses(log, recording)
    window, count = (entry.start, entry.end), len(vehicle.rotors)
    battery, command = log.channels.get("battery"), log.channels.get("command")
    if source == "mocap":
        prepared = prepare_mocap(
            log, rotor_count=count, arm=vehicle.arm, motors=motor_model, window=window
        )
        log, recorded = dataclasses.replace(log, channels={}), as_recorded(prepared)
    else:
        on_clock = on_one_clock(log, rotor_count=count, motors=motor_model)
        log = dataclasses.replace(log, channels={})  # a long log as recorded would fill the memory
        prepared = prepared_from(on_clock, arm=vehicle.arm, motors=motor_model, window=window)
        del on_clock
        recorded, tilt = as_recorded(prepared), imu_tilt_of(experiment.airframe)
        if experiment.identification.in_bands:
            prepared = decimated(prepared, motor_model, top=EDGES[-1])
        prepared = prepared if tilt is None else levelled(prepared, tilt)
    return LoadedFlight(
        entry=entry,
        log=log,
        prepared=prepared,
        recorded=recorded,
        speeds_commanded=speeds_commanded,
        telemetry=seen,
        limits=None if command is None else motor_limits(command, recorded.spans),
        command_responses=responses_within(responses, recorded.spans),
        motors=motors,
        battery=_voltage(battery, recorded.spans),
    )


def completed_motors(motors: MotorsEntry, log: FlightLog) -> MotorsEntry:
    """Return the motors as declared, with what only the log's parameters say of them.

    Parameters
    ----------
    motors
        As declared. A law in it stands; measured speeds need none.
    log
        Whose ``motors`` fill what is not declared.
    """
    logged = log.motors
    if motors.speed == "measured" or logged is None or "command" not in log.channels:
        return motors
    law = motors.law or law_entry_of(logged.law)
    return motors.model_copy(update={"law": law, "lag_on": motors.lag_on or logged.lag_on})


def _unresponsive_rotors(seen: Telemetry) -> list[int]:
    """Return the rotors, from 0, whose speed is not what their command makes it."""
    return [r.rotor - 1 for r in seen.rotors if r.state in UNRESPONSIVE]


def _voltage(battery: Channel | None, flown: Sequence[tuple[float, float]]) -> float | None:
    """Return the mean voltage in flight [V]; None where none was logged."""
    if battery is None:
        return None
    inside = np.zeros(len(battery.time), dtype=bool)
    for begin, end in flown:
        inside |= (battery.time >= begin) & (battery.time <= end)
    seen = battery.values[inside & np.isfinite(battery.values[:, 0]), 0]
    return float(seen.mean()) if len(seen) else None


def with_commanded_speeds(log: FlightLog, motors: MotorsEntry) -> tuple[FlightLog, bool]:
    """Return the log with commanded rotor speeds as its commands, and whether it has them.

    Simulators command speeds in rad/s, and so did the paper: the motors follow them with a lag,
    as they follow any command, but no law is needed.

    Parameters
    ----------
    log
        As read.
    motors
        As declared: only of ``speed = "commanded"`` is a rotor speed a command.

    Raises
    ------
    ExperimentError
        If a law from command to speed is given for commands that are speeds.
    """
    if motors.speed != "commanded" or "command" in log.channels:
        return log, False
    if "rotor_speed" not in log.channels:
        return log, False
    if motors.law is not None:
        raise ExperimentError(
            f"the log commands rotor speeds ({log.channels['rotor_speed'].source}), and [motors] "
            "has a law from command to speed: leave law out"
        )
    channels = dict(log.channels)
    channels["command"] = channels.pop("rotor_speed")
    return dataclasses.replace(log, channels=channels), True


def levelled_flights(dataset: Dataset, tilt: ImuTilt) -> Dataset:
    """Return the flights with the IMU's readings turned into the rotors' axes."""
    turned = with_prepared(dataset, lambda prepared: levelled(prepared, tilt))
    return dataclasses.replace(turned, body=None)


def with_prepared(dataset: Dataset, change: Callable[[PreparedFlight], PreparedFlight]) -> Dataset:
    """Return the dataset with every prepared flight changed."""
    configurations = tuple(
        dataclasses.replace(
            c,
            flights=[dataclasses.replace(f, prepared=change(f.prepared)) for f in c.flights],
        )
        for c in dataset.configurations
    )
    return dataclasses.replace(dataset, configurations=configurations)


def velocity_known(flights: list[LoadedFlight]) -> bool:
    """Return whether every used sample of every flight has a velocity, its neighbours too."""
    return all(
        flight.prepared.data.velocity is not None
        and all(
            np.isfinite(flight.prepared.data.velocity[max(s.start - 1, 0) : s.stop + 1]).all()
            for s in flight.prepared.data.segments
        )
        for flight in flights
    )
